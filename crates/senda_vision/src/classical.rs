//! Signs and lights by colour and shape: the classical detector (document D uses a network for them, D7 in SPEC).

use crate::components::Components;
use crate::detection::{Detection, Detector, ObjectClass};
use crate::digits::{corners, digit, luminance};
use crate::{HsvRange, street::colours};
use senda_core::{Channels, Image};

/// What counts as a sign's board and as a lit lamp. Sizes are parts of the frame's width.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClassicalOptions {
    /// Light blue of the boards.
    pub board: HsvRange,
    /// Lit red lamps.
    pub red_lamp: HsvRange,
    /// Lit green lamps.
    pub green_lamp: HsvRange,
    /// Smallest board and lamp.
    pub board_part: f64,
    /// Smallest lamp.
    pub lamp_part: f64,
    /// Largest lamp: a bar of a crossing is as red, and larger.
    pub lamp_limit_part: f64,
    /// Only this part of the frame's height is searched, from the top.
    pub part: f64,
}

impl Default for ClassicalOptions {
    /// Measured on rendered frames of the worlds for tuning.
    fn default() -> Self {
        Self {
            board: HsvRange {
                low: [74, 45, 60],
                high: [118, 255, 255],
            },
            red_lamp: HsvRange {
                low: [165, 100, 130],
                high: [12, 255, 255],
            },
            green_lamp: HsvRange {
                low: [48, 38, 120],
                high: [98, 255, 255],
            },
            board_part: 0.045,
            lamp_part: 0.016,
            lamp_limit_part: 0.14,
            part: 0.8,
        }
    }
}

/// Frames are shrunk by the whole factor that leaves at least this width (px).
const WORKING_WIDTH_PX: usize = 320;

/// The classical detector.
#[derive(Debug, Clone, Default)]
pub struct ClassicalDetector {
    options: ClassicalOptions,
    small: Image,
    hsv: Vec<[u8; 3]>,
    grey: Vec<u8>,
    row: Vec<u8>,
    components: Components,
    found: Vec<Detection>,
}

impl ClassicalDetector {
    /// With other limits.
    pub fn new(options: ClassicalOptions) -> Self {
        Self {
            options,
            ..Self::default()
        }
    }

    /// Boxes (px of the shrunk frame) of what is kept, with the part of each that is filled. `keeps` is told a pixel's hue,
    /// saturation and value, and its luminance.
    fn blobs(
        &mut self,
        height: usize,
        keeps: impl Fn([u8; 3], u8) -> bool,
        mut each: impl FnMut(&Image, [usize; 4], f64, &dyn Fn(usize, usize) -> bool),
    ) {
        let small = &self.small;
        let width = small.width();
        self.row.clear();
        self.row.resize(width.next_multiple_of(8), 0);
        let (hsv, grey) = (&self.hsv, &self.grey);
        self.components.label(height, &mut self.row, |v, row| {
            let line = v * width..(v + 1) * width;
            for ((out, hsv), grey) in row.iter_mut().zip(&hsv[line.clone()]).zip(&grey[line]) {
                *out = u8::from(keeps(*hsv, *grey));
            }
        });
        for blob in self.components.moments() {
            let size = [blob.left, blob.top, blob.right, blob.bottom].map(|side| side as usize);
            let area = (size[2] - size[0]) * (size[3] - size[1]);
            let kept = |u: usize, v: usize| keeps(hsv[v * width + u], grey[v * width + u]);
            each(small, size, blob.count as f64 / area.max(1) as f64, &kept);
        }
    }
}

impl ClassicalDetector {
    /// Hues and luminances of the shrunk frame, which every level looks at.
    fn prepare(&mut self) {
        let pixels = self.small.pixels().as_chunks::<3>().0;
        self.hsv.clear();
        self.hsv.extend(pixels.iter().map(|pixel| crate::hsv(*pixel)));
        self.grey.clear();
        self.grey
            .extend(pixels.iter().map(|pixel| (luminance(*pixel) / 8) as u8));
    }

