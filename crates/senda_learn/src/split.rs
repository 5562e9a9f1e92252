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
            if training.is_empty() && !samples.is_empty() {
                let lengths = samples.runs.iter().map(|run| run.frames.len());
                return Err(LearnError::NothingLeft {
                    longest: lengths.max().unwrap_or(0),
                    percent: 100.0 * share,
                    gap,
                });
            }
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
    let sizes: Vec<usize> = groups.iter().map(frames).collect();
    let wanted = (share * samples.len() as f64).round() as usize;
    let held: BTreeSet<String> = nearest_set(&sizes, wanted)
        .into_iter()
        .map(|index| groups[index].clone())
        .collect();
    let whole = |run: &crate::Run, take: bool| if take { 0..run.frames.len() } else { 0..0 };
    Ok((
        samples.part(|run| whole(run, !held.contains(&group(run)))),
        samples.part(|run| whole(run, held.contains(&group(run)))),
    ))
}

/// Indices of the groups whose sizes together come nearest to `wanted`: at least one and never all. Among equally near sets
/// the order decides, which the seed has shuffled.
fn nearest_set(sizes: &[usize], wanted: usize) -> Vec<usize> {
    let total: usize = sizes.iter().sum();
    let smallest = sizes.iter().copied().min().unwrap_or(0);
    // Any set beyond this is further off than nothing, or than the smallest group.
    let limit = (2 * wanted).max(smallest).min(total.saturating_sub(1));
    // For every sum that a set has: the group that was added last.
    let mut last: Vec<Option<usize>> = vec![None; limit + 1];
    for (index, size) in sizes.iter().enumerate() {
        // From above, so that no group is added twice.
        for sum in (*size..=limit).rev() {
            let is_reached = sum == *size || last[sum - size].is_some();
            if is_reached && last[sum].is_none() {
                last[sum] = Some(index);
            }
        }
    }
    let nearest = (0..=limit)
        .filter(|sum| last[*sum].is_some())
        .min_by_key(|sum| sum.abs_diff(wanted));
    let mut sum = nearest.unwrap_or(0);
    let mut taken = Vec::new();
    while let Some(index) = last[sum].filter(|_| sum > 0) {
        taken.push(index);
        sum -= sizes[index];
    }
    taken
}

/// What to say where more than twice or less than half of the part that was asked for judges.
pub fn far_off(training: &Samples, validation: &Samples, how: Split, share: f64) -> Option<String> {
    let part = validation.len() as f64 / (training.len() + validation.len()).max(1) as f64;
    let advice = match how {
        Split::Worlds | Split::Runs => {
            "no whole worlds or runs come nearer; record more of them, or split by `time`"
        }
        Split::Time if part < share => {
            "the runs are too short; record longer ones, or raise validation_share"
        }
        Split::Time => "the gap takes the rest; lower split_gap, or record longer runs",
        Split::RandomFrames => return None,
    };
    (part > 2.0 * share || part < 0.5 * share).then(|| {
        format!(
            "{:.0} % of the frames judge, where {:.0} % was asked for: {advice}",
            100.0 * part,
            100.0 * share
        )
    })
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

    /// Worlds were held out in a random order until there were enough: one long world judged with 61 %, two with 78 %.
    #[test]
    fn the_set_nearest_the_share_judges_whatever_the_seed() {
        let all = samples(&[("a", "long", 219), ("b", "middle", 78), ("c", "short", 62)]);
        for seed in 0..20 {
            let (training, validation) = split(&all, Split::Worlds, 0.2, 0, seed, false).unwrap();
            assert_eq!((training.len(), validation.len()), (281, 78), "seed {seed}");
            assert_eq!(far_off(&training, &validation, Split::Worlds, 0.2), None);
        }
        let uneven = samples(&[("a", "long", 900), ("b", "longer", 1000)]);
        let (training, validation) = split(&uneven, Split::Worlds, 0.2, 0, 1, false).unwrap();
        assert_eq!(validation.len(), 900);
        let note = far_off(&training, &validation, Split::Worlds, 0.2).unwrap();
        assert!(note.contains("47 %") && note.contains("20 %"), "{note}");
    }

    #[test]
    fn sets_are_as_near_as_trying_all_of_them() {
        for sizes in [&[5, 9, 14, 3][..], &[7, 7, 7], &[1, 100], &[40, 2, 2, 2, 31, 17]] {
            let total: usize = sizes.iter().sum();
            for wanted in 0..total {
                let taken = nearest_set(sizes, wanted);
                let distinct: BTreeSet<_> = taken.iter().collect();
                assert_eq!(distinct.len(), taken.len());
                let sum = |of: &[usize]| of.iter().map(|index| sizes[*index]).sum::<usize>();
                let best = (1..(1usize << sizes.len()) - 1)
                    .map(|bits| {
                        (0..sizes.len())
                            .filter(|i| bits & (1 << i) != 0)
                            .collect::<Vec<_>>()
                    })
                    .map(|set| sum(&set).abs_diff(wanted))
                    .min();
                assert_eq!(Some(sum(&taken).abs_diff(wanted)), best, "{sizes:?}, {wanted}");
            }
        }
    }

    #[test]
    fn seeds_draw_among_equal_worlds() {
        let names: Vec<String> = (0..10).map(|number| format!("world {number}")).collect();
        let runs: Vec<(&str, &str, usize)> = names
            .iter()
            .map(|name| (name.as_str(), name.as_str(), 30))
            .collect();
        let all = samples(&runs);
        let held = |seed: u64| {
            let (_, validation) = split(&all, Split::Worlds, 0.2, 0, seed, false).unwrap();
            assert_eq!(validation.len(), 60);
            validation.runs[0].world.clone() + &validation.runs[1].world
        };
        let different: BTreeSet<String> = (0..20).map(held).collect();
        assert!(different.len() > 8, "{different:?}");
        assert_eq!(held(3), held(3));
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
        assert_eq!(far_off(&training, &validation, Split::Time, 0.2), None);
    }

    /// One side was empty without a word, and training blamed the data.
    #[test]
    fn a_split_in_time_says_when_a_side_is_empty_or_far_too_large() {
        let all = samples(&[("a", "oval", 100), ("b", "oval", 60)]);
        let message = split(&all, Split::Time, 0.2, 100_000, 1, false)
            .unwrap_err()
            .to_string();
        for words in [
            "split_gap",
            "validation_share",
            "100000",
            "longest has 100",
            "20 %",
        ] {
            assert!(message.contains(words), "{message}");
        }
        let note = |all: &Samples, gap| {
            let (training, validation) = split(all, Split::Time, 0.2, gap, 1, false).unwrap();
            far_off(&training, &validation, Split::Time, 0.2).unwrap()
        };
        let wide = note(&all, 60);
        assert!(wide.contains("62 %") && wide.contains("split_gap"), "{wide}");
        let short = note(&samples(&[("a", "oval", 2)]), 0);
        assert!(short.contains("0 %") && short.contains("too short"), "{short}");
    }
}
