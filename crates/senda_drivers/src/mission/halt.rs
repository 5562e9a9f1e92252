//! Stopping square before a crossing: up to it, then by nudges whose effect is awaited.
//!
//! What is seen comes late: delay, motors and camera take more time than a small correction lasts. Steering by every frame would
//! swing around the goal for ever.

use super::MissionOptions;
use super::helm::{CREEP_MPS, CREEP_RADPS, towards, turn};
use senda_core::{Command, Stamp};
use senda_vision::StreetView;
use senda_vision::street::Crossing;

/// What may be left when it stands, and how far a nudge goes at most; more is driven by what every frame shows.
const GOOD_M: f64 = 0.006;
const GOOD_RAD: f64 = 0.013;
const NUDGE_M: f64 = 0.02;
const NUDGE_RAD: f64 = 0.1;

/// After this a movement has ended and has been seen (s).
const SETTLES_S: f64 = 0.3;

/// What is to be done before a crossing.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Move {
    /// On, until the next frame.
    Drive(Command),
    /// A command for so long (s).
    Nudge(Command, f64),
    /// It stands as it should.
    Stand,
}

/// Stops before one crossing.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Halt {
    nudge: Option<Command>,
    /// When the nudge ends, and when what it did is seen.
    nudged_until: Stamp,
    still_until: Stamp,
    drives: bool,
    /// Has stood as it should: small changes of what is seen do not move it again.
    stood: bool,
}

impl Halt {
    /// What to do now.
    pub(super) fn command(&mut self, view: &StreetView, options: &MissionOptions, now: Stamp) -> Command {
        let after = |seconds: f64| Stamp::from_s(now.as_s() + seconds);
        // A frame's period is no multiple of a nanosecond.
        let is_before = |end: Stamp| end.since_s(now) > 1e-6;
        if let Some(nudge) = self.nudge.filter(|_| is_before(self.nudged_until)) {
            return nudge;
        }
        self.nudge = None;
        if is_before(self.still_until) {
            return Command::STOP;
        }
        match best_move(view, options, self.stood) {
            Move::Drive(command) => {
                self.drives = true;
                command
            }
            _ if self.drives => {
                (self.drives, self.still_until) = (false, after(SETTLES_S));
                Command::STOP
            }
            Move::Nudge(command, seconds) => {
                self.nudge = Some(command);
                (self.nudged_until, self.still_until) = (after(seconds), after(seconds + SETTLES_S));
                command
            }
            Move::Stand => {
                self.stood = true;
                Command::STOP
            }
        }
    }
}

/// Whether it stands before a crossing, though not as it should.
pub(super) fn is_near(crossing: &Crossing, options: &MissionOptions) -> bool {
    (crossing.distance_m - options.stop_m).abs() < 2.0 * NUDGE_M && crossing.angle_rad.abs() < NUDGE_RAD
}

fn best_move(view: &StreetView, options: &MissionOptions, stood: bool) -> Move {
    let Some(crossing) = view.crossing else {
        // Too near to see it: back.
        return Move::Drive(Command::curvature(0.0, -CREEP_MPS));
    };
    let left_m = crossing.distance_m - options.stop_m;
    if left_m > NUDGE_M && !stood {
        let speed_mps = (1.5 * left_m).clamp(CREEP_MPS, options.speed_mps);
        // The line as long as it is seen before the crossing, then the crossing's own direction.
        return Move::Drive(match view.line.at_distance(options.look_ahead_m) {
            Some(point) if left_m > 0.06 => towards(point, speed_mps),
            _ => Command::yaw_rate((1.5 * crossing.angle_rad).clamp(-0.4, 0.4), speed_mps),
        });
    }
    let slack = if stood { 1.5 } else { 1.0 };
    let angle_rad = crossing.angle_rad;
    if angle_rad.abs() > NUDGE_RAD {
        return Move::Drive(turn(angle_rad, 0.5));
    }
    if angle_rad.abs() > slack * GOOD_RAD {
        let turning = Command::yaw_rate(CREEP_RADPS * angle_rad.signum(), 0.0);
        return Move::Nudge(turning, angle_rad.abs() / CREEP_RADPS);
    }
    let creeping = Command::curvature(0.0, CREEP_MPS * left_m.signum());
    match left_m.abs() {
        far_m if far_m > NUDGE_M => Move::Drive(creeping),
        some_m if some_m > slack * GOOD_M => Move::Nudge(creeping, some_m / CREEP_MPS),
        _ => Move::Stand,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_core::{Drive, Turn};
    use std::collections::VecDeque;

    /// A vehicle that does late what it is told, and whose camera shows late what it did: it comes to stand, within what may
    /// be left, and stays.
    #[test]
    fn it_comes_to_stand_however_late_it_sees() {
        let options = MissionOptions::default();
        for late in [1usize, 2, 4] {
            for (start_m, start_rad) in [(0.3, 0.15), (0.05, -0.09), (-0.03, 0.02), (0.012, 0.014)] {
                let (mut left_m, mut angle_rad): (f64, f64) = (start_m, start_rad);
                let mut seen = VecDeque::from(vec![(left_m, angle_rad); late]);
                let mut told = VecDeque::from(vec![Command::STOP; 2]);
                let mut halt = Halt::default();
                let mut stands = 0;
                for tick in 0..200 {
                    let (seen_m, seen_rad) = seen.pop_front().unwrap();
                    let view = StreetView {
                        crossing: Some(Crossing {
                            distance_m: options.stop_m + seen_m,
                            angle_rad: seen_rad,
                            left_m: 0.0,
                            width_m: 0.2,
                            pixels: 1000,
                        }),
                        ..StreetView::default()
                    };
                    let command = halt.command(&view, &options, Stamp::from_s(0.05 * f64::from(tick)));
                    stands = if command == Command::STOP { stands + 1 } else { 0 };
                    told.push_back(command);
                    let now = told.pop_front().unwrap();
                    if let Drive::SpeedMps(speed_mps) = now.drive {
                        left_m -= 0.05 * speed_mps;
                    }
                    if let Turn::YawRateRadps(rate) = now.turn {
                        angle_rad -= 0.05 * rate;
                    }
                    seen.push_back((left_m, angle_rad));
                }
                let case = format!("{late} frames late from {start_m} m, {start_rad}");
                assert!(stands > 40, "{case}: {stands}");
                assert!(
                    left_m.abs() < 0.01 && angle_rad.abs() < 0.02,
                    "{case}: {left_m}, {angle_rad}"
                );
            }
        }
    }
}
