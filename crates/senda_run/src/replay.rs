//! Runs a driver over what was recorded: by senda, or by somebody else.

use crate::{Ears, Pilot, RunError, Scenario, drive, drive::Ending};
use senda_data::{NO_SUMMARY, Recording, RecordingWriter, Replay};
use senda_world::World;
use std::io::Cursor;

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
