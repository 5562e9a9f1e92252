//! Recordings of any kind as samples.

use crate::samples::is_possible;
use crate::{LearnError, Samples};
use rayon::prelude::*;
use senda_core::{Body, Drive, Image};
use senda_data::{EncodedFrame, Recording, Step};
use senda_drivers::{Answer, is_gap};
use senda_geom::Camera;
use senda_nets::{FrameStack, InputSpec, Preparer};
use senda_run::Scenario;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
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
    /// The first thing that could not be read whole, if there is one; it is among the warnings.
    pub damage: Option<String>,
    /// The camera that senda's recordings were made with: the first one's. Foreign data do not know theirs.
    pub camera: Option<Camera>,
    /// The paths that gave frames, as they were named.
    pub used: Vec<PathBuf>,
    /// Every file or data set that was read, by its place on the disk.
    pub sources: BTreeSet<PathBuf>,
    /// What is not among the samples.
    left_out: LeftOut,
}

impl Data {
    /// Refuses data without a frame, and says where the frames went.
    pub fn expect_frames(&self, paths: &[PathBuf]) -> Result<(), LearnError> {
        if !self.samples.is_empty() {
            return Ok(());
        }
        let what: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
        Err(LearnError::NoFrames {
            what: what.join(", "),
            help: self.left_out.to_string(),
        })
    }
}

/// How many frames were left out, and why.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct LeftOut {
    of: usize,
    ends: usize,
    standing: usize,
    without_picture: usize,
    broken: usize,
}

impl LeftOut {
    fn add(&mut self, other: Self) {
        self.of += other.of;
        self.ends += other.ends;
        self.standing += other.standing;
        self.without_picture += other.without_picture;
        self.broken += other.broken;
    }
}

impl std::fmt::Display for LeftOut {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "of {} recorded frames", self.of)?;
        let reasons = [
            (self.ends, "lie at the ends of runs (skip_first, skip_last)"),
            (
                self.standing,
                "were taken while the vehicle stood (skip_standing = false keeps them)",
            ),
            (self.without_picture, "have no picture"),
            (self.broken, "cannot be read or have no possible label"),
        ];
        for (count, reason) in reasons.iter().filter(|(count, _)| *count > 0) {
            write!(f, ", {count} {reason}")?;
        }
        Ok(())
    }
}

/// Reads recordings (MCAP files, tubs, Udacity folders, named frames, folders of those), with the edits beside them
/// ([`senda_data::edits`]) applied before the selection, and prepares their frames. A frame that cannot be read is left out with a
/// warning; it never costs the data set. What is named twice is read once.
pub fn recordings(
    paths: &[PathBuf],
    body: &Body,
    input: &InputSpec,
    answers: &[Answer],
    selection: &Selection,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Data, LearnError> {
    let mut data = Data {
        samples: Samples::new(input.len(), answers.len()),
        ..Data::default()
    };
    for (number, path) in paths.iter().enumerate() {
        progress(number, paths.len());
        let mut index = 0;
        let frames_before = data.samples.len();
        data.warnings.extend(senda_data::edits::no_parts(path)?);
        for part in senda_data::edits::parts(path)? {
            if !data.sources.insert(place(&part)) {
                data.warnings
                    .push(format!("{}: named twice, counted once", part.display()));
                index += 1;
                continue;
            }
            for recording in senda_data::open_edited_runs(&part, body)? {
                let name = run_name(path, index);
                index += 1;
                data.take_camera(&recording, &name);
                for warning in &recording.warnings {
                    data.damaged(format!("{name}: {warning}"));
                }
                data.add(&recording, &name, input, answers, selection);
            }
        }
        if data.samples.len() > frames_before {
            data.used.push(path.clone());
        }
    }
    progress(paths.len(), paths.len());
    Ok(data)
}

/// Where a path leads to: two ways of writing one are the same.
fn place(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned())
}

fn run_name(path: &Path, index: usize) -> String {
    match index {
        0 => path.display().to_string(),
        _ => format!("{}#{index}", path.display()),
    }
}

impl Data {
    fn damaged(&mut self, warning: String) {
        self.damage.get_or_insert_with(|| warning.clone());
        self.warnings.push(warning);
    }

    fn take_camera(&mut self, recording: &Recording, name: &str) {
        let Some(own) = recording.header.body.cameras.first() else {
            return;
        };
        if recording.header.origin().is_some() {
            return;
        }
        if self.camera.as_ref().is_some_and(|first| first != own) {
            self.warnings.push(format!(
                "{name}: recorded with another camera than the first recording; the model will name the first one's"
            ));
        }
        self.camera.get_or_insert_with(|| own.clone());
    }

