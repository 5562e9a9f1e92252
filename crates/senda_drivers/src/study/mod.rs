//! C13: what the follow controller does to the kinematics alone, for any constants, without camera or world.
//!
//! A unicycle beside a straight line (or a circle), a measurement of its state with bias and noise, a controller that
//! runs every `period_s` and whose answer acts `delay_s` later. A pure function: the same options give the same traces.

mod verdict;

pub use verdict::{GAINS_TRIED, SETTLED_D_M, SETTLED_THETA_RAD, Verdict, critical_gains};

use crate::follow::{FollowOptions, Follower, Form, LineState};
use crate::options::{DriverError, check};
use crate::pid::PidGains;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use senda_geom::{angle, trig};
use serde::{Deserialize, Serialize};
use verdict::{judge, largest, rest};

/// A state from which the study begins, in the signs of [`crate::follow`] (which are the document's).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Distance of the line to the left of the axle (m).
    pub d_m: f64,
    /// Direction of the line in the vehicle frame (rad).
    pub theta_rad: f64,
}

/// What is studied: every combination of the listed constants from every start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StudyOptions {
    /// Which controller.
    pub form: Form,
    /// Where the vehicle begins.
    pub starts: Vec<Start>,
    /// Proportional gains (1/s), document form.
    pub kp_per_s: Vec<f64>,
    /// Integral gains (1/s²), document form.
    pub ki_per_s2: Vec<f64>,
    /// Derivative gains, document form.
    pub kd: Vec<f64>,
    /// Look-ahead distances (m): L of the document form, the distance constant of the others.
    pub look_ahead_m: Vec<f64>,
    /// Speed (m/s). C16: 0.07.
    pub speed_mps: f64,
    /// Time between measurements (s). C16: 0.2 at 320x240, 0.05 at 160x120.
    pub period_s: f64,
    /// From the measurement to the wheels (s). The document does not give it. Its robot computes for a whole period, and
    /// cameras keep a queue of frames; 0.5 s, two periods and a half, is what puts the limit of Kp where the document
    /// found it (2.5); with 0.2 s it would be at 4.9.
    pub delay_s: f64,
    /// How long to go on (s).
    pub duration_s: f64,
    /// Added to every measured d (m).
    pub d_bias_m: f64,
    /// Standard deviation of measured d (m).
    pub d_noise_m: f64,
    /// Added to every measured θ (rad).
    pub theta_bias_rad: f64,
    /// Standard deviation of measured θ (rad).
    pub theta_noise_rad: f64,
    /// Curvature of the line (1/m); 0 is straight.
    pub curvature_per_m: f64,
    /// Largest yaw rate (rad/s).
    pub yaw_rate_limit_radps: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for StudyOptions {
    fn default() -> Self {
        Self {
            form: Form::Document,
            starts: vec![Start {
                d_m: 0.10,
                theta_rad: 20f64.to_radians(),
            }],
            kp_per_s: vec![1.1],
            ki_per_s2: vec![0.0],
            kd: vec![0.0],
            look_ahead_m: vec![0.40],
            speed_mps: 0.07,
            period_s: 0.2,
            delay_s: 0.5,
            duration_s: 30.0,
            d_bias_m: 0.0,
            d_noise_m: 0.0,
            theta_bias_rad: 0.0,
            theta_noise_rad: 0.0,
            curvature_per_m: 0.0,
            yaw_rate_limit_radps: 2.5,
            seed: 1,
        }
    }
}

/// One run of the study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trace {
    /// Where it began.
    pub start: Start,
    /// Its gains.
    pub gains: PidGains,
    /// Its look-ahead (m).
    pub look_ahead_m: f64,
    /// Moments (s): every measurement.
    pub time_s: Vec<f64>,
    /// True d at these moments (m).
    pub d_m: Vec<f64>,
    /// True θ at these moments (rad).
    pub theta_rad: Vec<f64>,
    /// Yaw rate asked for at these moments (rad/s, left positive).
    pub omega_radps: Vec<f64>,
    /// True d where this controller rests (m): 0 is the line itself. A measurement with a bias moves it, and so does a curve
    /// that the controller does not know.
    pub rest_d_m: f64,
    /// How near to `rest_d_m` the true d must be to count as settled (m): [`SETTLED_D_M`], however noisy the measurement.
    pub settled_d_m: f64,
    /// How small the true |θ| must be as well (rad): [`SETTLED_THETA_RAD`].
    pub settled_theta_rad: f64,
    /// From when on the true state stays within these limits (s).
    pub settle_time_s: Option<f64>,
    /// How far it goes past the line to the other side (m, not negative).
    pub overshoot_m: f64,
    /// Largest distance from the line (m).
    pub largest_d_m: f64,
    /// Largest |θ| (rad).
    pub largest_theta_rad: f64,
    /// Judgement.
    pub verdict: Verdict,
}

