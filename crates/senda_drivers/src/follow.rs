//! C10: from where the line lies to how the vehicle turns.
//!
//! The state is that of the *line in the vehicle's frame*: `d_m` is how far the line passes to the left of the axle's
//! centre, `theta_rad` how far the line's direction is turned to the left of the vehicle's.
//!
//! The document that C10 comes from describes the *vehicle relative to the line*: its d is how far the vehicle is to the
//! right of the line, its θ how far the vehicle points to the right of it. That is the same pair of numbers with the
//! same signs. Only its ω (clockwise positive) is the negative of ours: here `d' = v·sin θ` and `θ' = -ω`.

use crate::options::{DriverError, check};
use crate::pid::{Pid, PidGains};
use senda_core::{Body, Steering};
use senda_geom::trig;
use serde::{Deserialize, Serialize};

/// Where the path lies, seen from the vehicle (vehicle frame, SI, left positive).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LineState {
    /// Distance from the axle's centre to the path (m), positive when the path is to the left.
    pub d_m: f64,
    /// Direction of the path in the vehicle frame (rad), positive when it points to the left.
    pub theta_rad: f64,
    /// Curvature of the path where the vehicle is (1/m), left positive; 0 in the document's form.
    pub curvature_per_m: f64,
}

/// How the line is described and followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// As the document: a straight line through the blob's centroid, angle controller with constants per second.
    Document,
    /// The line's shape on the floor plane: curvature ahead, feedback with constants per metre (C17).
    #[default]
    Curve,
    /// The line's shape on the floor plane, followed by pure pursuit of a point ahead (Coulter 1992).
    PurePursuit,
    /// Lanes only: where the road goes by a vote of all lines in each frame, followed by pure pursuit. Needs no vehicle that obeys.
    Road,
}

/// Constants of the controller. Those of the forms that are not in use are ignored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FollowOptions {
    /// Document: look-ahead L (m): the desired angle is atan(d / L). C10: 0.40, useful from 0.30 to 0.60.
    pub look_ahead_m: f64,
    /// Document: gains of the angle controller.
    pub pid: PidGains,
    /// All forms: the approach angle is not steeper than this (rad). The document has such a limit without giving it;
    /// 1.2 (69°) is a guess that keeps the line in a picture 54° wide.
    pub angle_limit_rad: f64,
    /// All forms: largest yaw rate asked for (rad/s). The document has such a limit without giving it; 2.5 is a guess.
    /// The vehicle's own limit holds as well.
    pub yaw_rate_limit_radps: f64,
    /// Curve: distance constant of the feedback (m) at low speed: an error falls to 1/e within about this distance.
    pub settle_m: f64,
    /// Curve: the distance constant is at least this time at the present speed (s), so that delays stay harmless.
    pub settle_s: f64,
    /// Curve: damping of the fall of d over the distance; 1 never crosses the line, 0.85 is faster.
    pub damping: f64,
    /// Curve: part of the path's curvature that is fed forward, 0..=1.
    pub feed_forward: f64,
    /// Pure pursuit: distance of the point that is pursued (m) at low speed.
    pub pursuit_m: f64,
    /// Pure pursuit: the point is at least this time ahead at the present speed (s).
    pub pursuit_s: f64,
}

impl Default for FollowOptions {
    fn default() -> Self {
        Self {
            look_ahead_m: 0.40,
            pid: PidGains::default(),
            angle_limit_rad: 1.2,
            yaw_rate_limit_radps: 2.5,
            settle_m: 0.10,
            settle_s: 0.5,
            damping: 0.85,
            feed_forward: 1.0,
            pursuit_m: 0.20,
            pursuit_s: 0.8,
        }
    }
}

impl FollowOptions {
    /// Refuses constants that make no sense.
    pub fn validate(&self) -> Result<(), DriverError> {
        check("follow.look_ahead_m", self.look_ahead_m, 0.001, 100.0)?;
        check("follow.pid.kp_per_s", self.pid.kp_per_s, 0.0, 1e3)?;
        check("follow.pid.ki_per_s2", self.pid.ki_per_s2, 0.0, 1e3)?;
        check("follow.pid.kd", self.pid.kd, 0.0, 1e3)?;
        check("follow.angle_limit_rad", self.angle_limit_rad, 0.01, 1.57)?;
        check(
            "follow.yaw_rate_limit_radps",
            self.yaw_rate_limit_radps,
            0.01,
            1e3,
        )?;
        check("follow.settle_m", self.settle_m, 0.005, 100.0)?;
        check("follow.settle_s", self.settle_s, 0.0, 100.0)?;
        check("follow.damping", self.damping, 0.3, 3.0)?;
        check("follow.feed_forward", self.feed_forward, 0.0, 1.0)?;
        check("follow.pursuit_m", self.pursuit_m, 0.005, 100.0)?;
        check("follow.pursuit_s", self.pursuit_s, 0.0, 100.0)
    }
}