    fn add(
        &mut self,
        recording: &Recording,
        name: &str,
        input: &InputSpec,
        answers: &[Answer],
        selection: &Selection,
    ) {
        let steps = &recording.steps;
        let end = steps.len().saturating_sub(selection.skip_last);
        let kept = steps.get(selection.skip_first.min(end)..end).unwrap_or_default();
        let body = &recording.header.body;
        let mut standing = vec![false; kept.len()];
        if selection.skip_standing && !kept.is_empty() {
            if tells_motion(recording) {
                standing = kept.iter().map(|step| is_standing(body, step)).collect();
            } else {
                self.warnings.push(format!(
                    "{name}: it tells neither speed nor throttle: frames of a standing vehicle, if there are any, are learned from too"
                ));
            }
        }
        if answers.contains(&Answer::Throttle)
            && kept.iter().any(|step| step.pedal().is_none())
            && has_pedals(recording)
        {
            self.warnings.push(format!(
                "{name}: it says how fast to go and not how far a pedal was pressed; throttle is learned as the part of top speed, which is not what holds that speed: record it anew with this senda"
            ));
        }
        let world = recording
            .header
            .world
            .as_deref()
            .and_then(world_name)
            .unwrap_or_default();
        let samples_before = self.samples.len();
        let mut left_out = LeftOut {
            of: steps.len(),
            ends: steps.len() - kept.len(),
            standing: standing.iter().filter(|stands| **stands).count(),
            ..LeftOut::default()
        };
        let cameras: &[(&str, f64)] = &[("", 0.0), ("left", -1.0), ("right", 1.0)];
        for (camera, side) in cameras {
            if *side != 0.0 && selection.side_camera_shift == 0.0 {
                continue;
            }
            let shift = side * selection.side_camera_shift;
            // Frames are prepared on all cores, in order.
            let prepared: Vec<Option<Prepared>> = kept
                .par_iter()
                .zip(&standing)
                .map_init(
                    || (Image::default(), None),
                    |(image, preparer), (step, stands)| {
                        let frame = match *camera {
                            "" => step.frames.first(),
                            name => step.frames.iter().find(|frame| frame.camera == name),
                        };
                        let frame = frame.filter(|_| !stands)?;
                        Some(prepare(frame, step, body, input, answers, shift, image, preparer))
                    },
                )
                .collect();
            let label = if camera.is_empty() {
                name.to_owned()
            } else {
                format!("{name} ({camera})")
            };
            if camera.is_empty() {
                left_out.without_picture =
                    prepared.iter().filter(|frame| frame.is_none()).count() - left_out.standing;
                left_out.broken = prepared
                    .iter()
                    .filter(|frame| matches!(frame, Some(Err(_))))
                    .count();
            }
            let samples = &mut self.samples;
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
            if samples.runs.last().is_some_and(|run| run.frames.is_empty()) {
                samples.runs.pop();
            }
            if broken > 0 {
                self.damaged(format!("{label}: {broken} frames were left out ({first})"));
            }
        }
        if self.samples.len() == samples_before {
            self.warnings
                .push(format!("{name}: none of its frames is used: {left_out}"));
        }
        self.left_out.add(left_out);
    }
}

/// Pixels and targets of a frame; `shift` is added to what turns.
#[expect(
    clippy::too_many_arguments,
    reason = "what a frame is, what it becomes, and two reused buffers"
)]
fn prepare(
    frame: &EncodedFrame,
    step: &Step,
    body: &Body,
    input: &InputSpec,
    answers: &[Answer],
    shift: f64,
    image: &mut Image,
    preparer: &mut Option<Preparer>,
) -> Prepared {
    if !step.command.is_finite() {
        return Err("a command that is no number".to_owned());
    }
    frame
        .encoded
        .decode_into(image)
        .map_err(|error| error.to_string())?;
    let size = [image.width(), image.height()];
    if size.contains(&0) {
        return Err("an empty picture".to_owned());
    }
    let preparer = match preparer {
        Some(preparer) if preparer.frame_size() == size => preparer,
        other => other.insert(input.preparer(size[0], size[1])),
    };
    let mut bytes = vec![0; input.frame_len()];
    preparer.prepare_bytes(image, &mut bytes);
    let targets: Vec<f32> = answers
        .iter()
        .map(|answer| {
            let shift = if answer.is_turn() { shift } else { 0.0 };
            (answer.target(body, &step.command, step.pedal()) + shift) as f32
        })
        .collect();
    match targets.iter().find(|target| !is_possible(**target)) {
        Some(target) => Err(format!("a label of {target}, where -1 to 1 is usual")),
        None => Ok((bytes, targets)),
    }
}

/// Whether the vehicle that was driven has an engine and brakes, as far as its name is known here.
fn has_pedals(recording: &Recording) -> bool {
    let scenario: Option<Scenario> = toml::from_str(&recording.header.scenario).ok();
    scenario
        .and_then(|scenario| scenario.resolve_vehicle().ok())
        .is_some_and(|vehicle| vehicle.engine.is_some())
}

/// Whether a run says anything of motion. Names of pictures tell neither speed nor throttle (FORMATS 4), and taking that for
/// standing would leave nothing of them.
fn tells_motion(recording: &Recording) -> bool {
    recording
        .steps
        .iter()
        .any(|step| step.speed_mps.is_some() || step.command.drive != Drive::Throttle(0.0))
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
