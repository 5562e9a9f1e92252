//! One run in the simulator: the loop, the referee, the recording and the summary.

use crate::{
    Ears, Guard, Pilot, RunError, Scenario, calibration::believed_body, guard::GuardStop, log::Log,
    referee::Referee,
};
use senda_core::{Body, Command, Explanation, Observation, Truth, Vehicle};
use senda_data::{Recording, RecordingHeader, RecordingWriter};
use senda_eval::Summary;
use senda_sim::{Delivery, SimOptions, Simulator, Start};
use senda_world::World;
use serde::{Deserialize, Serialize};
use std::io::{Cursor, Seek, Write};

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// All laps done.
    Finished,
    /// So far from the path that the run makes no sense any more.
    Strayed,
    /// The driver stopped the vehicle and left it standing.
    Stopped,
    /// The guard stopped it, because the driver saw nothing but old pictures.
    Blind,
    /// The guard stopped it, because the driver's commands were no numbers.
    NoNumber,
    /// The vehicle's battery was below its `empty_v`.
    BatteryEmpty,
    /// The time limit passed.
    TimeOut,
    /// The driver said that its work is done.
    Done,
    /// The driver has no line any more, or found none, and ended.
    WithoutLine,
    /// Somebody interrupted.
    Interrupted,
    /// The recording or data ended.
    EndOfData,
}

impl Ending {
    /// In words, for people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Finished => "goal reached",
            Self::Strayed => "strayed too far from the path",
            Self::Stopped => "the driver stopped",
            Self::Blind => GuardStop::Blind.words(),
            Self::NoNumber => GuardStop::NoNumber.words(),
            Self::BatteryEmpty => "the battery is empty",
            Self::TimeOut => "time over",
            Self::Done => "the driver has done its work",
            Self::WithoutLine => "the driver stopped without a line",
            Self::Interrupted => senda_eval::summary::INTERRUPTED,
            Self::EndOfData => "end of the data",
        }
    }
}

/// What came out of a run.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The figures.
    pub summary: Summary,
    /// Why it ended.
    pub ending: Ending,
    /// Time that the driver took for each frame (ns, by [`Ears::clock_ns`]).
    pub frame_times_ns: Vec<u64>,
}

/// Drives a scenario, writing a recording to `sink` if there is one.
pub fn run<W: Write + Seek>(
    scenario: &Scenario,
    sink: Option<W>,
    ears: &mut Ears,
) -> Result<(Outcome, Option<W>), RunError> {
    run_by(scenario, named(scenario), sink, ears)
}

/// Seats the driver that the scenario names, with what its vehicle and its seed say.
pub fn named(scenario: &Scenario) -> impl FnOnce(&Body, &World) -> Result<Pilot, RunError> + use<> {
    let scenario = scenario.clone();
    move |body, world| {
        Pilot::named(
            &scenario.driver,
            body,
            Some(&world.path),
            scenario.at_cruising_speed()?.speed_mps,
            &scenario.resolve_driver_options(),
        )
    }
}

/// As [`run`], by the pilot that `seat` puts into the vehicle.
pub fn run_by<W: Write + Seek>(
    scenario: &Scenario,
    seat: impl FnOnce(&Body, &World) -> Result<Pilot, RunError>,
    sink: Option<W>,
    ears: &mut Ears,
) -> Result<(Outcome, Option<W>), RunError> {
    // Every driver looks at the first camera alone: without a recording nobody misses the others' pictures.
    let cameras = sink.is_none().then_some(1);
    run_with(scenario, cameras, seat, sink, ears)
}

