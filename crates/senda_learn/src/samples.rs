//! Frames as a network sees them, with what it should answer.

use crate::LearnError;
use std::ops::Range;

/// A run inside [`Samples`]: frames in order of time, from one world. Sequences and splits never cut across it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Run {
    /// Where it came from: a file, or a world and a seed.
    pub name: String,
    /// The world or circuit it was driven on; empty where nobody knows. Splits keep a world on one side.
    pub world: String,
    /// Its frames.
    pub frames: Range<usize>,
}

/// Largest target that can be meant: outputs are around -1 to 1, and the tightest curve that any vehicle here drives is 5
/// ([`senda_drivers::Answer::Curvature`]). What is beyond, or no number, is a mistake in the data.
pub const TARGET_LIMIT: f32 = 10.0;

/// Whether a target can be meant.
pub(crate) fn is_possible(target: f32) -> bool {
    target.abs() <= TARGET_LIMIT
}

/// Prepared frames and targets. Pixels are kept as bytes, channel after channel, row after row, as
/// [`senda_nets::Preparer`] makes them; targets are in the units of the network's outputs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Samples {
    /// Bytes of one frame.
    pub frame_len: usize,
    /// Targets of one frame.
    pub outputs: usize,
    /// All frames one after the other.
    pub pixels: Vec<u8>,
    /// All targets one after the other.
    pub targets: Vec<f32>,
    /// The runs, in order, without gaps.
    pub runs: Vec<Run>,
    /// Frames before which others of the same run are missing, in order.
    pub breaks: Vec<usize>,
}

impl Samples {
    /// No samples yet, of this shape.
    pub fn new(frame_len: usize, outputs: usize) -> Self {
        Self {
            frame_len,
            outputs,
            ..Self::default()
        }
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.targets.len() / self.outputs.max(1)
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// Begins a run; frames pushed from now on belong to it.
    pub fn begin_run(&mut self, name: &str, world: &str) {
        let start = self.len();
        self.runs.push(Run {
            name: name.to_owned(),
            world: world.to_owned(),
            frames: start..start,
        });
    }

    /// Notes that frames are missing between the one pushed last and the next one: no sequence goes on across the gap.
    pub fn skip(&mut self) {
        let next = self.len();
        let is_inside = self.runs.last().is_some_and(|run| !run.frames.is_empty());
        if is_inside && self.breaks.last() != Some(&next) {
            self.breaks.push(next);
        }
    }

    /// Stretches of frames that follow each other in time: the runs, cut where frames are missing.
    pub fn stretches(&self) -> Vec<Range<usize>> {
        let mut breaks = self.breaks.iter().copied().peekable();
        let mut stretches = Vec::new();
        for run in &self.runs {
            let mut start = run.frames.start;
            while let Some(end) = breaks.next_if(|end| *end < run.frames.end) {
                if end > start {
                    stretches.push(start..end);
                    start = end;
                }
            }
            if run.frames.end > start {
                stretches.push(start..run.frames.end);
            }
        }
        stretches
    }

    /// Adds a frame to the run that was begun last.
    ///
    /// # Panics
    /// When the lengths do not fit, or no run was begun.
    pub fn push(&mut self, pixels: &[u8], targets: &[f32]) {
        assert_eq!((pixels.len(), targets.len()), (self.frame_len, self.outputs));
        self.pixels.extend_from_slice(pixels);
        self.targets.extend_from_slice(targets);
        let end = self.len();
        self.runs.last_mut().expect("a run was begun").frames.end = end;
    }

    /// Adds all runs of another set of the same shape.
    ///
    /// # Panics
    /// When the shapes differ.
    pub fn append(&mut self, other: &Self) {
        assert_eq!((self.frame_len, self.outputs), (other.frame_len, other.outputs));
        let shift = self.len();
        self.pixels.extend_from_slice(&other.pixels);
        self.targets.extend_from_slice(&other.targets);
        self.breaks.extend(other.breaks.iter().map(|place| place + shift));
        self.runs.extend(other.runs.iter().map(|run| Run {
            frames: run.frames.start + shift..run.frames.end + shift,
            ..run.clone()
        }));
    }

    /// One frame's pixels.
    pub fn frame(&self, index: usize) -> &[u8] {
        &self.pixels[index * self.frame_len..(index + 1) * self.frame_len]
    }

    /// One frame's targets.
    pub fn target(&self, index: usize) -> &[f32] {
        &self.targets[index * self.outputs..(index + 1) * self.outputs]
    }

    /// Refuses targets that are no numbers or beyond [`TARGET_LIMIT`]: one of them spoils all weights. `what` names the data.
    pub(crate) fn check_targets(&self, what: &'static str) -> Result<(), LearnError> {
        for run in &self.runs {
            for index in run.frames.clone() {
                for target in self.target(index) {
                    if !is_possible(*target) {
                        return Err(LearnError::Label {
                            what,
                            run: run.name.clone(),
                            frame: index - run.frames.start,
                            limit: TARGET_LIMIT,
                            found: *target,
                        });
                    }
                }
            }
        }
        Ok(())
    }

    /// A copy of part of every run: what `keep` answers for a run's length (a range within it).
    pub fn part(&self, keep: impl Fn(&Run) -> Range<usize>) -> Self {
        let mut out = Self::new(self.frame_len, self.outputs);
        for run in &self.runs {
            let kept = keep(run);
            if kept.is_empty() {
                continue;
            }
            out.begin_run(&run.name, &run.world);
            for index in kept.map(|index| run.frames.start + index) {
                if self.breaks.binary_search(&index).is_ok() {
                    out.skip();
                }
                out.push(self.frame(index), self.target(index));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_stay_whole_when_sets_are_joined_and_cut() {
        let mut a = Samples::new(2, 1);
        a.begin_run("a", "oval");
        a.push(&[1, 2], &[0.1]);
        a.push(&[3, 4], &[0.2]);
        let mut b = Samples::new(2, 1);
        b.begin_run("b", "");
        b.push(&[5, 6], &[0.3]);
        a.append(&b);
        assert_eq!((a.len(), a.runs[1].frames.clone()), (3, 2..3));
        assert_eq!((a.frame(2), a.target(1)), (&[5, 6][..], &[0.2][..]));
        let last = a.part(|run| run.frames.len() - 1..run.frames.len());
        assert_eq!((last.pixels, last.runs.len()), (vec![3, 4, 5, 6], 2));
        assert!(a.part(|_| 0..0).is_empty());
    }

    #[test]
    fn stretches_end_where_runs_end_and_where_frames_are_missing() {
        let mut a = Samples::new(1, 1);
        for run in 0..2 {
            a.begin_run("a", "");
            a.skip();
            for frame in 0..5 {
                if frame == 3 {
                    a.skip();
                    a.skip();
                }
                a.push(&[run], &[0.0]);
            }
            a.skip();
        }
        assert_eq!(a.stretches(), [0..3, 3..5, 5..8, 8..10]);
        let mut joined = a.part(|_| 2..5);
        assert_eq!(joined.stretches(), [0..1, 1..3, 3..4, 4..6]);
        joined.append(&a);
        assert_eq!(joined.stretches()[4..], [6..9, 9..11, 11..14, 14..16]);
        assert!(Samples::new(1, 1).stretches().is_empty());
    }
}
