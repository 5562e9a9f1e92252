//! Where a run starts, and whether the world and the vehicle have such a start.

use crate::{RunError, error::wrong, referee::OPEN_END_M};
use senda_world::{VehicleSpec, World};
use serde::{Deserialize, Serialize};

/// Where the vehicle stands at the beginning, relative to the path at the world's start.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartOffset {
    /// Further along the path (m).
    #[serde(default)]
    pub station_m: f64,
    /// To the left of the path (m).
    #[serde(default)]
    pub offset_m: f64,
    /// Turned to the left of the path's direction (rad).
    #[serde(default)]
    pub heading_rad: f64,
    /// Speed with which it rolls already (m/s).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub speed_mps: f64,
}

/// At least so much way lies before a start on an open path (m): with less there is nothing to drive.
const LEAST_WAY_M: f64 = 0.1;
/// Numbers beyond this are mistakes (m, rad).
const FAR: f64 = 1e6;

pub(crate) fn is_zero(number: &f64) -> bool {
    *number == 0.0
}

impl StartOffset {
    /// Refuses what no world and no vehicle has.
    pub(crate) fn check(&self) -> Result<(), RunError> {
        for (key, value) in [
            ("start.station_m", self.station_m),
            ("start.offset_m", self.offset_m),
            ("start.heading_rad", self.heading_rad),
        ] {
            if !(-FAR..=FAR).contains(&value) {
                return wrong(key, value, "a number, no further from 0 than a million");
            }
        }
        if !(0.0..=FAR).contains(&self.speed_mps) {
            return wrong(
                "start.speed_mps",
                self.speed_mps,
                "0 to the vehicle's highest speed",
            );
        }
        Ok(())
    }

    /// Refuses what this world or vehicle does not have.
    pub(crate) fn check_with(&self, world: &World, vehicle: &VehicleSpec) -> Result<(), RunError> {
        // Without an offset the world itself answers for its start.
        if let Some(latest_m) = latest_m(world).filter(|_| self.station_m != 0.0) {
            let earliest_m = 0.0 - world.start_station_m;
            if !(earliest_m..=latest_m).contains(&self.station_m) {
                return wrong(
                    "start.station_m",
                    self.station_m,
                    format!(
                        "{earliest_m:.2} to {latest_m:.2}: the path of {} is open, {:.2} m long, and the way ends \
                         {OPEN_END_M} m before it does",
                        world.name,
                        world.path.length_m()
                    ),
                );
            }
        }
        if self.speed_mps > vehicle.speed_limit_mps {
            return wrong(
                "start.speed_mps",
                self.speed_mps,
                format!(
                    "0 to {}: {} goes no faster",
                    vehicle.speed_limit_mps, vehicle.name
                ),
            );
        }
        let drive = &vehicle.drive;
        let rolls = vehicle.engine.is_some()
            || drive.speed_time_constant_s > 0.0
            || drive.acceleration_limit_mps2.is_some();
        if self.speed_mps > 0.0 && !rolls {
            return wrong(
                "start.speed_mps",
                self.speed_mps,
                format!(
                    "0: {} has the speed of its command at once, so it cannot roll without one",
                    vehicle.name
                ),
            );
        }
        Ok(())
    }

    /// The same start, brought back onto the way where an open path has ended before it: for starts that are drawn without
    /// knowing the world.
    pub(crate) fn on_the_way(self, world: &World) -> Self {
        match latest_m(world) {
            Some(latest_m) if self.station_m > latest_m => Self {
                station_m: if latest_m > 0.0 {
                    self.station_m % latest_m
                } else {
                    0.0
                },
                ..self
            },
            _ => self,
        }
    }
}

/// The latest start on an open path (m beyond the world's own); `None` where laps go round. Streets of a warehouse have no end
/// that counts, only one where they stop.
fn latest_m(world: &World) -> Option<f64> {
    let beyond_m = match world.warehouse {
        Some(_) => 0.0,
        None => OPEN_END_M + LEAST_WAY_M,
    };
    (!world.path.is_closed()).then(|| world.path.length_m() - world.start_station_m - beyond_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Ears, Scenario, drive};

    /// The key's complaint, or nothing.
    fn refused(world: &str, vehicle: &str, start: StartOffset) -> Option<String> {
        let mut scenario = Scenario::new(world, vehicle, "expert");
        scenario.start = start;
        scenario.time_limit_s = Some(0.2);
        let run = drive::in_memory(&scenario, &mut Ears::deaf());
        run.err().map(|error| error.to_string())
    }

    #[test]
    fn starts_that_the_path_does_not_have_are_refused() {
        let at = |station_m: f64| StartOffset {
            station_m,
            ..StartOffset::default()
        };
        for station_m in [999.0, 5.9, -3.0, f64::NAN, 1e9] {
            let error = refused("straight", "gopigo", at(station_m)).unwrap();
            assert!(
                error.contains(&format!("`start.station_m` is {station_m}, but must be")),
                "{error}"
            );
        }
        let error = refused("straight", "gopigo", at(999.0)).unwrap();
        assert!(error.contains("0.00 to 5.30: the path of straight"), "{error}");
        assert_eq!(refused("straight", "gopigo", at(5.29)), None);
        // Closed paths go round.
        assert_eq!(refused("oval", "gopigo", at(-3.0)), None);
        assert_eq!(refused("oval", "gopigo", at(99.0)), None);
    }

    #[test]
    fn starts_that_the_vehicle_does_not_have_are_refused() {
        let rolling = |speed_mps: f64| StartOffset {
            speed_mps,
            ..StartOffset::default()
        };
        for (vehicle, speed_mps, words) in [
            ("gopigo", 5.0, "gopigo goes no faster"),
            ("gopigo", -1.0, "0 to the vehicle's highest speed"),
            ("gopigo", f64::NAN, "is NaN, but must be 0 to"),
            ("unicycle", 0.2, "has the speed of its command at once"),
        ] {
            let error = refused("straight", vehicle, rolling(speed_mps)).unwrap();
            assert!(
                error.contains("`start.speed_mps`") && error.contains(words),
                "{error}"
            );
        }
        assert_eq!(refused("straight", "gopigo", rolling(0.3)), None);
        assert_eq!(refused("straight", "unicycle", rolling(0.0)), None);
    }

    /// They stood at the path's end and had completed it before they moved.
    #[test]
    fn drawn_starts_lie_on_the_way() {
        let world = World::named("straight").unwrap();
        for (drawn_m, found_m) in [(2.0, 2.0), (5.2, 5.2), (5.4, 0.1), (12.0, 1.4)] {
            let start = StartOffset {
                station_m: drawn_m,
                ..StartOffset::default()
            };
            let found = start.on_the_way(&world).station_m;
            assert!((found - found_m).abs() < 1e-9, "{drawn_m}: {found}");
        }
    }
}
