//! Recordings of any kind as samples.

use crate::samples::is_possible;
use crate::{LearnError, Samples};
use rayon::prelude::*;
use senda_core::{Body, Drive, Image};
use senda_data::{Recording, Step};
use senda_drivers::{Answer, is_gap};
use senda_geom::Camera;
use senda_nets::{FrameStack, InputSpec};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Which frames of recordings are learned from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Selection {
    /// Frames left out at the beginning of every run (A6 in SPEC: exposure settles in the first 2 to 5).
    pub skip_first: usize,
    /// Frames left out at the end of every run: the car is being picked up.
    pub skip_last: usize,
    /// Frames while the vehicle was told to stand are left out.
    pub skip_standing: bool,
    /// Steering (part of full lock) added for the left camera and taken away for the right one, so that frames from the side
    /// teach the way back (B5 in SPEC: 5° of 25°, 0.2; to the right for the left camera). 0: side cameras are not used.
    pub side_camera_shift: f64,
}

impl Default for Selection {
    fn default() -> Self {
        Self {
            skip_first: 4,
            skip_last: 0,
            skip_standing: true,
            side_camera_shift: 0.0,
        }
    }
}

/// Pixels and targets of a frame, or why there are none.
type Prepared = Result<(Vec<u8>, Vec<f32>), String>;

/// What recordings gave.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Data {
    /// Their frames.
    pub samples: Samples,
    /// What was left out or guessed.
    pub warnings: Vec<String>,
    /// The camera that senda's recordings were made with: the first one's. Foreign data do not know theirs.
    pub camera: Option<Camera>,
}

