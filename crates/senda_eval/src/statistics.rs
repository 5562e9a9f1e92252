//! Rates and means with their uncertainty: what a single lucky lap does not tell.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use senda_geom::trig;
use serde::{Deserialize, Serialize};

/// Two-sided 95 % quantile of the normal distribution.
const Z_95: f64 = 1.959_963_984_540_054;

/// An estimate with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The estimate itself.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Interval {
    /// All of it times a factor above 0, for other units.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            value: factor * self.value,
            low: factor * self.low,
            high: factor * self.high,
        }
    }
}

/// How often something happened: `hits` of `count`, with Wilson's 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Rate {
    /// How often it happened.
    pub hits: u64,
    /// How often it could have happened.
    pub count: u64,
    /// The rate and its interval, each in 0..=1. With `count` 0 nothing is known: 0 within 0..1.
    #[serde(flatten)]
    pub interval: Interval,
}

/// The rate of `hits` in `count` with Wilson's 95 % score interval (Wilson 1927), which stays inside 0..1 and is honest
/// at 0 and at 100 %: 0 losses in 500 runs gives an upper end of 0.76 %.
pub fn rate(hits: u64, count: u64) -> Rate {
    let hits = hits.min(count);
    let interval = if count == 0 {
        Interval {
            value: 0.0,
            low: 0.0,
            high: 1.0,
        }
    } else {
        let n = count as f64;
        let part = hits as f64 / n;
        let z2 = Z_95 * Z_95;
        let centre = (part + z2 / (2.0 * n)) / (1.0 + z2 / n);
        let half = Z_95 / (1.0 + z2 / n) * (part * (1.0 - part) / n + z2 / (4.0 * n * n)).sqrt();
        Interval {
            value: part,
            // Exact at the ends; rounding would leave 1e-18.
            low: if hits == 0 { 0.0 } else { (centre - half).max(0.0) },
            high: if hits == count {
                1.0
            } else {
                (centre + half).min(1.0)
            },
        }
    };
    Rate {
        hits,
        count,
        interval,
    }
}

/// Arithmetic mean; `None` without values.
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Standard deviation of a sample (divides by n - 1); `None` with fewer than two values.
pub fn standard_deviation(values: &[f64]) -> Option<f64> {
    let centre = mean(values)?;
    let squares: f64 = values.iter().map(|v| (v - centre) * (v - centre)).sum();
    (values.len() > 1).then(|| (squares / (values.len() - 1) as f64).sqrt())
}

/// Root of the mean square; `None` without values.
pub fn root_mean_square(values: &[f64]) -> Option<f64> {
    let squares: f64 = values.iter().map(|v| v * v).sum();
    (!values.is_empty()).then(|| (squares / values.len() as f64).sqrt())
}

/// The `part` quantile (0..=1) by linear interpolation between order statistics (type 7 of Hyndman & Fan 1996, the
/// default of R and NumPy). Values that are not finite are left out; `None` if none is left.
pub fn quantile(values: &[f64], part: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    if sorted.is_empty() {
        return None;
    }
    sorted.sort_by(f64::total_cmp);
    let place = part.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    Some(sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64))
}

/// The middle value; `None` without finite values.
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// Pearson's correlation of pairs; `None` with fewer than two pairs or when either side is constant.
pub fn correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    if pairs.len() < 2 {
        return None;
    }
    let n = pairs.len() as f64;
    let (mean_a, mean_b) = (
        pairs.iter().map(|p| p.0).sum::<f64>() / n,
        pairs.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in pairs {
        aa += (a - mean_a) * (a - mean_a);
        bb += (b - mean_b) * (b - mean_b);
        ab += (a - mean_a) * (b - mean_b);
    }
    // The mean of equal numbers is rounded: what is left of them is no change.
    let changes = |sum: f64, mean: f64| sum > n * (1e-12 * mean) * (1e-12 * mean);
    (changes(aa, mean_a) && changes(bb, mean_b)).then(|| (ab / (aa.sqrt() * bb.sqrt())).clamp(-1.0, 1.0))
}

/// Mean with Student's 95 % interval: right for roughly normal values, and for means of many. `None` without values;
/// one value has an endless interval.
pub fn mean_interval(values: &[f64]) -> Option<Interval> {
    let value = mean(values)?;
    let Some(deviation) = standard_deviation(values) else {
        return Some(Interval {
            value,
            low: f64::NEG_INFINITY,
            high: f64::INFINITY,
        });
    };
    let half = student_95(values.len() - 1) * deviation / (values.len() as f64).sqrt();
    Some(Interval {
        value,
        low: value - half,
        high: value + half,
    })
}

/// Mean with the percentile bootstrap's 95 % interval (Efron 1979): no assumption about the shape of the values, so
/// right for errors and times, which are skewed. The same seed gives the same interval. `None` without values.
pub fn bootstrap_mean(values: &[f64], resamples: usize, seed: u64) -> Option<Interval> {
    let value = mean(values)?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let count = values.len() as u64;
    let means: Vec<f64> = (0..resamples.max(1))
        .map(|_| {
            let sum: f64 = (0..count)
                // Multiply-shift (Lemire 2019): uniform below `count` but for a bias of count / 2^64.
                .map(|_| values[((u128::from(random.next_u64()) * u128::from(count)) >> 64) as usize])
                .sum();
            sum / count as f64
        })
        .collect();
    Some(Interval {
        value,
        low: quantile(&means, 0.025).unwrap_or(value),
        high: quantile(&means, 0.975).unwrap_or(value),
    })
}

