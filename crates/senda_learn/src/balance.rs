//! Rare curves against frequent straights: what a frame counts, from how many frames have its answer.

use crate::{Answers, Samples};

/// Ranges of the answer: an odd number, so that straight on has one of its own.
const BINS: usize = 21;
/// No frame counts more than so many times the mean one: a range with three frames in it must not decide the training.
const LARGEST: f64 = 10.0;

/// What frames of each range of an answer count; 1 on average.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Balance {
    output: usize,
    weights: [f32; BINS],
}

impl Balance {
    /// For samples of which the part `mirror` is mirrored while training.
    pub(crate) fn new(samples: &Samples, answers: &Answers, balance: f64, mirror: f64) -> Self {
        let output = answers.is_turn.iter().position(|turns| *turns).unwrap_or(0);
        let mirror = if answers.is_turn.get(output) == Some(&true) {
            mirror
        } else {
            0.0
        };
        let mut counts = [0.0; BINS];
        for index in 0..samples.len() {
            let place = bin(samples.target(index)[output]);
            counts[place] += 1.0 - mirror;
            counts[BINS - 1 - place] += mirror;
        }
        let total: f64 = counts.iter().sum();
        let raw = counts.map(|count| {
            if count > 0.0 {
                power(count / total.max(1.0), -balance)
            } else {
                0.0
            }
        });
        let mut weights = raw;
        // Limiting takes weight away, so the mean is put right again; a few times is enough for all but the oddest data.
        for _ in 0..4 {
            let mean = weights.iter().zip(&counts).map(|(w, n)| w * n).sum::<f64>() / total.max(1.0);
            for weight in &mut weights {
                *weight = (*weight / mean.max(1e-12)).min(LARGEST);
            }
        }
        Self {
            output,
            weights: weights.map(|weight| weight as f32),
        }
    }

    /// What a frame with these targets, mirrored or not, counts.
    pub(crate) fn weight(&self, targets: &[f32]) -> f32 {
        // A shift can move an answer into a range that no frame had.
        match self.weights[bin(targets[self.output])] {
            0.0 => 1.0,
            weight => weight,
        }
    }
}

fn bin(target: f32) -> usize {
    let part = (f64::from(target) + 1.0) / 2.0;
    // A cast limits what is beyond.
    ((part * BINS as f64) as usize).min(BINS - 1)
}

fn power(base: f64, exponent: f64) -> f64 {
    senda_geom::trig::pow(base, exponent)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(targets: &[(f32, usize)]) -> Samples {
        let mut samples = Samples::new(0, 1);
        samples.begin_run("a", "");
        for (target, count) in targets {
            for _ in 0..*count {
                samples.push(&[], &[*target]);
            }
        }
        samples
    }

    fn answers() -> Answers {
        Answers::of(&[senda_drivers::Answer::Steering])
    }

    #[test]
    fn fully_balanced_every_range_counts_as_much_as_any_other() {
        let samples = samples(&[(0.0, 60), (0.5, 30), (-0.9, 10)]);
        let balance = Balance::new(&samples, &answers(), 1.0, 0.0);
        let sums = [(0.0, 60.0), (0.5, 30.0), (-0.9, 10.0)].map(|(t, n)| n * balance.weight(&[t]));
        for sum in sums {
            assert!((sum - 100.0 / 3.0).abs() < 1e-3, "{sums:?}");
        }
        let none = Balance::new(&samples, &answers(), 0.0, 0.0);
        assert!((none.weight(&[0.5]) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn mirrored_frames_are_counted_on_both_sides() {
        let samples = samples(&[(0.0, 50), (0.5, 50)]);
        let balance = Balance::new(&samples, &answers(), 1.0, 0.5);
        assert_eq!(balance.weight(&[0.5]), balance.weight(&[-0.5]));
        assert!(balance.weight(&[0.5]) > balance.weight(&[0.0]));
        // Nothing there: such a frame counts as one.
        assert_eq!(balance.weight(&[0.99]), 1.0);
    }

    #[test]
    fn three_rare_frames_do_not_decide() {
        let samples = samples(&[(0.0, 10_000), (1.0, 3)]);
        let balance = Balance::new(&samples, &answers(), 1.0, 0.0);
        assert!(balance.weight(&[1.0]) <= LARGEST as f32);
        assert!((balance.weight(&[0.0]) - 1.0).abs() < 0.01);
        assert_eq!(
            Balance::new(&Samples::new(0, 1), &answers(), 1.0, 0.0).weight(&[0.0]),
            1.0
        );
    }
}
