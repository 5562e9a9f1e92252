//! How a camera frame becomes a network's input: one way for training and driving.

use crate::network::Shape;
use senda_core::{Channels, Image};
use senda_geom::Camera;
use serde::{Deserialize, Serialize};

/// What a network sees of a camera frame. In a model file it says all that a driver needs.
///
/// The frame is cropped, shrunk by averaging areas (enlarged linearly), taken to the colour space and rounded to bytes; a network's input is
/// `byte * scale + offset`, channel after channel, row after row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputSpec {
    /// Width (px).
    pub width: usize,
    /// Height (px).
    pub height: usize,
    /// Colour space; its number of channels is the network's.
    pub colour: Colour,
    /// What is cut off before.
    #[serde(default)]
    pub crop: Crop,
    /// Value of a byte: factor. 2/255 for -1..1.
    #[serde(default = "two_255ths")]
    pub scale: f32,
    /// Value of byte 0. -1 for -1..1.
    #[serde(default = "minus_one")]
    pub offset: f32,
    /// The camera that it was trained with; `None`: nobody knows, any camera is accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
}

fn two_255ths() -> f32 {
    2.0 / 255.0
}

fn minus_one() -> f32 {
    -1.0
}

/// Colour space of a network's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Colour {
    /// Red, green, blue.
    #[default]
    Rgb,
    /// Luminance (0.299, 0.587, 0.114).
    Grey,
    /// Saturation of HSV, 0..255 (B3 in SPEC).
    Saturation,
}

impl Colour {
    /// Number of channels.
    pub fn channels(self) -> usize {
        match self {
            Self::Rgb => 3,
            Self::Grey | Self::Saturation => 1,
        }
    }
}

/// Parts of the frame (0..1 of its height or width) that are cut off.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Crop {
    /// From above.
    pub top: f64,
    /// From below.
    pub bottom: f64,
    /// From the left.
    pub left: f64,
    /// From the right.
    pub right: f64,
}

impl InputSpec {
    /// For a network's input: -1..1, nothing cut off. One channel is grey, three are red, green, blue.
    pub fn of(shape: Shape) -> Self {
        Self {
            width: shape.width,
            height: shape.height,
            colour: if shape.channels == 3 {
                Colour::Rgb
            } else {
                Colour::Grey
            },
            crop: Crop::default(),
            scale: two_255ths(),
            offset: minus_one(),
            camera: None,
        }
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.colour.channels()
    }

    /// Values of one input.
    pub fn len(&self) -> usize {
        self.channels() * self.height * self.width
    }

    /// Whether there is nothing to see.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What is wrong with it, for a network with this input.
    pub fn fault(&self, shape: Shape) -> Option<String> {
        let own = [self.channels(), self.height, self.width];
        let theirs = [shape.channels, shape.height, shape.width];
        if own != theirs {
            return Some(format!(
                "expected an input of {} channels, {} rows, {} columns as the network has, but found {}, {}, {}",
                theirs[0], theirs[1], theirs[2], own[0], own[1], own[2]
            ));
        }
        let crop = self.crop;
        let parts = [crop.top, crop.bottom, crop.left, crop.right];
        if parts.iter().any(|part| !(0.0..1.0).contains(part))
            || crop.top + crop.bottom > 0.95
            || crop.left + crop.right > 0.95
        {
            return Some(format!(
                "expected a crop that leaves a twentieth of the frame each way, but found {parts:?}"
            ));
        }
        if !(self.scale.is_finite() && self.offset.is_finite() && self.scale != 0.0) {
            return Some(format!(
                "expected a finite scale other than 0 and a finite offset, but found {} and {}",
                self.scale, self.offset
            ));
        }
        None
    }

    /// Prepares frames of one size.
    ///
    /// # Panics
    /// When the size is 0.
    pub fn preparer(&self, frame_width: usize, frame_height: usize) -> Preparer {
        assert!(
            frame_width > 0 && frame_height > 0,
            "expected a frame with pixels"
        );
        Preparer {
            spec: self.clone(),
            frame: [frame_width, frame_height],
            columns: taps(frame_width, self.crop.left, self.crop.right, self.width),
            rows: taps(frame_height, self.crop.top, self.crop.bottom, self.height),
            sums: vec![0; 3 * frame_width],
            bytes: vec![0; self.len()],
        }
    }

    /// Bytes to the values that the network takes; both of the same length.
    pub fn normalise(&self, bytes: &[u8], values: &mut [f32]) {
        for (value, byte) in values.iter_mut().zip(bytes) {
            *value = f32::from(*byte) * self.scale + self.offset;
        }
    }
}

