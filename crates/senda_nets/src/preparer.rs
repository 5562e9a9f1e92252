//! Frames become bytes, bytes become a network's input: the same code for training and driving.

use crate::input::{Colour, InputSpec};
use senda_core::{Canny, Channels, Image};

/// Prepares frames of one size; allocates nothing per frame.
#[derive(Debug, Clone)]
pub struct Preparer {
    spec: InputSpec,
    frame: [usize; 2],
    columns: Vec<Tap>,
    rows: Vec<Tap>,
    sums: Vec<u32>,
    edges: Option<EdgeFinder>,
}

/// Memory of the search for edges.
#[derive(Debug, Clone)]
struct EdgeFinder {
    canny: Canny,
    saturation: Vec<u8>,
    edges: Vec<u8>,
}

impl Preparer {
    pub(crate) fn new(spec: &InputSpec, frame_width: usize, frame_height: usize) -> Self {
        assert!(
            frame_width > 0 && frame_height > 0,
            "expected a frame with pixels"
        );
        let pixels = frame_width * frame_height;
        Self {
            spec: spec.clone(),
            frame: [frame_width, frame_height],
            columns: taps(frame_width, spec.crop.left, spec.crop.right, spec.width),
            rows: taps(frame_height, spec.crop.top, spec.crop.bottom, spec.height),
            sums: vec![0; 3 * frame_width],
            edges: spec.edges.map(|_| EdgeFinder {
                canny: Canny::new(),
                saturation: vec![0; pixels],
                edges: vec![0; pixels],
            }),
        }
    }

    /// Width and height of the frames that it takes.
    pub fn frame_size(&self) -> [usize; 2] {
        self.frame
    }

    /// One frame as bytes, channel after channel: what training keeps.
    ///
    /// # Panics
    /// When the frame or the target has another size.
    pub fn prepare_bytes(&mut self, image: &Image, bytes: &mut [u8]) {
        assert_eq!(
            [image.width(), image.height()],
            self.frame,
            "a frame of another size"
        );
        assert_eq!(bytes.len(), self.spec.frame_len(), "a target of another size");
        let plane = self.spec.width * self.spec.height;
        let colour_space = self.spec.colour;
        let is_gray = image.channels() == Channels::Gray;
        let count = image.channels().count();
        let put = |at: usize, [r, g, b]: [u32; 3]| {
            let [r, g, b] = if is_gray { [r, r, r] } else { [r, g, b] };
            match colour_space {
                Colour::Rgb => {
                    bytes[at] = r as u8;
                    bytes[plane + at] = g as u8;
                    bytes[2 * plane + at] = b as u8;
                }
                // Parts of 1000 with rounding; 255 stays 255.
                Colour::Grey => bytes[at] = ((299 * r + 587 * g + 114 * b + 500) / 1000) as u8,
                Colour::Saturation => bytes[at] = saturation(r, g, b),
            }
        };
        shrink(
            [&self.rows, &self.columns],
            count,
            |row| image.row(row),
            &mut self.sums,
            put,
        );
        if let (Some(finder), Some(limits)) = (&mut self.edges, self.spec.edges) {
            let width = self.frame[0];
            finder.find(image, limits.low, limits.high);
            let row = |row: usize| &finder.edges[row * width..(row + 1) * width];
            let add = |at: usize, [edge, ..]: [u32; 3]| {
                for byte in bytes[at..].iter_mut().step_by(plane) {
                    *byte = byte.saturating_add(edge as u8);
                }
            };
            shrink([&self.rows, &self.columns], 1, row, &mut self.sums, add);
        }
    }
}

impl EdgeFinder {
    fn find(&mut self, image: &Image, low: u16, high: u16) {
        match image.channels() {
            Channels::Gray => self.saturation.fill(0),
            Channels::Rgb => {
                for (row, saturations) in self.saturation.chunks_exact_mut(image.width()).enumerate() {
                    for (pixel, value) in image.row(row).chunks_exact(3).zip(saturations) {
                        *value = saturation(pixel[0].into(), pixel[1].into(), pixel[2].into());
                    }
                }
            }
        }
        self.canny
            .detect(&self.saturation, image.width(), low, high, &mut self.edges);
    }
}

