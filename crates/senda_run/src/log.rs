//! What a run is judged by: everything but the pictures.

use crate::{Scenario, drive::Ending, referee, trajectory::TrajectoryDigest};
use senda_core::{Body, Command, Explanation, Observation, Truth};
use senda_drivers::MissionOptions;
use senda_drivers::loss::{GAVE_UP, STOPPED};
use senda_eval::metrics::{self, Motion};
use senda_eval::{Course, Delivery, DeliveryRules, Odometer, OdometryError, Summary, delivery};
use senda_world::World;

/// One row a step.
pub(crate) struct Log {
    body: Body,
    truths: Vec<Truth>,
    motions: Vec<Motion>,
    /// Only what losses are counted from: the signal `found` and the events.
    accounts: Vec<Explanation>,
    digest: TrajectoryDigest,
    odometer: Option<Odometer>,
    /// How many commands the guard replaced by a stop.
    pub(crate) guard_stops: u64,
    pub(crate) frame_times_ns: Vec<u64>,
}

impl Log {
    pub(crate) fn new(body: &Body) -> Self {
        Self {
            body: body.clone(),
            truths: Vec::new(),
            motions: Vec::new(),
            accounts: Vec::new(),
            digest: TrajectoryDigest::default(),
            odometer: Odometer::new(body),
            guard_stops: 0,
            frame_times_ns: Vec::new(),
        }
    }

    pub(crate) fn step(
        &mut self,
        seen: &Observation,
        truth: Option<&Truth>,
        command: &Command,
        frame_time_ns: u64,
    ) {
        self.motions.push(Motion::of(
            &self.body,
            seen.stamp.as_s(),
            command,
            truth,
            seen.speed_mps,
        ));
        self.truths.extend(truth);
        if let Some(odometer) = &mut self.odometer {
            odometer.step(seen.wheels, command);
        }
        self.digest.step(seen.stamp, truth, command);
        self.frame_times_ns.push(frame_time_ns);
    }

    pub(crate) fn explained(&mut self, explanation: &Explanation) {
        let found = explanation
            .signals
            .iter()
            .filter(|signal| signal.name == "found")
            .cloned()
            .collect();
        self.accounts.push(Explanation {
            signals: found,
            shapes: Vec::new(),
            events: explanation.events.clone(),
        });
    }

    /// Whether the driver ended in the last step because it had no line.
    pub(crate) fn ended_without_a_line(&self) -> bool {
        self.accounts.last().is_some_and(|last| {
            last.events
                .iter()
                .any(|event| [GAVE_UP, STOPPED].contains(&event.as_str()))
        })
    }

    /// What became of a package; `None` outside of warehouses.
    fn delivery(&self, world: &World) -> Option<Delivery> {
        let rules = DeliveryRules {
            stop_m: MissionOptions::default().stop_m,
            // The vehicle frame's origin is its middle on vehicles that turn in place about it.
            front_m: 0.5 * self.body.length_m,
        };
        let mut events = Vec::new();
        for (motion, account) in self.motions.iter().zip(&self.accounts) {
            events.extend(account.events.iter().map(|text| delivery::Event {
                time_s: motion.time_s,
                text: text.clone(),
            }));
        }
        delivery::judge(world, &self.truths, rules, events)
    }

    /// The figures of the run. Ends the log.
    pub(crate) fn summarise(
        mut self,
        scenario: &Scenario,
        world: &World,
        ending: Ending,
    ) -> (Summary, Vec<u64>) {
        let course = referee::course(scenario, world);
        let mut measured = metrics::measure(&course, &self.truths);
        if ending == Ending::Interrupted {
            // Nobody knows how the rest would have been driven: the errors are of the way until then.
            let until_then = Course { laps: None, ..course };
            let driven = metrics::measure(&until_then, &self.truths);
            (measured.lane_error, measured.heading_error) = (driven.lane_error, driven.heading_error);
        }
        let times = self.motions.iter().map(|motion| motion.time_s);
        let losses = metrics::losses(times.zip(&self.accounts));
        let smoothness = metrics::smoothness(&self.motions);
        let digest = std::mem::take(&mut self.digest).finish();
        let times_s: Vec<f64> = self.frame_times_ns.iter().map(|ns| *ns as f64 * 1e-9).collect();
        let summary = Summary {
            world: scenario.world.clone(),
            vehicle: scenario.vehicle.clone(),
            driver: scenario.driver.clone(),
            light: scenario.light.clone().unwrap_or_else(|| "as in the world".into()),
            floor: scenario.floor.clone().unwrap_or_else(|| floor_name(world)),
            reversed: scenario.reverse,
            seed: scenario.seed,
            speed_mps: scenario.speed_mps,
            laps_wanted: course.laps,
            ended: ending.words().to_owned(),
            digest,
            guard_stops: self.guard_stops,
            odometry: OdometryError::of(self.odometer.as_ref(), &self.truths),
            ..Summary::from_figures(&measured, &losses, &smoothness)
        };
        let summary = match self.delivery(world) {
            Some(delivery) => Summary {
                completed: delivery.is_whole(),
                departures: delivery.departures,
                delivery: Some(delivery),
                // Streets branch: the world's path is no yardstick for what is driven on them.
                completion: None,
                laps: 0,
                first_departure_s: None,
                first_departure_percent: None,
                interventions: 0,
                autonomy: None,
                lane_error_mean_m: None,
                lane_error_max_m: None,
                heading_error_mean_rad: None,
                heading_error_max_rad: None,
                other_means: senda_eval::summary::OtherMeans::default(),
                ..summary
            },
            None => summary,
        };
        // Without a clock there is nothing to say about time.
        let timed = times_s.iter().any(|time| *time > 0.0);
        (
            if timed {
                summary.with_frame_times(&times_s)
            } else {
                summary
            },
            self.frame_times_ns,
        )
    }
}

/// What a world's own floor is called: its kind, and whether it shines.
fn floor_name(world: &World) -> String {
    // Below this, reflections are hardly seen.
    let shine = if world.floor.gloss >= 0.2 { "glossy " } else { "" };
    format!("{shine}{}", world.floor.kind.name())
}