    /// Hues as they would be if the floor, which is most of the lower part of the frame, were grey: in warm light a light blue
    /// board is greenish.
    fn balance(&mut self) {
        let mut sum = [1u64; 3];
        let below = self.small.height() / 3..self.small.height();
        for v in below {
            for pixel in self.small.row(v).as_chunks::<3>().0 {
                for (sum, value) in sum.iter_mut().zip(pixel) {
                    *sum += u64::from(*value);
                }
            }
        }
        let grey = sum.iter().sum::<u64>() / 3;
        // In 256ths; a coloured floor shall not turn everything into its opposite.
        let gains = sum.map(|sum| (256 * grey / sum).clamp(128, 512) as u32);
        let pixels = self.small.pixels().as_chunks::<3>().0;
        for (hsv, pixel) in self.hsv.iter_mut().zip(pixels) {
            let mut balanced = *pixel;
            for (value, gain) in balanced.iter_mut().zip(gains) {
                *value = (u32::from(*value) * gain / 256).min(255) as u8;
            }
            *hsv = crate::hsv(balanced);
        }
    }

    /// Boards that show a digit: light blue at several least saturations, since a floor may be blue as well, and brighter than
    /// what is around them, since light may take their hue away.
    fn boards(&mut self, height: usize, mut keep: impl FnMut(ObjectClass, [usize; 4], f64)) {
        let options = self.options;
        let width = self.small.width();
        let mut board =
            |image: &Image, size: [usize; 4], filled: f64, kept: &dyn Fn(usize, usize) -> bool| {
                let is_high =
                    |size: [usize; 4]| (size[3] - size[1]) as f64 > options.board_part * width as f64;
                let has_shape = |size: [usize; 4]| {
                    let (w, h) = ((size[2] - size[0]) as f64, (size[3] - size[1]) as f64);
                    (0.4..1.5).contains(&(w / h))
                };
                let (mut size, mut filled) = (size, filled);
                if is_high(size) && !has_shape(size) {
                    (size, filled) = without_thin_ends(kept, size);
                }
                // Cut by the frame's edge its digit cannot be told.
                let whole = size[0] > 0 && size[1] > 0 && size[2] < width;
                if whole
                    && is_high(size)
                    && has_shape(size)
                    && filled > 0.45
                    && let Some((digit, confidence)) = digit(image, corners(kept, size))
                {
                    keep(ObjectClass::Sign(digit), size, confidence);
                }
            };
        for (balanced, least_hue) in [(false, 0), (true, 0), (true, BALANCED_HUE)] {
            if balanced && least_hue == 0 {
                self.balance();
            }
            for more in [0, 20, 40, 65, 95] {
                let mut colour = options.board;
                colour.low[0] = colour.low[0].max(least_hue);
                colour.low[1] = colour.low[1].saturating_add(more);
                self.blobs(height, |hsv, _| colour.contains(hsv), &mut board);
            }
        }
        for level in (1..=8).map(|step| 45 + 22 * step) {
            self.blobs(height, |_, grey| grey > level, &mut board);
        }
    }

    /// Lit lamps: by their colour at several least saturations and values, and by brightness alone, since a lamp that outshines
    /// the camera is white with a rim of its colour.
    fn lights(&mut self, height: usize, mut keep: impl FnMut(ObjectClass, [usize; 4], f64)) {
        let options = self.options;
        let width = self.small.width() as f64;
        let is_round = |size: [usize; 4], filled: f64| {
            let (w, h) = ((size[2] - size[0]) as f64, (size[3] - size[1]) as f64);
            let lamps = options.lamp_part * width..=options.lamp_limit_part * width;
            (0.55..1.6).contains(&(w / h)) && filled > 0.5 && lamps.contains(&h) && w <= *lamps.end()
        };
        for level in [200, 225, 245] {
            self.blobs(
                height,
                |hsv, _| hsv[2] > level,
                |image, size, filled, _| {
                    if !is_round(size, filled) {
                        return;
                    }
                    let tint = tint(mean(image, size));
                    let (class, partner) = if tint > 0.0 {
                        (ObjectClass::RedLight, 1.0)
                    } else {
                        (ObjectClass::GreenLight, -1.0)
                    };
                    // In warm light everything is reddish: a lamp is more so than its housing.
                    if let Some(lamp) = lamp(image, size, partner)
                        && (tint - lamp.housing_tint) * partner > TINT
                    {
                        keep(class, housing(size, partner), lamp.confidence * filled / 0.785);
                    }
                },
            );
        }
        for (class, colour, partner) in [
            (ObjectClass::RedLight, options.red_lamp, 1.0),
            (ObjectClass::GreenLight, options.green_lamp, -1.0),
        ] {
            for [saturation, value] in [[0, 0], [30, 0], [0, 50], [60, 50]] {
                let mut colour = colour;
                colour.low[1] = colour.low[1].saturating_add(saturation);
                colour.low[2] = colour.low[2].saturating_add(value);
                self.blobs(
                    height,
                    |hsv, _| colour.contains(hsv),
                    |image, size, filled, _| {
                        if !is_round(size, filled) {
                            return;
                        }
                        if let Some(lamp) = lamp(image, size, partner) {
                            keep(class, housing(size, partner), lamp.confidence * filled / 0.785);
                        }
                    },
                );
            }
        }
    }
}