/// Two-sided 95 % quantile of Student's t with `degrees` degrees of freedom.
///
/// Exact for 1 and 2; otherwise the Cornish-Fisher expansion about the normal quantile (Abramowitz & Stegun 26.7.5),
/// off by less than 0.5 % at 3 and by less than 0.01 % from 6 on.
pub fn student_95(degrees: usize) -> f64 {
    match degrees {
        0 => f64::INFINITY,
        1 => 1.0 / trig::tan(std::f64::consts::PI * 0.025),
        2 => 0.95 * (2.0 / (1.0 - 0.95f64 * 0.95)).sqrt(),
        _ => {
            let (n, z) = (degrees as f64, Z_95);
            let z2 = z * z;
            let g1 = z * (z2 + 1.0) / 4.0;
            let g2 = z * ((5.0 * z2 + 16.0) * z2 + 3.0) / 96.0;
            let g3 = z * (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / 384.0;
            let g4 = z * ((((79.0 * z2 + 776.0) * z2 + 1482.0) * z2 - 1920.0) * z2 - 945.0) / 92_160.0;
            z + g1 / n + g2 / (n * n) + g3 / (n * n * n) + g4 / (n * n * n * n)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn close(found: f64, expected: f64, tolerance: f64) {
        assert!(
            (found - expected).abs() <= tolerance,
            "expected {expected}, but found {found}"
        );
    }

    #[test]
    fn wilson_matches_published_values() {
        // Newcombe 1998, table I, method 3 (score without continuity correction).
        for (hits, count, low, high) in [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ] {
            let found = rate(hits, count).interval;
            close(found.low, low, 5e-5);
            close(found.high, high, 5e-5);
        }
        close(rate(0, 500).interval.high, 0.007_624, 1e-6);
        assert_eq!(rate(500, 500).interval.high, 1.0);
        assert_eq!(
            rate(0, 0).interval,
            Interval {
                value: 0.0,
                low: 0.0,
                high: 1.0
            }
        );
    }

    #[test]
    fn student_matches_the_table() {
        let table = [
            (1, 12.7062),
            (2, 4.30265),
            (3, 3.18245),
            (4, 2.77645),
            (5, 2.57058),
            (9, 2.26216),
            (29, 2.04523),
        ];
        for (degrees, expected) in table {
            close(student_95(degrees), expected, 0.005 * expected);
        }
        close(student_95(9), 2.26216, 1e-3);
        close(student_95(100_000), Z_95, 1e-4);
    }

    #[test]
    fn quantiles_interpolate_as_numpy_does() {
        let values = [4.0, f64::NAN, 1.0, 3.0, 2.0];
        close(quantile(&values, 0.25).unwrap(), 1.75, 1e-15);
        close(median(&values).unwrap(), 2.5, 1e-15);
        close(quantile(&values, 0.95).unwrap(), 3.85, 1e-12);
        assert_eq!(median(&[f64::NAN]), None);
    }

    #[test]
    fn bootstrap_is_repeatable_and_agrees_with_student_on_normal_values() {
        let values: Vec<f64> = (0..200).map(|i| f64::from((i * 7919) % 200)).collect();
        let boot = bootstrap_mean(&values, 2000, 7).unwrap();
        assert_eq!(boot, bootstrap_mean(&values, 2000, 7).unwrap());
        assert_ne!(boot, bootstrap_mean(&values, 2000, 8).unwrap());
        let student = mean_interval(&values).unwrap();
        close(boot.low, student.low, 1.0);
        close(boot.high, student.high, 1.0);
    }

    #[test]
    fn correlation_of_a_line_is_one_and_of_a_constant_unknown() {
        let line: Vec<(f64, f64)> = (0..9).map(|i| (f64::from(i), 3.0 - 2.0 * f64::from(i))).collect();
        close(correlation(&line).unwrap(), -1.0, 1e-12);
        assert_eq!(correlation(&[(1.0, 2.0), (1.0, 3.0)]), None);
        // Their mean is not exactly 0.3: it was a correlation of -2e-16.
        let constant: Vec<(f64, f64)> = (0..1340).map(|i| (0.3, f64::from(i % 7))).collect();
        assert!(constant.iter().map(|pair| pair.0).sum::<f64>() / 1340.0 != 0.3);
        assert_eq!(correlation(&constant), None);
    }

    proptest! {
        #[test]
        fn intervals_hold_their_estimate(hits in 0u64..1000, more in 0u64..1000) {
            let found = rate(hits, hits + more).interval;
            prop_assert!(0.0 <= found.low && found.low <= found.value);
            prop_assert!(found.value <= found.high && found.high <= 1.0);
        }
    }
}
