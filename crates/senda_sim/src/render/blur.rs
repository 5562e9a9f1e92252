//! Blur of a lens that is not quite in focus.

use super::kernel::Colours;

/// A Gaussian as repeated passes of three taps, across and down.
#[derive(Debug, Clone, Copy)]
pub(super) struct LensBlur {
    passes: u32,
    /// Weight of each neighbour (Q15); the middle keeps the rest.
    weight: i16,
}

/// Variance (px²) of one pass at most: neighbours of 0.3 still fall off smoothly.
const MOST_VARIANCE: f64 = 0.6;

impl LensBlur {
    pub(super) fn new(sigma_px: f64) -> Self {
        let variance = sigma_px * sigma_px;
        if variance < 0.02 {
            return Self { passes: 0, weight: 0 };
        }
        let passes = (variance / MOST_VARIANCE).ceil().min(64.0);
        // Two neighbours of weight w at distance 1 have variance 2w.
        let weight = (variance / passes).min(MOST_VARIANCE) / 2.0;
        Self {
            passes: passes as u32,
            weight: (weight * 32_768.0).round() as i16,
        }
    }

    pub(super) fn is_sharp(self) -> bool {
        self.passes == 0
    }

    /// Blurs a picture of rows of `groups` groups; the edges repeat.
    pub(super) fn apply(self, colours: &mut [Colours], groups: usize) {
        for _ in 0..self.passes {
            for row in colours.chunks_exact_mut(groups) {
                self.across(row.as_flattened_mut());
            }
            self.down(colours.as_flattened_mut(), groups * size_of::<Colours>() / 2);
        }
    }

    fn across(self, row: &mut [i16]) {
        let mut left: [i16; 4] = [row[0], row[1], row[2], row[3]];
        let count = row.len() / 4;
        for i in 0..count {
            let right = 4 * (i + 1).min(count - 1);
            for c in 0..4 {
                let here = row[4 * i + c];
                row[4 * i + c] = self.mixed(left[c], here, row[right + c]);
                left[c] = here;
            }
        }
    }

    fn down(self, colours: &mut [i16], stride: usize) {
        let rows = colours.len() / stride;
        // Each column block carries its row above; blocks of one group keep that in registers.
        for block in (0..stride).step_by(32) {
            let mut above = [0i16; 32];
            above.copy_from_slice(&colours[block..block + 32]);
            for v in 0..rows {
                let below = (v + 1).min(rows - 1) * stride + block;
                for i in 0..32 {
                    let here = colours[v * stride + block + i];
                    colours[v * stride + block + i] = self.mixed(above[i], here, colours[below + i]);
                    above[i] = here;
                }
            }
        }
    }

    #[inline(always)]
    fn mixed(self, a: i16, here: i16, b: i16) -> i16 {
        let around = i32::from(a) + i32::from(b) - 2 * i32::from(here);
        (i32::from(here) + ((around * i32::from(self.weight) + 16_384) >> 15)) as i16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_spreads_to_the_promised_width() {
        for sigma in [0.4, 0.8, 1.5] {
            let blur = LensBlur::new(sigma);
            let (groups, rows) = (4, 33);
            let mut picture = vec![[0i16; 32]; groups * rows];
            picture.as_flattened_mut()[(16 * 32 + 16) * 4] = 30_000;
            blur.apply(&mut picture, groups);
            let (mut sum, mut across, mut down) = (0.0, 0.0, 0.0);
            for (i, value) in picture.as_flattened().iter().step_by(4).enumerate() {
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