/// A box without its columns in which hardly anything is kept, and the part of the rest that is filled: a line far behind a
/// board, as blue as it, sticks out of it.
fn without_thin_ends(kept: &dyn Fn(usize, usize) -> bool, size: [usize; 4]) -> ([usize; 4], f64) {
    let [left, top, right, bottom] = size;
    let kept_in = |u: usize| (top..bottom).filter(|v| kept(u, *v)).count();
    let is_thick = |u: &usize| 3 * kept_in(*u) > bottom - top;
    let (Some(first), Some(last)) = ((left..right).find(is_thick), (left..right).rfind(is_thick)) else {
        return (size, 0.0);
    };
    let count: usize = (first..=last).map(kept_in).sum();
    let area = (last + 1 - first) * (bottom - top);
    ([first, top, last + 1, bottom], count as f64 / area as f64)
}

/// Hues from which on a board is blue when the floor is grey (measured: 98 and more): a street's green line, which joins
/// the board before it with what is beside it, has less.
const BALANCED_HUE: u8 = 92;

/// By so much the tint of a lamp that outshines the camera differs from its housing's.
const TINT: f64 = 0.05;

/// How much redder than green a colour is, as a part of the brighter of both.
fn tint([red, green, _]: [u32; 3]) -> f64 {
    (f64::from(red) - f64::from(green)) / f64::from(red.max(green).max(1))
}

/// Mean colour of a box.
fn mean(image: &Image, [left, top, right, bottom]: [usize; 4]) -> [u32; 3] {
    let mut sum = [0u32; 3];
    for v in top..bottom {
        for pixel in &image.row(v).as_chunks::<3>().0[left..right] {
            for (sum, value) in sum.iter_mut().zip(pixel) {
                *sum += u32::from(*value);
            }
        }
    }
    let count = ((bottom - top) * (right - left)).max(1) as u32;
    sum.map(|sum| sum / count)
}

/// The whole light around its lit lamp, as labels have it: 2.4 times as high as wide, lamps of 0.74 of its width.
fn housing([left, top, right, bottom]: [usize; 4], partner: f64) -> [usize; 4] {
    let side = 0.5 * (right - left + bottom - top) as f64 / 0.74;
    let middle_u = 0.5 * (left + right) as f64;
    let middle_v = 0.5 * (top + bottom) as f64 + partner * 0.55 * side;
    let at = |value: f64| value.max(0.0) as usize;
    [
        at(middle_u - 0.5 * side),
        at(middle_v - 1.2 * side),
        at(middle_u + 0.5 * side),
        at(middle_v + 1.2 * side),
    ]
}

impl Detector for ClassicalDetector {
    fn detect(&mut self, frame: &Image) -> &[Detection] {
        self.found.clear();
        if frame.channels() != Channels::Rgb || frame.width() < 64 || frame.height() < 48 {
            return &self.found;
        }
        let factor = (frame.width() / WORKING_WIDTH_PX).max(1);
        colours::shrink(frame, factor, &mut self.small);
        let height = (self.small.height() as f64 * self.options.part.clamp(0.1, 1.0)) as usize;
        let mut found = std::mem::take(&mut self.found);
        let mut keep = |class, size: [usize; 4], confidence: f64| {
            found.push(Detection {
                class,
                box_px: size.map(|side| (side * factor) as f32),
                confidence: confidence.clamp(0.0, 1.0) as f32,
            });
        };
        self.prepare();
        self.lights(height, &mut keep);
        self.boards(height, &mut keep);
        found.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        // Every level finds the same things again: the surest of what overlaps stays.
        let mut kept = 0;
        for index in 0..found.len() {
            let one = found[index];
            if found[..kept].iter().all(|other| overlap(other, &one) < 0.3) {
                found[kept] = one;
                kept += 1;
            }
        }
        found.truncate(kept);
        self.found = found;
        &self.found
    }
}

