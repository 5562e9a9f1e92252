//! What a course came to: settled, beside the line, swinging or growing, and the gain from which on small errors grow.

use super::{Start, StudyOptions, Trace, run};
use crate::follow::{FollowOptions, Follower, Form, LineState};
use crate::pid::PidGains;
use senda_geom::trig;
use serde::{Deserialize, Serialize};

/// How a trace ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Comes within [`SETTLED_D_M`] and [`SETTLED_THETA_RAD`] of the line and stays there.
    Converges,
    /// Comes as near to a place beside the line and stays there: a bias or a curve draws it away ([`Trace::rest_d_m`]).
    Beside,
    /// Comes nearer, but is not there when the study ends.
    Slow,
    /// Neither comes nearer nor goes away.
    Oscillates,
    /// Swings grow, or the vehicle turns round.
    Unstable,
}

/// Within this distance of the line the vehicle is on it (m): C16's 1 cm.
pub const SETTLED_D_M: f64 = 0.01;

/// Within this angle of the line the vehicle is on it (rad): C16's 2°.
pub const SETTLED_THETA_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;

/// Smallest and largest Kp (1/s) that are tried for [`critical_gains`].
pub const GAINS_TRIED: (f64, f64) = (0.05, 50.0);

/// Values of Kp that are tried before the borders are looked for, each by the same factor above the last.
const TRIES: i32 = 24;

/// The Kp (1/s) between which small errors die out in the document form, for the options' speed, period, delay, first Ki, Kd
/// and look-ahead, without limits on angle and yaw rate: the lowest such range within [`GAINS_TRIED`], its borders by
/// bisection; one that goes on below begins at 0. `None` when errors die out with none of them. `stop` ends it early.
pub fn critical_gains(options: &StudyOptions, stop: &dyn Fn() -> bool) -> Option<(f64, f64)> {
    let quiet = StudyOptions {
        form: Form::Document,
        d_noise_m: 0.0,
        theta_noise_rad: 0.0,
        d_bias_m: 0.0,
        theta_bias_rad: 0.0,
        curvature_per_m: 0.0,
        yaw_rate_limit_radps: 1e3,
        duration_s: (300.0 * options.period_s.max(0.5 * options.delay_s)).max(200.0),
        ..options.clone()
    };
    let first = |list: &[f64], otherwise: f64| list.first().copied().unwrap_or(otherwise);
    let look_ahead_m = first(&options.look_ahead_m, 0.4);
    // So small that nothing but the linear behaviour shows, however much it grows on the way.
    let start = Start {
        d_m: 1e-9 * look_ahead_m,
        theta_rad: 1e-9,
    };
    let dies_out = |kp_per_s: f64| {
        let gains = PidGains {
            kp_per_s,
            ki_per_s2: first(&options.ki_per_s2, 0.0),
            kd: first(&options.kd, 0.0),
        };
        let trace = run(&quiet, start, gains, look_ahead_m, stop);
        let (early, late) = trace.swings();
        trace.largest_theta_rad < 1e-6 && late < early
    };
    let border = |mut inside: f64, mut outside: f64| {
        while (outside - inside).abs() > 1e-3 && !stop() {
            let middle = 0.5 * (inside + outside);
            if dies_out(middle) {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        inside
    };
    let (lowest, highest) = GAINS_TRIED;
    let factor = trig::exp(trig::log(highest / lowest) / f64::from(TRIES));
    let mut tried = std::iter::successors(Some(lowest), |kp| Some(kp * factor)).take(TRIES as usize + 1);
    let inside = tried.find(|kp| stop() || dies_out(*kp))?;
    let low = if inside == lowest {
        0.0
    } else {
        border(inside, inside / factor)
    };
    let mut last = inside;
    let high = loop {
        match tried.next() {
            Some(kp) if !stop() && dies_out(kp) => last = kp,
            Some(kp) => break border(last, kp),
            None => break highest,
        }
    };
    Some((low, high))
}

/// True d at which the vehicle runs along the line and the controller asks for nothing but the line's own turn (m), by
/// bisection. `None` where there is no such place.
pub(super) fn rest(options: &StudyOptions, follow: FollowOptions) -> Option<f64> {
    let curvature_per_m = options.curvature_per_m;
    // What integrates ends with no error of the angle, whatever the turn.
    let integrates = options.form == Form::Document && follow.pid.ki_per_s2 > 0.0;
    let proportional = FollowOptions {
        pid: PidGains {
            ki_per_s2: 0.0,
            kd: 0.0,
            ..follow.pid
        },
        ..follow
    };
    let excess_radps = |d_m: f64| {
        let measured = LineState {
            d_m: d_m + options.d_bias_m,
            theta_rad: options.theta_bias_rad,
            curvature_per_m,
        };
        let asked = Follower::unlimited(options.form, proportional)
            .step(measured, options.speed_mps, options.period_s)
            .yaw_rate_radps;
        let needed = curvature_per_m * options.speed_mps / (1.0 + curvature_per_m * d_m);
        asked - if integrates { 0.0 } else { needed }
    };
    // Far enough for any bias, and never as far as a circle's centre.
    let reach_m = (10.0 * follow.look_ahead_m + 2.0 * options.d_bias_m.abs())
        .max(1.0)
        .min(0.5 / curvature_per_m.abs().max(1e-9));
    let (mut low, mut high) = (-reach_m, reach_m);
    if !(excess_radps(low) < 0.0 && excess_radps(high) > 0.0) {
        return None;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if excess_radps(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}

pub(super) fn judge(trace: &mut Trace, options: &StudyOptions) {
    trace.largest_d_m = largest(&trace.d_m);
    trace.largest_theta_rad = largest(&trace.theta_rad);
    let side = trace.start.d_m.signum();
    trace.overshoot_m = trace.d_m.iter().fold(0.0f64, |most, d| most.max(-side * d));
    let outside = |i: &usize| {
        (trace.d_m[*i] - trace.rest_d_m).abs() > trace.settled_d_m
            || trace.theta_rad[*i].abs() > trace.settled_theta_rad
    };
    let last_outside = (0..trace.time_s.len()).rev().find(outside);
    trace.settle_time_s = match last_outside {
        None => Some(0.0),
        Some(last) => trace.time_s.get(last + 1).copied(),
    };
    let (early, late) = trace.swings();
    let turned_round = trace.largest_theta_rad > std::f64::consts::FRAC_PI_2
        && trace.start.theta_rad.abs() < std::f64::consts::FRAC_PI_2;
    let settled = trace
        .settle_time_s
        .is_some_and(|time_s| time_s < 0.9 * options.duration_s);
    // Swings that noise alone makes differ from quarter to quarter (guess: by less than half).
    let is_noisy = options.d_noise_m > 0.0 || options.theta_noise_rad > 0.0;
    let grown = if is_noisy { 2.0 } else { 1.05 };
    trace.verdict = if turned_round || (!settled && late > grown * early) {
        Verdict::Unstable
    } else if settled && trace.rest_d_m.abs() > trace.settled_d_m {
        Verdict::Beside
    } else if settled {
        Verdict::Converges
    } else if late < 0.8 * early {
        Verdict::Slow
    } else {
        Verdict::Oscillates
    };
}

pub(super) fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, value| most.max(value.abs()))
}
