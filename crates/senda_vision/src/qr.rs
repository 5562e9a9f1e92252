//! QR codes in frames (D1 in SPEC).
//!
//! `rqrr` finds codes and corrects errors. It places its grid by the three finder patterns alone, which on small boards seen
//! aslant is off by more than half a module; so [`QrReader`] moves the grid's corners until the patterns that every code of
//! version 1 has (finders, timing) fit best, and samples the frame there. It is only asked where rows of pixels look like a
//! finder pattern. The work per frame is bounded by counts, not by a
//! clock: the same frame takes the same way on every machine.

use crate::finder_patterns::{FinderPatterns, Region};
use rqrr::{BitGrid, Grid, PreparedImage};
use senda_core::{Channels, Image};
use senda_geom::Vec2;

/// A code and where it is.
#[derive(Debug, Clone, PartialEq)]
pub struct QrCode {
    /// What it says.
    pub text: String,
    /// Its corners (px of the frame): top left, top right, bottom right, bottom left of the code itself.
    pub corners_px: [[f32; 2]; 4],
}

impl QrCode {
    /// Length of its longest side (px): nearer boards are larger.
    pub fn size_px(&self) -> f32 {
        (0..4)
            .map(|i| {
                let (a, b) = (self.corners_px[i], self.corners_px[(i + 1) % 4]);
                let (x, y) = (a[0] - b[0], a[1] - b[1]);
                (x * x + y * y).sqrt()
            })
            .fold(0.0, f32::max)
    }
}

/// Bounds of the work on one frame.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QrLimits {
    /// Wider frames are shrunk by a whole factor until they are at most this wide (px).
    pub width_px: usize,
    /// Only this part of the frame's height is searched, from the top: boards stand, they do not lie.
    pub part: f64,
    /// At most this many candidates are decoded.
    pub candidates: usize,
    /// Search everywhere, not only around rows that look like a finder pattern: several times as dear.
    pub everywhere: bool,
}

impl Default for QrLimits {
    fn default() -> Self {
        Self {
            width_px: 640,
            part: 0.62,
            candidates: 4,
            everywhere: false,
        }
    }
}

/// Reads QR codes.
#[derive(Debug, Clone, Default)]
pub struct QrReader {
    limits: QrLimits,
    grey: Vec<u8>,
    width: usize,
    height: usize,
    patterns: FinderPatterns,
    codes: Vec<QrCode>,
}

/// Modules of a version 1 code.
const MODULES: usize = 21;

impl QrReader {
    /// With other bounds.
    pub fn new(limits: QrLimits) -> Self {
        Self {
            limits,
            ..Self::default()
        }
    }

    /// The codes in a frame, the largest first. What cannot be decoded is left out.
    pub fn read(&mut self, frame: &Image) -> &[QrCode] {
        self.codes.clear();
        let factor = frame.width().div_ceil(self.limits.width_px.max(64)).max(1);
        self.width = frame.width() / factor;
        self.height = ((frame.height() / factor) as f64 * self.limits.part.clamp(0.1, 1.0)) as usize;
        // A finder pattern needs 7 px and its surroundings.
        if self.width < 32 || self.height < 32 {
            return &self.codes;
        }
        self.take_grey(frame, factor);
        let regions = if self.limits.everywhere {
            vec![[0, 0, self.width, self.height]]
        } else {
            self.patterns.find(&self.grey, self.width, self.height).to_vec()
        };
        let mut left = self.limits.candidates;
        for region in regions {
            left -= self.read_region(region, left, factor as f64);
        }
        self.codes.sort_by(|a, b| b.size_px().total_cmp(&a.size_px()));
        &self.codes
    }

    /// Reads up to `limit` candidates in a part of the frame; returns how many there were.
    fn read_region(&mut self, [left, top, right, bottom]: Region, limit: usize, scale: f64) -> usize {
        if limit == 0 || right < left + 21 || bottom < top + 21 {
            return 0;
        }
        let (width, grey) = (self.width, &self.grey);
        let mut prepared = PreparedImage::prepare_from_greyscale(right - left, bottom - top, |x, y| {
            grey[(top + y) * width + left + x]
        });
        let grids = prepared.detect_grids();
        for grid in grids.iter().take(limit) {
            let corners = grid
                .bounds
                .map(|point| Vec2::new(f64::from(point.x) + left as f64, f64::from(point.y) + top as f64));
            let (text, corners) = if grid.grid.size() == MODULES {
                let fitted = self.fit(corners);
                match self.sample(&fitted) {
                    Some(text) => (Some(text), fitted),
                    None => (grid.decode().ok().map(|(_, text)| text), corners),
                }
            } else {
                (grid.decode().ok().map(|(_, text)| text), corners)
            };
            if let Some(text) = text {
                self.codes.push(QrCode {
                    text,
                    corners_px: corners.map(|corner| [(corner.x * scale) as f32, (corner.y * scale) as f32]),
                });
            }
        }
        grids.len().min(limit)
    }