/// Saturation of HSV, 0..255.
fn saturation(r: u32, g: u32, b: u32) -> u8 {
    let most = r.max(g).max(b);
    let spread = most - r.min(g).min(b);
    ((255 * spread + most / 2).checked_div(most).unwrap_or(0)) as u8
}

/// A network's eye in one run: prepares each frame, whatever its size, and keeps the ones before it that the network is shown too.
/// Allocates only when the size of the frames changes.
#[derive(Debug, Clone)]
pub struct Eye {
    spec: InputSpec,
    preparer: Option<Preparer>,
    frame: Vec<u8>,
    stack: FrameStack,
    values: Vec<f32>,
}

impl Eye {
    /// An eye that has seen nothing.
    pub fn new(spec: &InputSpec) -> Self {
        Self {
            spec: spec.clone(),
            preparer: None,
            frame: vec![0; spec.frame_len()],
            stack: FrameStack::new(spec),
            values: vec![0.0; spec.len()],
        }
    }

    /// The next frame of the run, with those before it, as bytes.
    ///
    /// # Panics
    /// When the frame has no pixels.
    pub fn see_bytes(&mut self, image: &Image) -> &[u8] {
        let [width, height] = [image.width(), image.height()];
        let spec = &self.spec;
        if self
            .preparer
            .as_ref()
            .is_none_or(|one| one.frame_size() != [width, height])
        {
            self.preparer = None;
        }
        let preparer = self.preparer.get_or_insert_with(|| spec.preparer(width, height));
        preparer.prepare_bytes(image, &mut self.frame);
        self.stack.push(&self.frame)
    }

    /// The same as the values that the network takes.
    ///
    /// # Panics
    /// When the frame has no pixels.
    pub fn see(&mut self, image: &Image) -> &[f32] {
        self.see_bytes(image);
        self.spec.normalise(&self.stack.bytes, &mut self.values);
        &self.values
    }

    /// A run begins, or frames are missing: the next frame stands for those before it.
    pub fn forget(&mut self) {
        self.stack.forget();
    }
}

/// The last frames of a run, as a network is shown them: the newest last.
#[derive(Debug, Clone)]
pub struct FrameStack {
    bytes: Vec<u8>,
    is_new: bool,
}

impl FrameStack {
    /// As high as the input specification says, and empty.
    pub fn new(spec: &InputSpec) -> Self {
        Self {
            bytes: vec![0; spec.len()],
            is_new: true,
        }
    }

    /// Adds a prepared frame and gives all of them.
    ///
    /// # Panics
    /// When the frame has another length.
    pub fn push(&mut self, frame: &[u8]) -> &[u8] {
        assert!(
            !frame.is_empty() && self.bytes.len().is_multiple_of(frame.len()),
            "a frame of another length"
        );
        if std::mem::take(&mut self.is_new) {
            for place in self.bytes.chunks_exact_mut(frame.len()) {
                place.copy_from_slice(frame);
            }
        } else {
            let newest = self.bytes.len() - frame.len();
            self.bytes.copy_within(frame.len().., 0);
            self.bytes[newest..].copy_from_slice(frame);
        }
        &self.bytes
    }

    /// The next frame stands for those before it.
    pub fn forget(&mut self) {
        self.is_new = true;
    }
}