/// What the controller answers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Steer {
    /// The direction that the line should have in the vehicle frame (rad); the error is `theta_rad` minus this.
    pub desired_angle_rad: f64,
    /// Yaw rate to ask for (rad/s, left positive).
    pub yaw_rate_radps: f64,
}

/// The controller with its memory.
#[derive(Debug, Clone)]
pub struct Follower {
    form: Form,
    options: FollowOptions,
    yaw_rate_limit_radps: f64,
    curvature_limit_per_m: f64,
    pid: Pid,
}

impl Follower {
    /// A controller for a vehicle; takes over its limits.
    pub fn new(form: Form, options: FollowOptions, body: &Body) -> Result<Self, DriverError> {
        options.validate()?;
        let own_limit = if body.yaw_rate_limit_radps > 0.0 {
            body.yaw_rate_limit_radps
        } else {
            f64::INFINITY
        };
        Ok(Self {
            form,
            options,
            yaw_rate_limit_radps: options.yaw_rate_limit_radps.min(own_limit),
            curvature_limit_per_m: body.curvature_limit_per_m(),
            pid: Pid::default(),
        })
    }

    /// A controller that knows no limits but its options': for studies of the controller alone.
    pub fn unlimited(form: Form, options: FollowOptions) -> Self {
        Self {
            form,
            options,
            yaw_rate_limit_radps: options.yaw_rate_limit_radps,
            curvature_limit_per_m: f64::INFINITY,
            pid: Pid::default(),
        }
    }

    /// The most that is asked for at a speed of the vehicle (rad/s; m/s).
    pub fn yaw_rate_limit_radps(&self, speed_mps: f64) -> f64 {
        self.yaw_rate_limit_radps
            .min(self.curvature_limit_per_m * speed_mps.abs().max(1e-3))
    }

    /// One step: the line's state, the speed (m/s) and the time since the last step (s).
    pub fn step(&mut self, state: LineState, speed_mps: f64, dt_s: f64) -> Steer {
        let limit_radps = self.yaw_rate_limit_radps(speed_mps);
        let options = &self.options;
        let (desired_angle_rad, yaw_rate_radps) = match self.form {
            Form::Document => {
                // The heading relative to the line is -θ; the desired one points at the line, L ahead.
                let desired = trig::atan2(state.d_m, options.look_ahead_m)
                    .clamp(-options.angle_limit_rad, options.angle_limit_rad);
                let rate = self
                    .pid
                    .step(&options.pid, desired, -state.theta_rad, dt_s, limit_radps);
                (-desired, rate)
            }
            Form::Curve => {
                let length_m = options.settle_m.max(options.settle_s * speed_mps.abs());
                let (desired, curvature) = curve_law(state, length_m, options);
                (-desired, curvature * speed_mps)
            }
            Form::PurePursuit | Form::Road => {
                let reach_m = options.pursuit_m.max(options.pursuit_s * speed_mps.abs());
                let curvature = if self.form == Form::Road {
                    arc_pursuit_law(state, reach_m)
                } else {
                    pursuit_law(state, reach_m)
                };
                (-trig::atan2(state.d_m, reach_m), curvature * speed_mps)
            }
        };
        Steer {
            desired_angle_rad,
            yaw_rate_radps: yaw_rate_radps.clamp(-limit_radps, limit_radps),
        }
    }

    /// Forgets the past: after a loss.
    pub fn reset(&mut self) {
        self.pid.reset();
    }
}

/// Curvature feed-forward plus heading feedback towards an approach angle: for small errors a damped second-order
/// fall of d over the *distance* driven, whatever the speed: d'' + (2/ℓ)·d' + d/(ζℓ)² = 0 with ℓ = `length_m`.
fn curve_law(state: LineState, length_m: f64, options: &FollowOptions) -> (f64, f64) {
    let approach_m = 2.0 * options.damping * options.damping * length_m;
    let desired = trig::atan(state.d_m / approach_m).clamp(-options.angle_limit_rad, options.angle_limit_rad);
    let error = senda_geom::angle::difference(desired, -state.theta_rad);
    // The nearest point of the path runs faster than the vehicle when the vehicle is on the outside of the curve.
    let stretch = (1.0 + state.curvature_per_m * state.d_m).max(0.3);
    let forward = state.curvature_per_m * trig::cos(state.theta_rad) / stretch;
    (desired, options.feed_forward * forward + 2.0 / length_m * error)
}

/// The circle through the axle, tangent to the vehicle, that meets the path `reach_m` ahead: κ = 2·y / ℓ².
fn pursuit_law(state: LineState, reach_m: f64) -> f64 {
    let (sin, cos) = trig::sincos(state.theta_rad);
    // Along the path from its nearest point: a parabola stands for the arc.
    let along = (reach_m * reach_m - state.d_m * state.d_m)
        .max(0.25 * reach_m * reach_m)
        .sqrt();
    let aside = 0.5 * state.curvature_per_m * along * along;
    let x = -sin * state.d_m + along * cos - aside * sin;
    let y = cos * state.d_m + along * sin + aside * cos;
    2.0 * y / (x * x + y * y).max(1e-6)
}

