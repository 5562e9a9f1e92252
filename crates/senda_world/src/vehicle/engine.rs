//! Engine and brakes of a vehicle that is driven by throttle: forces instead of speeds.

use crate::error::WorldError;
use crate::reader::Table;
use crate::writer::Document;

/// Longitudinal forces (Rajamani 2012, chapter 4, without gears): mass · acceleration = drive - drag·v² - rolling, or
/// less the brakes. Without an engine a vehicle obeys in m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Engine {
    /// Mass of the vehicle (kg).
    pub mass_kg: f64,
    /// Force at full throttle and low speed (N).
    pub drive_force_n: f64,
    /// Power at full throttle (W): at speed the force is no more than this divided by the speed.
    pub power_w: f64,
    /// Force of the brakes at throttle -1 (N).
    pub brake_force_n: f64,
    /// Air drag: force per speed squared (N·s²/m²), half of density · drag coefficient · frontal area.
    pub drag_n_per_mps2: f64,
    /// Rolling resistance (N).
    pub rolling_n: f64,
}

/// How fast a wanted speed is approached when a command gives a speed instead of a throttle (s): a patient foot.
const APPROACH_S: f64 = 0.6;

impl Engine {
    /// Acceleration (m/s²) at a throttle of -1 (full brakes) to 1 (full power) and a speed (m/s), on a level road.
    /// At standstill nothing pulls backwards.
    pub fn acceleration(&self, throttle: f64, speed_mps: f64) -> f64 {
        let force_n = if throttle >= 0.0 {
            throttle.min(1.0) * self.pull_n(speed_mps)
        } else {
            throttle.max(-1.0) * self.brake_force_n
        };
        (force_n - self.resistance_n(speed_mps)) / self.mass_kg
    }

    /// Speed (m/s) after a time (s) at a throttle: never below 0, for brakes and resistance only stop, and never pulled
    /// above `limit_mps`.
    pub fn speed_after(&self, throttle: f64, speed_mps: f64, limit_mps: f64, time_s: f64) -> f64 {
        let next_mps = speed_mps + self.acceleration(throttle, speed_mps) * time_s;
        // Above the limit it rolls out; nothing stops it at once.
        next_mps.min(limit_mps.max(speed_mps)).max(0.0)
    }

    /// The throttle (-1..=1) that brings the speed to a wanted one (m/s).
    pub fn throttle_for(&self, wanted_mps: f64, speed_mps: f64) -> f64 {
        if wanted_mps <= 0.0 {
            return -1.0;
        }
        let force_n = self.mass_kg * (wanted_mps - speed_mps) / APPROACH_S + self.resistance_n(wanted_mps);
        if force_n >= 0.0 {
            (force_n / self.pull_n(speed_mps)).min(1.0)
        } else {
            (force_n / self.brake_force_n).max(-1.0)
        }
    }

    fn pull_n(&self, speed_mps: f64) -> f64 {
        self.drive_force_n.min(self.power_w / speed_mps.max(0.1))
    }

    fn resistance_n(&self, speed_mps: f64) -> f64 {
        self.rolling_n + self.drag_n_per_mps2 * speed_mps * speed_mps
    }

    pub(super) fn read(mut table: Table) -> Result<Self, WorldError> {
        let mass_kg = table.required_f64("mass_kg", 0.01, 100_000.0)?;
        let drive_force_n = table.required_f64("drive_force_n", 0.001, 1e6)?;
        let engine = Self {
            mass_kg,
            drive_force_n,
            power_w: table.required_f64("power_w", 0.001, 1e7)?,
            brake_force_n: table.f64("brake_force_n", 0.001, 1e6, 2.0 * drive_force_n)?,
            drag_n_per_mps2: table.f64("drag_n_per_mps2", 0.0, 100.0, 0.0)?,
            // A hundredth of the weight: rubber on asphalt.
            rolling_n: table.f64("rolling_n", 0.0, 1e5, mass_kg * 9.81 * 0.01)?,
        };
        table.finish()?;
        Ok(engine)
    }

    pub(super) fn write(&self, document: &mut Document) {
        document.header("engine");
        document.number("mass_kg", self.mass_kg);
        document.number("drive_force_n", self.drive_force_n);
        document.number("power_w", self.power_w);
        document.number("brake_force_n", self.brake_force_n);
        document.number("drag_n_per_mps2", self.drag_n_per_mps2);
        document.number("rolling_n", self.rolling_n);
    }
}

#[cfg(test)]
mod tests {
    use crate::VehicleSpec;

    fn roll(throttle: impl Fn(f64) -> f64, from_mps: f64, seconds: f64) -> f64 {
        let spec = VehicleSpec::named("sedan").unwrap();
        let engine = spec.engine.unwrap();
        (0..(seconds * 200.0) as usize).fold(from_mps, |speed, _| {
            engine.speed_after(throttle(speed), speed, spec.speed_limit_mps, 0.005)
        })
    }

    #[test]
    fn throttle_pulls_brakes_stop_and_the_limit_holds() {
        assert!(roll(|_| 0.3, 0.0, 2.0) < roll(|_| 0.6, 0.0, 2.0));
        let limit_mps = VehicleSpec::named("sedan").unwrap().speed_limit_mps;
        assert!((roll(|_| 1.0, 0.0, 60.0) - limit_mps).abs() < 1e-9);
        assert_eq!(roll(|_| -1.0, 8.0, 4.0), 0.0, "brakes stop and never pull back");
        assert!(roll(|_| 0.0, 8.0, 3.0) < 8.0, "it rolls out");
        assert_eq!(roll(|_| 0.0, 0.0, 3.0), 0.0);
    }

    #[test]
    fn a_wanted_speed_is_reached_from_below_and_above() {
        let engine = VehicleSpec::named("sedan").unwrap().engine.unwrap();
        for from_mps in [0.0, 12.0] {
            let speed_mps = roll(|speed| engine.throttle_for(7.0, speed), from_mps, 12.0);
            assert!((speed_mps - 7.0).abs() < 0.05, "{speed_mps}");
        }
        assert_eq!(roll(|speed| engine.throttle_for(0.0, speed), 9.0, 5.0), 0.0);
    }

    #[test]
    fn the_resolved_copy_is_the_same_vehicle() {
        let spec = VehicleSpec::named("sedan").unwrap();
        assert_eq!(VehicleSpec::parse("sedan.toml", &spec.to_toml()).unwrap().0, spec);
    }
}
