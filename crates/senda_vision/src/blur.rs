//! Gaussian blur of grey pictures in integer arithmetic.

use crate::simd::{Kernel, Level};
use senda_geom::trig;

/// Fraction bits of [`GaussianBlur::blur_fine`]'s result: 255 grey levels become 65,280.
pub const FINE_BITS: u32 = 8;

/// A separable Gaussian filter with the picture's border repeated outwards. Owns its row buffers.
///
/// Intermediate values have 8 fraction bits; the weights have 8 across the rows and 16 along them: the result is within
/// one grey level of the exact convolution, and the same on every processor.
#[derive(Debug, Clone)]
pub struct GaussianBlur {
    /// Weights across the rows, centre first, then outwards; centre + 2 · the others = 256. Empty: no blur.
    across: Vec<u16>,
    /// Weights along a row, centre first; centre + the others = 65,536 (the others stand for both sides).
    along: Vec<u16>,
    /// One row after the first pass, with a margin of repeated values at either side.
    row: Vec<u16>,
    /// One row of sums of the second pass.
    sums: Vec<u16>,
    level: Level,
}

impl GaussianBlur {
    /// A filter of standard deviation `sigma_px` (px), cut off at 3σ. Below 0.2 px it changes nothing.
    pub fn new(sigma_px: f64) -> Self {
        Self::with_level(sigma_px, Level::detect())
    }

    pub(crate) fn with_level(sigma_px: f64, level: Level) -> Self {
        let (mut across, mut along) = (Vec::new(), Vec::new());
        if sigma_px >= 0.2 {
            // 20 px: far beyond any use; keeps a foreign number from asking for the impossible.
            let sigma_px = sigma_px.min(20.0);
            let radius = (3.0 * sigma_px).ceil() as usize;
            let exact: Vec<f64> = (0..=radius)
                .map(|k| trig::exp(-0.5 * (k as f64 / sigma_px) * (k as f64 / sigma_px)))
                .collect();
            let sum = exact[0] + 2.0 * exact[1..].iter().sum::<f64>();
            // Rounding must neither brighten nor darken: the centre takes the difference.
            across = exact
                .iter()
                .map(|weight| (weight / sum * 256.0).round() as u16)
                .collect();
            across[0] = 256 - 2 * across[1..].iter().sum::<u16>();
            while across.last() == Some(&0) {
                across.pop();
            }
            let both = |weight: &f64| (2.0 * weight / sum * 65_536.0).round() as u16;
            along = exact.iter().map(both).collect();
            let sides: u32 = along[1..].iter().map(|weight| u32::from(*weight)).sum();
            along[0] = (65_536 - sides).min(65_535) as u16;
        }
        Self {
            across,
            along,
            row: Vec::new(),
            sums: Vec::new(),
            level,
        }
    }

    /// Blurs `source` (rows of `width` pixels) into `target`, rounded to whole grey levels.
    ///
    /// # Panics
    /// When the lengths differ or are not whole rows.
    pub fn blur(&mut self, source: &[u8], width: usize, target: &mut [u8]) {
        assert_eq!(source.len(), target.len());
        if self.across.is_empty() || source.is_empty() {
            target.copy_from_slice(source);
        } else {
            self.run(source, width, target);
        }
    }

    /// Blurs `source` into `target` with [`FINE_BITS`] fraction bits: 256 stands for one grey level.
    ///
    /// # Panics
    /// When the lengths differ or are not whole rows.
    pub fn blur_fine(&mut self, source: &[u8], width: usize, target: &mut [u16]) {
        assert_eq!(source.len(), target.len());
        if self.across.is_empty() || source.is_empty() {
            for (to, from) in target.iter_mut().zip(source) {
                *to = u16::from(*from) << FINE_BITS;
            }
        } else {
            self.run(source, width, target);
        }
    }

