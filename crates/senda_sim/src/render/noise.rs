//! Noise of image sensors, from a tile drawn once.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Gaussian numbers for R, G and B, and 0, pixel after pixel. Every row of every frame starts elsewhere in it.
#[derive(Debug, Clone)]
pub(super) struct NoiseTile {
    values: Vec<i8>,
    width: usize,
}

/// Starting places: a power of two, small enough for the tile to stay in the first-level cache.
const STARTS: usize = 4096;

impl NoiseTile {
    /// For rows of `width` pixels.
    pub(super) fn new(width: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(0x6e6f_6973_6521);
        let values = (0..4 * (STARTS + width))
            .map(|i| {
                if i % 4 == 3 {
                    return 0;
                }
                // The sum of four uniform numbers, scaled to a standard deviation of 32; its tails end at 3.5 of them.
                let bits = random.next_u64();
                let sum: i64 = (0..4).map(|k| ((bits >> (16 * k)) & 0xffff) as i64).sum();
                // The variance of one is (65536² - 1) / 12.
                ((sum - 2 * 65_535) as f64 * 32.0 / (65_536.0 / 3f64.sqrt())).round() as i8
            })
            .collect();
        Self { values, width }
    }

    /// The noise of row `v` of the frame with this seed.
    pub(super) fn row(&self, seed: u64, v: usize) -> &[i8] {
        let start = (mixed(seed.wrapping_add((v as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15))) >> 32) as usize
            % STARTS;
        &self.values[4 * start..4 * (start + self.width)]
    }
}

/// A bijection that makes neighbouring numbers unlike (the finaliser of SplitMix64, Steele et al. 2014).
fn mixed(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tile_has_no_mean_and_the_promised_spread() {
        let tile = NoiseTile::new(320);
        let values: Vec<f64> = tile
            .values
            .iter()
            .enumerate()
            .filter(|(i, _)| i % 4 != 3)
            .map(|(_, v)| f64::from(*v))
            .collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
        assert!(mean.abs() < 0.7, "{mean}");
        assert!((variance.sqrt() - 32.0).abs() < 0.5, "{}", variance.sqrt());
    }

    #[test]
    fn rows_and_frames_start_elsewhere() {
        let tile = NoiseTile::new(64);
        assert_ne!(tile.row(1, 0), tile.row(1, 1));
        assert_ne!(tile.row(1, 0), tile.row(2, 0));
        assert_eq!(tile.row(7, 5), tile.row(7, 5));
    }
}
