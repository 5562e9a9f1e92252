//! What the line extraction is told: which lines to look for and the limits of C5 in SPEC.

use serde::{Deserialize, Serialize};

/// Whether lines are darker or lighter than the floor (in the channel in use).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Contrast {
    /// Dark line on a lighter floor: residue of two closings.
    Dark,
    /// Light line on a darker floor: residue of two openings.
    Light,
}

/// The grey picture in which lines are sought.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Channel {
    /// 0.299 R + 0.587 G + 0.114 B (C3 in SPEC).
    #[default]
    Luminance,
    /// max(R, G, B) - min(R, G, B): coloured tape on a grey floor, whatever its hue and brightness.
    Chroma,
    /// offset + red · R + green · G + blue · B, clamped to 0..=255: a direction in colour space that separates a
    /// certain tape from a certain floor. [`crate::LineExtractor::decide`] finds one from a frame.
    Projection {
        /// Weight of red, -1..=1.
        red: f64,
        /// Weight of green, -1..=1.
        green: f64,
        /// Weight of blue, -1..=1.
        blue: f64,
        /// Grey level of black.
        offset: f64,
    },
}

/// Which components count as lines: C5 in SPEC. Lengths, areas and scores are those of a 320x240 image; the
/// extractor scales them to the size in use (C6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BlobLimits {
    /// Area above this part of the image (1/750).
    pub area_part: f64,
    /// Ellipticity above this (1.7).
    pub ellipticity: f64,
    /// Score above this (25,000).
    pub score: f64,
    /// Variance along the short axis above this (2 px²).
    pub lambda_min_px2: f64,
    /// Variance along the long axis above this (15 px²).
    pub lambda_max_px2: f64,
    /// Centroid outside this part of the width at either side (1/32).
    pub side_part: f64,
    /// Orientation within ± this (72°, in rad).
    pub orientation_rad: f64,
    /// Compact things are refused: those with area/box above the first, ellipticity below the second **and** score
    /// below the third figure of any row. (0.6, 3.8, 50,000), (0.4, 4, 35,000), (0.3, 5, 27,500).
    pub compact: Vec<[f64; 3]>,
    /// Not in the document: a painted line has an even width, clusters of speckles have not. The widths of a blob's
    /// runs, each as part of the expected width in its row, may scatter by this part of their mean, or of the expected
    /// width if that is larger (0.3, measured: speckles 0.30 to 0.51, lines below 0.2 and worn hard curves up to 0.35,
    /// which are wider). Infinite switches it off.
    pub width_scatter: f64,
    /// Not in the document: mean residue above this (5 grey levels, measured: noise of a floor without a line up to 3.8,
    /// lines 15 and more). The threshold alone is relative: where there is no line it finds shapes in the noise.
    pub strength: f64,
}

impl Default for BlobLimits {
    fn default() -> Self {
        Self {
            area_part: 1.0 / 750.0,
            ellipticity: 1.7,
            score: 25_000.0,
            lambda_min_px2: 2.0,
            lambda_max_px2: 15.0,
            side_part: 1.0 / 32.0,
            orientation_rad: 72f64.to_radians(),
            compact: vec![[0.6, 3.8, 50_000.0], [0.4, 4.0, 35_000.0], [0.3, 5.0, 27_500.0]],
            width_scatter: 0.3,
            strength: 5.0,
        }
    }
}

/// Everything that can be adjusted about the extraction. The defaults are the document's (C3, C5 in SPEC) where it
/// gives a figure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExtractorOptions {
    /// The grey picture in which lines are sought.
    pub channel: Channel,
    /// Standard deviation of the Gaussian blur, before the filters and on their residue, in an image 320 px wide
    /// (2 px, C3); scaled with the image. 0 switches it off.
    pub blur_sigma_px: f64,
    /// Width of the first filter as part of the expected line width: narrower things vanish. (The document subtracts
    /// an offset that it does not give; this lets 1.5 cm tape pass where 2 cm are expected.)
    pub narrow_part: f64,
    /// Width of the second filter as part of the expected line width: wider things vanish. A line that leans by φ is
    /// 1/cos φ times as wide along a row.
    pub wide_part: f64,
    /// Rows where the line is expected to be narrower than this are ignored (px of the image in use): there it is
    /// no wider than the noise, or beyond the horizon.
    pub width_min_px: f64,
    /// Threshold = `threshold_mean_factor` · mean + `threshold_max_part` · maximum of the residue (1.5, C3).
    pub threshold_mean_factor: f64,
    /// See `threshold_mean_factor` (1/15, C3).
    pub threshold_max_part: f64,
    /// Where the residue's maximum is below this many grey levels, there is nothing but noise: no blobs.
    pub residue_min: f64,
    /// Which components count as lines.
    pub limits: BlobLimits,
}

impl Default for ExtractorOptions {
    fn default() -> Self {
        Self {
            channel: Channel::Luminance,
            blur_sigma_px: 2.0,
            narrow_part: 0.6,
            wide_part: 2.5,
            width_min_px: 1.5,
            threshold_mean_factor: 1.5,
            threshold_max_part: 1.0 / 15.0,
            residue_min: 3.0,
            limits: BlobLimits::default(),
        }
    }
}