fn run_with<W: Write + Seek>(
    scenario: &Scenario,
    cameras: Option<usize>,
    seat: impl FnOnce(&Body, &World) -> Result<Pilot, RunError>,
    sink: Option<W>,
    ears: &mut Ears,
) -> Result<(Outcome, Option<W>), RunError> {
    scenario.check()?;
    let scenario = &scenario.at_cruising_speed()?;
    let world = scenario.resolve_world()?;
    let spec = scenario.resolve_vehicle()?;
    scenario.start.check_with(&world, &spec)?;
    let start = Start {
        station_m: Some(
            world
                .path
                .normalise_station(world.start_station_m + scenario.start.station_m),
        ),
        offset_m: scenario.start.offset_m,
        heading_rad: scenario.start.heading_rad,
        speed_mps: scenario.start.speed_mps,
    };
    let options = SimOptions {
        seed: scenario.seed,
        start,
        extra_latency_s: scenario.latency_s,
        lost_frames: scenario.lost_frames,
        // Only recordings keep the bytes.
        delivery: match sink {
            Some(_) => Delivery::Compressed,
            None => Delivery::Pixels,
        },
        cameras,
        ..SimOptions::default()
    };
    let mut simulator = Simulator::new(world.clone(), &spec, options)?;
    let body = believed_body(simulator.body(), scenario.calibration.as_deref())?;
    let mut pilot = seat(&body, &world)?;
    let mut recorder = match sink {
        Some(sink) => Some(RecordingWriter::new(sink, &header(scenario, &world, &body))?),
        None => None,
    };
    let mut referee = match pilot {
        Pilot::Person(_) => Referee::patient(scenario, &world),
        Pilot::Driver(_) | Pilot::Privileged(_) => Referee::new(scenario, &world),
    };
    let mut log = Log::new(&body);
    let ending = steps(
        &mut simulator,
        &mut pilot,
        &mut recorder,
        &mut referee,
        &mut log,
        ears,
    )?;
    let ending = match ending {
        Ending::Done if log.ended_without_a_line() => Ending::WithoutLine,
        other => other,
    };

    if let Pilot::Person(_) = pilot {
        // A person's time for a frame is the waiting for the next one: no figure about senda.
        log.frame_times_ns.clear();
    }
    let (summary, frame_times_ns) = log.summarise(scenario, &world, ending);
    let sink = match recorder {
        Some(recorder) => Some(recorder.finish(&repeatable(&summary))?),
        None => None,
    };
    Ok((
        Outcome {
            summary,
            ending,
            frame_times_ns,
        },
        sink,
    ))
}

/// Drives a scenario without keeping its pictures.
pub fn in_memory(scenario: &Scenario, ears: &mut Ears) -> Result<Outcome, RunError> {
    Ok(run::<Cursor<Vec<u8>>>(scenario, None, ears)?.0)
}

/// Drives a scenario and keeps what the driver's own camera saw in memory, for a report of many runs.
pub fn recorded_by_first_camera(
    scenario: &Scenario,
    ears: &mut Ears,
) -> Result<(Outcome, Recording), RunError> {
    let sink = Some(Cursor::new(Vec::new()));
    let (outcome, sink) = run_with(scenario, Some(1), named(scenario), sink, ears)?;
    let bytes = sink.map(Cursor::into_inner).unwrap_or_default();
    Ok((outcome, Recording::from_bytes(&bytes)?))
}

/// Drives a scenario and keeps its recording in memory, for a report.
pub fn recorded(scenario: &Scenario, ears: &mut Ears) -> Result<(Outcome, Recording), RunError> {
    let (outcome, sink) = run(scenario, Some(Cursor::new(Vec::new())), ears)?;
    let bytes = sink.map(Cursor::into_inner).unwrap_or_default();
    Ok((outcome, Recording::from_bytes(&bytes)?))
}

/// Says when a run is over.
pub(crate) trait Judge {
    /// The part of the way that is done, 0..=1.
    fn progress(&self) -> f64;
    /// Whether the run is over after this step.
    fn judge(&mut self, truth: Option<&Truth>, command: &Command, pilot: &Pilot) -> Option<Ending>;
}

/// For recordings: over when the data are.
pub(crate) struct Unjudged {
    pub(crate) total: f64,
    pub(crate) done: f64,
}

impl Judge for Unjudged {
    fn progress(&self) -> f64 {
        self.done / self.total
    }