impl StudyOptions {
    /// Refuses what cannot be studied.
    pub fn validate(&self) -> Result<(), DriverError> {
        check("study.speed_mps", self.speed_mps, 0.001, 100.0)?;
        check("study.period_s", self.period_s, 0.001, 10.0)?;
        check("study.delay_s", self.delay_s, 0.0, 10.0)?;
        check("study.duration_s", self.duration_s, self.period_s, 3600.0)?;
        check("study.d_bias_m", self.d_bias_m, -10.0, 10.0)?;
        check("study.d_noise_m", self.d_noise_m, 0.0, 10.0)?;
        check("study.theta_bias_rad", self.theta_bias_rad, -3.0, 3.0)?;
        check("study.theta_noise_rad", self.theta_noise_rad, 0.0, 3.0)?;
        check("study.curvature_per_m", self.curvature_per_m, -100.0, 100.0)?;
        for (key, list) in [
            ("study.kp_per_s", &self.kp_per_s),
            ("study.ki_per_s2", &self.ki_per_s2),
            ("study.kd", &self.kd),
        ] {
            list.iter().try_for_each(|value| check(key, *value, 0.0, 1e3))?;
        }
        for value in &self.look_ahead_m {
            check("study.look_ahead_m", *value, 0.001, 100.0)?;
        }
        for start in &self.starts {
            check("study.starts.d_m", start.d_m, -100.0, 100.0)?;
            check("study.starts.theta_rad", start.theta_rad, -3.2, 3.2)?;
        }
        let lists = [&self.look_ahead_m, &self.kp_per_s, &self.ki_per_s2, &self.kd];
        let runs: usize = lists.iter().map(|list| list.len()).product::<usize>() * self.starts.len();
        let steps = runs * self.steps();
        if steps > MOST_STEPS {
            return Err(DriverError::TooManySteps {
                runs,
                steps,
                most: MOST_STEPS,
            });
        }
        check(
            "study.yaw_rate_limit_radps",
            self.yaw_rate_limit_radps,
            0.001,
            1e3,
        )
    }

    /// Measurements in each run.
    fn steps(&self) -> usize {
        (self.duration_s / self.period_s).floor() as usize + 1
    }
}

/// All runs of a study have so many steps together at most: they are kept, 32 bytes each.
const MOST_STEPS: usize = 2_000_000;
/// Steps between two looks at whether to stop.
const STEPS_UNHEARD: usize = 4096;

/// Runs every combination: starts outermost, then L, Kp, Ki, Kd. Once `stop` says so what is left is cut short, and the
/// traces mean nothing.
pub fn study(options: &StudyOptions, stop: &dyn Fn() -> bool) -> Result<Vec<Trace>, DriverError> {
    options.validate()?;
    let mut traces = Vec::new();
    for start in &options.starts {
        for look_ahead_m in &options.look_ahead_m {
            for kp_per_s in &options.kp_per_s {
                for ki_per_s2 in &options.ki_per_s2 {
                    for kd in &options.kd {
                        let gains = PidGains {
                            kp_per_s: *kp_per_s,
                            ki_per_s2: *ki_per_s2,
                            kd: *kd,
                        };
                        traces.push(run(options, *start, gains, *look_ahead_m, stop));
                    }
                }
            }
        }
    }
    Ok(traces)
}