/// The same for a path that bends by more than a parabola can say over the reach: its arc itself, up to where it has turned
/// by two radians.
fn arc_pursuit_law(state: LineState, reach_m: f64) -> f64 {
    const TURNED_MOST_RAD: f64 = 2.0;
    let half = (0.5 * state.curvature_per_m * reach_m).clamp(-0.5 * TURNED_MOST_RAD, 0.5 * TURNED_MOST_RAD);
    let chord_m = if half.abs() < 1e-6 {
        reach_m
    } else {
        2.0 * trig::sin(half) / state.curvature_per_m
    };
    let (sin, cos) = trig::sincos(state.theta_rad);
    let (chord_sin, chord_cos) = trig::sincos(state.theta_rad + half);
    let x = -sin * state.d_m + chord_m * chord_cos;
    let y = cos * state.d_m + chord_m * chord_sin;
    2.0 * y / (x * x + y * y).max(1e-6)
}

/// Speeds of the left and right wheels (m/s) of a unicycle: v ∓ ω·track/2 (equation 4 of C's document, ω left positive).
pub fn wheel_speeds(speed_mps: f64, yaw_rate_radps: f64, track_m: f64) -> (f64, f64) {
    let half = 0.5 * track_m * yaw_rate_radps;
    (speed_mps - half, speed_mps + half)
}

/// Distance between the wheels where there are two driven ones, else the vehicle's width: for logging wheel speeds.
pub(crate) fn track_m(body: &Body) -> f64 {
    match body.steering {
        Steering::Differential { track_m } => track_m,
        Steering::Ackermann { .. } => body.width_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FORMS: [Form; 4] = [Form::Document, Form::Curve, Form::PurePursuit, Form::Road];

    fn state(d_m: f64, theta_rad: f64, curvature_per_m: f64) -> LineState {
        LineState {
            d_m,
            theta_rad,
            curvature_per_m,
        }
    }

    #[test]
    fn a_line_to_the_left_or_pointing_left_turns_the_vehicle_left() {
        for form in FORMS {
            let mut follower = Follower::unlimited(form, FollowOptions::default());
            assert!(
                follower.step(state(0.05, 0.0, 0.0), 0.1, 0.05).yaw_rate_radps > 0.0,
                "{form:?}"
            );
            let mut follower = Follower::unlimited(form, FollowOptions::default());
            assert!(
                follower.step(state(0.0, 0.2, 0.0), 0.1, 0.05).yaw_rate_radps > 0.0,
                "{form:?}"
            );
            let (left, right) = wheel_speeds(0.1, 0.5, 0.11);
            assert!(right > left && (right + left - 0.2).abs() < 1e-12);
        }
    }

    #[test]
    fn document_form_is_gain_times_angle_error() {
        let mut follower = Follower::unlimited(Form::Document, FollowOptions::default());
        let steer = follower.step(state(0.10, 20f64.to_radians(), 0.0), 0.07, 0.05);
        let expected = 1.1 * (20f64.to_radians() + trig::atan(0.1 / 0.4));
        assert!((steer.yaw_rate_radps - expected).abs() < 1e-12);
        assert!((steer.desired_angle_rad + trig::atan(0.25)).abs() < 1e-12);
    }

    #[test]
    fn on_a_circle_the_curve_forms_ask_for_its_curvature() {
        for form in [Form::Curve, Form::PurePursuit, Form::Road] {
            let mut follower = Follower::unlimited(form, FollowOptions::default());
            let rate = follower.step(state(0.0, 0.0, 2.0), 0.15, 0.05).yaw_rate_radps;
            assert!((rate - 0.30).abs() < 0.02, "{form:?} {rate}");
        }
    }

    #[test]
    fn constants_without_sense_are_refused_by_name() {
        let options = FollowOptions {
            look_ahead_m: 0.0,
            ..FollowOptions::default()
        };
        let message = options.validate().unwrap_err().to_string();
        assert!(
            message.contains("follow.look_ahead_m") && message.contains('0'),
            "{message}"
        );
    }

    proptest! {
        #[test]
        fn mirrored_states_give_mirrored_turns(d in -0.4..0.4f64, theta in -1.2..1.2f64, k in -3.0..3.0f64, v in 0.02..1.0f64) {
            for form in FORMS {
                let mut one = Follower::unlimited(form, FollowOptions::default());
                let mut two = one.clone();
                let a = one.step(state(d, theta, k), v, 0.05);
                let b = two.step(state(-d, -theta, -k), v, 0.05);
                prop_assert!((a.yaw_rate_radps + b.yaw_rate_radps).abs() < 1e-12);
                prop_assert!(a.yaw_rate_radps.abs() <= 2.5);
            }
        }
    }
}
