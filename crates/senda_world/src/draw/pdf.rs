//! A PDF of plain vector pages (ISO 32000-1): lines, areas, letters of the standard fonts. Nothing else is needed to
//! print a floor, so no library is.

use super::shape::{Anchor, Shape, short};
use crate::colour::Colour;
use senda_geom::Vec2;
use std::fmt::Write;

/// PostScript points in a millimetre.
const POINTS_PER_MM: f64 = 72.0 / 25.4;

/// One page.
pub(super) struct Page {
    pub(super) width_mm: f64,
    pub(super) height_mm: f64,
    pub(super) shapes: Vec<Shape>,
}

/// Pages as a PDF file. The same pages give the same bytes: no date, no random identifier.
pub(super) fn write(pages: &[Page], title: &str) -> Vec<u8> {
    // Objects: 1 catalogue, 2 page tree, 3 and 4 fonts, 5 information, then two for each page.
    let mut objects: Vec<String> = Vec::new();
    let kids: Vec<String> = (0..pages.len()).map(|i| format!("{} 0 R", 6 + 2 * i)).collect();
    // Printing must not scale: the viewer is asked not to (PrintScaling, ISO 32000-1, 12.2).
    objects.push("<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>".to_owned());
    objects.push(format!(
        "<< /Type /Pages /Count {} /Kids [{}] >>",
        pages.len(),
        kids.join(" ")
    ));
    for font in ["Helvetica", "Helvetica-Bold"] {
        objects.push(format!(
            "<< /Type /Font /Subtype /Type1 /BaseFont /{font} /Encoding /WinAnsiEncoding >>"
        ));
    }
    objects.push(format!("<< /Title ({}) /Producer (senda) >>", letters(title)));
    for (i, page) in pages.iter().enumerate() {
        let mut content = String::new();
        // From here on one unit is one millimetre.
        let _ = writeln!(content, "{0} 0 0 {0} 0 0 cm 1 j", scale());
        write_shapes(&mut content, &page.shapes);
        objects.push(format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {} {}] /Contents {} 0 R \
             /Resources << /Font << /F1 3 0 R /F2 4 0 R >> >> >>",
            short(page.width_mm * POINTS_PER_MM),
            short(page.height_mm * POINTS_PER_MM),
            7 + 2 * i
        ));
        objects.push(format!(
            "<< /Length {} >>\nstream\n{content}endstream",
            content.len()
        ));
    }
    let mut file = String::from("%PDF-1.5\n%\u{7f}senda\n");
    let mut offsets = Vec::with_capacity(objects.len());
    for (i, object) in objects.iter().enumerate() {
        offsets.push(file.len());
        let _ = write!(file, "{} 0 obj\n{object}\nendobj\n", i + 1);
    }
    let table = file.len();
    let _ = write!(file, "xref\n0 {}\n0000000000 65535 f \n", objects.len() + 1);
    for offset in offsets {
        let _ = writeln!(file, "{offset:010} 00000 n ");
    }
    let _ = write!(
        file,
        "trailer\n<< /Size {} /Root 1 0 R /Info 5 0 R >>\nstartxref\n{table}\n%%EOF\n",
        objects.len() + 1
    );
    file.into_bytes()
}

/// Points a millimetre with the digits that keep a metre true to a thousandth of a millimetre.
fn scale() -> String {
    format!("{POINTS_PER_MM:.8}")
}

fn write_shapes(out: &mut String, shapes: &[Shape]) {
    for shape in shapes {
        match shape {
            Shape::Line {
                points,
                closed,
                width_mm,
                colour,
                dash_mm,
                round,
            } => {
                let dash = dash_mm.map_or(String::from("[] 0 d"), |(dash, gap)| {
                    format!("[{} {}] 0 d", short(dash), short(gap))
                });
                let _ = writeln!(
                    out,
                    "{} RG {} w {} J {dash}",
                    channels(*colour),
                    short(*width_mm),
                    u8::from(*round)
                );
                path(out, points);
                out.push_str(if *closed { "s\n" } else { "S\n" });
            }
            Shape::Area { points, colour } => {
                let _ = writeln!(out, "{} rg", channels(*colour));
                path(out, points);
                out.push_str("f\n");
            }
            Shape::Disc {
                centre,
                radius_mm,
                colour,
                ..
            } => {
                // A point drawn with a round pen is a disc.
                let _ = writeln!(
                    out,
                    "{} RG {} w 1 J [] 0 d {x} {y} m {x} {y} l S",
                    channels(*colour),
                    short(radius_mm * 2.0),
                    x = short(centre.x),
                    y = short(centre.y)
                );
            }
            Shape::Text {
                at,
                size_mm,
                anchor,
                bold,
                colour,
                text,
            } => {
                let shift = match anchor {
                    Anchor::Left => 0.0,
                    Anchor::Middle => -0.5 * width_of(text) * size_mm,
                    Anchor::Right => -width_of(text) * size_mm,
                };
                let _ = writeln!(
                    out,
                    "{} rg BT /{} {} Tf {} {} Td ({}) Tj ET",
                    channels(*colour),
                    if *bold { "F2" } else { "F1" },
                    short(*size_mm),
                    short(at.x + shift),
                    short(at.y),
                    letters(text)
                );
            }
            Shape::Clipped { low, high, shapes } => {
                let _ = writeln!(
                    out,
                    "q {} {} {} {} re W n",
                    short(low.x),
                    short(low.y),
                    short(high.x - low.x),
                    short(high.y - low.y)
                );
                write_shapes(out, shapes);
                out.push_str("Q\n");
            }
        }
    }
}

fn path(out: &mut String, points: &[Vec2]) {
    for (i, point) in points.iter().enumerate() {
        let operator = if i == 0 { "m" } else { "l" };
        let _ = write!(out, "{} {} {operator} ", short(point.x), short(point.y));
    }
}

fn channels(colour: Colour) -> String {
    colour.rgb.map(|value| short(f64::from(value) / 255.0)).join(" ")
}

/// A text as a PDF string: WinAnsi, other characters as question marks.
fn letters(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '(' | ')' | '\\' => {
                out.push('\\');
                out.push(c);
            }
            ' '..='~' => out.push(c),
            '\u{a0}'..='\u{ff}' => {
                let _ = write!(out, "\\{:03o}", c as u32);
            }
            _ => out.push('?'),
        }
    }
    out
}

/// Width of a text in Helvetica, in its size: close enough to align labels.
fn width_of(text: &str) -> f64 {
    text.chars()
        .map(|c| match c {
            'i' | 'j' | 'l' | '.' | ',' | ':' | '|' | '\'' | '!' => 0.25,
            ' ' | 't' | 'f' | 'r' | '(' | ')' | '-' | '/' => 0.31,
            'm' | 'M' | 'W' | 'w' => 0.83,
            'A'..='Z' => 0.68,
            _ => 0.55,
        })
        .sum()
}