/// What two boxes have in common, as a part of the smaller.
fn overlap(one: &Detection, other: &Detection) -> f32 {
    let along = |axis: usize| {
        (one.box_px[axis + 2].min(other.box_px[axis + 2]) - one.box_px[axis].max(other.box_px[axis])).max(0.0)
    };
    let area = |box_px: &[f32; 4]| (box_px[2] - box_px[0]) * (box_px[3] - box_px[1]);
    along(0) * along(1) / area(&one.box_px).min(area(&other.box_px)).max(1.0)
}

/// A light's lit lamp.
struct Lamp {
    confidence: f64,
    /// [`tint`] of the housing beside it.
    housing_tint: f64,
}

/// Whether a bright blob is a light's lamp: grey housing around it, and in the direction of its partner (1 down, -1 up) a
/// dark lamp.
fn lamp(image: &Image, [left, top, right, bottom]: [usize; 4], partner: f64) -> Option<Lamp> {
    let (w, h) = ((right - left) as f64, (bottom - top) as f64);
    let (u, v) = (0.5 * (left + right) as f64, 0.5 * (top + bottom) as f64);
    let radius = 0.25 * (w + h);
    let pixel = |u: f64, v: f64| -> Option<[i32; 3]> {
        let inside = u >= 0.0 && v >= 0.0 && (u as usize) < image.width() && (v as usize) < image.height();
        inside.then(|| {
            let pixel = image.pixel(u as usize, v as usize);
            [0, 1, 2].map(|c| i32::from(pixel[c]))
        })
    };
    let value = |pixel: [i32; 3]| pixel[0].max(pixel[1]).max(pixel[2]);
    let own = value(pixel(u, v)?);
    // Lamps' middles are 1.1 of the board's width apart, their radius is 0.37 of it.
    let other = value(pixel(u, v + partner * 1.1 / 0.37 * radius)?);
    // Between the two lamps and beyond the partner lies housing.
    let between = pixel(u, v + partner * 0.55 / 0.37 * radius)?;
    let grey = value(between) - between.iter().min().copied().unwrap_or(0);
    let dark = f64::from(own - other) / f64::from(own.max(1));
    // The dark lamp is darker than the housing: what lies below a crossing's red bar is street all over.
    let hole = 100 * other < 85 * value(between);
    (dark > 0.35 && grey < 70 && value(between) < own && hole).then(|| Lamp {
        confidence: 0.6 + 0.4 * dark,
        housing_tint: tint(between.map(|value| value as u32)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A light of 48 x 116 px on a brown floor; `lit` is the colour at the edge of the red lamp and at its middle.
    fn light(rim: [u8; 3], middle: [u8; 3]) -> Image {
        let mut image = Image::new(640, 480, Channels::Rgb);
        for v in 0..480usize {
            for u in 0..640usize {
                let (x, y) = (u as f64 - 400.0, v as f64 - 150.0);
                let off = |cy: f64| (x * x + (y - cy) * (y - cy)).sqrt();
                let colour = if off(-27.0) < 15.0 {
                    middle
                } else if off(-27.0) < 18.0 {
                    rim
                } else if off(27.0) < 18.0 {
                    [20, 90, 50]
                } else if x.abs() < 24.0 && y.abs() < 58.0 {
                    [205, 204, 210]
                } else {
                    [110, 90, 75]
                };
                image.pixels_mut()[3 * (640 * v + u)..][..3].copy_from_slice(&colour);
            }
        }
        image
    }

    #[test]
    fn a_lamp_that_outshines_the_camera_is_found() {
        for (rim, middle) in [([230, 40, 30], [230, 40, 30]), ([255, 160, 135], [255, 255, 250])] {
            let image = light(rim, middle);
            let mut detector = ClassicalDetector::default();
            let found = detector.detect(&image);
            let [one] = found else {
                panic!("{middle:?}: {found:?}");
            };
            assert_eq!(one.class, ObjectClass::RedLight);
            let [u, v] = one.middle_px();
            assert!((u - 400.0).abs() < 6.0 && (v - 150.0).abs() < 12.0, "{found:?}");
        }
        // White all over, as a window is, it is none.
        let white = light([255; 3], [255; 3]);
        assert!(ClassicalDetector::default().detect(&white).is_empty());
    }
}