fn run(
    options: &StudyOptions,
    start: Start,
    gains: PidGains,
    look_ahead_m: f64,
    stop: &dyn Fn() -> bool,
) -> Trace {
    let follow = FollowOptions {
        pid: gains,
        look_ahead_m,
        settle_m: look_ahead_m,
        settle_s: 0.0,
        pursuit_m: look_ahead_m,
        pursuit_s: 0.0,
        yaw_rate_limit_radps: options.yaw_rate_limit_radps,
        ..FollowOptions::default()
    };
    let mut follower = Follower::unlimited(options.form, follow);
    let mut noise = ChaCha8Rng::seed_from_u64(options.seed);
    let steps = options.steps();
    let mut trace = Trace {
        start,
        gains,
        look_ahead_m,
        time_s: Vec::with_capacity(steps),
        d_m: Vec::with_capacity(steps),
        theta_rad: Vec::with_capacity(steps),
        omega_radps: Vec::with_capacity(steps),
        rest_d_m: rest(options, follow).unwrap_or(0.0),
        settled_d_m: SETTLED_D_M,
        settled_theta_rad: SETTLED_THETA_RAD,
        settle_time_s: None,
        overshoot_m: 0.0,
        largest_d_m: 0.0,
        largest_theta_rad: 0.0,
        verdict: Verdict::Unstable,
    };
    let mut state = LineState {
        d_m: start.d_m,
        theta_rad: start.theta_rad,
        curvature_per_m: options.curvature_per_m,
    };
    // What was asked at step k acts from k·period + delay on: whole periods and a rest.
    let late_steps = (options.delay_s / options.period_s).floor() as usize;
    let rest_s = options.delay_s - late_steps as f64 * options.period_s;
    for step in 0..steps {
        if step.is_multiple_of(STEPS_UNHEARD) && stop() {
            break;
        }
        let (d_noise, theta_noise) = normal_pair(&mut noise);
        let measured = LineState {
            d_m: state.d_m + options.d_bias_m + options.d_noise_m * d_noise,
            theta_rad: angle::wrap(
                state.theta_rad + options.theta_bias_rad + options.theta_noise_rad * theta_noise,
            ),
            curvature_per_m: options.curvature_per_m,
        };
        let omega = follower
            .step(measured, options.speed_mps, options.period_s)
            .yaw_rate_radps;
        trace.time_s.push(step as f64 * options.period_s);
        trace.d_m.push(state.d_m);
        trace.theta_rad.push(state.theta_rad);
        trace.omega_radps.push(omega);
        let asked = |steps_ago: usize| {
            step.checked_sub(steps_ago)
                .map_or(0.0, |index| trace.omega_radps[index])
        };
        state = advance(state, options.speed_mps, asked(late_steps + 1), rest_s);
        state = advance(
            state,
            options.speed_mps,
            asked(late_steps),
            options.period_s - rest_s,
        );
    }
    judge(&mut trace, options);
    trace
}

/// The kinematics d' = v·sin θ, θ' = κ·(nearest point's speed) - ω, in steps of at most 5 ms (midpoint rule).
fn advance(state: LineState, speed_mps: f64, omega_radps: f64, time_s: f64) -> LineState {
    if !(time_s > 0.0) {
        return state;
    }
    let steps = (time_s / 0.005).ceil().max(1.0);
    let dt_s = time_s / steps;
    let slope = |d_m: f64, theta_rad: f64| {
        let (sin, cos) = trig::sincos(theta_rad);
        let stretch = (1.0 + state.curvature_per_m * d_m).max(0.1);
        (
            speed_mps * sin,
            state.curvature_per_m * speed_mps * cos / stretch - omega_radps,
        )
    };
    let (mut d_m, mut theta_rad) = (state.d_m, state.theta_rad);
    for _ in 0..steps as usize {
        let (d_slope, theta_slope) = slope(d_m, theta_rad);
        let (d_slope, theta_slope) = slope(d_m + 0.5 * dt_s * d_slope, theta_rad + 0.5 * dt_s * theta_slope);
        d_m += dt_s * d_slope;
        theta_rad = angle::wrap(theta_rad + dt_s * theta_slope);
    }
    LineState {
        d_m,
        theta_rad,
        ..state
    }
}

impl Trace {
    /// Size of the swings about the resting place in the second and in the last quarter (m); an angle counts as what it is
    /// worth at the look-ahead.
    fn swings(&self) -> (f64, f64) {
        let count = self.time_s.len();
        let size = |from: usize, to: usize| {
            let angle_m = self.look_ahead_m * largest(&self.theta_rad[from..to]);
            let most_m = |most: f64, d: &f64| most.max((d - self.rest_d_m).abs());
            self.d_m[from..to].iter().fold(angle_m, most_m)
        };
        (size(count / 4, count / 2), size(3 * count / 4, count))
    }
}

/// Two independent standard normal numbers (Box & Muller 1958).
fn normal_pair(random: &mut ChaCha8Rng) -> (f64, f64) {
    let radius = (-2.0 * trig::log(1.0 - random.random::<f64>())).sqrt();
    let (sin, cos) = trig::sincos(2.0 * std::f64::consts::PI * random.random::<f64>());
    (radius * cos, radius * sin)
}
#[cfg(test)]
mod tests;
