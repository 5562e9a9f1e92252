//! Which runs a network learns from and which judge it (A7 in SPEC).
//!
//! Neighbouring frames of a run are almost the same picture. Whoever puts one into training and the next into validation
//! measures memory, not driving. So a split keeps runs, and worlds, whole.

use crate::{LearnError, Samples};
use rand::{SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// How to split.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// Whole worlds are held out; runs whose world is unknown count as worlds of their own.
    #[default]
    Worlds,
    /// Whole runs are held out; the same world may be on both sides.
    Runs,
    /// The last part of every run in time, with `gap` frames left out before it.
    Time,
    /// Random frames: leaks. Refused unless the leak is asked for by name.
    RandomFrames,
}

/// Splits into training and validation samples. `share` (0 to 1) goes to validation, at least one run and never all. `gap` frames are left out
/// between the parts of a split in time.
pub fn split(
    samples: &Samples,
    how: Split,
    share: f64,
    gap: usize,
    seed: u64,
    allow_leak: bool,
) -> Result<(Samples, Samples), LearnError> {
    if !(share > 0.0 && share < 1.0) {
        return Err(LearnError::Option {
            key: "validation_share",
            expected: "more than 0 and less than 1".into(),
            found: share.to_string(),
        });
    }
    match how {
        Split::Worlds | Split::Runs => by_group(samples, how, share, seed),
        Split::Time => {
            let cut = |length: usize| ((length as f64) * (1.0 - share)).round() as usize;
            let training = samples.part(|run| 0..cut(run.frames.len()).saturating_sub(gap));
            let validation = samples.part(|run| cut(run.frames.len())..run.frames.len());
            Ok((training, validation))
        }
        Split::RandomFrames if !allow_leak => Err(LearnError::Leak),
        Split::RandomFrames => Ok(random_frames(samples, share, seed)),
    }
}

fn by_group(samples: &Samples, how: Split, share: f64, seed: u64) -> Result<(Samples, Samples), LearnError> {
    let group = |run: &crate::Run| match how {
        Split::Worlds if !run.world.is_empty() => run.world.clone(),
        _ => run.name.clone(),
    };
    let mut groups: Vec<String> = samples
        .runs
        .iter()
        .map(group)
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect();
    if groups.len() < 2 {
        return Err(LearnError::NothingToHoldOut {
            what: if how == Split::Worlds { "world" } else { "run" },
            found: groups.len(),
        });
    }
    groups.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let frames = |name: &String| -> usize {
        samples
            .runs
            .iter()
            .filter(|run| group(run) == *name)
            .map(|run| run.frames.len())
            .sum()
    };
    let wanted = share * samples.len() as f64;
    let mut held = BTreeSet::new();
    let mut count = 0.0;
    for name in &groups[..groups.len() - 1] {
        if !held.is_empty() && count >= wanted {
            break;
        }
        count += frames(name) as f64;
        held.insert(name.clone());
    }
    let whole = |run: &crate::Run, take: bool| if take { 0..run.frames.len() } else { 0..0 };
    Ok((
        samples.part(|run| whole(run, !held.contains(&group(run)))),
        samples.part(|run| whole(run, held.contains(&group(run)))),
    ))
}

/// Each kept frame becomes a run of its own: nobody may take them for sequences.
fn random_frames(samples: &Samples, share: f64, seed: u64) -> (Samples, Samples) {
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let count = ((share * order.len() as f64).round() as usize).clamp(1, order.len().max(2) - 1);
    let take = |indices: &[usize]| {
        let mut out = Samples::new(samples.frame_len, samples.outputs);
        for index in indices {
            out.begin_run("random frame", "");
            out.push(samples.frame(*index), samples.target(*index));
        }
        out
    };
    let (validation, training) = order.split_at(count.min(order.len()));
    (take(training), take(validation))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(runs: &[(&str, &str, usize)]) -> Samples {
        let mut out = Samples::new(1, 1);
        for (number, (name, world, length)) in runs.iter().enumerate() {
            out.begin_run(name, world);
            for _ in 0..*length {
                out.push(&[number as u8], &[0.0]);
            }
        }
        out
    }

    fn worlds_of(samples: &Samples) -> BTreeSet<&str> {
        samples.runs.iter().map(|run| run.world.as_str()).collect()
    }

    #[test]
    fn a_world_is_on_one_side_only() {
        let all = samples(&[
            ("a", "oval", 50),
            ("b", "oval", 50),
            ("c", "eight", 40),
            ("d", "bean", 60),
        ]);
        for seed in 0..20 {
            let (training, validation) = split(&all, Split::Worlds, 0.25, 0, seed, false).unwrap();
            assert!(worlds_of(&training).is_disjoint(&worlds_of(&validation)));
            assert_eq!(training.len() + validation.len(), 200);
            assert!(!training.is_empty() && !validation.is_empty());
        }
    }

    #[test]
    fn one_world_cannot_be_split_by_world() {
        let all = samples(&[("a", "oval", 50), ("b", "oval", 50)]);
        let message = split(&all, Split::Worlds, 0.2, 0, 1, false)
            .unwrap_err()
            .to_string();
        assert!(message.contains("world"), "{message}");
        assert!(split(&all, Split::Runs, 0.2, 0, 1, false).is_ok());
    }

    #[test]
    fn random_frames_are_refused_and_the_leak_is_named() {
        let all = samples(&[("a", "oval", 50)]);
        let message = split(&all, Split::RandomFrames, 0.2, 0, 1, false)
            .unwrap_err()
            .to_string();
        assert!(message.contains("neighbour"), "{message}");
        let (training, validation) = split(&all, Split::RandomFrames, 0.2, 0, 1, true).unwrap();
        assert_eq!((training.len(), validation.len()), (40, 10));
    }

    #[test]
    fn time_keeps_a_gap() {
        let all = samples(&[("a", "oval", 1000)]);
        let (training, validation) = split(&all, Split::Time, 0.2, 40, 1, false).unwrap();
        assert_eq!((training.len(), validation.len()), (760, 200));
    }
}
