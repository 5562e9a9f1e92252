//! The vehicle's own motion, guessed from what was commanded: commands act late and the vehicle follows with a lag.

use senda_core::Stamp;
use senda_geom::{Pose2, trig};
use std::collections::VecDeque;

/// How many commands can be under way at once; more are forgotten from the oldest on.
const PENDING_LIMIT: usize = 64;
/// The lag is integrated in steps of at most this (s).
const STEP_S: f64 = 0.01;
/// Time that passes between two observations at most, as far as motion is concerned (s): a recording may have gaps.
const GAP_LIMIT_S: f64 = 1.0;

/// A command on its way to the wheels.
#[derive(Debug, Clone, Copy)]
struct Pending {
    acts_at_s: f64,
    speed_mps: f64,
    yaw_rate_radps: f64,
}

/// Dead reckoning from commands: pure delay, then a first-order lag.
#[derive(Debug, Clone)]
pub(crate) struct CommandModel {
    delay_s: f64,
    lag_s: f64,
    now_s: Option<f64>,
    pending: VecDeque<Pending>,
    goal: (f64, f64),
    speed_mps: f64,
    yaw_rate_radps: f64,
}

impl CommandModel {
    /// For a vehicle whose commands act `delay_s` late and are followed with the time constant `lag_s`.
    pub(crate) fn new(delay_s: f64, lag_s: f64) -> Self {
        Self {
            delay_s,
            lag_s,
            now_s: None,
            pending: VecDeque::with_capacity(PENDING_LIMIT),
            goal: (0.0, 0.0),
            speed_mps: 0.0,
            yaw_rate_radps: 0.0,
        }
    }

    /// Notes a command given at `stamp`.
    pub(crate) fn command(&mut self, stamp: Stamp, speed_mps: f64, yaw_rate_radps: f64) {
        if self.pending.len() == PENDING_LIMIT {
            self.pending.pop_front();
        }
        self.pending.push_back(Pending {
            acts_at_s: stamp.as_s() + self.delay_s,
            speed_mps,
            yaw_rate_radps,
        });
    }

    /// Motion since the last call: the new vehicle frame in the old one. A measured speed replaces the guessed one.
    pub(crate) fn advance(&mut self, stamp: Stamp, measured_mps: Option<f64>) -> Pose2 {
        let to_s = stamp.as_s();
        let from_s = match self.now_s {
            Some(now_s) if now_s <= to_s => now_s.max(to_s - GAP_LIMIT_S),
            _ => to_s,
        };
        self.now_s = Some(to_s);
        if let Some(speed_mps) = measured_mps.filter(|speed| speed.is_finite()) {
            self.speed_mps = speed_mps;
        }
        let motion = self.integrate(from_s, to_s, measured_mps.is_none());
        while self.pending.front().is_some_and(|first| first.acts_at_s <= to_s) {
            self.pending.pop_front();
        }
        motion
    }

    /// Where the vehicle will be after `horizon_s` if no further command comes, in the present vehicle frame.
    pub(crate) fn predict(&self, horizon_s: f64) -> Pose2 {
        let now_s = self.now_s.unwrap_or(0.0);
        let mut copy = Wheels {
            goal: self.goal,
            speed_mps: self.speed_mps,
            yaw_rate_radps: self.yaw_rate_radps,
        };
        copy.integrate(&self.pending, self.lag_s, now_s, now_s + horizon_s, true)
    }

    /// The speed that the vehicle is thought to have (m/s).
    pub(crate) fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    /// The yaw rate that the vehicle is thought to have (rad/s).
    pub(crate) fn yaw_rate_radps(&self) -> f64 {
        self.yaw_rate_radps
    }

    /// Takes over measured speed and yaw rate.
    pub(crate) fn correct(&mut self, speed_mps: f64, yaw_rate_radps: f64) {
        self.speed_mps = speed_mps;
        self.yaw_rate_radps = yaw_rate_radps;
    }

    fn integrate(&mut self, from_s: f64, to_s: f64, speed_follows: bool) -> Pose2 {
        let mut wheels = Wheels {
            goal: self.goal,
            speed_mps: self.speed_mps,
            yaw_rate_radps: self.yaw_rate_radps,
        };
        let motion = wheels.integrate(&self.pending, self.lag_s, from_s, to_s, speed_follows);
        (self.goal, self.speed_mps, self.yaw_rate_radps) =
            (wheels.goal, wheels.speed_mps, wheels.yaw_rate_radps);
        motion
    }
}

/// The lagging part, separate so that predicting does not copy the queue.
struct Wheels {
    goal: (f64, f64),
    speed_mps: f64,
    yaw_rate_radps: f64,
}

impl Wheels {
    fn integrate(
        &mut self,
        pending: &VecDeque<Pending>,
        lag_s: f64,
        from_s: f64,
        to_s: f64,
        speed_follows: bool,
    ) -> Pose2 {
        let mut pose = Pose2::default();
        let mut at_s = from_s;
        let mut next = 0;
        loop {
            while let Some(command) = pending.get(next).filter(|command| command.acts_at_s <= at_s) {
                self.goal = (command.speed_mps, command.yaw_rate_radps);
                next += 1;
            }
            if at_s >= to_s {
                return pose;
            }
            let switch_s = pending
                .get(next)
                .map_or(f64::INFINITY, |command| command.acts_at_s);
            let until_s = to_s.min(switch_s).min(at_s + STEP_S);
            let dt_s = until_s - at_s;
            let kept = if lag_s > 0.0 {
                trig::exp(-dt_s / lag_s)
            } else {
                0.0
            };
            if speed_follows {
                self.speed_mps = self.goal.0 + (self.speed_mps - self.goal.0) * kept;
            }
            self.yaw_rate_radps = self.goal.1 + (self.yaw_rate_radps - self.goal.1) * kept;
            pose = pose.advance(self.speed_mps, self.yaw_rate_radps, dt_s);
            at_s = until_s;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_moves_the_vehicle_only_after_its_delay() {
        let mut model = CommandModel::new(0.2, 0.0);
        model.advance(Stamp::from_s(0.0), None);
        model.command(Stamp::from_s(0.0), 1.0, 0.0);
        assert!(model.advance(Stamp::from_s(0.2), None).x_m.abs() < 1e-6);
        assert!((model.predict(0.5).x_m - 0.5).abs() < 1e-9);
        assert!((model.advance(Stamp::from_s(0.5), None).x_m - 0.3).abs() < 1e-6);
    }

    #[test]
    fn a_lag_loses_its_time_constant_in_distance() {
        let mut model = CommandModel::new(0.0, 0.1);
        model.advance(Stamp::from_s(0.0), None);
        model.command(Stamp::from_s(0.0), 1.0, 0.5);
        let motion = model.advance(Stamp::from_s(1.0), None);
        assert!((motion.x_m - 0.87).abs() < 0.06, "{motion:?}");
        assert!(
            (motion.heading_rad - 0.45).abs() < 0.01 && motion.y_m > 0.0,
            "{motion:?}"
        );
    }

    #[test]
    fn measured_speed_wins_and_time_never_runs_backwards() {
        let mut model = CommandModel::new(0.0, 0.0);
        model.advance(Stamp::from_s(1.0), None);
        model.command(Stamp::from_s(1.0), 1.0, 0.0);
        assert!((model.advance(Stamp::from_s(1.5), Some(0.4)).x_m - 0.2).abs() < 1e-9);
        assert_eq!(model.advance(Stamp::from_s(0.1), None), Pose2::default());
    }
}
