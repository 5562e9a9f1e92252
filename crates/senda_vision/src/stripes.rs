//! Painted stripes by their two sharp flanks, along rows and along columns.
//!
//! [`crate::LineExtractor`] asks which areas stand out as a line does; this asks where two sharp edges face each other
//! a line's width apart. A lamp's image on a shiny floor is as bright as paint, but its flanks are soft; and a line that lies
//! across the picture, as in tight curves before a wide camera, is found along the columns. What it gives are single points
//! with a weight, for whoever fits something to all of them at once.
//!
//! ```
//! use senda_core::{Channels, Image};
//! use senda_geom::{Camera, Lens, Mounting};
//! use senda_vision::{Contrast, FloorMap, StripeFinder};
//! let camera = Camera {
//!     name: "center".into(),
//!     width_px: 160,
//!     height_px: 120,
//!     lens: Lens::equidistant(160, 120, 2.0),
//!     mounting: Mounting { x_m: 0.1, y_m: 0.0, z_m: 0.15, yaw_rad: 0.0, tilt_rad: 0.3, roll_rad: 0.0 },
//! };
//! let map = FloorMap::from_camera(&camera, 160, 120);
//! let mut finder = StripeFinder::new(&map, 0.05);
//! // An even floor has no stripes.
//! assert!(finder.find(&Image::new(160, 120, Channels::Gray), &map, Contrast::Light).is_empty());
//! ```

use crate::blur::GaussianBlur;
use crate::luminance::luminance;
use crate::{Contrast, FloorMap};
use senda_core::edges::{Gradients, sobel};
use senda_core::{Channels, Image};
use senda_geom::Vec2;

/// A point of a stripe's middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stripe {
    /// In the picture (px).
    pub pixel: Vec2,
    /// On the floor (vehicle frame, m).
    pub floor: Vec2,
    /// How sharp the softer of its flanks is: 0 as soft as noise, 1 as sharp as paint.
    pub sharpness: f64,
    /// How much floor lies between this point and the next one of an unbroken stripe (m).
    pub step_m: f64,
}

/// Finds stripes in frames of one size; owns its memory.
#[derive(Debug, Clone)]
pub struct StripeFinder {
    width: usize,
    height: usize,
    /// Expected length of a stripe's section along a row, for each row (px); 0 beyond the horizon.
    along_row_px: Vec<f64>,
    /// The same along a column, where the stripe lies across.
    along_column_px: Vec<f64>,
    blur: GaussianBlur,
    grey: Vec<u8>,
    blurred: Vec<u8>,
    gradients: Gradients,
    stripes: Vec<Stripe>,
}

/// Lengths in pixels refer to pictures of this width.
const REFERENCE_WIDTH_PX: f64 = 160.0;
/// Blur before the gradient (px).
const BLUR_PX: f64 = 0.8;
/// Softer flanks than this are noise (grey levels a px). Measured on real frames of a shiny floor, as the next one.
const SOFTEST: f64 = 4.0;
/// Flanks sharper than this are paint (grey levels a px).
const SHARP: f64 = 12.0;
/// Sobel's kernels give this for a slope of one grey level a px.
const SOBEL: f64 = 8.0;
/// A section may be this many times as long as expected: along a row because lines lean, and a little along a column.
const LONGEST: [f64; 2] = [2.5, 1.8];
/// And this part shorter, less a pixel.
const SHORTEST: f64 = 0.5;
/// Where a stripe is expected narrower than this (px) it is not looked for.
const NARROWEST_PX: f64 = 0.8;
/// Every so many columns are looked along: on the floor they stand closer than rows do.
const COLUMN_STEP: usize = 2;

#[derive(Clone, Copy, PartialEq)]
enum Along {
    Row,
    Column,
}

impl StripeFinder {
    /// For frames of the map's size and stripes `line_width_m` wide.
    pub fn new(map: &FloorMap, line_width_m: f64) -> Self {
        let (width, height) = (map.width(), map.height());
        let middle = 0.5 * width as f64;
        let sections = |step: Vec2| {
            (0..height)
                .map(|row| {
                    let pixel = Vec2::new(middle, row as f64 + 0.5);
                    match (map.floor(pixel - step * 0.5), map.floor(pixel + step * 0.5)) {
                        (Some(a), Some(b)) => line_width_m / (a - b).length().max(1e-9),
                        _ => 0.0,
                    }
                })
                .collect()
        };
        Self {
            width,
            height,
            along_row_px: sections(Vec2::new(1.0, 0.0)),
            along_column_px: sections(Vec2::new(0.0, 1.0)),
            blur: GaussianBlur::new(BLUR_PX * width as f64 / REFERENCE_WIDTH_PX),
            grey: vec![0; width * height],
            blurred: vec![0; width * height],
            gradients: Gradients::default(),
            stripes: Vec::new(),
        }
    }

