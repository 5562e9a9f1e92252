//! From command to motion: actuators, wheels, encoders, motors and battery.

use crate::error::WorldError;
use crate::reader::Table;
use crate::writer::Document;
use senda_core::Steering;
use std::f64::consts::PI;

/// How commands become motion. All zeros: the kinematic vehicle that obeys at once.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DriveTrain {
    /// Time from a command to its first effect (s).
    pub delay_s: f64,
    /// Time constant of the first-order response of speed, of each wheel on a differential vehicle (s); 0: at once.
    pub speed_time_constant_s: f64,
    /// Time constant of the first-order response of the front wheels' angle (s); 0: at once.
    pub steering_time_constant_s: f64,
    /// Largest acceleration and deceleration (m/s²); `None`: unlimited.
    pub acceleration_limit_mps2: Option<f64>,
    /// Fastest change of the front wheels' angle (rad/s); `None`: unlimited. A servo of 0.16 s for 60° has 6.5.
    pub steering_rate_limit_radps: Option<f64>,
    /// Smallest wheel speed (m/s) that overcomes friction: anything slower stands still.
    pub dead_band_mps: f64,
    /// Smallest step of the steering servo (rad); 0: continuous. The kit car's servo moves in whole degrees.
    pub steering_step_rad: f64,
    /// Play of the steering (rad): the wheels lag the servo by up to half of it when it turns back.
    pub steering_play_rad: f64,
    /// Standard deviation of the steering's lasting zero error (rad), drawn once a run.
    pub steering_bias_std_rad: f64,
    /// Standard deviation of a lasting error of speed, relative, drawn once a run.
    pub speed_bias_std: f64,
}

impl DriveTrain {
    pub(super) fn read(mut table: Table) -> Result<Self, WorldError> {
        let drive = Self {
            delay_s: table.f64("delay_s", 0.0, 2.0, 0.0)?,
            speed_time_constant_s: table.f64("speed_time_constant_s", 0.0, 10.0, 0.0)?,
            steering_time_constant_s: table.f64("steering_time_constant_s", 0.0, 10.0, 0.0)?,
            acceleration_limit_mps2: table.optional_f64("acceleration_limit_mps2", 0.01, 100.0)?,
            steering_rate_limit_radps: table.optional_angle(
                "steering_rate_limit_radps",
                "steering_rate_limit_degps",
                0.01,
                100.0,
            )?,
            dead_band_mps: table.f64("dead_band_mps", 0.0, 1.0, 0.0)?,
            steering_step_rad: table
                .optional_angle("steering_step_rad", "steering_step_deg", 0.0, 0.2)?
                .unwrap_or(0.0),
            steering_play_rad: table
                .optional_angle("steering_play_rad", "steering_play_deg", 0.0, 0.3)?
                .unwrap_or(0.0),
            steering_bias_std_rad: table
                .optional_angle("steering_bias_std_rad", "steering_bias_std_deg", 0.0, 0.3)?
                .unwrap_or(0.0),
            speed_bias_std: table.f64("speed_bias_std", 0.0, 0.5, 0.0)?,
        };
        table.finish()?;
        Ok(drive)
    }

    pub(super) fn write(&self, document: &mut Document) {
        document.header("drive");
        document.number("delay_s", self.delay_s);
        document.number("speed_time_constant_s", self.speed_time_constant_s);
        document.number("steering_time_constant_s", self.steering_time_constant_s);
        if let Some(limit) = self.acceleration_limit_mps2 {
            document.number("acceleration_limit_mps2", limit);
        }
        if let Some(limit) = self.steering_rate_limit_radps {
            document.number("steering_rate_limit_radps", limit);
        }
        document.number("dead_band_mps", self.dead_band_mps);
        document.number("steering_step_rad", self.steering_step_rad);
        document.number("steering_play_rad", self.steering_play_rad);
        document.number("steering_bias_std_rad", self.steering_bias_std_rad);
        document.number("speed_bias_std", self.speed_bias_std);
    }
}

/// The driven wheels and how well they hold the floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Wheels {
    /// Diameter (m).
    pub diameter_m: f64,
    /// Distance between the driven wheels (m).
    pub track_m: f64,
    /// Standard deviation of each wheel's speed, relative to it, renewed every 0.1 s (uneven floor, gears).
    pub noise: f64,
    /// Standard deviation of the lasting difference between left and right, relative, drawn once a run.
    pub imbalance_std: f64,
}

impl Wheels {
    pub(super) fn read(mut table: Table, steering: &Steering) -> Result<Self, WorldError> {
        let diameter_m = table.required_f64("diameter_m", 0.001, 5.0)?;
        let track_m = match *steering {
            Steering::Differential { track_m } => track_m,
            Steering::Ackermann { wheelbase_m, .. } => {
                table.f64("track_m", 0.005, 10.0, wheelbase_m * 0.8)?
            }
        };
        let wheels = Self {
            diameter_m,
            track_m,
            noise: table.f64("noise", 0.0, 0.5, 0.0)?,
            imbalance_std: table.f64("imbalance_std", 0.0, 0.5, 0.0)?,
        };
        table.finish()?;
        Ok(wheels)
    }

    pub(super) fn write(&self, document: &mut Document, steering: &Steering) {
        document.header("wheels");
        document.number("diameter_m", self.diameter_m);
        if matches!(steering, Steering::Ackermann { .. }) {
            document.number("track_m", self.track_m);
        }
        document.number("noise", self.noise);
        document.number("imbalance_std", self.imbalance_std);
    }

    /// Circumference (m).
    pub fn circumference_m(&self) -> f64 {
        PI * self.diameter_m
    }
}

