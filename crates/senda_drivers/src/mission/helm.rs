//! Steering of a mission: along the line, across a junction, in place.

use super::MissionOptions;
use senda_core::Command;
use senda_geom::{Vec2, trig};
use senda_vision::StreetView;
use senda_vision::street::FarLine;

/// Slower than this the motors do not turn reliably (m/s), and likewise in place (rad/s).
pub(super) const CREEP_MPS: f64 = 0.03;
pub(super) const CREEP_RADPS: f64 = 0.22;

/// Towards a floor point (vehicle frame, m): the arc through it (pure pursuit, Coulter 1992).
pub(super) fn towards(point: Vec2, speed_mps: f64) -> Command {
    let curvature_per_m = 2.0 * point.y / point.length_squared().max(0.01);
    // In tight curves as fast as 0.3 m/s² across allows.
    let most_mps = (0.3 / curvature_per_m.abs().max(0.5)).sqrt();
    Command::curvature(curvature_per_m, speed_mps.min(most_mps.max(0.12)))
}

/// Along the line that is seen; `None` without one.
pub(super) fn along(view: &StreetView, options: &MissionOptions, speed_mps: f64) -> Option<Command> {
    let look_m = options.look_ahead_m + 0.25 * (speed_mps - 0.2).max(0.0);
    Some(towards(view.line.at_distance(look_m)?, speed_mps))
}

/// In place, by an angle that is left (rad, left positive).
pub(super) fn turn(left_rad: f64, fastest_radps: f64) -> Command {
    let rate = (2.0 * left_rad).clamp(-fastest_radps, fastest_radps);
    let rate = if rate.abs() < CREEP_RADPS {
        CREEP_RADPS * left_rad.signum()
    } else {
        rate
    };
    Command::yaw_rate(rate, 0.0)
}

/// A line ahead that is remembered while the vehicle moves (D6): a point of it and its direction.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Remembered {
    at: Vec2,
    direction_rad: f64,
    /// Where it begins (m ahead): what is seen nearer belongs to the line that is left.
    begins_m: f64,
}

impl Remembered {
    pub(super) fn of(line: &FarLine) -> Self {
        let middle_m = 0.5 * (line.span_m[0] + line.span_m[1]);
        Self {
            at: Vec2::new(middle_m, line.left_at(middle_m)),
            direction_rad: trig::atan(line.slope),
            begins_m: line.span_m[0],
        }
    }

    /// What is seen nearer than this is not it (m ahead): its beginning, with what reckoning may be wrong by.
    pub(super) fn starts_m(&self) -> f64 {
        (self.begins_m - 0.08).max(0.0)
    }

    /// After the vehicle went on and turned.
    pub(super) fn moved(&mut self, forward_m: f64, turned_rad: f64) {
        let (sin, cos) = trig::sincos(turned_rad);
        let from = self.at - Vec2::new(forward_m, 0.0);
        self.at = Vec2::new(from.x * cos + from.y * sin, from.y * cos - from.x * sin);
        self.direction_rad -= turned_rad;
        self.begins_m -= forward_m;
    }

    pub(super) fn slope(&self) -> f64 {
        trig::tan(self.direction_rad.clamp(-1.2, 1.2))
    }

    pub(super) fn left_at(&self, ahead_m: f64) -> f64 {
        self.at.y + self.slope() * (ahead_m - self.at.x)
    }

    /// Half way to what is seen of it.
    pub(super) fn corrected(&mut self, seen: &FarLine) {
        let middle_m = 0.5 * (seen.span_m[0] + seen.span_m[1]);
        let off_m = seen.left_at(middle_m) - self.left_at(middle_m);
        // Short pieces tell where it is, not where it runs.
        let long = (seen.span_m[1] - seen.span_m[0]) / 0.3;
        let turned = trig::atan(seen.slope) - self.direction_rad;
        self.direction_rad += 0.4 * long.clamp(0.0, 1.0) * turned.clamp(-0.1, 0.1);
        self.at = Vec2::new(middle_m, self.left_at(middle_m));
        self.at.y += 0.5 * off_m;
    }

    pub(super) fn command(&self, speed_mps: f64) -> Command {
        let ahead_m = 0.38;
        towards(Vec2::new(ahead_m, self.left_at(ahead_m)), speed_mps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line that stays where it is on the floor, seen from a vehicle that goes on and turns.
    #[test]
    fn what_is_remembered_stays_where_it_is() {
        let line = FarLine {
            intercept_m: 0.02,
            slope: 0.1,
            span_m: [0.9, 1.2],
        };
        let mut remembered = Remembered::of(&line);
        assert!((remembered.left_at(0.3) - 0.05).abs() < 1e-9);
        let (mut here, mut heading_rad) = (Vec2::ZERO, 0.0f64);
        for _ in 0..100 {
            let (sin, cos) = trig::sincos(heading_rad);
            here += Vec2::new(cos, sin) * 0.005;
            heading_rad += 0.001;
            remembered.moved(0.005, 0.001);
        }
        let (sin, cos) = trig::sincos(heading_rad);
        for ahead_m in [0.3, 0.6] {
            let left_m = remembered.left_at(ahead_m);
            let at = here + Vec2::new(ahead_m * cos - left_m * sin, ahead_m * sin + left_m * cos);
            assert!((at.y - line.left_at(at.x)).abs() < 1e-6, "{at}");
        }
        assert!((remembered.starts_m() - 0.32).abs() < 1e-9);
    }

    /// What is seen of it draws it there, and a short piece does not turn it.
    #[test]
    fn what_is_seen_corrects_what_is_remembered() {
        let of = |slope: f64, span_m: [f64; 2], left_m: f64| FarLine {
            intercept_m: left_m - slope * 0.5 * (span_m[0] + span_m[1]),
            slope,
            span_m,
        };
        let mut remembered = Remembered::of(&of(0.0, [0.9, 1.1], 0.0));
        for _ in 0..20 {
            remembered.corrected(&of(0.0, [0.8, 1.1], 0.03));
        }
        assert!((remembered.left_at(0.95) - 0.03).abs() < 0.002);
        let before = remembered.slope();
        remembered.corrected(&of(0.2, [1.0, 1.02], 0.03));
        assert!((remembered.slope() - before).abs() < 0.01);
    }
}
