//! Decides when a run is over.

use crate::{
    Pilot, Scenario,
    drive::{Ending, Judge},
    scenario::find_vehicle,
};
use senda_core::{Command, Truth};
use senda_eval::Course;
use senda_geom::{Curve, Tracker};
use senda_world::{Warehouse, World};

/// On an open path the way ends this far before the path does: there the camera sees past its end (m). C2: the
/// GoPiGo's camera sees 50 cm ahead.
pub const OPEN_END_M: f64 = 0.6;
/// A vehicle slower than this stands (m/s).
const STANDING_MPS: f64 = 0.002;
/// Missions in a warehouse end after this time (s) unless the scenario says otherwise: waits for packages and lights included.
const MISSION_LIMIT_S: f64 = 400.0;
/// Standing for this long ends the run (s): longer than any start-up delay, shorter than a spectator's patience.
const STANDING_S: f64 = 3.0;

/// A battery that is below its empty voltage for this long ends the run (s): longer than a start under load pulls it down.
const EMPTY_S: f64 = 1.0;

/// Watches the true state and says when a run is over. Without a true state it only watches the driver.
pub struct Referee {
    path: Curve,
    /// In a warehouse: no laps, no limit on standing, and the nearest street counts.
    warehouse: Option<Warehouse>,
    tracker: Tracker,
    goal_m: f64,
    stray_limit_m: f64,
    time_limit_s: f64,
    standing_limit_s: f64,
    standing_since_s: Option<f64>,
    /// Below this the vehicle has to stop (V); `None`: nothing says so, or the driver itself sees to it.
    empty_v: Option<f64>,
    empty_since_s: Option<f64>,
    lap_m: f64,
}

impl Referee {
    /// For a scenario in its world.
    pub fn new(scenario: &Scenario, world: &World) -> Self {
        let station_m = world.start_station_m + scenario.start.station_m;
        let way_m = way_m(&world.path, world.path.normalise_station(station_m));
        let goal_m = way_m
            * if world.path.is_closed() {
                f64::from(scenario.laps)
            } else {
                1.0
            };
        // The slowest speed that a run without a stated speed is expected to have (m/s): half of C16's slowest.
        let speed_mps = scenario.speed_mps.unwrap_or(0.035);
        Self {
            path: world.path.clone(),
            warehouse: world.warehouse.clone(),
            tracker: Tracker::new(world.path.normalise_station(station_m)),
            goal_m,
            // Three times as far as the lane is wide: no driver of ours finds back from there.
            stray_limit_m: 3.0 * world.corridor_half_width_m + scenario.start.offset_m.abs(),
            time_limit_s: scenario.time_limit_s.unwrap_or(if world.warehouse.is_some() {
                MISSION_LIMIT_S
            } else {
                4.0 * goal_m / speed_mps + 20.0
            }),
            standing_limit_s: STANDING_S,
            standing_since_s: None,
            empty_v: empty_v(scenario),
            empty_since_s: None,
            lap_m: way_m,
        }
    }

    /// For a person, who may stand, stray and come back, and takes as long as the scenario allows.
    pub fn patient(scenario: &Scenario, world: &World) -> Self {
        Self {
            stray_limit_m: f64::INFINITY,
            standing_limit_s: f64::INFINITY,
            time_limit_s: scenario.time_limit_s.unwrap_or(f64::INFINITY),
            ..Self::new(scenario, world)
        }
    }

    /// What a scenario asks to be driven, as the metrics see it.
    pub fn course<'a>(scenario: &Scenario, world: &'a World) -> Course<'a> {
        Course {
            open_end_m: OPEN_END_M,
            ..Course::of(world, Some(f64::from(scenario.laps)))
        }
    }

    /// The length of one lap, or of the way on an open path (m).
    pub fn lap_m(&self) -> f64 {
        self.lap_m
    }
}