    fn run<T: Sample>(&mut self, source: &[u8], width: usize, target: &mut [T]) {
        assert!(
            width > 0 && source.len().is_multiple_of(width),
            "expected whole rows"
        );
        self.row.resize(width + 2 * (self.along.len() - 1), 0);
        self.sums.resize(width, 0);
        self.level.run(BlurKernel {
            blur: self,
            source,
            width,
            target,
        });
    }
}

/// What the second pass writes.
trait Sample: Copy {
    fn from_fine(fine: u16) -> Self;
}

impl Sample for u8 {
    #[inline(always)]
    fn from_fine(fine: u16) -> Self {
        // At most 65,280 + 128: no overflow.
        ((fine + (1 << (FINE_BITS - 1))) >> FINE_BITS) as u8
    }
}

impl Sample for u16 {
    #[inline(always)]
    fn from_fine(fine: u16) -> Self {
        fine
    }
}

struct BlurKernel<'a, T> {
    blur: &'a mut GaussianBlur,
    source: &'a [u8],
    width: usize,
    target: &'a mut [T],
}

impl<T: Sample> Kernel for BlurKernel<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.width;
        let GaussianBlur {
            across,
            along,
            row,
            sums,
            ..
        } = self.blur;
        let margin = along.len() - 1;
        let last = self.source.len() / width - 1;
        let line = |y: usize| &self.source[y * width..(y + 1) * width];
        for (y, target) in self.target.chunks_exact_mut(width).enumerate() {
            let middle = &mut row[margin..margin + width];
            let above = |k: usize| line(y.saturating_sub(k));
            let below = |k: usize| line((y + k).min(last));
            scale_row(middle, line(y), across[0]);
            // Three pairs of rows a time: each sum is fetched and put back once for six rows.
            let mut k = 1;
            while k + 2 < across.len() {
                add_rows(middle, [k, k + 1, k + 2].map(|k| (above(k), below(k), across[k])));
                k += 3;
            }
            while k < across.len() {
                add_rows(middle, [(above(k), below(k), across[k])]);
                k += 1;
            }
            let (first, end) = (row[margin], row[margin + width - 1]);
            row[..margin].fill(first);
            row[margin + width..].fill(end);
            scale_fine(sums, &row[margin..margin + width], along[0]);
            let left = |k: usize| &row[margin - k..margin - k + width];
            let right = |k: usize| &row[margin + k..margin + k + width];
            let mut k = 1;
            while k + 2 < along.len() {
                add_fine(sums, [k, k + 1, k + 2].map(|k| (left(k), right(k), along[k])));
                k += 3;
            }
            while k < along.len() {
                add_fine(sums, [(left(k), right(k), along[k])]);
                k += 1;
            }
            for (to, fine) in target.iter_mut().zip(&*sums) {
                *to = T::from_fine(*fine);
            }
        }
    }
}

#[inline(always)]
fn scale_row(sums: &mut [u16], row: &[u8], weight: u16) {
    for (sum, value) in sums.iter_mut().zip(row) {
        *sum = u16::from(*value) * weight;
    }
}

/// Adds pairs of rows with their weights. All weights together are 256: the sums stay within 65,280.
#[inline(always)]
fn add_rows<const PAIRS: usize>(sums: &mut [u16], pairs: [(&[u8], &[u8], u16); PAIRS]) {
    let width = sums.len();
    let pairs = pairs.map(|(above, below, weight)| (&above[..width], &below[..width], weight));
    for x in 0..width {
        let mut sum = sums[x];
        for (above, below, weight) in pairs {
            sum = sum.wrapping_add((u16::from(above[x]) + u16::from(below[x])).wrapping_mul(weight));
        }
        sums[x] = sum;
    }
}

/// The upper 16 bits of the product: one instruction on vectors.
#[inline(always)]
fn multiply_high(a: u16, b: u16) -> u16 {
    ((u32::from(a) * u32::from(b)) >> 16) as u16
}

/// Rounded up, which on average makes up for part of what [`multiply_high`] cuts off.
#[inline(always)]
fn average(a: u16, b: u16) -> u16 {
    ((u32::from(a) + u32::from(b) + 1) >> 1) as u16
}

