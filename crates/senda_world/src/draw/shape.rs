//! A flat picture in millimetres, written as SVG or as the contents of a PDF page.

use crate::colour::Colour;
use senda_geom::Vec2;
use std::fmt::Write;

/// One thing on a sheet. Places are millimetres, x right, y **up** (paper as one reads it, origin at the lower left).
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Shape {
    /// A line through points.
    Line {
        points: Vec<Vec2>,
        closed: bool,
        width_mm: f64,
        colour: Colour,
        /// Lengths of dash and gap.
        dash_mm: Option<(f64, f64)>,
        round: bool,
    },
    /// A filled polygon.
    Area { points: Vec<Vec2>, colour: Colour },
    /// A filled disc.
    Disc {
        centre: Vec2,
        radius_mm: f64,
        colour: Colour,
        opacity: f64,
    },
    /// Letters, as high as `size_mm`; x is their left edge, middle or right edge.
    Text {
        at: Vec2,
        size_mm: f64,
        anchor: Anchor,
        bold: bool,
        colour: Colour,
        text: String,
    },
    /// Everything inside shows only within the rectangle (lower left, upper right).
    Clipped {
        low: Vec2,
        high: Vec2,
        shapes: Vec<Shape>,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Left,
    Middle,
    Right,
}

impl Shape {
    pub(super) fn line(points: Vec<Vec2>, width_mm: f64, colour: Colour) -> Self {
        Self::Line {
            points,
            closed: false,
            width_mm,
            colour,
            dash_mm: None,
            round: false,
        }
    }

    pub(super) fn text(at: Vec2, size_mm: f64, colour: Colour, text: impl Into<String>) -> Self {
        Self::Text {
            at,
            size_mm,
            anchor: Anchor::Left,
            bold: false,
            colour,
            text: text.into(),
        }
    }

    /// The same text, aligned otherwise.
    pub(super) fn anchored(mut self, to: Anchor) -> Self {
        if let Self::Text { anchor, .. } = &mut self {
            *anchor = to;
        }
        self
    }

    /// The same text in bold letters.
    pub(super) fn bold(mut self) -> Self {
        if let Self::Text { bold, .. } = &mut self {
            *bold = true;
        }
        self
    }
}

/// A number with at most three decimals: a thousandth of a millimetre.
pub(super) fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".to_owned()
    } else {
        text.to_owned()
    }
}

/// A sheet of `width_mm` x `height_mm` as an SVG document of that true size.
pub(super) fn to_svg(shapes: &[Shape], width_mm: f64, height_mm: f64, title: &str) -> String {
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}mm\" height=\"{h}mm\" viewBox=\"0 0 {w} {h}\" \
         font-family=\"Helvetica, Arial, sans-serif\">\n<title>{}</title>\n",
        escaped(title),
        w = short(width_mm),
        h = short(height_mm),
    );
    let mut clips = 0;
    svg_shapes(&mut out, shapes, height_mm, &mut clips);
    out.push_str("</svg>\n");
    out
}

fn svg_shapes(out: &mut String, shapes: &[Shape], height_mm: f64, clips: &mut usize) {
    // Writing to a String cannot fail.
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
                let _ = write!(
                    out,
                    "<path d=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{}\"",
                    svg_path(points, *closed, height_mm),
                    short(*width_mm)
                );
                if let Some((dash, gap)) = dash_mm {
                    let _ = write!(out, " stroke-dasharray=\"{} {}\"", short(*dash), short(*gap));
                }
                let cap = if *round { "round" } else { "butt" };
                let _ = writeln!(out, " stroke-linecap=\"{cap}\" stroke-linejoin=\"round\"/>");
            }
            Shape::Area { points, colour } => {
                let _ = writeln!(
                    out,
                    "<path d=\"{}\" fill=\"{colour}\"/>",
                    svg_path(points, true, height_mm)
                );
            }
            Shape::Disc {
                centre,
                radius_mm,
                colour,
                opacity,
            } => {
                let _ = writeln!(
                    out,
                    "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" fill=\"{colour}\" fill-opacity=\"{}\"/>",
                    short(centre.x),
                    short(height_mm - centre.y),
                    short(*radius_mm),
                    short(*opacity)
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
                let anchor = match anchor {
                    Anchor::Left => "start",
                    Anchor::Middle => "middle",
                    Anchor::Right => "end",
                };
                let weight = if *bold { " font-weight=\"bold\"" } else { "" };
                let _ = writeln!(
                    out,
                    "<text x=\"{}\" y=\"{}\" font-size=\"{}\" text-anchor=\"{anchor}\" fill=\"{colour}\"{weight}>{}</text>",
                    short(at.x),
                    short(height_mm - at.y),
                    short(*size_mm),
                    escaped(text)
                );
            }
            Shape::Clipped { low, high, shapes } => {
                *clips += 1;
                let _ = writeln!(
                    out,
                    "<clipPath id=\"clip{clips}\"><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath>\n\
                     <g clip-path=\"url(#clip{clips})\">",
                    short(low.x),
                    short(height_mm - high.y),
                    short(high.x - low.x),
                    short(high.y - low.y),
                );
                svg_shapes(out, shapes, height_mm, clips);
                out.push_str("</g>\n");
            }
        }
    }
}

fn svg_path(points: &[Vec2], closed: bool, height_mm: f64) -> String {
    let mut path = String::new();
    for (i, point) in points.iter().enumerate() {
        let letter = if i == 0 { 'M' } else { 'L' };
        let _ = write!(path, "{letter}{} {}", short(point.x), short(height_mm - point.y));
    }
    if closed {
        path.push('Z');
    }
    path
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
