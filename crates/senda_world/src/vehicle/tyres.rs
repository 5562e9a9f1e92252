//! Tyres of a front-steered vehicle that is fast enough to slide.

use crate::error::WorldError;
use crate::reader::Table;
use crate::writer::Document;

/// Linear tyres for the dynamic bicycle (Rajamani 2012, chapter 2): side force = stiffness · slip angle, for both wheels
/// of an axle together. Without them a front-steered vehicle rolls without slipping (the kinematic bicycle).
#[derive(Debug, Clone, PartialEq)]
pub struct Tyres {
    /// Mass of the vehicle (kg).
    pub mass_kg: f64,
    /// Moment of inertia about the upright axis through the centre of mass (kg·m²).
    pub yaw_inertia_kgm2: f64,
    /// Centre of mass ahead of the rear axle (m), less than the wheelbase.
    pub centre_ahead_m: f64,
    /// Side force of the front axle per slip angle (N/rad).
    pub front_stiffness_npr: f64,
    /// Side force of the rear axle per slip angle (N/rad).
    pub rear_stiffness_npr: f64,
    /// Largest side acceleration that the floor's grip allows (m/s²): friction coefficient times 9.81.
    pub grip_mps2: f64,
}

impl Tyres {
    pub(super) fn read(mut table: Table, wheelbase_m: f64) -> Result<Self, WorldError> {
        let mass_kg = table.required_f64("mass_kg", 0.01, 10_000.0)?;
        let tyres = Self {
            mass_kg,
            // A bar of one and a half wheelbases has this inertia.
            yaw_inertia_kgm2: table.f64(
                "yaw_inertia_kgm2",
                1e-7,
                1e6,
                mass_kg * wheelbase_m * wheelbase_m * 2.25 / 12.0,
            )?,
            centre_ahead_m: table.f64("centre_ahead_m", 0.0, wheelbase_m, 0.5 * wheelbase_m)?,
            front_stiffness_npr: table.required_f64("front_stiffness_npr", 0.01, 1e6)?,
            rear_stiffness_npr: table.required_f64("rear_stiffness_npr", 0.01, 1e6)?,
            grip_mps2: table.f64("grip_mps2", 0.1, 50.0, 8.0)?,
        };
        table.finish()?;
        Ok(tyres)
    }

    pub(super) fn write(&self, document: &mut Document) {
        document.header("tyres");
        document.number("mass_kg", self.mass_kg);
        document.number("yaw_inertia_kgm2", self.yaw_inertia_kgm2);
        document.number("centre_ahead_m", self.centre_ahead_m);
        document.number("front_stiffness_npr", self.front_stiffness_npr);
        document.number("rear_stiffness_npr", self.rear_stiffness_npr);
        document.number("grip_mps2", self.grip_mps2);
    }
}

#[cfg(test)]
mod tests {
    use crate::VehicleSpec;

    const CAR: &str = "width_m = 0.2\nlength_m = 0.3\nspeed_limit_mps = 3\n[wheels]\ndiameter_m = 0.07\n\
                       [tyres]\nmass_kg = 1.6\nfront_stiffness_npr = 50\nrear_stiffness_npr = 60\n[steering]\n";

    #[test]
    fn tyres_survive_the_resolved_copy_and_fill_their_defaults() {
        let toml = format!("{CAR}kind = \"ackermann\"\nwheelbase_m = 0.2\nsteering_limit_deg = 30");
        let spec = VehicleSpec::parse("car.toml", &toml).unwrap().0;
        let tyres = spec.tyres.clone().unwrap();
        assert_eq!((tyres.centre_ahead_m, tyres.grip_mps2), (0.1, 8.0));
        assert!((tyres.yaw_inertia_kgm2 - 0.012).abs() < 1e-12);
        let again = VehicleSpec::parse("car.toml", &spec.to_toml()).unwrap().0;
        assert_eq!(again, spec);
    }

    #[test]
    fn a_differential_vehicle_has_none() {
        let toml = format!("{CAR}kind = \"differential\"\ntrack_m = 0.1");
        let error = VehicleSpec::parse("robot.toml", &toml).unwrap_err().to_string();
        assert!(error.contains("tyres on a front-steered vehicle"), "{error}");
    }
}