/// Reads recordings (MCAP files, tubs, Udacity folders, named frames, folders of those), with the edits beside them
/// ([`senda_data::edits`]) applied before the selection, and prepares their frames. A frame that cannot be read is left out with a
/// warning; it never costs the data set.
pub fn recordings(
    paths: &[PathBuf],
    body: &Body,
    input: &InputSpec,
    answers: &[Answer],
    selection: &Selection,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Data, LearnError> {
    let mut samples = Samples::new(input.len(), answers.len());
    let mut warnings = Vec::new();
    let mut camera: Option<Camera> = None;
    for (number, path) in paths.iter().enumerate() {
        progress(number, paths.len());
        for (index, recording) in senda_data::open_edited_runs(path, body)?.into_iter().enumerate() {
            let name = run_name(path, index);
            let is_own = recording.header.origin().is_none();
            if let (true, Some(own)) = (is_own, recording.header.body.cameras.first()) {
                if camera.as_ref().is_some_and(|first| first != own) {
                    warnings.push(format!(
                        "{name}: recorded with another camera than the first recording; the model will name the first one's"
                    ));
                }
                camera.get_or_insert_with(|| own.clone());
            }
            warnings.extend(
                recording
                    .warnings
                    .iter()
                    .map(|warning| format!("{name}: {warning}")),
            );
            add(
                &mut samples,
                &recording,
                &name,
                input,
                answers,
                selection,
                &mut warnings,
            )?;
        }
    }
    progress(paths.len(), paths.len());
    Ok(Data {
        samples,
        warnings,
        camera,
    })
}

fn run_name(path: &Path, index: usize) -> String {
    match index {
        0 => path.display().to_string(),
        _ => format!("{}#{index}", path.display()),
    }
}

fn add(
    samples: &mut Samples,
    recording: &Recording,
    name: &str,
    input: &InputSpec,
    answers: &[Answer],
    selection: &Selection,
    warnings: &mut Vec<String>,
) -> Result<(), LearnError> {
    let steps = &recording.steps;
    let end = steps.len().saturating_sub(selection.skip_last);
    let kept = steps.get(selection.skip_first.min(end)..end).unwrap_or_default();
    let world = recording
        .header
        .world
        .as_deref()
        .and_then(world_name)
        .unwrap_or_default();
    let body = &recording.header.body;
    let cameras: &[(&str, f64)] = &[("", 0.0), ("left", -1.0), ("right", 1.0)];
    for (camera, side) in cameras {
        if *side != 0.0 && selection.side_camera_shift == 0.0 {
            continue;
        }
        // Frames are prepared on all cores, in order.
        let prepared: Vec<Option<Prepared>> = kept
            .par_iter()
            .map_init(
                || (Image::default(), None),
                |(image, preparer), step| {
                    let frame = match *camera {
                        "" => step.frames.first(),
                        name => step.frames.iter().find(|frame| frame.camera == name),
                    }?;
                    let command = &step.command;
                    if selection.skip_standing && is_standing(body, step) {
                        return None;
                    }
                    if !command.is_finite() {
                        return Some(Err("a command that is no number".to_owned()));
                    }
                    if let Err(error) = frame.encoded.decode_into(image) {
                        return Some(Err(error.to_string()));
                    }
                    let size = [image.width(), image.height()];
                    if size.contains(&0) {
                        return Some(Err("an empty picture".to_owned()));
                    }
                    let preparer: &mut Option<senda_nets::Preparer> = preparer;
                    if preparer
                        .as_ref()
                        .is_none_or(|preparer| preparer.frame_size() != size)
                    {
                        *preparer = Some(input.preparer(size[0], size[1]));
                    }
                    let mut bytes = vec![0; input.frame_len()];
                    preparer.as_mut()?.prepare_bytes(image, &mut bytes);
                    let targets: Vec<f32> = answers
                        .iter()
                        .map(|answer| {
                            let shift = if answer.is_turn() {
                                side * selection.side_camera_shift
                            } else {
                                0.0
                            };
                            (answer.target(body, command) + shift) as f32
                        })
                        .collect();
                    if let Some(target) = targets.iter().find(|target| !is_possible(**target)) {
                        return Some(Err(format!("a label of {target}, where -1 to 1 is usual")));
                    }
                    Some(Ok((bytes, targets)))
                },
            )
            .collect();
        let label = if camera.is_empty() {
            name.to_owned()
        } else {
            format!("{name} ({camera})")
        };
        samples.begin_run(&label, &world);
        let mut broken = 0usize;
        let mut first = String::new();
        let mut stack = FrameStack::new(input);
        for (number, frame) in prepared.into_iter().enumerate() {
            let before = number.checked_sub(1).map(|before| &kept[before]);
            let is_gap = before.is_some_and(|before| is_gap(body, before.stamp, kept[number].stamp));
            if is_gap || !matches!(frame, Some(Ok(_))) {
                samples.skip();
                stack.forget();
            }
            match frame {
                None => {}
                Some(Ok((bytes, targets))) => samples.push(stack.push(&bytes), &targets),
                Some(Err(reason)) => {
                    broken += 1;
                    if first.is_empty() {
                        first = reason;
                    }
                }
            }
        }
        if broken > 0 {
            warnings.push(format!("{label}: {broken} frames were left out ({first})"));
        }
        if samples.runs.last().is_some_and(|run| run.frames.is_empty()) {
            samples.runs.pop();
        }
    }
    Ok(())
}

/// Slower than this a car whose pedal is released stands (m/s).
const ROLLING_MPS: f64 = 0.1;

/// Whether the vehicle was told to stand. Coasting and braking are part of driving by throttle: there a measured speed
/// decides, where there is one.
fn is_standing(body: &Body, step: &Step) -> bool {
    let told = body.speed_of(&step.command).abs() < 1e-6;
    match step.command.drive {
        Drive::SpeedMps(_) => told,
        Drive::Throttle(_) => {
            told && step
                .speed_mps
                .is_none_or(|speed_mps| speed_mps.abs() < ROLLING_MPS)
        }
    }
}

/// The name in a world's TOML.
fn world_name(toml: &str) -> Option<String> {
    let table: toml::Table = toml.parse().ok()?;
    Some(table.get("name")?.as_str()?.to_owned())
}
