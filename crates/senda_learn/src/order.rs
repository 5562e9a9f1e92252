//! In which order frames are learned: single frames shuffled, or, for networks with a memory, parallel runs in order of time.

use crate::Samples;
use rand::{Rng, RngExt, seq::SliceRandom};
use std::ops::Range;

/// A frame's place in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    /// Which frame.
    pub(crate) frame: usize,
    /// Frames with the same number are changed in the same way: the first frame of the piece. Where every frame is shown
    /// both ways, numbers from the number of frames on are the mirrored ones.
    pub(crate) draw: usize,
}

/// What one step of training learns from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Portion {
    /// Moments that follow each other.
    pub(crate) moments: usize,
    /// Streams that go side by side.
    pub(crate) streams: usize,
    /// The frames by moment, then by stream; none where a stream has no more.
    pub(crate) places: Vec<Option<Place>>,
    /// Streams that begin a piece here, without memory of the one before.
    pub(crate) begins: Vec<usize>,
}

impl Portion {
    /// Number of frames.
    pub(crate) fn len(&self) -> usize {
        self.places.iter().flatten().count()
    }
}

/// Single frames in any order, each without memory; each twice where they are shown both ways.
pub(crate) fn shuffled(count: usize, both_ways: bool, batch: usize, rng: &mut impl Rng) -> Vec<Portion> {
    let times = if both_ways { 2 } else { 1 };
    let mut order: Vec<usize> = (0..times * count).collect();
    order.shuffle(rng);
    order
        .chunks(batch)
        .map(|frames| Portion {
            moments: 1,
            streams: frames.len(),
            places: frames
                .iter()
                .map(|draw| {
                    Some(Place {
                        frame: draw % count,
                        draw: *draw,
                    })
                })
                .collect(),
            begins: (0..frames.len()).collect(),
        })
        .collect()
}

/// A stretch longer than this many sequences may be cut into pieces, so that few long runs fill all streams.
const SHORTEST_CUT: usize = 4;
/// Pieces that each stream gets where runs are long: several, so that streams end at about the same time.
const PIECES_PER_STREAM: usize = 4;