    fn take_grey(&mut self, frame: &Image, factor: usize) {
        self.grey.clear();
        self.grey.resize(self.width * self.height, 0);
        let channels = frame.channels().count();
        let weights: [u32; 3] = if frame.channels() == Channels::Rgb {
            [77, 150, 29]
        } else {
            [256, 0, 0]
        };
        let share = (factor * factor) as u32;
        if factor == 1 && channels == 3 {
            for (v, grey) in self.grey.chunks_exact_mut(self.width).enumerate() {
                for (grey, [red, green, blue]) in grey.iter_mut().zip(frame.row(v).as_chunks::<3>().0) {
                    let sum = u32::from(*red) * weights[0]
                        + u32::from(*green) * weights[1]
                        + u32::from(*blue) * weights[2];
                    *grey = (sum / 256) as u8;
                }
            }
            return;
        }
        for v in 0..self.height {
            for u in 0..self.width {
                let mut sum = 0;
                for dv in 0..factor {
                    let row = frame.row(v * factor + dv);
                    for du in 0..factor {
                        let at = (u * factor + du) * channels;
                        sum += row[at..at + channels]
                            .iter()
                            .zip(weights)
                            .map(|(value, weight)| u32::from(*value) * weight)
                            .sum::<u32>();
                    }
                }
                self.grey[v * self.width + u] = (sum / (256 * share)) as u8;
            }
        }
    }

    /// Grey at a place (px, bilinear); the edge's beyond it.
    fn grey_at(&self, at: Vec2) -> f64 {
        let x = (at.x - 0.5).clamp(0.0, (self.width - 2) as f64);
        let y = (at.y - 0.5).clamp(0.0, (self.height - 2) as f64);
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        let index = row * self.width + column;
        let value = |index: usize| f64::from(self.grey[index]);
        let upper = value(index) * (1.0 - fx) + value(index + 1) * fx;
        let lower = value(index + self.width) * (1.0 - fx) + value(index + self.width + 1) * fx;
        upper * (1.0 - fy) + lower * fy
    }

    /// Mean grey of the known light modules minus that of the known dark ones, and the value in the middle.
    fn contrast(&self, corners: &[Vec2; 4]) -> (f64, f64) {
        let Some(square) = Square::new(corners) else {
            return (f64::NEG_INFINITY, 0.0);
        };
        let (mut light, mut dark) = ((0.0, 0.0), (0.0, 0.0));
        for (column, row, is_dark) in known_modules() {
            let value = self.grey_at(square.at(column as f64 + 0.5, row as f64 + 0.5));
            let side = if is_dark { &mut dark } else { &mut light };
            *side = (side.0 + value, side.1 + 1.0);
        }
        let (light, dark) = (light.0 / light.1, dark.0 / dark.1);
        (light - dark, 0.5 * (light + dark))
    }

    /// Moves the corners until the known patterns fit best: each coordinate by halving steps.
    fn fit(&self, mut corners: [Vec2; 4]) -> [Vec2; 4] {
        let side_px = (corners[1] - corners[0]).length().max(8.0);
        let mut best = self.contrast(&corners).0;
        // A module and a half at first: so far off is the fourth corner of a code seen aslant.
        let mut step_px = 1.5 * side_px / MODULES as f64;
        for _ in 0..5 {
            // Twice over all coordinates at each step.
            for index in (0..16).map(|i| i % 8) {
                for sign in [1.0, -1.0] {
                    let mut moved = corners;
                    let way = if index % 2 == 0 { Vec2::X } else { Vec2::Y };
                    moved[index / 2] += way * (sign * step_px);
                    let contrast = self.contrast(&moved).0;
                    if contrast > best {
                        (best, corners) = (contrast, moved);
                        break;
                    }
                }
            }
            step_px *= 0.5;
        }
        corners
    }

    fn sample(&self, corners: &[Vec2; 4]) -> Option<String> {
        let square = Square::new(corners)?;
        let (contrast, middle) = self.contrast(corners);
        if contrast < 12.0 {
            return None;
        }
        let mut modules = [[false; MODULES]; MODULES];
        for (row, modules) in modules.iter_mut().enumerate() {
            for (column, module) in modules.iter_mut().enumerate() {
                *module = self.grey_at(square.at(column as f64 + 0.5, row as f64 + 0.5)) < middle;
            }
        }
        let (_, text) = Grid::new(Modules(modules)).decode().ok()?;
        Some(text)
    }
}

/// Sampled modules.
struct Modules([[bool; MODULES]; MODULES]);

impl BitGrid for Modules {
    fn size(&self) -> usize {
        MODULES
    }

    fn bit(&self, y: usize, x: usize) -> bool {
        self.0[y][x]
    }
}

