//! The sheet as SVG, one user unit a millimetre.

use super::Sheet;
use super::draw::{Mark, marks};
use std::fmt::Write;

/// The sheet as an SVG file of the page's true size.
pub fn svg(sheet: &Sheet) -> String {
    let (width, height) = (mm(sheet.page_width_m * 1e3), mm(sheet.page_length_m * 1e3));
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" \
         viewBox=\"0 0 {width} {height}\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for mark in marks(sheet) {
        // Writing to a String cannot fail.
        let _ = match mark {
            Mark::Box {
                bounds: [x, y, w, h],
                ink,
            } => {
                let level = ((1.0 - ink) * 255.0).round();
                let (x, y, w, h) = (mm(x), mm(y), mm(w), mm(h));
                writeln!(
                    out,
                    "<rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" fill=\"rgb({level},{level},{level})\"/>"
                )
            }
            Mark::Line { from, to, width } => writeln!(
                out,
                "<line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"black\" stroke-width=\"{width}\"/>",
                mm(from[0]),
                mm(from[1]),
                mm(to[0]),
                mm(to[1])
            ),
            Mark::Text { at, size, words } => writeln!(
                out,
                "<text x=\"{}\" y=\"{}\" font-family=\"Helvetica, Arial, sans-serif\" font-size=\"{size}\">{words}</text>",
                mm(at[0]),
                mm(at[1])
            ),
        };
    }
    out.push_str("</svg>\n");
    out
}

/// A length in mm without the tail of digits that binary fractions have.
pub(super) fn mm(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_drawn_at_true_scale() {
        let drawn = svg(&Sheet::default());
        assert!(drawn.starts_with("<svg") && drawn.ends_with("</svg>\n"));
        assert!(drawn.contains("width=\"210mm\" height=\"297mm\" viewBox=\"0 0 210 297\""));
        // The page ends 282 mm ahead of the axle: the squares' far edges (265 and 190 mm) are 17 and 92 mm below its top.
        for top in [17, 92] {
            let square =
                format!("<rect x=\"80\" y=\"{top}\" width=\"50\" height=\"50\" fill=\"rgb(0,0,0)\"/>");
            assert!(drawn.contains(&square), "{drawn}");
        }
        assert_eq!(drawn.matches("<line").count(), 1 + 5 + 12);
    }
}
