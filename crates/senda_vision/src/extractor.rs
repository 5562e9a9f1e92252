//! From a frame to the blobs that may be lines: C3 to C6 in SPEC.

use crate::{Channel, Contrast, ExtractorOptions, LineBlob, WidthProfile};
use senda_core::Image;

/// What the log keeps of each extraction (C15 in SPEC), in grey levels of the blurred residue.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Statistics {
    /// Mean over the image.
    pub mean: f64,
    /// Largest value.
    pub max: f64,
    /// 1.5 · mean + max / 15 with the default options.
    pub threshold: f64,
}

/// How strongly a frame speaks for dark and for light lines: the sums of the scores of all accepted blobs (C4).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ContrastScores {
    /// Sum for dark lines.
    pub dark: f64,
    /// Sum for light lines.
    pub light: f64,
}

/// Finds line-like blobs in frames of one size. Owns its working memory: extraction allocates nothing once the
/// first frames have passed.
#[derive(Debug, Clone)]
pub struct LineExtractor {
    width: usize,
    height: usize,
    options: ExtractorOptions,
    blobs: Vec<LineBlob>,
    statistics: Statistics,
}

impl LineExtractor {
    /// For frames of `width` x `height` pixels; `profile` may be for another size, it is scaled (C6).
    pub fn new(width: usize, height: usize, profile: &WidthProfile, options: ExtractorOptions) -> Self {
        let _ = profile;
        Self {
            width,
            height,
            options,
            blobs: Vec::new(),
            statistics: Statistics::default(),
        }
    }

    /// Frame width (px).
    pub fn width(&self) -> usize {
        self.width
    }

    /// Frame height (px).
    pub fn height(&self) -> usize {
        self.height
    }

    /// The options in use, with the channel that was last chosen.
    pub fn options(&self) -> &ExtractorOptions {
        &self.options
    }

    /// Looks for the channel and contrast in which this frame shows its lines best (C4, and coloured tape of the
    /// floor's brightness: A5 in SPEC), and uses that channel from now on. Luminance unless another is clearly better.
    pub fn decide(&mut self, image: &Image) -> Contrast {
        self.decide_contrast(image)
    }

    /// Both ways of looking at a frame: the sums of the scores of the blobs that pass (C4).
    pub fn contrast_scores(&mut self, image: &Image) -> ContrastScores {
        let _ = image;
        ContrastScores::default()
    }

    /// Whether the frame shows dark or light lines (C4): the larger total score wins; without any accepted blob the
    /// stronger residue.
    pub fn decide_contrast(&mut self, image: &Image) -> Contrast {
        let _ = image;
        Contrast::Dark
    }

    /// The blobs that pass all limits of C5, largest score first. Valid until the next call.
    ///
    /// A frame of another size than the extractor's is stretched over it by nearest neighbour, so that a camera that
    /// changes its mode costs precision, not the drive. An empty image gives no blobs.
    pub fn extract(&mut self, image: &Image, contrast: Contrast) -> &[LineBlob] {
        let _ = (image, contrast, Channel::Luminance);
        self.blobs.clear();
        &self.blobs
    }

    /// The accepted blobs of the last [`LineExtractor::extract`].
    pub fn blobs(&self) -> &[LineBlob] {
        &self.blobs
    }

    /// Mean, maximum and threshold of the last extraction.
    pub fn statistics(&self) -> Statistics {
        self.statistics
    }
}
