//! From a frame to the straight edges of what may be lines: mask, Canny, Hough (A4 in SPEC).

use crate::hough::{HoughDriverOptions, Mask};
use senda_core::{Channels, Image};
use senda_geom::Camera;
use senda_vision::{
    Canny, Contrast, ExtractorOptions, Hough, HoughOptions, LineExtractor, Segment, WidthProfile,
};

/// The width that lengths and votes refer to (px). A4's pictures are 320x240.
const REFERENCE_WIDTH_PX: f64 = 320.0;
/// Rows above the crop that still decide about edges below it: Canny's gradient and its neighbour.
const MARGIN_ROWS: usize = 2;

/// Finds segments in frames of one size; owns its memory.
pub(crate) struct EdgeEye {
    width: usize,
    height: usize,
    /// First row that is looked at, and the first one of `mask` and `edges`.
    top: usize,
    first: usize,
    colour: Vec<u8>,
    mask: Vec<u8>,
    /// The mask of one more colour.
    other: Vec<u8>,
    edges: Vec<u8>,
    canny: Canny,
    hough: Hough,
    strength: Option<Strength>,
}

/// What a mask by local contrast needs.
struct Strength {
    extractor: LineExtractor,
    contrast: Option<Contrast>,
    whole: Vec<u8>,
}

impl EdgeEye {
    pub(crate) fn new(width: usize, height: usize, camera: &Camera, options: &HoughDriverOptions) -> Self {
        // At least one row stays.
        let top = ((options.crop_part * height as f64).round() as usize).min(height.saturating_sub(1));
        let first = top.saturating_sub(MARGIN_ROWS);
        let pixels = width * (height - first);
        let scale = width as f64 / REFERENCE_WIDTH_PX;
        let scaled = |count: u32| (f64::from(count) * scale).round().max(1.0) as u32;
        let segments = HoughOptions {
            votes: scaled(options.segments.votes),
            length_min_px: scaled(options.segments.length_min_px),
            gap_max_px: scaled(options.segments.gap_max_px),
            ..options.segments
        };
        let strength = (options.mask == Mask::Strength).then(|| {
            let profile = WidthProfile::from_camera(camera, options.line_width_m);
            Strength {
                extractor: LineExtractor::new(width, height, &profile, ExtractorOptions::default()),
                contrast: None,
                whole: vec![0; width * height],
            }
        });
        Self {
            width,
            height,
            top,
            first,
            colour: Vec::new(),
            mask: vec![0; pixels],
            other: vec![0; if options.colours.len() > 1 { pixels } else { 0 }],
            edges: vec![0; pixels],
            canny: Canny::new(),
            hough: Hough::new(segments),
            strength,
        }
    }

    /// Whether it is for frames of this size.
    pub(crate) fn fits(&self, width: usize, height: usize) -> bool {
        (self.width, self.height) == (width, height)
    }

    /// First row that is looked at.
    pub(crate) fn top(&self) -> usize {
        self.top
    }

    /// Local contrast: what is a line must be decided again from the next frame.
    pub(crate) fn doubt(&mut self) {
        if let Some(strength) = &mut self.strength {
            strength.contrast = None;
        }
    }

    /// The segments of a frame, in its pixels.
    pub(crate) fn look(&mut self, image: &Image, options: &HoughDriverOptions, segments: &mut Vec<Segment>) {
        segments.clear();
        match &mut self.strength {
            Some(strength) => {
                strength.look(image);
                self.mask
                    .copy_from_slice(&strength.whole[self.first * self.width..]);
            }
            None => self.mask_colours(image, options),
        }
        let [low, high] = options.canny;
        self.canny
            .detect(&self.mask, self.width, low, high, &mut self.edges);
        let edges = &self.edges[(self.top - self.first) * self.width..];
        let down = self.top as u32;
        let found = self.hough.segments(edges, self.width);
        segments.extend(found.iter().map(|segment| Segment {
            from: [segment.from[0], segment.from[1] + down],
            to: [segment.to[0], segment.to[1] + down],
        }));
    }

    fn mask_colours(&mut self, image: &Image, options: &HoughDriverOptions) {
        let pixels = &image.pixels()[self.first * self.width * image.channels().count()..];
        let rgb = match image.channels() {
            Channels::Rgb => pixels,
            Channels::Gray => {
                // Grey has no hue, but a range may still ask for dark or bright.
                self.colour.clear();
                self.colour.extend(pixels.iter().flat_map(|grey| [*grey; 3]));
                &self.colour
            }
        };
        let Some((first, others)) = options.colours.split_first() else {
            return self.mask.fill(0);
        };
        first.mask(rgb, &mut self.mask);
        for range in others {
            range.mask(rgb, &mut self.other);
            for (bit, other) in self.mask.iter_mut().zip(&self.other) {
                *bit |= other;
            }
        }
    }
}

impl Strength {
    fn look(&mut self, image: &Image) {
        let contrast = match self.contrast {
            Some(contrast) => contrast,
            None => *self.contrast.insert(self.extractor.decide(image)),
        };
        self.extractor.extract(image, contrast);
        self.extractor.mask(&mut self.whole);
    }
}
