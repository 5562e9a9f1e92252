//! Writing TOML so that reading it gives back the same numbers, bit for bit.

use senda_geom::{Pose2, Vec2};
use std::fmt::Write;

/// A float that parses back to the same bits (shortest such decimal).
pub(crate) fn float(value: f64) -> String {
    format!("{value:?}")
}

/// Text in quotes with everything escaped that TOML asks for.
pub(crate) fn quoted(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 2);
    out.push('"');
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            c if c.is_control() => {
                // Writing to a String cannot fail.
                let _ = write!(out, "\\u{:04X}", c as u32);
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// `{ x_m = …, y_m = …, heading_rad = … }`.
pub(crate) fn pose(pose: Pose2) -> String {
    format!(
        "{{ x_m = {}, y_m = {}, heading_rad = {} }}",
        float(pose.x_m),
        float(pose.y_m),
        float(pose.heading_rad)
    )
}

/// `[[x, y], …]`, one pair a line.
pub(crate) fn pairs(points: &[Vec2]) -> String {
    let mut out = String::from("[\n");
    for point in points {
        let _ = writeln!(out, "  [{}, {}],", float(point.x), float(point.y));
    }
    out.push(']');
    out
}

/// A document under construction.
#[derive(Debug, Default)]
pub(crate) struct Document {
    text: String,
}

impl Document {
    pub(crate) fn line(&mut self, key: &str, value: impl std::fmt::Display) {
        let _ = writeln!(self.text, "{key} = {value}");
    }

    pub(crate) fn number(&mut self, key: &str, value: f64) {
        self.line(key, float(value));
    }

    pub(crate) fn text(&mut self, key: &str, value: &str) {
        self.line(key, quoted(value));
    }

    pub(crate) fn header(&mut self, name: &str) {
        let _ = writeln!(self.text, "\n[{name}]");
    }

    pub(crate) fn item(&mut self, name: &str) {
        let _ = writeln!(self.text, "\n[[{name}]]");
    }

    pub(crate) fn finish(self) -> String {
        self.text
    }
}