impl Judge for Referee {
    fn progress(&self) -> f64 {
        (self.tracker.travelled_m() / self.goal_m).clamp(0.0, 1.0)
    }

    fn judge(&mut self, truth: Option<&Truth>, command: &Command, pilot: &Pilot) -> Option<Ending> {
        if pilot.is_done() {
            return Some(Ending::Done);
        }
        let truth = truth?;
        let now_s = truth.stamp.as_s();
        if self.empty_v.is_none_or(|empty_v| truth.battery_v >= empty_v) {
            self.empty_since_s = None;
        } else if now_s - *self.empty_since_s.get_or_insert(now_s) > EMPTY_S {
            return Some(Ending::BatteryEmpty);
        }
        if let Some(warehouse) = &self.warehouse {
            let at = truth.world_from_vehicle.position();
            let (_, place) = warehouse.nearest_street(&self.path, at);
            if place.offset_m.abs() > self.stray_limit_m {
                return Some(Ending::Strayed);
            }
            return (now_s > self.time_limit_s).then_some(Ending::TimeOut);
        }
        let place = self
            .tracker
            .advance(&self.path, truth.world_from_vehicle.position());
        if self.tracker.travelled_m() >= self.goal_m {
            return Some(Ending::Finished);
        }
        if place.offset_m.abs() > self.stray_limit_m {
            return Some(Ending::Strayed);
        }
        let standing = truth.speed_mps.abs() < STANDING_MPS
            && matches!(command.drive, senda_core::Drive::SpeedMps(v) if v.abs() < STANDING_MPS);
        let since_s = self.standing_since_s.get_or_insert(now_s);
        if !standing {
            *since_s = now_s;
        } else if now_s - *since_s > self.standing_limit_s {
            return Some(Ending::Stopped);
        }
        (now_s > self.time_limit_s).then_some(Ending::TimeOut)
    }
}

/// The voltage below which the vehicle of a scenario has to stop. A mission has an option for it, and drives home or gives up by itself.
fn empty_v(scenario: &Scenario) -> Option<f64> {
    let vehicle = find_vehicle(&scenario.vehicle).ok()?;
    let battery = vehicle.battery.filter(|_| scenario.driver != "mission")?;
    Some(battery.empty_v)
}

/// What a scenario asks to be driven, as the metrics see it.
pub fn course<'a>(scenario: &Scenario, world: &'a World) -> Course<'a> {
    Course {
        open_end_m: OPEN_END_M,
        ..Course::of(world, Some(f64::from(scenario.laps)))
    }
}

/// The length of one lap, or what is left of an open path up to where the camera sees its end (m).
pub fn way_m(path: &Curve, from_station_m: f64) -> f64 {
    if path.is_closed() {
        path.length_m()
    } else {
        (path.length_m() - OPEN_END_M - from_station_m).max(0.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Ears, drive};

    /// Whatever the file said, an empty battery was driven on.
    #[test]
    fn an_empty_battery_ends_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tired.toml");
        let vehicle = find_vehicle("gopigo").unwrap().to_toml();
        let ended = |start_v: f64| {
            let tired = vehicle.replace("start_v = 9.277", &format!("start_v = {start_v:?}"));
            std::fs::write(&path, tired).unwrap();
            let scenario = Scenario {
                time_limit_s: Some(3.0),
                ..Scenario::new("straight", path.to_str().unwrap(), "line")
            };
            drive::in_memory(&scenario, &mut Ears::deaf()).unwrap()
        };
        let outcome = ended(7.1);
        assert_eq!(outcome.ending, Ending::BatteryEmpty);
        assert_eq!(outcome.summary.ended, "the battery is empty");
        assert!((EMPTY_S..2.0).contains(&outcome.summary.duration_s));
        assert_eq!(ended(8.0).ending, Ending::TimeOut);
        let mission = Scenario::new("warehouse", "warehouse-cart", "mission");
        assert_eq!(empty_v(&mission), None, "it has its own rule");
    }
}