/// Which source pixels make one target pixel, and how much of each (parts of 4096, sum 4096).
#[derive(Debug, Clone, PartialEq)]
struct Tap {
    first: usize,
    weights: Vec<u32>,
}

const ONE: u32 = 4096;

fn taps(length: usize, cut_before: f64, cut_after: f64, count: usize) -> Vec<Tap> {
    let from = cut_before * length as f64;
    let size = (length as f64 * (1.0 - cut_after) - from).max(1.0) / count.max(1) as f64;
    if size < 1.0 {
        return enlarging_taps(length, from, size, count);
    }
    (0..count)
        .map(|i| {
            let low = (from + i as f64 * size).clamp(0.0, length as f64 - 1e-6);
            let high = (from + (i + 1) as f64 * size).clamp(low + 1e-6, length as f64);
            let first = low as usize;
            let last = (high.ceil() as usize).clamp(first + 1, length);
            let mut weights: Vec<u32> = (first..last)
                .map(|at| {
                    let covered = (high.min(at as f64 + 1.0) - low.max(at as f64)).max(0.0);
                    (covered / (high - low) * f64::from(ONE)).round() as u32
                })
                .collect();
            // Rounding errors go to the largest weight: a uniform frame stays uniform.
            let sum: u32 = weights.iter().sum();
            if let Some(largest) = weights.iter_mut().max() {
                *largest = *largest + ONE - sum;
            }
            Tap { first, weights }
        })
        .collect()
}

/// Where a target pixel is smaller than a source pixel: linear between the two nearest.
fn enlarging_taps(length: usize, from: f64, size: f64, count: usize) -> Vec<Tap> {
    (0..count)
        .map(|i| {
            let centre = (from + (i as f64 + 0.5) * size - 0.5).clamp(0.0, (length - 1) as f64);
            let first = (centre as usize).min(length.saturating_sub(2));
            let second = ((centre - first as f64) * f64::from(ONE)).round() as u32;
            let weights = if length > 1 {
                vec![ONE - second, second]
            } else {
                vec![ONE]
            };
            Tap { first, weights }
        })
        .collect()
}

/// Prepares frames of one size; allocates nothing per frame.
#[derive(Debug, Clone)]
pub struct Preparer {
    spec: InputSpec,
    frame: [usize; 2],
    columns: Vec<Tap>,
    rows: Vec<Tap>,
    sums: Vec<u32>,
    bytes: Vec<u8>,
}

impl Preparer {
    /// Width and height of the frames that it takes.
    pub fn frame_size(&self) -> [usize; 2] {
        self.frame
    }

    /// A frame as bytes, channel after channel: what training keeps.
    ///
    /// # Panics
    /// When the frame or the target has another size.
    pub fn prepare_bytes(&mut self, image: &Image, bytes: &mut [u8]) {
        assert_eq!(
            [image.width(), image.height()],
            self.frame,
            "a frame of another size"
        );
        assert_eq!(bytes.len(), self.spec.len(), "a target of another size");
        let in_channels = image.channels().count();
        let row_len = in_channels * image.width();
        let plane = self.spec.width * self.spec.height;
        for (v, tap) in self.rows.iter().enumerate() {
            let sums = &mut self.sums[..row_len];
            sums.fill(0);
            for (offset, weight) in tap.weights.iter().enumerate() {
                for (sum, byte) in sums.iter_mut().zip(image.row(tap.first + offset)) {
                    *sum += weight * u32::from(*byte);
                }
            }
            for (u, tap) in self.columns.iter().enumerate() {
                let mut colour = [0u32; 3];
                for (offset, weight) in tap.weights.iter().enumerate() {
                    let at = (tap.first + offset) * in_channels;
                    for (channel, total) in colour.iter_mut().enumerate().take(in_channels) {
                        // At most 255 * 4096 * 4096, which fits.
                        *total += weight * sums[at + channel];
                    }
                }
                let [r, g, b] = colour.map(|total| (total + (1 << 23)) >> 24);
                let [r, g, b] = match image.channels() {
                    Channels::Gray => [r, r, r],
                    Channels::Rgb => [r, g, b],
                };
                let at = v * self.spec.width + u;
                match self.spec.colour {
                    Colour::Rgb => {
                        bytes[at] = r as u8;
                        bytes[plane + at] = g as u8;
                        bytes[2 * plane + at] = b as u8;
                    }
                    // Parts of 1000 with rounding; 255 stays 255.
                    Colour::Grey => bytes[at] = ((299 * r + 587 * g + 114 * b + 500) / 1000) as u8,
                    Colour::Saturation => {
                        let most = r.max(g).max(b);
                        let spread = most - r.min(g).min(b);
                        bytes[at] = ((255 * spread + most / 2).checked_div(most).unwrap_or(0)) as u8;
                    }
                }
            }
        }
    }

