//! Numbers and words for people: human units, typographic signs, harmless text.

use senda_geom::trig;

/// A number with `digits` after the point, a true minus sign, and no negative zero. `–` if it is not finite.
pub fn fixed(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    let plain = format!("{:.digits$}", value.abs());
    let is_zero = plain.chars().all(|c| c == '0' || c == '.');
    if value < 0.0 && !is_zero {
        format!("\u{2212}{plain}")
    } else {
        plain
    }
}

/// A number with about three significant digits: `0.0123`, `4.56`, `789`, `12345`.
pub fn short(value: f64) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let magnitude = trig::log10(value.abs()).floor() as i32;
    let text = fixed(value, (2 - magnitude).clamp(0, 9) as usize);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// A length in the unit that people use for it: mm, cm or m.
pub fn length(metres: f64) -> String {
    let size = metres.abs();
    if size < 0.01 {
        format!("{} mm", fixed(1e3 * metres, 1))
    } else if size < 1.0 {
        format!("{} cm", fixed(1e2 * metres, 2))
    } else {
        format!("{} m", fixed(metres, 2))
    }
}

/// A given length without needless digits: `15 cm`, `1.5 m`.
pub fn length_short(metres: f64) -> String {
    if metres.abs() < 1.0 {
        format!("{} cm", short(100.0 * metres))
    } else {
        format!("{} m", short(metres))
    }
}

/// A length in people's unit and in metres: `1.23 cm (0.0123 m)`.
pub fn length_both(metres: f64) -> String {
    if metres.abs() < 1.0 {
        format!("{} ({} m)", length(metres), fixed(metres, 4))
    } else {
        length(metres)
    }
}

/// An angle in degrees.
pub fn angle(radians: f64) -> String {
    format!("{}°", fixed(radians.to_degrees(), 1))
}

/// An angle in degrees and in radians: `2.3° (0.040 rad)`.
pub fn angle_both(radians: f64) -> String {
    format!("{} ({} rad)", angle(radians), fixed(radians, 4))
}

/// A speed in cm/s below 1 m/s, else in m/s.
pub fn speed(mps: f64) -> String {
    if mps.abs() < 1.0 {
        format!("{} cm/s", fixed(1e2 * mps, 1))
    } else {
        format!("{} m/s", fixed(mps, 2))
    }
}

/// A part of one in per cent: `99.2 %`.
pub fn percent(part: f64) -> String {
    format!("{} %", fixed(100.0 * part, 1))
}

/// Text for a terminal: control characters (escape sequences among them) become `?`.
pub fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}

/// Text for HTML and SVG, inside elements and inside quoted attributes. Characters that XML forbids become U+FFFD.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\t' | '\n' | '\r' => out.push(c),
            c if c.is_control() || ('\u{fffe}'..='\u{ffff}').contains(&c) => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// JSON for a `<script>` element: nothing in it can end the element or open a comment.
pub fn script_json(value: &serde_json::Value) -> String {
    value
        .to_string()
        .replace('<', "\\u003c")
        .replace('>', "\\u003e")
        .replace('&', "\\u0026")
        .replace('\u{2028}', "\\u2028")
        .replace('\u{2029}', "\\u2029")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(fixed(-0.001, 2), "0.00");
        assert_eq!(fixed(-1.5, 1), "−1.5");
        assert_eq!(fixed(f64::NAN, 1), "–");
        assert_eq!(short(0.012_345), "0.0123");
        assert_eq!(short(12_345.0), "12345");
        assert_eq!(short(2.0), "2");
        assert_eq!(short(-0.5), "−0.5");
        assert_eq!(length(0.0123), "1.23 cm");
        assert_eq!(length(0.0049), "4.9 mm");
        assert_eq!(length_both(0.0123), "1.23 cm (0.0123 m)");
        assert_eq!(angle_both(0.04), "2.3° (0.0400 rad)");
    }

    #[test]
    fn foreign_text_cannot_act() {
        assert_eq!(escape("<a b='c'>&\""), "&lt;a b=&#39;c&#39;&gt;&amp;&quot;");
        assert_eq!(printable("a\u{1b}[2Jb"), "a?[2Jb");
        let json = script_json(&serde_json::json!({"n": "</script><!-- &amp;"}));
        assert!(!json.contains('<') && !json.contains('&'), "{json}");
        assert_eq!(
            serde_json::from_str::<serde_json::Value>(&json).unwrap()["n"],
            "</script><!-- &amp;"
        );
    }
}