/// Frames in order of time: `batch` streams side by side, each taking piece after piece of the runs, `sequence` frames a step.
/// A piece never goes on across the end of a run or a gap. Long runs are cut into pieces, at other places every time. Every piece
/// comes twice where frames are shown both ways.
pub(crate) fn in_order(
    samples: &Samples,
    both_ways: bool,
    sequence: usize,
    batch: usize,
    rng: &mut impl Rng,
) -> Vec<Portion> {
    let share = samples.len().div_ceil(batch * PIECES_PER_STREAM);
    let longest = share.max(SHORTEST_CUT * sequence).next_multiple_of(sequence);
    // With what is added to the number of the first frame: pieces that are mirrored are changed differently.
    let mut pieces: Vec<(Range<usize>, usize)> = Vec::new();
    for stretch in samples.stretches() {
        let mut start = stretch.start;
        let mut len = match stretch.len() > longest {
            true => rng.random_range(1..=longest),
            false => stretch.len(),
        };
        while start < stretch.end {
            let end = (start + len).min(stretch.end);
            pieces.push((start..end, 0));
            if both_ways {
                pieces.push((start..end, samples.len()));
            }
            start = end;
            len = longest;
        }
    }
    pieces.shuffle(rng);

    let mut waiting = pieces.into_iter();
    // Of each stream: what is left of its piece, and the piece's first frame.
    let mut streams: Vec<(Range<usize>, usize)> = vec![(0..0, 0); batch];
    let mut portions = Vec::new();
    loop {
        let mut begins = Vec::new();
        for (number, stream) in streams.iter_mut().enumerate() {
            if stream.0.is_empty()
                && let Some((piece, added)) = waiting.next()
            {
                begins.push(number);
                *stream = (piece.clone(), piece.start + added);
            }
        }
        let moments = streams.iter().map(|(left, _)| left.len().min(sequence)).max();
        let count = streams.iter().rposition(|(left, _)| !left.is_empty());
        let (Some(moments), Some(last)) = (moments, count) else {
            return portions;
        };
        let mut places = Vec::with_capacity(moments * (last + 1));
        for _ in 0..moments {
            for (left, draw) in &mut streams[..=last] {
                places.push(left.next().map(|frame| Place { frame, draw: *draw }));
            }
        }
        portions.push(Portion {
            moments,
            streams: last + 1,
            places,
            begins,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Runs of these lengths; before every seventh frame others are missing.
    fn samples(lengths: &[usize]) -> Samples {
        let mut samples = Samples::new(0, 1);
        for length in lengths {
            samples.begin_run("a", "");
            for _ in 0..*length {
                if samples.len() % 7 == 6 {
                    samples.skip();
                }
                samples.push(&[], &[0.0]);
            }
        }
        samples
    }

    proptest! {
        #[test]
        fn every_frame_comes_once_and_no_stream_goes_on_across_a_run_or_a_gap(
            lengths in prop::collection::vec(1usize..90, 0..8),
            has_gaps: bool, both_ways: bool, sequence in 2usize..9, batch in 1usize..6, seed: u64,
        ) {
            let mut samples = samples(&lengths);
            if !has_gaps {
                samples.breaks.clear();
            }
            let follows = |before: usize, after: usize| {
                after == before + 1
                    && samples.stretches().iter().any(|s| s.contains(&before) && s.contains(&after))
            };
            let mut seen = vec![0; samples.len()];
            let mut last: Vec<Option<Place>> = vec![None; batch];
            for portion in in_order(&samples, both_ways, sequence, batch, &mut ChaCha8Rng::seed_from_u64(seed)) {
                prop_assert!(portion.moments <= sequence && portion.streams <= batch && portion.len() > 0);
                prop_assert_eq!(portion.places.len(), portion.moments * portion.streams);
                for begun in &portion.begins {
                    last[*begun] = None;
                }
                for moment in portion.places.chunks(portion.streams) {
                    for (stream, place) in moment.iter().enumerate() {
                        let Some(place) = place else { continue };
                        seen[place.frame] += 1;
                        match last[stream] {
                            Some(before) => prop_assert!(
                                follows(before.frame, place.frame) && before.draw == place.draw
                            ),
                            None => prop_assert!(
                                portion.begins.contains(&stream) && place.draw % samples.len() == place.frame
                            ),
                        }
                        last[stream] = Some(*place);
                    }
                }
            }
            prop_assert!(seen.iter().all(|count| *count == 1 + usize::from(both_ways)));
        }
    }

    #[test]
    fn one_long_run_fills_all_streams_and_is_cut_elsewhere_the_next_time() {
        let mut samples = samples(&[4000]);
        samples.breaks.clear();
        let portions = |seed| in_order(&samples, false, 16, 8, &mut ChaCha8Rng::seed_from_u64(seed));
        let steps = portions(1);
        assert_eq!((steps[0].streams, steps[0].begins.len()), (8, 8));
        let full = steps.iter().filter(|step| step.len() == 8 * 16).count();
        assert!(full >= 20 && steps.len() < 48, "{full} of {}", steps.len());
        assert_eq!(steps, portions(1));
        let cuts = |seed: u64| {
            let places = portions(seed).into_iter().flat_map(|step| step.places);
            let mut cuts: Vec<usize> = places.flatten().map(|place| place.draw).collect();
            cuts.sort_unstable();
            cuts.dedup();
            cuts
        };
        assert_ne!(cuts(1), cuts(2));
    }

    #[test]
    fn both_ways_shows_every_frame_as_it_is_and_mirrored() {
        let mut draws: Vec<usize> = shuffled(10, true, 4, &mut ChaCha8Rng::seed_from_u64(1))
            .iter()
            .flat_map(|portion| portion.places.clone())
            .map(|place| {
                let place = place.expect("single frames fill their places");
                assert_eq!(place.frame, place.draw % 10);
                place.draw
            })
            .collect();
        draws.sort_unstable();
        assert_eq!(draws, (0..20).collect::<Vec<_>>());
    }
}