/// Encoders on both driven wheels.
#[derive(Debug, Clone, PartialEq)]
pub struct Encoders {
    /// Ticks in one turn of a wheel.
    pub ticks_per_turn: u32,
    /// Whether they tell forwards from backwards. The GoPiGo's count up only.
    pub signed: bool,
}

impl Encoders {
    pub(super) fn read(mut table: Table) -> Result<Self, WorldError> {
        let Some(ticks) = table.optional_u64("ticks_per_turn", 1, 1_000_000)? else {
            return Err(table.missing("ticks_per_turn", "a whole number"));
        };
        let encoders = Self {
            ticks_per_turn: ticks as u32,
            signed: table.bool("signed", false)?,
        };
        table.finish()?;
        Ok(encoders)
    }

    pub(super) fn write(&self, document: &mut Document) {
        document.header("encoders");
        document.line("ticks_per_turn", self.ticks_per_turn);
        document.line("signed", self.signed);
    }
}

/// Motor value against wheel speed at a voltage (C11 in SPEC): value = slope·(turns/s) + intercept at
/// `reference_v`, and at the same value speed is proportional to the voltage.
#[derive(Debug, Clone, PartialEq)]
pub struct Motor {
    /// Value per turn of the wheel per second.
    pub slope_per_turnps: f64,
    /// Value at which the wheel just stands still.
    pub intercept: f64,
    /// Voltage of the calibration (V).
    pub reference_v: f64,
    /// Largest value; values are whole numbers.
    pub value_limit: u32,
    /// Below this value the motor does not move.
    pub dead_value: u32,
}

impl Motor {
    /// The value (not rounded, not limited) that turns a wheel at `turns_per_s` with a battery at `battery_v`.
    pub fn value_for(&self, turns_per_s: f64, battery_v: f64) -> f64 {
        if turns_per_s == 0.0 || battery_v <= 0.0 {
            return 0.0;
        }
        let at_reference = turns_per_s.abs() * self.reference_v / battery_v;
        turns_per_s.signum() * (self.slope_per_turnps * at_reference + self.intercept)
    }

    /// The turns a second that a value gives with a battery at `battery_v`.
    pub fn turns_per_s(&self, value: f64, battery_v: f64) -> f64 {
        if value.abs() < f64::from(self.dead_value) || value.abs() <= self.intercept {
            return 0.0;
        }
        value.signum() * (value.abs() - self.intercept) / self.slope_per_turnps * battery_v / self.reference_v
    }

    pub(super) fn read(mut table: Table) -> Result<Self, WorldError> {
        let whole = |value: Option<u64>, default: u32| value.map_or(default, |value| value as u32);
        let motor = Self {
            slope_per_turnps: table.required_f64("slope_per_turnps", 0.001, 1e6)?,
            intercept: table.f64("intercept", 0.0, 1e6, 0.0)?,
            reference_v: table.required_f64("reference_v", 0.1, 1000.0)?,
            value_limit: whole(table.optional_u64("value_limit", 1, 1_000_000)?, 255),
            dead_value: whole(table.optional_u64("dead_value", 0, 1_000_000)?, 0),
        };
        table.finish()?;
        Ok(motor)
    }

    pub(super) fn write(&self, document: &mut Document) {
        document.header("motor");
        document.number("slope_per_turnps", self.slope_per_turnps);
        document.number("intercept", self.intercept);
        document.number("reference_v", self.reference_v);
        document.line("value_limit", self.value_limit);
        document.line("dead_value", self.dead_value);
    }
}

/// A battery whose voltage falls with time and load.
#[derive(Debug, Clone, PartialEq)]
pub struct Battery {
    /// Voltage at the beginning of a run (V).
    pub start_v: f64,
    /// Voltage below which the vehicle should stop (V).
    pub empty_v: f64,
    /// Fall of the voltage at full speed (V/s).
    pub drain_vps: f64,
    /// Drop under full load (V).
    pub sag_v: f64,
    /// Standard deviation of a measurement (V).
    pub noise_v: f64,
    /// What a converter makes of it for the motors (V); `None`: they are fed by the battery itself.
    pub regulated_v: Option<f64>,
}

/// A step-down converter needs this much more than it gives (V; document D's data sheet).
const CONVERTER_V: f64 = 1.0;

impl Battery {
    pub(super) fn read(mut table: Table) -> Result<Self, WorldError> {
        let start_v = table.required_f64("start_v", 0.1, 1000.0)?;
        let battery = Self {
            start_v,
            empty_v: table.f64("empty_v", 0.0, 1000.0, start_v * 0.8)?,
            drain_vps: table.f64("drain_vps", 0.0, 10.0, 0.0)?,
            sag_v: table.f64("sag_v", 0.0, 100.0, 0.0)?,
            noise_v: table.f64("noise_v", 0.0, 10.0, 0.0)?,
            regulated_v: table.optional_f64("regulated_v", 0.1, 1000.0)?,
        };
        table.finish()?;
        Ok(battery)
    }

    pub(super) fn write(&self, document: &mut Document) {
        document.header("battery");
        document.number("start_v", self.start_v);
        document.number("empty_v", self.empty_v);
        document.number("drain_vps", self.drain_vps);
        document.number("sag_v", self.sag_v);
        document.number("noise_v", self.noise_v);
        if let Some(regulated_v) = self.regulated_v {
            document.number("regulated_v", regulated_v);
        }
    }

    /// What the motors are fed with (V) while the battery has `battery_v`.
    pub fn supply_v(&self, battery_v: f64) -> f64 {
        self.regulated_v.map_or(battery_v, |regulated_v| {
            regulated_v.min(battery_v - CONVERTER_V).max(0.0)
        })
    }
}
