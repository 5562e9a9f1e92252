//! How calmly the vehicle was driven.

use crate::statistics::root_mean_square;
use senda_core::{Body, Command, Drive, Truth};
use serde::{Deserialize, Serialize};

/// What smoothness is computed from: one row a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Time since the run began (s).
    pub time_s: f64,
    /// Yaw rate that was commanded (rad/s).
    pub yaw_rate_command_radps: f64,
    /// Speed of the vehicle, true or measured, else commanded (m/s).
    pub speed_mps: f64,
    /// Yaw rate of the vehicle, true where it is known, else commanded (rad/s).
    pub yaw_rate_radps: f64,
}

impl Motion {
    /// Of one step. A turn is asked for at the speed that is asked for; pedals ask for none, so there it is the speed that the
    /// vehicle has.
    pub fn of(
        body: &Body,
        time_s: f64,
        command: &Command,
        truth: Option<&Truth>,
        measured_mps: Option<f64>,
    ) -> Self {
        let asked_mps = body.speed_of(command);
        let speed_mps = truth
            .map(|truth| truth.speed_mps)
            .or(measured_mps)
            .unwrap_or(asked_mps);
        let turned_at_mps = match command.drive {
            Drive::SpeedMps(_) => asked_mps,
            Drive::Throttle(_) => speed_mps,
        };
        let asked_radps = body.yaw_rate_of(command.turn, turned_at_mps);
        Self {
            time_s,
            yaw_rate_command_radps: asked_radps,
            speed_mps,
            yaw_rate_radps: truth.map_or(asked_radps, |truth| truth.yaw_rate_radps),
        }
    }
}

/// Smaller is calmer. `None` with too few frames.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Smoothness {
    /// Root mean square of the change of the commanded yaw rate, per second (rad/s²).
    pub command_change_radps2: Option<f64>,
    /// The same per metre driven (rad/s/m): comparable between speeds.
    pub command_change_radps_per_m: Option<f64>,
    /// Root mean square of the change of sideways acceleration (speed · yaw rate), m/s³.
    pub lateral_jerk_mps3: Option<f64>,
    /// Root mean square of the change of forward acceleration, m/s³.
    pub forward_jerk_mps3: Option<f64>,
}

/// Shortest distance that a change is divided by (m): a command that changes at a standstill is not endlessly rough.
const SHORTEST_STEP_M: f64 = 1e-3;

/// Smoothness of a drive. Frames at equal or decreasing times are left out.
pub fn smoothness(rows: &[Motion]) -> Smoothness {
    let mut used: Vec<Motion> = Vec::with_capacity(rows.len());
    for row in rows {
        if used.last().is_none_or(|last| row.time_s > last.time_s) {
            used.push(*row);
        }
    }
    let changes = |value: fn(&Motion) -> f64| -> Vec<f64> {
        used.windows(2)
            .map(|w| (value(&w[1]) - value(&w[0])) / (w[1].time_s - w[0].time_s))
            .collect()
    };
    let per_second = changes(|row| row.yaw_rate_command_radps);
    let lateral = changes(|row| row.speed_mps * row.yaw_rate_radps);
    let acceleration = changes(|row| row.speed_mps);
    let forward: Vec<f64> = (1..acceleration.len())
        .map(|i| {
            // Accelerations belong to the middles of their intervals.
            let apart_s = 0.5 * (used[i + 1].time_s - used[i - 1].time_s);
            (acceleration[i] - acceleration[i - 1]) / apart_s
        })
        .collect();
    let (mut squares, mut driven_m) = (0.0, 0.0);
    for w in used.windows(2) {
        let step_s = w[1].time_s - w[0].time_s;
        let step_m = (0.5 * (w[0].speed_mps + w[1].speed_mps).abs() * step_s).max(SHORTEST_STEP_M);
        let change = w[1].yaw_rate_command_radps - w[0].yaw_rate_command_radps;
        squares += change * change / step_m;
        driven_m += step_m;
    }
    Smoothness {
        command_change_radps2: root_mean_square(&per_second),
        command_change_radps_per_m: (driven_m > 0.0).then(|| (squares / driven_m).sqrt()),
        lateral_jerk_mps3: root_mean_square(&lateral),
        forward_jerk_mps3: root_mean_square(&forward),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use senda_core::{Steering, Turn};

    /// It counted at the part of top speed that the pedal is: cars that only steer were compared with seemingly calmer ones.
    #[test]
    fn a_turn_by_pedals_is_one_at_the_speed_that_the_vehicle_has() {
        let body = Body {
            name: "car".into(),
            steering: Steering::Differential { track_m: 1.0 },
            width_m: 1.0,
            length_m: 2.0,
            speed_limit_mps: 10.0,
            yaw_rate_limit_radps: 5.0,
            period_s: 0.05,
            encoders: None,
            cameras: vec![],
        };
        let rate = |drive, truth: Option<&Truth>, measured_mps| {
            let turn = Turn::CurvaturePerM(0.1);
            Motion::of(&body, 0.0, &Command { turn, drive }, truth, measured_mps).yaw_rate_command_radps
        };
        let truth = Truth {
            speed_mps: 8.0,
            ..Truth::default()
        };
        assert_eq!(rate(Drive::Throttle(0.05), Some(&truth), None), 0.8);
        assert_eq!(rate(Drive::Throttle(0.05), None, Some(6.0)), 0.1 * 6.0);
        assert_eq!(rate(Drive::Throttle(0.5), None, None), 0.5);
        assert_eq!(rate(Drive::SpeedMps(4.0), Some(&truth), None), 0.4);
    }

    fn ramp(rate_change_radps2: f64, speed_mps: f64, step_s: f64) -> Vec<Motion> {
        (0..50)
            .map(|i| {
                let time_s = f64::from(i) * step_s;
                let rate = rate_change_radps2 * time_s;
                Motion {
                    time_s,
                    yaw_rate_command_radps: rate,
                    speed_mps,
                    yaw_rate_radps: rate,
                }
            })
            .collect()
    }

    #[test]
    fn a_ramp_has_its_slope() {
        let found = smoothness(&ramp(0.4, 0.2, 0.05));
        assert!((found.command_change_radps2.unwrap() - 0.4).abs() < 1e-9);
        assert!((found.command_change_radps_per_m.unwrap() - 2.0).abs() < 1e-9);
        assert!((found.lateral_jerk_mps3.unwrap() - 0.08).abs() < 1e-9);
        assert!(found.forward_jerk_mps3.unwrap() < 1e-9);
    }

    proptest! {
        #[test]
        fn frame_rate_does_not_matter(slope in 0.01..2.0f64, step_s in 0.01..0.1f64) {
            let found = smoothness(&ramp(slope, 0.3, step_s));
            prop_assert!((found.command_change_radps2.unwrap() / slope - 1.0).abs() < 1e-6);
            prop_assert!((found.command_change_radps_per_m.unwrap() / (slope / 0.3) - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn too_few_frames_give_nothing() {
        assert_eq!(smoothness(&[]), Smoothness::default());
        assert_eq!(smoothness(&[Motion::default(); 3]), Smoothness::default());
    }
}
