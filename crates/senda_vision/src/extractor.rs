//! From a frame to the blobs that may be lines: C3 to C6 in SPEC.

use crate::blob::{Rejection, Scale};
use crate::blob_pool::{BlobPool, Residue};
use crate::blur::{FINE_BITS, GaussianBlur};
use crate::components::Components;
use crate::luminance::Grey;
use crate::morphology::LineResidue;
use crate::simd::{Kernel, Level};
use crate::{Channel, Contrast, ExtractorOptions, LineBlob, WidthProfile};
use senda_core::Image;

/// What the log keeps of each extraction (C15 in SPEC), in grey levels of the blurred residue, over the whole frame; rows
/// in which no line is expected have none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Statistics {
    /// Mean.
    pub mean: f64,
    /// Largest value.
    pub max: f64,
    /// 1.5 · mean + max / 15 with the default options.
    pub threshold: f64,
}

/// How strongly a frame speaks for dark and for light lines (C4): the sums over all accepted blobs and fragments of
/// score times mean residue times the part of their rows that the picture's edge does not cut.
///
/// The document sums the scores alone. They know nothing of strength: beside a dark line, under light that falls off
/// to one side, a faint light shoulder of a few grey levels has a larger box than the line itself. And the strip of
/// floor between a line and the picture's edge looks like a line of the other kind, of which half is out of sight.
/// Fragments count because a first frame may show nothing but dashes.
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
    /// For the size in use.
    profile: WidthProfile,
    /// First row in which a line is expected: what lies above it, beyond the horizon, is not looked at.
    top: usize,
    scale: Scale,
    level: Level,
    grey: Vec<u8>,
    blurred: Vec<u8>,
    residue: Vec<u8>,
    fine: Vec<u16>,
    mask_row: Vec<u8>,
    blur: GaussianBlur,
    filter: LineResidue,
    components: Components,
    pool: BlobPool,
    fragments: BlobPool,
    rejected: Vec<Rejection>,
    statistics: Statistics,
}

/// A fragment's area is above this part of a whole line's least area: a guess that lets the farthest dash pass.
const FRAGMENT_AREA_PART: f64 = 0.3;

/// With less than this part of its rows whole a component is cut by the picture's side, and its shape is not its own.
const CUT_PART: f64 = 0.3;

/// The image width that lengths in options and limits refer to (C3, C5 in SPEC).
const REFERENCE_WIDTH_PX: f64 = 320.0;

impl LineExtractor {
    /// For frames of `width` x `height` pixels; `profile` may be for another size, it is scaled (C6).
    pub fn new(width: usize, height: usize, profile: &WidthProfile, options: ExtractorOptions) -> Self {
        Self::with_level(width, height, profile, options, Level::detect())
    }