#[inline(always)]
fn scale_fine(sums: &mut [u16], row: &[u16], weight: u16) {
    for (sum, value) in sums.iter_mut().zip(row) {
        *sum = multiply_high(*value, weight);
    }
}

#[inline(always)]
fn add_fine<const PAIRS: usize>(sums: &mut [u16], pairs: [(&[u16], &[u16], u16); PAIRS]) {
    let width = sums.len();
    let pairs = pairs.map(|(left, right, weight)| (&left[..width], &right[..width], weight));
    for x in 0..width {
        let mut sum = sums[x];
        for (left, right, weight) in pairs {
            sum = sum.wrapping_add(multiply_high(average(left[x], right[x]), weight));
        }
        sums[x] = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Separable convolution in floating point, border repeated.
    fn reference(source: &[u8], width: usize, sigma: f64) -> Vec<f64> {
        let height = source.len() / width;
        let radius = (3.0 * sigma).ceil() as i64;
        let weights: Vec<f64> = (-radius..=radius)
            .map(|k| trig::exp(-0.5 * (k as f64 / sigma) * (k as f64 / sigma)))
            .collect();
        let sum: f64 = weights.iter().sum();
        let pass = |values: &[f64], dx: i64, dy: i64| -> Vec<f64> {
            (0..values.len())
                .map(|i| {
                    let (x, y) = ((i % width) as i64, (i / width) as i64);
                    (-radius..=radius)
                        .zip(&weights)
                        .map(|(k, weight)| {
                            let u = (x + k * dx).clamp(0, width as i64 - 1) as usize;
                            let v = (y + k * dy).clamp(0, height as i64 - 1) as usize;
                            weight / sum * values[v * width + u]
                        })
                        .sum()
                })
                .collect()
        };
        let exact: Vec<f64> = source.iter().map(|value| f64::from(*value)).collect();
        pass(&pass(&exact, 0, 1), 1, 0)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn within_one_grey_level_of_the_exact_convolution(
            (width, source) in (1usize..50).prop_flat_map(|width| {
                (1usize..20).prop_flat_map(move |height| {
                    prop::collection::vec(any::<u8>(), width * height).prop_map(move |source| (width, source))
                })
            }),
            sigma in prop::sample::select(vec![0.3, 0.77, 1.0, 2.0, 4.0]),
        ) {
            let exact = reference(&source, width, sigma);
            let mut rounded = vec![0; source.len()];
            let mut fine = vec![0; source.len()];
            let mut fine_baseline = vec![0; source.len()];
            GaussianBlur::new(sigma).blur(&source, width, &mut rounded);
            GaussianBlur::new(sigma).blur_fine(&source, width, &mut fine);
            GaussianBlur::with_level(sigma, Level::Baseline).blur_fine(&source, width, &mut fine_baseline);
            prop_assert_eq!(&fine, &fine_baseline);
            for ((exact, rounded), fine) in exact.iter().zip(&rounded).zip(&fine) {
                prop_assert!((exact - f64::from(*fine) / 256.0).abs() < 1.0, "{exact} {fine}");
                prop_assert!((exact - f64::from(*rounded)).abs() < 1.5, "{exact} {rounded}");
            }
        }
    }

    #[test]
    fn flat_pictures_stay_as_they_are() {
        for sigma in [0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 3.3, 9.0, 1e9] {
            for grey in [0, 1, 77, 254, 255] {
                let source = vec![grey; 40 * 12];
                let mut target = vec![0; source.len()];
                GaussianBlur::new(sigma).blur(&source, 40, &mut target);
                assert_eq!(target, source, "sigma {sigma}");
            }
        }
    }

    #[test]
    fn not_a_number_changes_nothing() {
        let mut target = [0; 2];
        GaussianBlur::new(f64::NAN).blur(&[3, 200], 2, &mut target);
        assert_eq!(target, [3, 200]);
    }
}
