//! Blur of a lens that is not quite in focus.

use super::kernel::{Colours, GROUP, Kernel};

/// A Gaussian as a chain of passes of three taps, across and down. Rows go in at one end and come out at the other,
/// so that only a few rows are in work.
#[derive(Debug, Clone)]
pub(super) struct LensBlur {
    /// Weight of both neighbours together (Q15).
    weight: i16,
    passes: Vec<Pass>,
}

#[derive(Debug, Clone)]
struct Pass {
    /// The rows before the latest and the latest, blurred across, and room for the next.
    rows: [Vec<Colours>; 3],
    out: Vec<Colours>,
    seen: usize,
}

/// Variance (px²) of one pass at most: neighbours of 0.3 each still fall off smoothly.
const MOST_VARIANCE: f64 = 0.6;

impl LensBlur {
    /// Of a standard deviation (px), for rows of `groups` groups.
    pub(super) fn new(sigma_px: f64, groups: usize) -> Self {
        let variance = sigma_px * sigma_px;
        let passes = if variance < 0.02 {
            0.0
        } else {
            (variance / MOST_VARIANCE).ceil().min(64.0)
        };
        // Two neighbours of weight w at distance 1 have variance 2w.
        let weight = (variance / passes.max(1.0)).min(MOST_VARIANCE);
        let row = || vec![[0; 4 * GROUP]; groups];
        Self {
            weight: (weight * 32_768.0).round() as i16,
            passes: (0..passes as usize)
                .map(|_| Pass {
                    rows: [row(), row(), row()],
                    out: row(),
                    seen: 0,
                })
                .collect(),
        }
    }

    /// Takes the next row of a picture and hands finished rows, from the top, to `finished`.
    pub(super) fn push(&mut self, kernel: Kernel, row: &[Colours], finished: &mut impl FnMut(&[Colours])) {
        self.push_into(0, kernel, row, finished);
    }

    /// After the last row of a picture: finishes what is in work.
    pub(super) fn flush(&mut self, kernel: Kernel, finished: &mut impl FnMut(&[Colours])) {
        for first in 0..self.passes.len() {
            let pass = &mut self.passes[first];
            let [above, here, _] = &pass.rows;
            kernel.blur_down([above, here, here], self.weight, &mut pass.out);
            pass.seen = 0;
            let out = std::mem::take(&mut pass.out);
            self.push_into(first + 1, kernel, &out, finished);
            self.passes[first].out = out;
        }
    }

    fn push_into(
        &mut self,
        first: usize,
        kernel: Kernel,
        row: &[Colours],
        finished: &mut impl FnMut(&[Colours]),
    ) {
        for index in first..self.passes.len() {
            let (before, rest) = self.passes.split_at_mut(index);
            let pass = &mut rest[0];
            let row = if index == first {
                row
            } else {
                &before[index - 1].out
            };
            let [above, here, below] = &mut pass.rows;
            kernel.blur_across(row, self.weight, below);
            if pass.seen == 0 {
                // The edge repeats.
                above.copy_from_slice(below);
                here.copy_from_slice(below);
                pass.seen = 1;
                return;
            }
            kernel.blur_down([above, here, below], self.weight, &mut pass.out);
            pass.rows.rotate_left(1);
        }
        match self.passes.last() {
            Some(last) if first < self.passes.len() => finished(&last.out),
            _ => finished(row),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_spreads_to_the_promised_width() {
        for sigma in [0.0, 0.4, 0.7, 1.5] {
            let (groups, rows) = (4, 33);
            let mut blur = LensBlur::new(sigma, groups);
            let mut picture = vec![[0i16; 32]; groups * rows];
            picture.as_flattened_mut()[(16 * 32 + 16) * 4] = 30_000;
            let mut blurred: Vec<i16> = Vec::new();
            let mut finished = |row: &[Colours]| blurred.extend(row.as_flattened());
            for row in picture.chunks(groups) {
                blur.push(Kernel::Portable, row, &mut finished);
            }
            blur.flush(Kernel::Portable, &mut finished);
            assert_eq!(blurred.len(), 32 * groups * rows);
            let (mut sum, mut across, mut down) = (0.0, 0.0, 0.0);
            for (i, value) in blurred.iter().step_by(4).enumerate() {
                let (du, dv) = ((i % 32) as f64 - 16.0, (i / 32) as f64 - 16.0);
                let value = f64::from(*value);
                sum += value;
                across += value * du * du;
                down += value * dv * dv;
            }
            assert!((sum / 30_000.0 - 1.0).abs() < 0.02, "{sum}");
            for variance in [across / sum, down / sum] {
                assert!(
                    (variance.sqrt() - sigma).abs() < 0.06,
                    "{sigma}: {}",
                    variance.sqrt()
                );
            }
        }
    }
}
