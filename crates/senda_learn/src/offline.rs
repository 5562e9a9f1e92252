//! What a network answers to recorded frames beside what was done there (B6 in SPEC: frame by frame against the human).

use crate::gather::{self, Selection};
use crate::train::{Errors, compare};
use crate::{LearnError, Samples};
use rayon::prelude::*;
use senda_core::Body;
use senda_drivers::Answer;
use senda_nets::Model;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Errors of one output, in its own unit: a part of full lock, of full throttle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputErrors {
    /// `steering`, `throttle`, …
    pub output: String,
    /// Root of the mean square over all frames: B6.
    pub root_mean_square: f64,
    /// The other figures.
    pub errors: Errors,
}

/// Frames as they were driven: all of them, also those that nobody would learn from.
pub const ALL_FRAMES: Selection = Selection {
    skip_first: 0,
    skip_last: 0,
    skip_standing: false,
    side_camera_shift: 0.0,
};

/// Compares a model with what was done in recordings (anything that [`gather::recordings`] reads), with the warnings of those.
/// [`ALL_FRAMES`] is B6; other selections leave frames out.
pub fn against_recordings(
    model: &Model,
    paths: &[PathBuf],
    body: &Body,
    selection: &Selection,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<(Vec<OutputErrors>, Vec<String>), LearnError> {
    let answers: Vec<Answer> = model
        .outputs
        .iter()
        .map(|output| {
            Answer::named(&output.name).ok_or_else(|| LearnError::Option {
                key: "outputs of the model",
                expected: "steering, curvature, speed or throttle".into(),
                found: output.name.clone(),
            })
        })
        .collect::<Result<_, _>>()?;
    let data = gather::recordings(paths, body, &model.input, &answers, selection, progress)?;
    data.expect_frames(paths)?;
    let mut warnings = data.warnings;
    if let Some(Err(mismatch)) = data.camera.as_ref().map(|camera| model.check_camera(camera)) {
        warnings.insert(0, format!("{mismatch}; the figures say little about this model"));
    }
    Ok((against_samples(model, &data.samples), warnings))
}

/// Compares a model with prepared frames and their targets, one entry for each output.
pub fn against_samples(model: &Model, samples: &Samples) -> Vec<OutputErrors> {
    let answers = answers(model, samples);
    let outputs = samples.outputs;
    let column = |values: &[f32], output: usize| -> Vec<f32> {
        values.iter().skip(output).step_by(outputs).copied().collect()
    };
    model
        .outputs
        .iter()
        .enumerate()
        .map(|(number, output)| {
            let errors = compare(&column(&answers, number), &column(&samples.targets, number), 1);
            OutputErrors {
                output: output.name.clone(),
                root_mean_square: errors.mean_squared.sqrt(),
                errors,
            }
        })
        .collect()
}

/// What a model answers to every frame, in order. A memory is carried on through each stretch of frames that follow each other and
/// begins empty at the next.
pub fn answers(model: &Model, samples: &Samples) -> Vec<f32> {
    let of_stretches: Vec<Vec<f32>> = samples
        .stretches()
        .into_par_iter()
        .map_init(
            || (model.inference(), vec![0.0; samples.frame_len]),
            |(inference, input), stretch| {
                inference.reset_state();
                stretch
                    .flat_map(|frame| {
                        model.input.normalise(samples.frame(frame), input);
                        inference.run(input).to_vec()
                    })
                    .collect()
            },
        )
        .collect();
    of_stretches.concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_nets::{InputSpec, Network, Provenance, View, Weights};

    fn model(name: &str) -> Model {
        let network = Network::named(name).unwrap().with_outputs(2).unwrap();
        Model {
            weights: Weights::random(&network, 1),
            input: InputSpec::for_network(&network, &View::default()).unwrap(),
            network,
            outputs: [Answer::Steering, Answer::Throttle].map(Answer::output).to_vec(),
            provenance: Provenance::default(),
            grids: vec![],
            detection: None,
            forgets: false,
        }
    }

    fn samples(model: &Model, targets: impl Fn(usize) -> [f32; 2]) -> Samples {
        let mut samples = Samples::new(model.input.len(), 2);
        for run in 0..2 {
            samples.begin_run("run", "");
            for frame in 0..20 {
                let seed = 31 * frame + 7 * run + 1;
                let pixels: Vec<u8> = (0..model.input.len()).map(|i| (i * seed % 251) as u8).collect();
                samples.push(&pixels, &targets(20 * run + frame));
            }
        }
        samples
    }

    #[test]
    fn each_output_has_its_own_error() {
        let model = model("lstm-tinypilotnet");
        let exact = answers(&model, &samples(&model, |_| [0.0, 0.0]));
        let shifted = samples(&model, |frame| {
            // Steering off by 0.1 to and fro, throttle by 0.3 always.
            let sign = if frame % 2 == 0 { 0.1 } else { -0.1 };
            [exact[2 * frame] + sign, exact[2 * frame + 1] - 0.3]
        });
        let found = against_samples(&model, &shifted);
        assert_eq!([&found[0].output, &found[1].output], ["steering", "throttle"]);
        assert!((found[0].root_mean_square - 0.1).abs() < 1e-6);
        assert!((found[1].root_mean_square - 0.3).abs() < 1e-6);
        assert_eq!(found[0].errors.count, 40);
    }

    #[test]
    fn a_memory_begins_empty_with_each_run_and_after_a_gap() {
        let model = model("lstm-tinypilotnet");
        let mut all = samples(&model, |_| [0.0, 0.0]);
        let whole = answers(&model, &all);
        let second = answers(
            &model,
            &all.part(|run| match run.frames.start {
                0 => 0..0,
                _ => 0..20,
            }),
        );
        assert_eq!(whole[40..], second);
        all.breaks = vec![10];
        let cut = answers(&model, &all);
        assert_eq!(cut[..20], whole[..20]);
        assert_ne!(cut[20..40], whole[20..40]);
        assert_eq!(cut[40..], whole[40..]);
    }
}
