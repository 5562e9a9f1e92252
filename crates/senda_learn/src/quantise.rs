//! A model on an 8-bit grid: frames to calibrate with, and what the grid changes in its answers (A14 in SPEC).

use crate::correct::{self, Brief, Gathering};
use crate::gather::{self, Selection};
use crate::{LearnError, Samples};
use senda_core::Body;
use senda_drivers::Answer;
use senda_nets::Model;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// How the answers of an exact model and of its quantised form differ on frames that did not calibrate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// The output's name.
    pub output: String,
    /// Mean absolute difference, in the output's unit.
    pub mean: f64,
    /// Largest absolute difference.
    pub largest: f64,
}

/// What quantising gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantised {
    /// The model on the grid.
    pub model: Model,
    /// For each output, how its answers changed.
    pub differences: Vec<Difference>,
    /// Frames that calibrated.
    pub calibrated: usize,
    /// Frames that compared.
    pub compared: usize,
}

/// Frames to calibrate a model with. Each source is a path (recordings and what [`gather::recordings`] takes beside them) or
/// `FAMILY:SEED`, random worlds from this seed on, which the model drives itself. Each source gives about the same share of
/// `frames`, evenly over its length.
///
/// # Errors
/// When a source cannot be read or driven, or none gives a frame.
pub fn frames(
    model: &Model,
    sources: &[String],
    vehicle: &str,
    frames: usize,
    progress: &(dyn Fn(usize, usize) + Sync),
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Result<Samples, LearnError> {
    if frames < 2 {
        return Err(LearnError::Option {
            key: "frames",
            expected: "at least 2: half of them calibrate, half compare".into(),
            found: frames.to_string(),
        });
    }
    let mut all = Samples::new(model.input.len(), 1);
    let share = frames.div_ceil(sources.len().max(1)).max(1);
    for (number, source) in sources.iter().enumerate() {
        let samples = match world_source(source) {
            Some((family, first_world)) => {
                let gathering = Gathering {
                    families: vec![family.to_owned()],
                    first_world,
                    vehicle: vehicle.to_owned(),
                    // Four frames for each that is kept: neighbours are almost the same picture.
                    drive_frames: 100,
                    ..Gathering::default()
                };
                let brief = Brief {
                    gathering: &gathering,
                    input: &model.input,
                    answers: &[Answer::Steering],
                    seed: 1,
                };
                let done = |done: usize| progress(number * share + done.min(4 * share) / 4, frames);
                correct::gather(&brief, Some(model), 4 * share, 0, &done, interrupted)?.samples
            }
            None => {
                let body: Body = senda_run::scenario::find_vehicle(vehicle)?.body();
                let paths = [PathBuf::from(source)];
                let selection = Selection::default();
                let answers = [Answer::Steering];
                let mut done = |_: usize, _: usize| progress(number * share, frames);
                gather::recordings(&paths, &body, &model.input, &answers, &selection, &mut done)?.samples
            }
        };
        let step = samples.len().div_ceil(share).max(1);
        all.append(&every(&samples, step));
    }
    if all.len() < 2 {
        return Err(LearnError::NoFrames {
            what: sources.join(", "),
            help: "name recordings, or random worlds such as random-circuit:9000".to_owned(),
        });
    }
    Ok(all)
}

/// `random-circuit:9000`, where no file is called so.
fn world_source(source: &str) -> Option<(&str, u64)> {
    let (family, seed) = source.split_once(':')?;
    let seed = seed.parse().ok()?;
    (!Path::new(source).exists()).then_some((family, seed))
}

fn every(samples: &Samples, step: usize) -> Samples {
    let mut out = Samples::new(samples.frame_len, samples.outputs);
    out.begin_run("calibration", "");
    for index in (0..samples.len()).step_by(step) {
        out.push(samples.frame(index), samples.target(index));
    }
    out
}

/// Calibrates on the first half of the frames and compares on the second.
///
/// # Errors
/// When the model is quantised already.
pub fn quantise(model: &Model, samples: &Samples) -> Result<Quantised, LearnError> {
    let calibrated = samples.len().div_ceil(2);
    let len = model.input.len();
    let mut values = vec![0.0; calibrated * len];
    model
        .input
        .normalise(&samples.pixels[..calibrated * len], &mut values);
    let quantised = model.quantised(&values)?;
    let (mut exact, mut coarse) = (model.inference(), quantised.inference());
    let mut differences: Vec<Difference> = model
        .outputs
        .iter()
        .map(|output| Difference {
            output: output.name.clone(),
            mean: 0.0,
            largest: 0.0,
        })
        .collect();
    let compared = samples.len() - calibrated;
    let mut input = vec![0.0; len];
    for index in calibrated..samples.len() {
        model.input.normalise(samples.frame(index), &mut input);
        let pairs = exact.run(&input).iter().zip(coarse.run(&input));
        for (difference, (exact, coarse)) in differences.iter_mut().zip(pairs) {
            let apart = f64::from((exact - coarse).abs());
            difference.mean += apart / compared as f64;
            difference.largest = difference.largest.max(apart);
        }
    }
    Ok(Quantised {
        model: quantised,
        differences,
        calibrated,
        compared,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worlds_have_a_family_and_a_seed() {
        assert_eq!(
            world_source("random-circuit:9000"),
            Some(("random-circuit", 9000))
        );
        assert_eq!(world_source("runs/a.mcap"), None);
        assert_eq!(world_source("C:\\runs"), None);
    }
}
