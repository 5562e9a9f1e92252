//! A PID controller with real units: explicit time step, anti-windup, derivative on the measurement.

use serde::{Deserialize, Serialize};

/// Gains of a controller from an angle error (rad) to a yaw rate (rad/s).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PidGains {
    /// Yaw rate per radian of error (1/s). C10: 1.1, useful from 0.9 to 1.3.
    pub kp_per_s: f64,
    /// Yaw rate per radian second of summed error (1/s²). C10: 0.
    pub ki_per_s2: f64,
    /// Yaw rate per rad/s of change of the error (no unit). C10: 0.
    pub kd: f64,
}

impl Default for PidGains {
    fn default() -> Self {
        Self {
            kp_per_s: 1.1,
            ki_per_s2: 0.0,
            kd: 0.0,
        }
    }
}

/// The controller's memory.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pid {
    summed_rad_s: f64,
    last_measured_rad: Option<f64>,
}

impl Pid {
    /// The output (rad/s), limited to ±`limit_radps`, that takes `measured_rad` to `desired_rad`.
    ///
    /// The derivative acts on the measurement only, so that a jump of the desired angle gives no kick. The sum does
    /// not grow while the output is saturated in the same direction (anti-windup by conditional integration).
    /// `dt_s` is the time since the previous call; with 0 or less neither sum nor derivative act.
    pub fn step(
        &mut self,
        gains: &PidGains,
        desired_rad: f64,
        measured_rad: f64,
        dt_s: f64,
        limit_radps: f64,
    ) -> f64 {
        let error_rad = senda_geom::angle::difference(desired_rad, measured_rad);
        let slope_radps = match self.last_measured_rad {
            Some(last) if dt_s > 0.0 => senda_geom::angle::difference(measured_rad, last) / dt_s,
            _ => 0.0,
        };
        self.last_measured_rad = Some(measured_rad);
        let step_rad_s = if dt_s > 0.0 { error_rad * dt_s } else { 0.0 };
        let output = |sum: f64| gains.kp_per_s * error_rad + gains.ki_per_s2 * sum - gains.kd * slope_radps;
        let wanted = output(self.summed_rad_s + step_rad_s);
        if wanted.abs() <= limit_radps || wanted * gains.ki_per_s2 * error_rad < 0.0 {
            self.summed_rad_s += step_rad_s;
        }
        output(self.summed_rad_s).clamp(-limit_radps, limit_radps)
    }

    /// Forgets sum and last measurement.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gains(kp_per_s: f64, ki_per_s2: f64, kd: f64) -> PidGains {
        PidGains {
            kp_per_s,
            ki_per_s2,
            kd,
        }
    }

    #[test]
    fn proportional_part_is_gain_times_error() {
        let mut pid = Pid::default();
        assert!((pid.step(&gains(1.1, 0.0, 0.0), 0.3, 0.1, 0.05, 9.0) - 0.22).abs() < 1e-12);
    }

    #[test]
    fn the_sum_does_not_wind_up_while_saturated() {
        let mut pid = Pid::default();
        let only_sum = gains(0.0, 1.0, 0.0);
        for _ in 0..1000 {
            assert!(pid.step(&only_sum, 1.0, 0.0, 0.1, 0.5) <= 0.5);
        }
        // 1000 steps of 0.1 s would have summed 100; the limit allows 0.5, gone after 0.5 s of opposite error.
        let mut steps = 0;
        while pid.step(&only_sum, -1.0, 0.0, 0.1, 0.5) > 0.0 {
            steps += 1;
        }
        assert!(steps <= 5, "{steps}");
    }

    #[test]
    fn a_jump_of_the_goal_gives_no_derivative_kick() {
        let mut pid = Pid::default();
        let only_slope = gains(0.0, 0.0, 1.0);
        pid.step(&only_slope, 0.0, 0.2, 0.1, 9.0);
        assert_eq!(pid.step(&only_slope, 1.0, 0.2, 0.1, 9.0), 0.0);
        assert!((pid.step(&only_slope, 1.0, 0.25, 0.1, 9.0) + 0.5).abs() < 1e-9);
    }

    #[test]
    fn the_same_error_in_half_steps_sums_the_same() {
        let (mut coarse, mut fine) = (Pid::default(), Pid::default());
        let only_sum = gains(0.0, 2.0, 0.0);
        let mut last = (0.0, 0.0);
        for _ in 0..10 {
            last.0 = coarse.step(&only_sum, 0.1, 0.0, 0.1, 9.0);
            fine.step(&only_sum, 0.1, 0.0, 0.05, 9.0);
            last.1 = fine.step(&only_sum, 0.1, 0.0, 0.05, 9.0);
        }
        assert!((last.0 - last.1).abs() < 1e-12 && last.0 > 0.19);
    }
}
