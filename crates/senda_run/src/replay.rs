//! Runs a driver over what was recorded: by senda, or by somebody else.

use crate::{Ears, Pilot, RunError, Scenario, drive};
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
    /// Steps whose command differs from the recorded one, bit for bit.
    pub different_commands: usize,
    /// Frames whose picture could not be decoded.
    pub damaged_frames: usize,
    /// Time that the driver took for each frame (ns).
    pub frame_times_ns: Vec<u64>,
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
    let total = recording.steps.len().max(1) as f64;
    let mut vehicle = Replay::new(recording);
    let mut recorder = Some(RecordingWriter::new(Cursor::new(Vec::new()), &header)?);
    let mut log = crate::log::Log::new(&header.body);
    drive::steps(
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
    Ok(Replayed {
        recording,
        steps: vehicle.compared(),
        different_commands: vehicle.differences(),
        damaged_frames: vehicle.damaged_frames(),
        frame_times_ns: log.frame_times_ns,
    })
}

/// The world that a recording was made in, driven the way it was driven; `None` for real vehicles.
pub fn recorded_world(recording: &Recording) -> Result<Option<World>, RunError> {
    let Some(text) = &recording.header.world else {
        return Ok(None);
    };
    Ok(Some(World::parse("the recording's world", text)?.0))
}