    /// A frame as the values that the network takes.
    ///
    /// # Panics
    /// As [`Preparer::prepare_bytes`].
    pub fn prepare(&mut self, image: &Image, values: &mut [f32]) {
        let mut bytes = std::mem::take(&mut self.bytes);
        self.prepare_bytes(image, &mut bytes);
        self.spec.normalise(&bytes, values);
        self.bytes = bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spec(width: usize, height: usize, colour: Colour) -> InputSpec {
        InputSpec {
            colour,
            ..InputSpec::of(Shape {
                channels: colour.channels(),
                height,
                width,
            })
        }
    }

    fn uniform(width: usize, height: usize, colour: [u8; 3]) -> Image {
        let pixels = colour.iter().copied().cycle().take(3 * width * height).collect();
        Image::from_pixels(width, height, Channels::Rgb, pixels).unwrap()
    }

    proptest! {
        #[test]
        fn uniform_frames_stay_uniform(
            (w, h) in (1usize..70, 1usize..50), (tw, th) in (1usize..40, 1usize..40),
            top in 0.0..0.6f64, left in 0.0..0.4f64, colour in any::<[u8; 3]>(),
        ) {
            let mut spec = spec(tw, th, Colour::Rgb);
            spec.crop = Crop { top, left, ..Crop::default() };
            let mut bytes = vec![0; spec.len()];
            spec.preparer(w, h).prepare_bytes(&uniform(w, h, colour), &mut bytes);
            for (channel, value) in colour.iter().enumerate() {
                prop_assert!(bytes[channel * tw * th..(channel + 1) * tw * th].iter().all(|byte| byte == value));
            }
        }

        #[test]
        fn shrinking_by_whole_numbers_is_the_mean(pixels in prop::collection::vec(any::<u8>(), 12 * 8)) {
            let image = Image::from_pixels(12, 8, Channels::Gray, pixels.clone()).unwrap();
            let spec = spec(3, 2, Colour::Grey);
            let mut bytes = vec![0; 6];
            spec.preparer(12, 8).prepare_bytes(&image, &mut bytes);
            for (i, byte) in bytes.iter().enumerate() {
                let (u, v) = (i % 3, i / 3);
                let sum: u32 = (0..16).map(|k| u32::from(pixels[(4 * v + k / 4) * 12 + 4 * u + k % 4])).sum();
                prop_assert!((f64::from(sum) / 16.0 - f64::from(*byte)).abs() <= 0.51);
            }
        }
    }

    #[test]
    fn cropping_cuts_where_it_says() {
        let mut image = Image::new(4, 4, Channels::Gray);
        image.row_mut(3).copy_from_slice(&[10, 20, 30, 40]);
        let mut spec = spec(2, 1, Colour::Grey);
        spec.crop = Crop {
            top: 0.75,
            left: 0.5,
            ..Crop::default()
        };
        let mut bytes = [0; 2];
        spec.preparer(4, 4).prepare_bytes(&image, &mut bytes);
        assert_eq!(bytes, [30, 40]);
    }

    #[test]
    fn saturation_is_that_of_hsv_and_values_span_minus_one_to_one() {
        let spec = spec(1, 1, Colour::Saturation);
        let mut values = [0.0];
        for (colour, expected) in [([255, 0, 0], 1.0), ([80, 80, 80], -1.0), ([0, 0, 0], -1.0)] {
            spec.preparer(5, 5).prepare(&uniform(5, 5, colour), &mut values);
            assert!((values[0] - expected).abs() < 1e-6, "{colour:?} {values:?}");
        }
    }

    #[test]
    fn faults_are_named() {
        let shape = Shape {
            channels: 3,
            height: 66,
            width: 200,
        };
        assert_eq!(InputSpec::of(shape).fault(shape), None);
        assert!(
            spec(200, 66, Colour::Grey)
                .fault(shape)
                .unwrap()
                .contains("3 channels")
        );
        let mut cut = InputSpec::of(shape);
        cut.crop.top = 0.96;
        assert!(cut.fault(shape).unwrap().contains("crop"));
    }
}