/// Gives each target pixel the mean of its part of the source, for up to three channels.
fn shrink<'a>(
    [rows, columns]: [&[Tap]; 2],
    channels: usize,
    row: impl Fn(usize) -> &'a [u8],
    sums: &mut [u32],
    mut put: impl FnMut(usize, [u32; 3]),
) {
    for (v, tap) in rows.iter().enumerate() {
        sums.fill(0);
        for (offset, weight) in tap.weights.iter().enumerate() {
            for (sum, byte) in sums.iter_mut().zip(row(tap.first + offset)) {
                *sum += weight * u32::from(*byte);
            }
        }
        for (u, tap) in columns.iter().enumerate() {
            let mut colour = [0u32; 3];
            for (offset, weight) in tap.weights.iter().enumerate() {
                let at = (tap.first + offset) * channels;
                for (channel, total) in colour.iter_mut().enumerate().take(channels) {
                    // At most 255 * 4096 * 4096, which fits.
                    *total += weight * sums[at + channel];
                }
            }
            put(
                v * columns.len() + u,
                colour.map(|total| (total + (1 << 23)) >> 24),
            );
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{Crop, Edges};
    use crate::network::Shape;
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
        let mut eye = Eye::new(&spec);
        for (colour, expected) in [([255, 0, 0], 1.0), ([80, 80, 80], -1.0), ([0, 0, 0], -1.0)] {
            let value = eye.see(&uniform(5, 5, colour))[0];
            assert!((value - expected).abs() < 1e-6, "{colour:?} {value}");
        }
    }

    /// A red patch on white: an edge where saturation changes.
    #[test]
    fn edges_of_the_saturation_are_added_to_the_shrunk_frame() {
        let mut image = uniform(40, 20, [90, 90, 90]);
        for v in 0..20 {
            for pixel in image.row_mut(v)[3 * 20..].chunks_exact_mut(3) {
                pixel.copy_from_slice(&[180, 120, 120]);
            }
        }
        let mut plain = spec(10, 5, Colour::Saturation);
        let mut without = vec![0; plain.len()];
        plain.preparer(40, 20).prepare_bytes(&image, &mut without);
        plain.edges = Some(Edges::default());
        let mut with = vec![0; plain.len()];
        plain.preparer(40, 20).prepare_bytes(&image, &mut with);
        for (place, (with, without)) in with.iter().zip(&without).enumerate() {
            // The edge is one pixel of four wide and as high as the picture.
            let expected = if place % 10 == 4 { 64 } else { 0 };
            assert_eq!(with - without, expected, "{place}");
        }
        let mut rgb = spec(10, 5, Colour::Rgb);
        rgb.edges = plain.edges;
        let mut bytes = vec![0; rgb.len()];
        rgb.preparer(40, 20).prepare_bytes(&image, &mut bytes);
        assert_eq!([bytes[4], bytes[54], bytes[104]], [90 + 64; 3]);
        assert_eq!([bytes[5], bytes[55], bytes[105]], [180, 120, 120]);
    }

    #[test]
    fn a_grey_picture_has_no_edges_of_saturation() {
        let mut spec = spec(4, 4, Colour::Grey);
        spec.edges = Some(Edges::default());
        let mut image = Image::new(8, 8, Channels::Gray);
        image.row_mut(3).fill(255);
        let mut with = vec![0; spec.len()];
        spec.preparer(8, 8).prepare_bytes(&image, &mut with);
        spec.edges = None;
        let mut without = vec![0; spec.len()];
        spec.preparer(8, 8).prepare_bytes(&image, &mut without);
        assert_eq!(with, without);
    }

    #[test]
    fn the_first_frame_stands_for_those_before_it_and_after_a_gap_again() {
        let mut spec = spec(1, 1, Colour::Grey);
        spec.stack = 3;
        let mut eye = Eye::new(&spec);
        let mut see = |grey: u8, forgets: bool| {
            if forgets {
                eye.forget();
            }
            eye.see_bytes(&uniform(4, 4, [grey; 3])).to_vec()
        };
        assert_eq!(see(1, false), [1, 1, 1]);
        assert_eq!(see(2, false), [1, 1, 2]);
        assert_eq!(see(3, false), [1, 2, 3]);
        assert_eq!(see(4, false), [2, 3, 4]);
        assert_eq!(see(9, true), [9, 9, 9]);
        assert_eq!(see(10, false), [9, 9, 10]);
    }
}
