//! The piece of path around the vehicle, remembered on the floor plane.
//!
//! The camera sees the path ahead, never the part under the axle, and sometimes nothing at all. This keeps what was
//! seen as points in the vehicle frame, carries them along as the vehicle moves, corrects that motion by what is seen
//! now, and averages old and new. So the line's whole shape is known (curves as curves, C17), dashes are joined, a
//! frame without a line costs nothing, and the state \[d, θ, κ\] is taken where the vehicle is, not where it looks.

mod arc;
mod options;
mod sighting;

pub use options::TrackOptions;

use senda_geom::{Pose2, Vec2};

/// A remembered point.
#[derive(Debug, Clone, Copy)]
struct Node {
    at: Vec2,
    /// 1 / variance sideways (1/m²).
    weight: f64,
    /// Distance along the path from the first node (m).
    station_m: f64,
}

/// Where a point lies relative to the remembered path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OnPath {
    /// Distance along the path from its first node (m); negative or beyond the length where the path is continued.
    pub(crate) station_m: f64,
    /// Distance to the left of the path (m).
    pub(crate) offset_m: f64,
    /// How far outside the remembered piece (m); 0 inside.
    pub(crate) beyond_m: f64,
    /// Unit vector to the left of the path.
    pub(crate) left: Vec2,
}

/// Remembered points, from behind the vehicle to ahead of it.
#[derive(Debug, Clone, Default)]
pub(crate) struct PathMemory {
    nodes: Vec<Node>,
    scratch: Vec<Node>,
    /// Direction and curvature (1/m) at the near and the far end.
    ends: [(Vec2, f64); 2],
    /// Sightings in a row that contradict the memory.
    contradictions: u32,
}

/// Beyond its ends the path is continued with its curvature for this far (m).
const CONTINUED_M: f64 = 0.25;
/// And with no more curvature than this (1/m).
const CONTINUED_PER_M: f64 = 4.0;
/// Distance between remembered points (m).
const SPACING_M: f64 = 0.01;
/// At most so many are kept.
const NODES_LIMIT: usize = 160;

impl PathMemory {
    pub(crate) fn is_empty(&self) -> bool {
        self.nodes.len() < 2
    }

    pub(crate) fn clear(&mut self) {
        self.nodes.clear();
        self.contradictions = 0;
    }

