//! Pictures made from what they say: QR codes, number signs, pedestrian lights.

use crate::colour::Colour;
use crate::error::WorldError;
use crate::reader::Table;
use crate::texture::Cells;
use crate::writer::Document;
use qrcode::{EcLevel, QrCode};
use senda_geom::{Vec2, trig};
use std::f64::consts::TAU;

/// White modules around a code: what the standard asks for (ISO/IEC 18004).
const QUIET_ZONE: usize = 4;
const PAPER: Colour = Colour::new(244, 244, 240);
const PRINT: Colour = Colour::new(16, 16, 18);
/// The signs' light blue and the digit on it ("en color celeste", document D; the shade is a guess).
pub(crate) const SIGN: Colour = Colour::new(112, 190, 236);
pub(crate) const DIGIT: Colour = Colour::new(18, 26, 58);
const HOUSING: Colour = Colour::new(88, 90, 94);

/// When a pedestrian light is green: for `green_s`, then red for `red_s`, and so on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightProgram {
    /// How long it is green (s); 0: never.
    pub green_s: f64,
    /// How long it is red (s); 0: never.
    pub red_s: f64,
    /// Where in its cycle it is at time 0 (s after it turned green).
    pub offset_s: f64,
}

impl LightProgram {
    /// Whether it is green at a time (s).
    pub fn is_green(&self, time_s: f64) -> bool {
        let cycle_s = self.green_s + self.red_s;
        if self.green_s <= 0.0 || cycle_s <= 0.0 {
            return false;
        }
        (time_s + self.offset_s).rem_euclid(cycle_s) < self.green_s
    }

    pub(crate) fn read(table: &mut Table) -> Result<Self, WorldError> {
        Ok(Self {
            green_s: table.required_f64("green_s", 0.0, 1e5)?,
            red_s: table.required_f64("red_s", 0.0, 1e5)?,
            offset_s: table.f64("offset_s", 0.0, 1e6, 0.0)?,
        })
    }

    pub(crate) fn write(&self, document: &mut Document) {
        document.number("green_s", self.green_s);
        document.number("red_s", self.red_s);
        document.number("offset_s", self.offset_s);
    }
}

/// A QR code with its quiet zone; `None` for what [`crate::Texture::qr`] refuses.
pub(crate) fn qr(text: &str) -> Option<Cells> {
    let printable = text.bytes().all(|byte| (0x20..0x7f).contains(&byte));
    if text.is_empty() || text.len() > 64 || !printable {
        return None;
    }
    let code = QrCode::with_error_correction_level(text, EcLevel::M).ok()?;
    let (inner, modules) = (code.width(), code.to_colors());
    let width = inner + 2 * QUIET_ZONE;
    let mut cells = vec![PAPER; width * width];
    for (index, module) in modules.into_iter().enumerate() {
        let (column, row) = (index % inner + QUIET_ZONE, index / inner + QUIET_ZONE);
        cells[row * width + column] = module.select(PRINT, PAPER);
    }
    Some(Cells {
        width,
        height: width,
        cells,
    })
}

/// Cells along a sign's side: a millimetre on a sign of 8 cm.
const SIGN_CELLS: usize = 80;
/// Half the width of a digit's strokes, as part of the board.
pub(crate) const STROKE: f64 = 0.055;

/// A number sign.
pub(crate) fn sign(number: u8) -> Cells {
    let strokes = strokes(number);
    picture(SIGN_CELLS, SIGN_CELLS, |at| {
        // The digit fills the middle of the board: half its width, 0.7 of its height.
        let place = Vec2::new((at.x - 0.25) / 0.5, (at.y - 0.15) / 0.7);
        let scale = Vec2::new(0.5, 0.7);
        let away = strokes
            .iter()
            .flat_map(|stroke| stroke.windows(2))
            .map(|pair| distance(place * scale, pair[0] * scale, pair[1] * scale))
            .fold(f64::INFINITY, f64::min);
        mix(SIGN, DIGIT, (STROKE - away) * SIGN_CELLS as f64 + 0.5)
    })
}