/// Modules whose colour every version 1 code shares, as column, row, dark: three finders with their white border, and timing.
fn known_modules() -> impl Iterator<Item = (usize, usize, bool)> {
    let finder = |column: usize, row: usize| {
        // Rings around the finder's middle at (3, 3): dark up to 1, light at 2, dark at 3, light at 4.
        let ring = column.abs_diff(3).max(row.abs_diff(3));
        ring != 2 && ring != 4
    };
    let finders = (0..3 * 64).map(move |i| {
        let (column, row, which) = (i % 8, i / 8 % 8, i / 64);
        let far = MODULES - 1;
        let dark = finder(column, row);
        match which {
            0 => (column, row, dark),
            1 => (far - column, row, dark),
            _ => (column, far - row, dark),
        }
    });
    let timing = (8..13).flat_map(|i| [(i, 6, i % 2 == 0), (6, i, i % 2 == 0)]);
    finders.chain(timing)
}

/// The perspective of a square of [`MODULES`] (Heckbert 1989): module coordinates to pixels.
struct Square {
    origin: Vec2,
    along: Vec2,
    down: Vec2,
    fall: Vec2,
}

impl Square {
    fn new(corners: &[Vec2; 4]) -> Option<Self> {
        let [a, b, c, d] = *corners;
        let (e, f, g) = (b - c, d - c, a - b + c - d);
        let determinant = e.perp_dot(f);
        if determinant.abs() < 1e-6 {
            return None;
        }
        let fall = Vec2::new(g.perp_dot(f) / determinant, e.perp_dot(g) / determinant);
        Some(Self {
            origin: a,
            along: b - a + b * fall.x,
            down: d - a + d * fall.y,
            fall,
        })
    }

    fn at(&self, column: f64, row: f64) -> Vec2 {
        let (u, v) = (column / MODULES as f64, row / MODULES as f64);
        let w = 1.0 + self.fall.x * u + self.fall.y * v;
        (self.origin + self.along * u + self.down * v) / w
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use senda_world::Texture;

    /// Codes upright on grey, 5 px a module, from the given columns; `damage` paints over that part of each from the left.
    fn picture(codes: &[(&str, usize)], damage: f64) -> Image {
        let mut image = Image::new(480, 320, Channels::Gray);
        image.pixels_mut().fill(120);
        for (text, from) in codes {
            let texture = Texture::qr(text).unwrap();
            for v in 0..145 {
                for u in 0..145 {
                    let (right, down) = (u as f64 + 0.5, v as f64 + 0.5);
                    let value = texture.colour_at(right, down, 145.0, 145.0).rgb[0];
                    let inside =
                        (40.0..40.0 + 65.0 * damage).contains(&right) && (60.0..125.0).contains(&down);
                    image.row_mut(v + 20)[from + u] = if inside { 200 } else { value };
                }
            }
        }
        image
    }

    #[test]
    fn two_codes_in_view_are_both_read_the_largest_first() {
        let codes = QrReader::default()
            .read(&picture(&[("I2", 20), ("P", 260)], 0.0))
            .to_vec();
        let mut texts: Vec<&str> = codes.iter().map(|code| code.text.as_str()).collect();
        texts.sort_unstable();
        assert_eq!(texts, ["I2", "P"]);
        assert!(
            codes.iter().all(|code| (code.size_px() - 105.0).abs() < 6.0),
            "{codes:?}"
        );
    }

    #[test]
    fn damage_is_corrected_or_the_code_is_left_out_never_misread() {
        for damage in [0.0, 0.1, 0.2, 0.4, 0.7, 1.0] {
            let codes = QrReader::default()
                .read(&picture(&[("F1", 100)], damage))
                .to_vec();
            assert!(codes.iter().all(|code| code.text == "F1"), "{damage}: {codes:?}");
            assert!(damage > 0.0 || !codes.is_empty(), "{damage}");
            assert!(damage < 0.9 || codes.is_empty(), "{damage}");
        }
    }

    #[test]
    fn other_contents_are_read_as_they_are() {
        for text in ["Z9", "https://example.org/a", "I", "F-3"] {
            let codes = QrReader::default().read(&picture(&[(text, 100)], 0.0)).to_vec();
            assert_eq!(codes.first().map(|code| code.text.as_str()), Some(text));
        }
    }

    #[test]
    fn a_square_maps_its_corners() {
        let corners = [
            Vec2::new(10.0, 20.0),
            Vec2::new(90.0, 25.0),
            Vec2::new(95.0, 110.0),
            Vec2::new(5.0, 100.0),
        ];
        let square = Square::new(&corners).unwrap();
        for (corner, (column, row)) in
            corners
                .iter()
                .zip([(0.0, 0.0), (21.0, 0.0), (21.0, 21.0), (0.0, 21.0)])
        {
            assert!((square.at(column, row) - *corner).length() < 1e-9);
        }
        assert!(Square::new(&[Vec2::ZERO; 4]).is_none());
    }
}