    pub(crate) fn with_level(
        width: usize,
        height: usize,
        profile: &WidthProfile,
        options: ExtractorOptions,
        level: Level,
    ) -> Self {
        let profile = profile.scaled(width as u32, height as u32);
        let sigma_px = options.blur_sigma_px * width as f64 / REFERENCE_WIDTH_PX;
        let widths: Vec<(usize, usize)> = (0..height)
            .map(|y| {
                let expected = profile.at(y as f64 + 0.5);
                if expected < options.width_min_px {
                    return (0, 0);
                }
                let narrow = (expected * options.narrow_part).floor();
                let wide = (expected * options.wide_part).ceil();
                (narrow as usize, wide as usize)
            })
            .collect();
        let top = widths.iter().position(|width| *width != (0, 0)).unwrap_or(height);
        let pixels = width * (height - top);
        Self {
            profile,
            top,
            scale: Scale::new(width, height),
            grey: vec![0; pixels],
            blurred: vec![0; pixels],
            residue: vec![0; pixels],
            fine: vec![0; pixels],
            mask_row: vec![0; width.next_multiple_of(8)],
            blur: GaussianBlur::with_level(sigma_px, level),
            filter: LineResidue::with_level(width, widths[top..].iter().copied(), level),
            components: Components::with_size(width, height),
            pool: BlobPool::default(),
            fragments: BlobPool::default(),
            rejected: Vec::new(),
            statistics: Statistics::default(),
            width,
            height,
            options,
            level,
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

    /// First row in which a line is expected (C3 looks at nothing above it).
    pub fn top(&self) -> usize {
        self.top
    }

    /// Narrow and wide width of the two filters (px) in each row from [`LineExtractor::top`] on.
    pub fn filter_widths(&self) -> &[(usize, usize)] {
        self.filter.widths()
    }

    /// Looks for lines in another channel from now on.
    pub fn use_channel(&mut self, channel: Channel) {
        self.options.channel = channel;
    }

    /// Both ways of looking at a frame (C4).
    pub fn contrast_scores(&mut self, image: &Image) -> ContrastScores {
        let shown = |blob: &LineBlob| blob.score * blob.residue_mean * blob.whole_part();
        let mut total = |contrast| {
            let whole: f64 = self.extract(image, contrast).iter().map(shown).sum();
            whole + self.fragments().iter().map(shown).sum::<f64>()
        };
        ContrastScores {
            dark: total(Contrast::Dark),
            light: total(Contrast::Light),
        }
    }

    /// Whether the frame shows dark or light lines (C4): the larger total score wins; without any accepted blob the
    /// stronger residue.
    pub fn decide_contrast(&mut self, image: &Image) -> Contrast {
        let scores = self.contrast_scores(image);
        if scores.dark != scores.light {
            return if scores.light > scores.dark {
                Contrast::Light
            } else {
                Contrast::Dark
            };
        }
        self.extract(image, Contrast::Dark);
        let dark = self.statistics.max;
        self.extract(image, Contrast::Light);
        if self.statistics.max > dark {
            Contrast::Light
        } else {
            Contrast::Dark
        }
    }

    /// The blobs that pass all limits of C5, largest score first. Valid until the next call.
    ///
    /// A frame of another size than the extractor's is stretched over it by nearest neighbour, so that a camera that
    /// changes its mode costs precision, not the drive. An empty image gives no blobs.
    pub fn extract(&mut self, image: &Image, contrast: Contrast) -> &[LineBlob] {
        self.pool.clear();
        self.fragments.clear();
        self.components.clear();
        self.rejected.clear();
        self.statistics = Statistics::default();
        if image.is_empty() || self.grey.is_empty() {
            return &[];
        }
        self.convert(image);
        self.blur.blur(&self.grey, self.width, &mut self.blurred);
        self.filter.filter(&self.blurred, contrast, &mut self.residue);
        self.blur.blur_fine(&self.residue, self.width, &mut self.fine);
        self.measure();
        if self.statistics.max >= self.options.residue_min {
            self.label();
            self.describe();
        }
        self.blobs()
    }

    /// The accepted blobs of the last [`LineExtractor::extract`].
    pub fn blobs(&self) -> &[LineBlob] {
        self.pool.blobs()
    }

    /// Pieces of the last extraction that are as wide as a line but too short or too small to pass C5: dashes, and what
    /// shows of a line between reflections. For [`crate::LineJoiner`].
    pub fn fragments(&mut self) -> &[LineBlob] {
        self.collect_fragments(false)
    }

    /// The same with the components that were refused for their uneven width (a line that melts with a reflection) or
    /// that the picture's side cuts: everything in which whoever knows where a line should be may find a piece of it.
    pub fn pieces(&mut self) -> &[LineBlob] {
        self.collect_fragments(true)
    }

    fn collect_fragments(&mut self, all: bool) -> &[LineBlob] {
        let Self {
            fragments,
            components,
            scale,
            options,
            profile,
            ..
        } = self;
        let limits = &options.limits;
        let residue = Residue {
            fine: &self.fine,
            top: self.top,
            width: self.width,
            profile,
        };
        let area_min = scale.area_min(limits) * FRAGMENT_AREA_PART;
        fragments.collect(components, residue, |moments, blob| {
            if moments.count as f64 <= area_min {
                return false;
            }
            blob.set_moments(moments, scale);
            match scale.check(blob, limits) {
                Ok(()) => all,
                Err(Rejection::LambdaMin) => false,
                Err(_) => true,
            }
        });
        fragments.retain(|blob| {
            if blob.residue_mean <= limits.strength {
                return false;
            }
            if !all {
                return scale.is_fragment(blob, profile);
            }
            let accepted =
                scale.check(blob, limits).is_ok() && scale.check_paint(blob, profile, limits).is_ok();
            !accepted && (scale.is_piece(blob, profile) || blob.whole_part() < CUT_PART)
        });
        fragments.sort();
        fragments.blobs()
    }

    /// What the last call of [`LineExtractor::fragments`] or [`LineExtractor::pieces`] found.
    pub fn found_fragments(&self) -> &[LineBlob] {
        self.fragments.blobs()
    }

    /// Why the other components of the last extraction were refused, in the order of their first pixels.
    pub fn rejected(&self) -> &[Rejection] {
        &self.rejected
    }

    /// Mean, maximum and threshold of the last extraction.
    pub fn statistics(&self) -> Statistics {
        self.statistics
    }

    /// Writes 255 where the last extraction's residue is above its threshold and 0 elsewhere: what shows as lines before
    /// shapes are judged. For whoever looks for lines by edges (A5 in SPEC).
    ///
    /// # Panics
    /// When `mask` has not one byte for each pixel of a frame.
    pub fn mask(&self, mask: &mut [u8]) {
        assert_eq!(mask.len(), self.width * self.height);
        if self.statistics.max < self.options.residue_min {
            return mask.fill(0);
        }
        let (above, looked_at) = mask.split_at_mut(self.width * self.top);
        above.fill(0);
        self.level.run(Threshold {
            values: &self.fine,
            threshold: self.fine_threshold(),
            mask: looked_at,
        });
        for bit in looked_at {
            *bit *= 255;
        }
    }

    /// The threshold in units of the fine residue.
    fn fine_threshold(&self) -> u16 {
        (self.statistics.threshold * f64::from(1 << FINE_BITS)).floor() as u16
    }

    fn convert(&mut self, image: &Image) {
        let grey = Grey::new(self.options.channel);
        if (image.width(), image.height()) == (self.width, self.height) {
            let start = self.top * self.width * image.channels().count();
            grey.convert(
                image.channels(),
                &image.pixels()[start..],
                &mut self.grey,
                self.level,
            );
        } else {
            for (y, row) in self.grey.chunks_exact_mut(self.width).enumerate() {
                let from_y = (y + self.top) * image.height() / self.height;
                for (x, to) in row.iter_mut().enumerate() {
                    let from_x = x * image.width() / self.width;
                    *to = grey.of_pixel(image.pixel(from_x, from_y));
                }
            }
        }
    }

    fn measure(&mut self) {
        let (sum, max) = self.level.run(SumAndMax(&self.fine));
        let one = f64::from(1 << FINE_BITS);
        let mean = sum as f64 / (self.width * self.height) as f64 / one;
        let max = f64::from(max) / one;
        let threshold = self.options.threshold_mean_factor * mean + self.options.threshold_max_part * max;
        self.statistics = Statistics { mean, max, threshold };
    }

    fn label(&mut self) {
        let threshold = self.fine_threshold();
        let (fine, width, level, top) = (&self.fine, self.width, self.level, self.top);
        self.components.label(self.height, &mut self.mask_row, |y, mask| {
            let Some(y) = y.checked_sub(top) else {
                return mask.fill(0);
            };
            level.run(Threshold {
                values: &fine[y * width..(y + 1) * width],
                threshold,
                mask,
            });
        });
    }

    fn describe(&mut self) {
        let Self {
            pool,
            components,
            rejected,
            scale,
            options,
            profile,
            ..
        } = self;
        let limits = &options.limits;
        let residue = Residue {
            fine: &self.fine,
            top: self.top,
            width: self.width,
            profile,
        };
        pool.collect(components, residue, |moments, blob| {
            // Most components are specks: their area settles it.
            let result = if moments.count as f64 <= scale.area_min(limits) {
                Err(Rejection::Area)
            } else {
                blob.set_moments(moments, scale);
                scale.check(blob, limits)
            };
            result.map_err(|rejection| rejected.push(rejection)).is_ok()
        });
        pool.retain(|blob| {
            let result = scale.check_paint(blob, profile, limits);
            result.map_err(|rejection| rejected.push(rejection)).is_ok()
        });
        pool.sort();
    }
}

struct SumAndMax<'a>(&'a [u16]);

impl Kernel for SumAndMax<'_> {
    type Output = (u64, u16);