    /// The remembered points (vehicle frame, m), from behind to ahead.
    pub(crate) fn points(&self) -> impl Iterator<Item = Vec2> + '_ {
        self.nodes.iter().map(|node| node.at)
    }

    pub(crate) fn length_m(&self) -> f64 {
        self.nodes.last().map_or(0.0, |node| node.station_m)
    }

    /// The vehicle moved: `motion` is its new frame in the old one.
    pub(crate) fn carry(&mut self, motion: Pose2, options: &TrackOptions) {
        let new_from_old = motion.inverse();
        let driven_m = motion.position().length();
        let spread = options.drift_m * options.drift_m * driven_m;
        for node in &mut self.nodes {
            node.at = new_from_old.transform(node.at);
            node.weight /= 1.0 + node.weight * spread;
        }
        let behind = self
            .nodes
            .iter()
            .take_while(|node| node.at.x < -options.behind_m)
            .count();
        // Two nodes stay, so that a direction stays known.
        let drop = behind.min(self.nodes.len().saturating_sub(2));
        self.nodes.drain(..drop);
        self.restation();
    }

    /// Forgets what lies further ahead of the axle than this (m).
    pub(crate) fn shorten(&mut self, ahead_m: f64) {
        let Some(place) = self.locate(Vec2::ZERO) else {
            return;
        };
        let limit_m = place.station_m + ahead_m;
        let keep = self.nodes.partition_point(|node| node.station_m <= limit_m);
        self.nodes.truncate(keep.max(2));
        self.restation();
    }

    /// Moves everything to the left (m), as seen along the path: from a line to the middle of its lane.
    pub(crate) fn shift(&mut self, left_m: f64) {
        let count = self.nodes.len();
        if count < 2 {
            return;
        }
        let mut before = self.nodes[0].at;
        for index in 0..count {
            let at = self.nodes[index].at;
            let after = self.nodes[(index + 1).min(count - 1)].at;
            let direction = (after - before).try_normalize().unwrap_or(Vec2::X);
            before = at;
            self.nodes[index].at = at + direction.perp() * left_m;
        }
        self.restation();
    }

    /// Where a floor point lies relative to the path, which is continued straight at both ends.
    pub(crate) fn locate(&self, point: Vec2) -> Option<OnPath> {
        if self.is_empty() {
            return None;
        }
        let last = self.nodes.len() - 1;
        let mut best = f64::INFINITY;
        let mut found = None;
        for (index, pair) in self.nodes.windows(2).enumerate() {
            let (from, along) = (pair[0].at, pair[1].at - pair[0].at);
            let length = along.length();
            if length < 1e-9 {
                continue;
            }
            let direction = along / length;
            let away = point - from;
            let part = away.dot(direction);
            let clamped = part.clamp(0.0, length);
            let distance = (away - direction * clamped).length_squared();
            if distance < best {
                best = distance;
                let outside = (index == 0 && part < 0.0) || (index + 1 == last && part > length);
                found = Some((index, direction, part, clamped, outside));
            }
        }
        let (index, direction, part, clamped, outside) = found?;
        let from = self.nodes[index];
        if !outside {
            let left = direction.perp();
            let foot = from.at + direction * clamped;
            let away = point - foot;
            let side = away.dot(left);
            let offset_m = if side >= 0.0 {
                away.length()
            } else {
                -away.length()
            };
            return Some(OnPath {
                station_m: from.station_m + clamped,
                offset_m,
                beyond_m: 0.0,
                left,
            });
        }
        // Beyond an end: the arc of the last piece, which is a parabola here, and straight on after 25 cm.
        let ahead = part > 0.0;
        let end = if ahead { self.nodes[last] } else { self.nodes[0] };
        let (direction, curvature) = self.ends[usize::from(ahead)];
        let away = point - end.at;
        let along = away.dot(direction);
        let bent = along.clamp(-CONTINUED_M, CONTINUED_M);
        let aside = curvature * bent * (along - 0.5 * bent);
        let slope = curvature * bent;
        let tangent = (direction + direction.perp() * slope).normalize();
        Some(OnPath {
            station_m: end.station_m + along,
            offset_m: (away.dot(direction.perp()) - aside) / (1.0 + slope * slope).sqrt(),
            beyond_m: along.abs(),
            left: tangent.perp(),
        })
    }

    /// Direction over the last 6 cm at an end.
    fn end_direction(&self, ahead: bool) -> Option<Vec2> {
        let length = self.length_m();
        if ahead {
            let end = self.nodes.last()?;
            let from = self
                .nodes
                .iter()
                .rev()
                .find(|node| node.station_m <= length - 0.06);
            (end.at - from.or(self.nodes.first())?.at).try_normalize()
        } else {
            let end = self.nodes.first()?;
            let to = self.nodes.iter().find(|node| node.station_m >= 0.06);
            (to.or(self.nodes.last())?.at - end.at).try_normalize()
        }
    }

    fn restation(&mut self) {
        let mut station_m = 0.0;
        let mut before: Option<Vec2> = None;
        for node in &mut self.nodes {
            if let Some(before) = before {
                station_m += (node.at - before).length();
            }
            before = Some(node.at);
            node.station_m = station_m;
        }
        for (ahead, station_m) in [(false, 0.0), (true, station_m)] {
            let direction = self.end_direction(ahead).unwrap_or(Vec2::X);
            let curvature = self
                .fit(station_m, 0.1)
                .map_or(0.0, |parabola| parabola.curvature());
            self.ends[usize::from(ahead)] = (direction, curvature.clamp(-CONTINUED_PER_M, CONTINUED_PER_M));
        }
    }

    /// How much of the path is known ahead of a point (m).
    pub(crate) fn ahead_of(&self, point: Vec2) -> f64 {
        self.locate(point)
            .map_or(0.0, |place| (self.length_m() - place.station_m).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidate::FloorPoint;
    use senda_geom::trig;

    pub(super) fn points(shape: impl Fn(f64) -> Vec2, from: f64, to: f64) -> Vec<FloorPoint> {
        (0..=30)
            .map(|i| FloorPoint {
                at: shape(from + (to - from) * f64::from(i) / 30.0),
                sigma_m: 0.003,
                step_m: 0.01,
            })
            .collect()
    }

    /// Point of a circle of radius 0.5 to the left that passes through the origin, after an arc length.
    pub(super) fn circle(s: f64) -> Vec2 {
        let (sin, cos) = trig::sincos(s / 0.5);
        Vec2::new(0.5 * sin, 0.5 * (1.0 - cos))
    }

    #[test]
    fn what_was_seen_is_still_known_after_driving_on_blind() {
        let options = TrackOptions::default();
        let mut memory = PathMemory::default();
        memory.update(&points(circle, 0.1, 0.4), &options, |_| true);
        // 0.2 m along the circle.
        memory.carry(Pose2::default().advance(0.2, 0.4, 1.0), &options);
        let state = memory.state(Pose2::default(), 0.0, &options).unwrap();
        assert!(
            state.d_m.abs() < 0.003 && state.theta_rad.abs() < 0.03,
            "{state:?}"
        );
        assert!((memory.ahead_of(Vec2::ZERO) - 0.2).abs() < 0.02);
    }

    #[test]
    fn left_and_right_have_their_signs() {
        let mut memory = PathMemory::default();
        memory.update(
            &points(|s| Vec2::new(s, 0.1), 0.1, 0.4),
            &TrackOptions::default(),
            |_| true,
        );
        let state = memory
            .state(Pose2::default(), 0.0, &TrackOptions::default())
            .unwrap();
        assert!((state.d_m - 0.1).abs() < 1e-6);
        assert!((memory.locate(Vec2::new(0.2, 0.3)).unwrap().offset_m - 0.2).abs() < 1e-9);
        memory.shift(-0.1);
        assert!(
            memory
                .state(Pose2::default(), 0.0, &TrackOptions::default())
                .unwrap()
                .d_m
                .abs()
                < 1e-6
        );
    }
}
