//! The sheet as a PDF of one page: a small own writer, for the few operators that a sheet needs.

use super::Sheet;
use super::draw::{Mark, marks};
use super::svg::mm;
use std::fmt::Write;

/// Points a millimetre (ISO 32000: 72 points an inch).
const POINTS_PER_MM: f64 = 72.0 / 25.4;

/// The sheet as a PDF file of the page's true size (ISO 32000-1, version 1.4).
pub fn pdf(sheet: &Sheet) -> Vec<u8> {
    let content = content(sheet);
    let (width, height) = (sheet.page_width_m * 1e3, sheet.page_length_m * 1e3);
    let objects = [
        // Asks viewers not to shrink the page when they print it.
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {} {}] /Contents 4 0 R \
             /Resources << /Font << /F1 5 0 R >> >> >>",
            mm(width * POINTS_PER_MM),
            mm(height * POINTS_PER_MM)
        ),
        format!("<< /Length {} >>\nstream\n{content}endstream", content.len()),
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>".to_owned(),
    ];
    let mut out = "%PDF-1.4\n".to_owned();
    let mut offsets = Vec::new();
    for (index, object) in objects.iter().enumerate() {
        offsets.push(out.len());
        let _ = write!(out, "{} 0 obj\n{object}\nendobj\n", index + 1);
    }
    let table = out.len();
    let _ = write!(out, "xref\n0 {}\n0000000000 65535 f \n", objects.len() + 1);
    for offset in offsets {
        let _ = writeln!(out, "{offset:010} 00000 n ");
    }
    let _ = write!(
        out,
        "trailer\n<< /Size {} /Root 1 0 R >>\nstartxref\n{table}\n%%EOF\n",
        objects.len() + 1
    );
    out.into_bytes()
}

/// The page's drawing operators. The first one makes a unit a millimetre; y runs up in PDF.
fn content(sheet: &Sheet) -> String {
    let height = sheet.page_length_m * 1e3;
    let mut out = format!("{POINTS_PER_MM:.8} 0 0 {POINTS_PER_MM:.8} 0 0 cm\n");
    for mark in marks(sheet) {
        let _ = match mark {
            Mark::Box {
                bounds: [x, y, w, h],
                ink,
            } => {
                writeln!(
                    out,
                    "{} g {} {} {} {} re f",
                    1.0 - ink,
                    mm(x),
                    mm(height - y - h),
                    mm(w),
                    mm(h)
                )
            }
            Mark::Line { from, to, width } => writeln!(
                out,
                "{width} w {} {} m {} {} l S",
                mm(from[0]),
                mm(height - from[1]),
                mm(to[0]),
                mm(height - to[1])
            ),
            Mark::Text { at, size, words } => {
                let words = words
                    .replace('\\', "\\\\")
                    .replace('(', "\\(")
                    .replace(')', "\\)");
                writeln!(
                    out,
                    "BT /F1 {size} Tf {} {} Td ({words}) Tj ET",
                    mm(at[0]),
                    mm(height - at[1])
                )
            }
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cross_references_point_at_the_objects() {
        let bytes = pdf(&Sheet::default());
        let text = String::from_utf8(bytes).unwrap();
        let start: usize = text
            .rsplit("startxref\n")
            .next()
            .unwrap()
            .lines()
            .next()
            .unwrap()
            .parse()
            .unwrap();
        assert!(text[start..].starts_with("xref\n0 6\n"));
        for (index, entry) in text[start..].lines().skip(3).take(5).enumerate() {
            let offset: usize = entry[..10].parse().unwrap();
            assert!(text[offset..].starts_with(&format!("{} 0 obj", index + 1)));
        }
        let length: usize = text
            .split("/Length ")
            .nth(1)
            .unwrap()
            .split(' ')
            .next()
            .unwrap()
            .parse()
            .unwrap();
        let stream = text.split("stream\n").nth(1).unwrap();
        assert!(stream[length..].starts_with("endstream") || stream.len() == length + 3);
    }

    #[test]
    fn page_and_squares_have_their_true_size() {
        let text = String::from_utf8(pdf(&Sheet::default())).unwrap();
        // A4 is 595.2756 x 841.8898 points.
        assert!(text.contains("/MediaBox [0 0 595.2756 841.8898]"), "{text}");
        // The far square's far edge is 17 mm below the top of the page: 297 - 17 - 50 = 230 mm above its foot.
        assert!(text.contains("0 g 80 230 50 50 re f"));
        assert!(text.contains("(Print at 100 %, not fitted to the page;) Tj"));
    }
}
