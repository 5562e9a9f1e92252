//! Runs a driver over what was recorded: by senda, or by somebody else.

use crate::{Ears, Pilot, RunError, Scenario, drive, drive::Ending};
use senda_data::{NO_SUMMARY, Recording, RecordingWriter, Replay};
use senda_world::World;
use serde::Serialize;
use std::{io::Cursor, path::Path};

/// What to replay with; what is absent stays as recorded.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Another driver.
    pub driver: Option<String>,
    /// Another cruising speed (m/s).
    pub speed_mps: Option<f64>,
    /// Options for another driver (the recorded driver keeps its own, with these laid over them).
    pub driver_options: toml::Table,
}

/// Steps that a damaged recording does not hold any more.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Gap {
    /// The last step before them (s); 0 without one.
    pub from_s: f64,
    /// The first step after them (s).
    pub to_s: f64,
    /// How many.
    pub steps: u32,
}

/// What a replay showed.
#[derive(Debug, Clone)]
pub struct Replayed {
    /// The same observations with the commands and explanations of this replay.
    pub recording: Recording,
    /// Steps replayed.
    pub steps: usize,
    /// Steps that there were to replay.
    pub recorded_steps: usize,
    /// Whether somebody interrupted before all of them were; a warning of the recording says so too.
    pub interrupted: bool,
    /// Steps whose command differs from the recorded one, bit for bit.
    pub different_commands: usize,
    /// Those of them before anything was found missing.
    pub unexplained: usize,
    /// The first step before or in which something is missing.
    pub first_damaged: Option<usize>,
    /// What a damaged file does not hold any more.
    pub gaps: Vec<Gap>,
    /// Frames whose picture could not be decoded.
    pub damaged_frames: usize,
    /// Time that the driver took for each frame (ns).
    pub frame_times_ns: Vec<u64>,
}

impl Replayed {
    /// How far an interrupted replay came, in words; `None` for a whole one.
    pub fn interruption(&self) -> Option<String> {
        let (steps, all) = (self.steps, self.recorded_steps);
        self.interrupted
            .then(|| format!("interrupted after {steps} of {all} steps: all figures are of these alone"))
    }
}

/// Replays a recording through a driver. With nothing changed, the commands equal the recorded ones.
pub fn run(recording: Recording, options: &Options, ears: &mut Ears) -> Result<Replayed, RunError> {
    let recorded: Option<Scenario> = toml::from_str(&recording.header.scenario).ok();
    let driver = options
        .driver
        .clone()
        .unwrap_or_else(|| recording.header.driver.clone());
    let mut driver_options = toml::Table::new();
    let mut speed_mps = options.speed_mps;
    if let Some(scenario) = recorded.filter(|scenario| scenario.driver == driver) {
        driver_options = scenario.resolve_driver_options();
        speed_mps = speed_mps.or(scenario.speed_mps);
    }
    driver_options.extend(options.driver_options.clone());
    if options.driver_options.get("model").is_none()
        && let Some(model) = driver_options.get("model").and_then(toml::Value::as_str)
        && !Path::new(model).exists()
    {
        return Err(RunError::DriverOptions {
            driver,
            reason: format!(
                "model: the network that drove is not at {model} any more; give its file with --model, or another driver with --driver"
            ),
        });
    }
    let world = recorded_world(&recording)?;
    let mut header = recording.header.clone();
    header.driver.clone_from(&driver);
    let mut pilot = Pilot::named(
        &driver,
        &header.body,
        world.as_ref().map(|world| &world.path),
        speed_mps,
        &driver_options,
    )?;
    if matches!(pilot, Pilot::Privileged(_)) && recording.steps.iter().all(|step| step.truth.is_none()) {
        return Err(RunError::NoTruth { driver });
    }
    let recorded_steps = recording.steps.len();
    let time_s = |step: usize| recording.steps.get(step).map_or(0.0, |step| step.stamp.as_s());
    let gaps = recording.lost.iter().map(|lost| Gap {
        from_s: lost.before.checked_sub(1).map_or(0.0, time_s),
        to_s: time_s(lost.before),
        steps: lost.count,
    });
    let gaps = gaps.collect();
    let total = recorded_steps.max(1) as f64;
    let mut vehicle = Replay::new(recording);
    let mut recorder = Some(RecordingWriter::new(Cursor::new(Vec::new()), &header)?);
    let mut log = crate::log::Log::new(&header.body);
    let ending = drive::steps(
        &mut vehicle,
        &mut pilot,
        &mut recorder,
        &mut drive::Unjudged { total, done: 0.0 },
        &mut log,
        ears,
    )?;
    let bytes = match recorder {
        Some(recorder) => recorder.finish_without_summary()?.into_inner(),
        None => Vec::new(),
    };
    let mut recording = Recording::from_bytes(&bytes)?;
    // A replay has none to begin with.
    recording.warnings.retain(|warning| warning != NO_SUMMARY);
    let steps = vehicle.compared();
    let mut replayed = Replayed {
        recording,
        steps,
        recorded_steps,
        interrupted: ending == Ending::Interrupted && steps < recorded_steps,
        different_commands: vehicle.differences(),
        unexplained: vehicle.unexplained(),
        first_damaged: vehicle.first_damaged(),
        gaps,
        damaged_frames: vehicle.damaged_frames(),
        frame_times_ns: log.frame_times_ns,
    };
    let interruption = replayed.interruption();
    replayed.recording.warnings.splice(..0, interruption);
    Ok(replayed)
}