/// A pedestrian light of 1 x 2.4: red lamp above, green below.
pub(crate) fn light(green: bool) -> Cells {
    picture(30, 72, |at| {
        let at = Vec2::new(at.x, at.y * 2.4);
        let lamp = |middle_y: f64, colour: Colour, lit: bool| {
            let away = (at - Vec2::new(0.5, middle_y)).length();
            let inside = (0.37 - away) * 30.0 + 0.5;
            // A lit lamp is paler in its middle; a dark one shows some of its colour.
            let [r, g, b] = colour.rgb.map(f64::from);
            let part = if lit { 1.0 } else { 0.22 };
            let pale = if lit {
                90.0 * (1.0 - away / 0.37).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let shown = [r, g, b].map(|c| (c * part + pale).min(255.0) as u8);
            (Colour { rgb: shown }, inside)
        };
        let (red_colour, in_red) = lamp(0.65, Colour::new(255, 46, 36), !green);
        let (green_colour, in_green) = lamp(1.75, Colour::new(40, 240, 110), green);
        mix(mix(HOUSING, red_colour, in_red), green_colour, in_green)
    })
}

/// A picture from a function of the place, x right and y down, 0..1.
fn picture(width: usize, height: usize, colour_at: impl Fn(Vec2) -> Colour) -> Cells {
    let cells = (0..width * height)
        .map(|index| {
            let (column, row) = (index % width, index / width);
            colour_at(Vec2::new(
                (column as f64 + 0.5) / width as f64,
                (row as f64 + 0.5) / height as f64,
            ))
        })
        .collect();
    Cells { width, height, cells }
}

fn mix(under: Colour, over: Colour, part: f64) -> Colour {
    let part = part.clamp(0.0, 1.0);
    let channel = |c: usize| {
        let (a, b) = (f64::from(under.rgb[c]), f64::from(over.rgb[c]));
        (a + (b - a) * part).round() as u8
    };
    Colour::new(channel(0), channel(1), channel(2))
}

/// Distance of a point from a segment.
fn distance(at: Vec2, a: Vec2, b: Vec2) -> f64 {
    let edge = b - a;
    let part = ((at - a).dot(edge) / edge.length_squared().max(1e-12)).clamp(0.0, 1.0);
    (at - a - edge * part).length()
}

/// A digit as joined points in its own box, x right and y down, 0..1.
pub(crate) fn strokes(number: u8) -> Vec<Vec<Vec2>> {
    let line = |points: &[(f64, f64)]| points.iter().map(|&(x, y)| Vec2::new(x, y)).collect::<Vec<_>>();
    let ring = |x: f64, y: f64, half_width: f64, half_height: f64| {
        (0..=24)
            .map(|i| {
                let (sin, cos) = trig::sincos(TAU * f64::from(i) / 24.0);
                Vec2::new(x + half_width * cos, y + half_height * sin)
            })
            .collect::<Vec<_>>()
    };
    let six = [
        (0.78, 0.06),
        (0.5, 0.1),
        (0.24, 0.3),
        (0.12, 0.6),
        (0.2, 0.88),
        (0.5, 1.0),
        (0.8, 0.88),
        (0.9, 0.68),
        (0.78, 0.5),
        (0.5, 0.42),
        (0.24, 0.5),
        (0.13, 0.66),
    ];
    match number {
        0 => vec![ring(0.5, 0.5, 0.42, 0.5)],
        1 => vec![line(&[(0.2, 0.24), (0.58, 0.0), (0.58, 1.0)])],
        2 => vec![line(&[
            (0.1, 0.26),
            (0.22, 0.06),
            (0.5, 0.0),
            (0.8, 0.08),
            (0.88, 0.28),
            (0.74, 0.52),
            (0.1, 1.0),
            (0.94, 1.0),
        ])],
        3 => vec![line(&[
            (0.12, 0.1),
            (0.5, 0.0),
            (0.82, 0.1),
            (0.86, 0.3),
            (0.7, 0.44),
            (0.42, 0.48),
            (0.74, 0.54),
            (0.92, 0.7),
            (0.84, 0.9),
            (0.5, 1.0),
            (0.08, 0.9),
        ])],
        4 => vec![line(&[(0.68, 1.0), (0.68, 0.0), (0.04, 0.68), (0.98, 0.68)])],
        5 => vec![line(&[
            (0.86, 0.0),
            (0.22, 0.0),
            (0.16, 0.46),
            (0.5, 0.38),
            (0.8, 0.46),
            (0.92, 0.68),
            (0.8, 0.9),
            (0.48, 1.0),
            (0.08, 0.9),
        ])],
        6 => vec![line(&six)],
        7 => vec![line(&[(0.06, 0.0), (0.92, 0.0), (0.38, 1.0)])],
        8 => vec![ring(0.5, 0.25, 0.33, 0.25), ring(0.5, 0.74, 0.42, 0.26)],
        _ => vec![line(&six.map(|(x, y)| (1.0 - x, 1.0 - y)))],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_is_green_for_its_time_and_then_red() {
        let program = LightProgram {
            green_s: 4.0,
            red_s: 6.0,
            offset_s: 3.0,
        };
        assert!(program.is_green(0.0) && program.is_green(0.99));
        assert!(!program.is_green(1.0) && !program.is_green(6.9) && program.is_green(7.1));
        assert!(
            !LightProgram {
                green_s: 0.0,
                ..program
            }
            .is_green(5.0)
        );
        assert!(
            LightProgram {
                red_s: 0.0,
                ..program
            }
            .is_green(5.0)
        );
    }

    #[test]
    fn codes_have_their_quiet_zone_and_refuse_what_cannot_be_printed() {
        let cells = qr("I2").unwrap();
        assert_eq!((cells.width, cells.height), (29, 29));
        assert!(cells.cells[..4 * 29].iter().all(|cell| *cell == PAPER));
        assert_eq!(cells.cells[4 * 29 + 4], PRINT);
        assert!(qr("").is_none() && qr("Depósito").is_none() && qr(&"x".repeat(65)).is_none());
    }

    /// Ten digits that a template can tell apart: any two differ in at least 6 % of their cells.
    #[test]
    fn no_two_signs_look_alike() {
        let signs: Vec<Cells> = (0..10).map(sign).collect();
        for (i, a) in signs.iter().enumerate() {
            for b in &signs[..i] {
                let differ = a.cells.iter().zip(&b.cells).filter(|(a, b)| a != b).count();
                assert!(differ > SIGN_CELLS * SIGN_CELLS / 16, "{i}: {differ}");
            }
        }
    }

    #[test]
    fn the_lit_lamp_is_above_for_red_and_below_for_green() {
        let brightness = |cells: &Cells, row: usize| cells.cells[row * 30 + 15].luminance();
        let (red, green) = (light(false), light(true));
        assert!(brightness(&red, 19) > brightness(&red, 52) + 50.0);
        assert!(brightness(&green, 52) > brightness(&green, 19) + 50.0);
    }
}