    #[inline(always)]
    fn run(self) -> (u64, u16) {
        let (mut sum, mut max) = (0u64, 0u16);
        // 65,536 values of 16 bits fit in 32 bits; 4,096 keep well inside.
        for piece in self.0.chunks(4096) {
            let (mut part, mut part_max) = (0u32, 0u16);
            for value in piece {
                part += u32::from(*value);
                part_max = part_max.max(*value);
            }
            sum += u64::from(part);
            max = max.max(part_max);
        }
        (sum, max)
    }
}

struct Threshold<'a> {
    values: &'a [u16],
    threshold: u16,
    mask: &'a mut [u8],
}

impl Kernel for Threshold<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (mask, value) in self.mask.iter_mut().zip(self.values) {
            *mask = u8::from(*value > self.threshold);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_core::Channels;

    #[test]
    fn every_processor_gives_the_same_blobs() {
        // A leaning band over a rough floor, in colour.
        let (width, height) = (173, 131);
        let mut image = Image::new(width, height, Channels::Rgb);
        let mut state = 1u32;
        for y in 0..height {
            for x in 0..width {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let grey = if (x + y / 3).abs_diff(90) < 9 { 60 } else { 150 } + (state >> 27) as u8;
                image.row_mut(y)[3 * x..3 * x + 3].copy_from_slice(&[grey, grey / 2, grey / 3 + 40]);
            }
        }
        let profile = WidthProfile {
            intercept_px: 12.0,
            slope_px_per_row: 0.05,
            width_px: width as u32,
            height_px: height as u32,
        };
        let mut extractors = [Level::Baseline, Level::detect()].map(|level| {
            LineExtractor::with_level(width, height, &profile, ExtractorOptions::default(), level)
        });
        for contrast in [Contrast::Dark, Contrast::Light] {
            let [baseline, detected] = &mut extractors;
            let blobs = baseline.extract(&image, contrast).to_vec();
            assert_eq!(blobs, detected.extract(&image, contrast));
            assert_eq!(baseline.statistics(), detected.statistics());
            assert_eq!(baseline.fragments(), detected.fragments());
            assert_eq!(blobs.len(), usize::from(contrast == Contrast::Dark));
        }
    }
}