/// The world that a recording was made in, driven the way it was driven; `None` for real vehicles.
pub fn recorded_world(recording: &Recording) -> Result<Option<World>, RunError> {
    let Some(text) = &recording.header.world else {
        return Ok(None);
    };
    Ok(Some(World::parse("the recording's world", text)?.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    /// Steps were missing, so the driver remembered something else, and senda was said to be broken.
    #[test]
    fn what_differs_after_a_damaged_place_is_not_blamed_on_senda() {
        let scenario = Scenario {
            time_limit_s: Some(6.0),
            ..Scenario::new("oval", "gopigo", "line")
        };
        let (_, sink) = drive::run(&scenario, Some(Cursor::new(Vec::new())), &mut Ears::deaf()).unwrap();
        let mut bytes = sink.unwrap().into_inner();
        let whole = Recording::from_bytes(&bytes).unwrap();
        let picture = &whole.steps[whole.steps.len() / 2].frames[0].encoded.bytes;
        let at = bytes
            .windows(picture.len())
            .position(|found| found == picture)
            .unwrap();
        bytes[at + 100..at + 300].fill(0);
        let damaged = Recording::from_bytes(&bytes).unwrap();
        let replayed = run(damaged.clone(), &Options::default(), &mut Ears::deaf()).unwrap();
        let [gap] = replayed.gaps[..] else {
            panic!("{:?}", replayed.gaps)
        };
        assert_eq!(damaged.steps.len() + gap.steps as usize, whole.steps.len());
        assert!(0.0 < gap.from_s && gap.from_s < gap.to_s, "{gap:?}");
        assert!(replayed.different_commands > 0);
        assert_eq!(replayed.unexplained, 0);
        // Before the damage nothing may differ.
        let mut other = damaged;
        other.steps[2].command = senda_core::Command::curvature(1.0, 0.1);
        let replayed = run(other, &Options::default(), &mut Ears::deaf()).unwrap();
        assert_eq!(replayed.unexplained, 1);
    }

    /// "No such file or directory" told nobody what to do.
    #[test]
    fn a_network_that_is_not_there_any_more_is_asked_for() {
        let scenario = Scenario {
            time_limit_s: Some(1.0),
            ..Scenario::new("straight", "gopigo", "line")
        };
        let (_, mut recording) = drive::recorded(&scenario, &mut Ears::deaf()).unwrap();
        let mut neural = Scenario::new("straight", "gopigo", "neural");
        neural.driver_options.insert("model".into(), "gone.senda".into());
        recording.header.scenario = neural.to_toml();
        recording.header.driver = "neural".into();
        let error = run(recording, &Options::default(), &mut Ears::deaf()).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains("gone.senda") && error.contains("--model"),
            "{error}"
        );
    }

    /// What an interrupted replay had done by then claimed to be the whole.
    #[test]
    fn an_interrupted_replay_says_how_far_it_came() {
        let scenario = Scenario {
            time_limit_s: Some(2.0),
            ..Scenario::new("straight", "gopigo", "line")
        };
        let (_, recording) = drive::recorded(&scenario, &mut Ears::deaf()).unwrap();
        let all = recording.steps.len();
        let asked = Cell::new(0);
        let mut ears = Ears {
            interrupted: Box::new(|| {
                asked.set(asked.get() + 1);
                asked.get() == 5
            }),
            ..Ears::deaf()
        };
        let part = run(recording.clone(), &Options::default(), &mut ears).unwrap();
        assert_eq!(
            (part.steps, part.recorded_steps, part.interrupted),
            (5, all, true)
        );
        assert_eq!(part.recording.steps.len(), 5);
        let warning = &part.recording.warnings[0];
        assert!(
            warning.contains(&format!("interrupted after 5 of {all} steps")),
            "{warning}"
        );
        let whole = run(recording, &Options::default(), &mut Ears::deaf()).unwrap();
        assert_eq!((whole.steps, whole.interrupted), (all, false));
        assert!(whole.recording.warnings.is_empty());
    }
}
