//! Noise from integer hashes: the same on every machine, no tables to carry.

/// A hash of a lattice point (finaliser of MurmurHash3 over a linear mix).
pub(super) fn hash(x: i32, y: i32, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1)
        ^ (y as u32).wrapping_mul(0x85EB_CA77).rotate_left(13)
        ^ seed.wrapping_mul(0xC2B2_AE3D);
    h ^= h >> 16;
    h = h.wrapping_mul(0x85EB_CA6B);
    h ^= h >> 13;
    h = h.wrapping_mul(0xC2B2_AE35);
    h ^ (h >> 16)
}

/// A hash as a number in [0, 1).
pub(super) fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Folds a file's seed, and the use it is put to, into 32 bits.
pub(super) fn fold(seed: u64, use_number: u32) -> u32 {
    hash(seed as i32, (seed >> 32) as i32, use_number)
}

/// 0 below 0, 1 above 1, smooth in between.
pub(super) fn smooth(part: f32) -> f32 {
    let t = part.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Value noise in [0, 1): smooth between random values on the integer lattice.
pub(super) fn value(x: f64, y: f64, seed: u32) -> f32 {
    let (fx, fy) = (x.floor(), y.floor());
    let (ix, iy) = (fx as i64 as i32, fy as i64 as i32);
    let (tx, ty) = (smooth((x - fx) as f32), smooth((y - fy) as f32));
    let corner = |dx: i32, dy: i32| unit(hash(ix.wrapping_add(dx), iy.wrapping_add(dy), seed));
    let low = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * tx;
    let high = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * tx;
    low + (high - low) * ty
}

/// Value noise that repeats, with its random values drawn once: many samples for few hashes.
pub(super) struct Lattice {
    values: Vec<f32>,
    columns: i32,
    rows: i32,
}

impl Lattice {
    /// Noise that repeats every `columns` cells along x and `rows` along y.
    pub(super) fn new(columns: i32, rows: i32, seed: u32) -> Self {
        let values = (0..rows)
            .flat_map(|y| (0..columns).map(move |x| unit(hash(x, y, seed))))
            .collect();
        Self {
            values,
            columns,
            rows,
        }
    }

    /// Adds `weight` times the noise around 0.5 to a picture of rows of `columns`, whose pixel (i, j) lies at
    /// (i·`step_x`, j·`step_y`); the picture is one period.
    pub(super) fn add_picture(
        &self,
        sums: &mut [f32],
        columns: usize,
        step_x: f32,
        step_y: f32,
        weight: f32,
    ) {
        let next = |i: usize, period: i32| if i + 1 < period as usize { i + 1 } else { 0 };
        let places: Vec<(usize, usize, f32)> = (0..columns)
            .map(|column| {
                let x = column as f32 * step_x;
                let left = x as usize;
                (left, next(left, self.columns), smooth(x - left as f32))
            })
            .collect();
        // The lattice's rows below and above, spread over the columns.
        let spread = |row: usize, out: &mut Vec<f32>| {
            let values = &self.values[row * self.columns as usize..][..self.columns as usize];
            out.clear();
            out.extend(
                places
                    .iter()
                    .map(|(left, right, part)| values[*left] + (values[*right] - values[*left]) * part),
            );
        };
        let (mut low, mut high) = (Vec::with_capacity(columns), Vec::with_capacity(columns));
        let mut ready = usize::MAX;
        for (row, sums) in sums.chunks_exact_mut(columns).enumerate() {
            let y = row as f32 * step_y;
            let below = y as usize;
            let part = smooth(y - below as f32);
            if below != ready {
                spread(below, &mut low);
                spread(next(below, self.rows), &mut high);
                ready = below;
            }
            for ((sum, low), high) in sums.iter_mut().zip(&low).zip(&high) {
                *sum += (low + (high - low) * part - 0.5) * weight;
            }
        }
    }

    /// A value in [0, 1), smooth. `x` and `y` must lie in one period or the next: 0 ..= 2 periods.
    pub(super) fn at(&self, x: f32, y: f32) -> f32 {
        let (ix, iy) = (x as i32, y as i32);
        let (tx, ty) = (smooth(x - ix as f32), smooth(y - iy as f32));
        let wrap = |i: i32, period: i32| {
            let once = if i >= period { i - period } else { i };
            (if once >= period { once - period } else { once }) as usize
        };
        let (left, right) = (wrap(ix, self.columns), wrap(ix + 1, self.columns));
        let columns = self.columns as usize;
        let low_row = &self.values[wrap(iy, self.rows) * columns..][..columns];
        let high_row = &self.values[wrap(iy + 1, self.rows) * columns..][..columns];
        let low = low_row[left] + (low_row[right] - low_row[left]) * tx;
        let high = high_row[left] + (high_row[right] - high_row[left]) * tx;
        low + (high - low) * ty
    }
}

/// Three octaves of value noise, about [0, 1] with mean 0.5.
pub(super) fn clouds(x: f64, y: f64, seed: u32) -> f32 {
    (4.0 * value(x, y, seed)
        + 2.0 * value(x * 2.1, y * 2.1, seed ^ 0x51)
        + value(x * 4.3, y * 4.3, seed ^ 0xA7))
        / 7.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_its_range_mean_and_pinned_bits() {
        let mut sum = 0.0;
        for i in 0..10_000 {
            let n = value(f64::from(i) * 0.37, f64::from(i) * -0.11, 7);
            assert!((0.0..1.0).contains(&n));
            sum += f64::from(n);
        }
        assert!((sum / 10_000.0 - 0.5).abs() < 0.02, "{sum}");
        // Every world's picture hangs on these bits.
        assert_eq!(hash(3, -5, 11), 1_506_223_949);
    }

    #[test]
    fn tiling_noise_tiles() {
        let lattice = Lattice::new(8, 4, 3);
        for i in 0..40 {
            let (x, y) = (i as f32 * 0.171, i as f32 * 0.093);
            assert!((lattice.at(x, y) - lattice.at(x + 8.0, y + 4.0)).abs() < 1e-4);
        }
    }
}