    fn judge(&mut self, _truth: Option<&Truth>, _command: &Command, _pilot: &Pilot) -> Option<Ending> {
        self.done += 1.0;
        None
    }
}

/// The loop. It never grows a special case: vehicles, drivers and the referee hide theirs.
pub(crate) fn steps<W: Write + Seek>(
    vehicle: &mut dyn Vehicle,
    pilot: &mut Pilot,
    recorder: &mut Option<RecordingWriter<W>>,
    referee: &mut dyn Judge,
    log: &mut Log,
    ears: &mut Ears,
) -> Result<Ending, RunError> {
    let mut guard = Guard::new(vehicle.body());
    let mut observation = Observation::default();
    let mut explanation = Explanation::default();
    let mut said = None;
    while vehicle.observe(&mut observation)? {
        let began_ns = (ears.clock_ns)();
        let command = guard.check(&observation, pilot.drive(&observation, vehicle.truth()));
        log.step(
            &observation,
            vehicle.truth(),
            &command,
            (ears.clock_ns)().saturating_sub(began_ns),
        );
        explanation.clear();
        pilot.explain(&mut explanation);
        // Once, not at every step of a gap.
        if let Some(stop) = guard.stop().filter(|stop| said != Some(*stop)) {
            explanation.event(stop.words());
        }
        said = guard.stop();
        log.guard_stops = guard.stops();
        if let Some(pedal) = vehicle.pedal(&command) {
            explanation.signal(Explanation::PEDAL, pedal);
        }
        log.explained(&explanation);
        if let Some(recorder) = recorder {
            recorder.step(&observation, &command, vehicle.truth(), &explanation)?;
        }
        vehicle.actuate(&command)?;
        (ears.progress)(referee.progress());
        if let Some(ending) = referee.judge(vehicle.truth(), &command, pilot) {
            return Ok(match (ending, guard.stop()) {
                (Ending::Stopped, Some(GuardStop::Blind)) => Ending::Blind,
                (Ending::Stopped, Some(GuardStop::NoNumber)) => Ending::NoNumber,
                (ending, _) => ending,
            });
        }
        if (ears.interrupted)() {
            return Ok(Ending::Interrupted);
        }
    }
    Ok(Ending::EndOfData)
}

/// The summary as it goes into a recording: without wall times, which no second run repeats.
fn repeatable(summary: &Summary) -> serde_json::Value {
    let summary = Summary {
        frame_time_mean_s: None,
        frame_time_p95_s: None,
        wall_s: 0.0,
        ..summary.clone()
    };
    serde_json::to_value(summary).unwrap_or_default()
}

fn header(scenario: &Scenario, world: &World, body: &senda_core::Body) -> RecordingHeader {
    RecordingHeader {
        senda: env!("CARGO_PKG_VERSION").to_owned(),
        commit: crate::COMMIT.to_owned(),
        scenario: scenario.to_toml(),
        world: Some(world.to_toml()),
        reversed: scenario.reverse,
        body: body.clone(),
        driver: scenario.driver.clone(),
        seed: scenario.seed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    /// What was still to be driven counted as driven outside, under the words "all figures are of the time until then".
    #[test]
    fn an_interrupted_run_is_judged_by_what_was_driven() {
        let scenario = Scenario {
            laps: 200,
            ..Scenario::new("oval", "gopigo", "line")
        };
        let asked = Cell::new(0);
        let mut ears = Ears {
            interrupted: Box::new(|| {
                asked.set(asked.get() + 1);
                asked.get() == 60
            }),
            ..Ears::deaf()
        };
        let outcome = in_memory(&scenario, &mut ears).unwrap();
        let summary = outcome.summary;
        assert_eq!(outcome.ending, Ending::Interrupted);
        assert!(!summary.completed && summary.completion.unwrap() < 0.01);
        assert!(summary.lane_error_max_m.unwrap() < 0.05, "{summary:?}");
        assert!(summary.heading_error_max_rad.unwrap() < 0.5, "{summary:?}");
    }
}