    /// Whether it is for frames of a map's size.
    pub fn is_for(&self, map: &FloorMap) -> bool {
        (map.width(), map.height()) == (self.width, self.height)
    }

    /// The stripes of a frame; none when it has another size than the finder's.
    pub fn find(&mut self, image: &Image, map: &FloorMap, contrast: Contrast) -> &[Stripe] {
        self.stripes.clear();
        if (image.width(), image.height()) != (self.width, self.height) || image.is_empty() {
            return &[];
        }
        match image.channels() {
            Channels::Gray => self.grey.copy_from_slice(image.pixels()),
            Channels::Rgb => luminance(image.pixels(), &mut self.grey),
        }
        self.blur.blur(&self.grey, self.width, &mut self.blurred);
        sobel(&self.blurred, self.width, &mut self.gradients);
        for row in 0..self.height {
            self.scan(row, Along::Row, map, contrast);
        }
        for column in (0..self.width).step_by(COLUMN_STEP) {
            self.scan(column, Along::Column, map, contrast);
        }
        &self.stripes
    }

    /// One row or column: every flank that rises, with the steepest falling one behind it.
    fn scan(&mut self, line: usize, along: Along, map: &FloorMap, contrast: Contrast) {
        let (length, values) = match along {
            Along::Row => (self.width, &self.gradients.du),
            Along::Column => (self.height, &self.gradients.dv),
        };
        let index = |at: usize| match along {
            Along::Row => line * self.width + at,
            Along::Column => at * self.width + line,
        };
        let sign = match contrast {
            Contrast::Light => 1.0,
            Contrast::Dark => -1.0,
        };
        // Per pixel of the reference width, so that thresholds hold for every size.
        let scale = sign * self.width as f64 / (REFERENCE_WIDTH_PX * SOBEL);
        let slope = |at: usize| scale * f64::from(values[index(at)]);
        if along == Along::Row && self.along_row_px[line] < NARROWEST_PX {
            return;
        }
        let (mut before, mut own) = (0.0, slope(0));
        for start in 0..length.saturating_sub(1) {
            let after = slope(start + 1);
            let is_flank = own > SOFTEST && own >= before && own > after;
            (before, own) = (own, after);
            if !is_flank {
                continue;
            }
            let (expected, longest) = match along {
                Along::Row => (self.along_row_px[line], LONGEST[0]),
                Along::Column => (self.along_column_px[start], LONGEST[1]),
            };
            if expected < NARROWEST_PX {
                continue;
            }
            let last = (start + (longest * expected).ceil() as usize + 2).min(length - 1);
            let mut end = start + 1;
            for at in start + 2..=last {
                if slope(at) < slope(end) {
                    end = at;
                }
            }
            let section_px = (end - start) as f64;
            if slope(end) > -SOFTEST || end + 1 == length || section_px < SHORTEST * expected - 1.0 {
                continue;
            }
            let middle = 0.5 * (start + end) as f64 + 0.5;
            let (pixel, next) = match along {
                Along::Row => (Vec2::new(middle, line as f64 + 0.5), Vec2::new(0.0, -1.0)),
                Along::Column => (
                    Vec2::new(line as f64 + 0.5, middle),
                    Vec2::new(COLUMN_STEP as f64, 0.0),
                ),
            };
            let (Some(floor), Some(beside)) = (map.floor(pixel), map.floor(pixel + next)) else {
                continue;
            };
            let steepness = |at: usize| {
                let at = index(at);
                let (u, v) = (f64::from(self.gradients.du[at]), f64::from(self.gradients.dv[at]));
                scale.abs() * (u * u + v * v).sqrt()
            };
            let softer = steepness(start).min(steepness(end));
            self.stripes.push(Stripe {
                pixel,
                floor,
                sharpness: ((softer - SOFTEST) / (SHARP - SOFTEST)).clamp(0.0, 1.0),
                step_m: (beside - floor).length(),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_geom::{Camera, Lens, Mounting};

    fn map(width: u32, height: u32) -> FloorMap {
        let camera = Camera {
            name: "center".into(),
            width_px: 160,
            height_px: 120,
            lens: Lens::equidistant(160, 120, 2.0),
            mounting: Mounting {
                x_m: 0.1,
                y_m: 0.0,
                z_m: 0.15,
                yaw_rad: 0.0,
                tilt_rad: 0.3,
                roll_rad: 0.0,
            },
        };
        FloorMap::from_camera(&camera, width as usize, height as usize)
    }

    /// A picture whose floor is as bright as a function of the floor point says.
    fn picture(map: &FloorMap, brightness: impl Fn(Vec2) -> f64) -> Image {
        let (width, height) = (map.width(), map.height());
        let pixels = (0..width * height)
            .map(|i| {
                let pixel = Vec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
                map.floor(pixel).map_or(60.0, &brightness).clamp(0.0, 255.0) as u8
            })
            .collect();
        Image::from_pixels(width, height, Channels::Gray, pixels).unwrap()
    }

    /// A stripe 5 cm wide along a line through a point.
    fn stripe(point: Vec2, direction: Vec2) -> impl Fn(Vec2) -> f64 {
        move |floor| {
            if (floor - point).perp_dot(direction).abs() < 0.025 {
                180.0
            } else {
                60.0
            }
        }
    }

    #[test]
    fn lines_along_and_across_are_found_where_they_are_at_any_size() {
        for (width, height) in [(160, 120), (320, 240)] {
            let map = map(width, height);
            for (point, direction) in [
                (Vec2::new(0.0, -0.1), Vec2::X),
                (Vec2::new(0.5, 0.0), Vec2::Y), // straight across: only columns see it
                (Vec2::new(0.3, 0.2), Vec2::new(0.8, 0.6)),
            ] {
                let image = picture(&map, stripe(point, direction));
                let mut finder = StripeFinder::new(&map, 0.05);
                let found = finder.find(&image, &map, Contrast::Light);
                let near: Vec<_> = found
                    .iter()
                    .filter(|stripe| stripe.floor.length() < 0.8)
                    .collect();
                assert!(near.len() > 25, "{direction}: {}", near.len());
                // Where the picture's side cuts the line a flank may face the wrong one.
                let right = |stripe: &&&Stripe| {
                    (stripe.floor - point).perp_dot(direction).abs() < 0.015 && stripe.sharpness > 0.5
                };
                let count = near.iter().filter(right).count();
                assert!(
                    10 * count > 9 * near.len(),
                    "{direction}: {count} of {}",
                    near.len()
                );
            }
        }
    }

    #[test]
    fn soft_flanks_are_no_paint_and_dark_lines_no_light_ones() {
        let map = map(160, 120);
        // A lamp's image: as bright, but fading out over 15 cm.
        let lamp = picture(&map, |floor| {
            60.0 + 120.0 * (1.0 - (floor.y / 0.15).abs()).max(0.0)
        });
        let mut finder = StripeFinder::new(&map, 0.05);
        let sum = |found: &[Stripe]| {
            found
                .iter()
                .filter(|stripe| stripe.floor.length() < 0.6)
                .map(|stripe| stripe.sharpness)
                .sum::<f64>()
        };
        let of_lamp = sum(finder.find(&lamp, &map, Contrast::Light));
        let paint = picture(&map, stripe(Vec2::ZERO, Vec2::X));
        let of_paint = sum(finder.find(&paint, &map, Contrast::Light));
        let of_dark = sum(finder.find(&paint, &map, Contrast::Dark));
        assert!(of_paint > 20.0 && of_lamp < 0.1 * of_paint && of_dark < 0.1 * of_paint);
    }

    #[test]
    fn pictures_of_another_size_or_none_are_no_trouble() {
        let map = map(160, 120);
        let mut finder = StripeFinder::new(&map, 0.05);
        assert!(finder.find(&Image::default(), &map, Contrast::Dark).is_empty());
        let small = Image::new(20, 20, Channels::Rgb);
        assert!(finder.find(&small, &map, Contrast::Dark).is_empty());
    }
}
