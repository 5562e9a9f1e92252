//! The piece of path around the vehicle, remembered on the floor plane.
//!
//! The camera sees the path ahead, never the part under the axle, and sometimes nothing at all. This keeps what was
//! seen as points in the vehicle frame, carries them along as the vehicle moves, corrects that motion by what is seen
//! now, and averages old and new. So the line's whole shape is known (curves as curves, C17), dashes are joined, a
//! frame without a line costs nothing, and the state \[d, θ, κ\] is taken where the vehicle is, not where it looks.

use crate::follow::LineState;
use crate::options::{DriverError, check};
use crate::sight::FloorPoint;
use senda_geom::{Pose2, Vec2, angle, trig};
use serde::{Deserialize, Serialize};

/// Constants of the remembered path and of the guess at the vehicle's own motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackOptions {
    /// How late commands act (s): for predicting the vehicle's own motion. A robot on a toy's bus: 0.05 (guess).
    pub delay_s: f64,
    /// Time constant with which the vehicle follows commands (s): 0.08 (guess).
    pub lag_s: f64,
    /// A line's points may lie this far from where the path is expected (m). C8: 0.04.
    pub gate_m: f64,
    /// The gate grows by this per metre of distance to the point: tilt and calibration errors do.
    pub gate_slope: f64,
    /// The path's direction and curvature are taken over this distance to both sides (m).
    pub window_m: f64,
    /// The curvature that is fed forward is taken this far ahead (m).
    pub preview_m: f64,
    /// The same as time at the present speed (s), added.
    pub preview_s: f64,
    /// Remembered behind the axle (m).
    pub behind_m: f64,
    /// How much one sighting may be outweighed by memory: so many equal sightings (at least 1).
    pub sightings: f64,
    /// Uncertainty that driving adds, sideways (m per square root of metre driven).
    pub drift_m: f64,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            delay_s: 0.05,
            lag_s: 0.08,
            gate_m: 0.04,
            gate_slope: 0.05,
            window_m: 0.07,
            preview_m: 0.0,
            preview_s: 0.0,
            behind_m: 0.15,
            sightings: 6.0,
            drift_m: 0.02,
        }
    }
}

impl TrackOptions {
    /// Refuses what makes no sense.
    pub fn validate(&self) -> Result<(), DriverError> {
        check("track.delay_s", self.delay_s, 0.0, 5.0)?;
        check("track.lag_s", self.lag_s, 0.0, 5.0)?;
        check("track.gate_m", self.gate_m, 0.001, 10.0)?;
        check("track.gate_slope", self.gate_slope, 0.0, 10.0)?;
        check("track.window_m", self.window_m, 0.01, 10.0)?;
        check("track.preview_m", self.preview_m, 0.0, 10.0)?;
        check("track.preview_s", self.preview_s, 0.0, 10.0)?;
        check("track.behind_m", self.behind_m, 0.0, 10.0)?;
        check("track.sightings", self.sightings, 1.0, 1e6)?;
        check("track.drift_m", self.drift_m, 0.0, 10.0)
    }
}

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
    left: Vec2,
}

/// A parabola η = a + b·ξ + c·ξ² on axes through `origin`.
struct Parabola {
    origin: Vec2,
    direction: Vec2,
    a: f64,
    b: f64,
    c: f64,
}

/// Remembered points, from behind the vehicle to ahead of it.
#[derive(Debug, Clone, Default)]
pub(crate) struct PathMemory {
    nodes: Vec<Node>,
    scratch: Vec<Node>,
}

/// Distance between remembered points (m).
const SPACING_M: f64 = 0.01;
/// Neighbours further apart than this have a gap between them, such as between dashes (m).
const GAP_M: f64 = 0.05;
/// At most so many are kept.
const NODES_LIMIT: usize = 160;
/// A node that is in view but not confirmed keeps this part of its weight per sighting.
const UNCONFIRMED_KEPT: f64 = 0.75;
/// A node at the far end below this weight is dropped (1/m²): 10 cm of standard deviation.
const WEIGHT_DROPPED: f64 = 100.0;
/// Expected size of curvatures (1/m, one standard deviation): keeps short or far pieces from bending wildly.
const CURVATURE_PRIOR_PER_M: f64 = 12.0;

impl PathMemory {
    pub(crate) fn is_empty(&self) -> bool {
        self.nodes.len() < 2
    }

    pub(crate) fn clear(&mut self) {
        self.nodes.clear();
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
        if drop > 0 {
            self.nodes.drain(..drop);
            self.restation();
        }
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
        // Beyond an end: along the direction of the last few centimetres there.
        let ahead = part > 0.0;
        let direction = self.end_direction(ahead).unwrap_or(direction);
        let end = if ahead { self.nodes[last] } else { self.nodes[0] };
        let away = point - end.at;
        let along = away.dot(direction);
        Some(OnPath {
            station_m: end.station_m + along,
            offset_m: away.dot(direction.perp()),
            beyond_m: along.abs(),
            left: direction.perp(),
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

    /// Takes over what is seen now: points of the path from near to far, already in the present vehicle frame.
    /// `sees` tells whether a floor point is in the picture, where a line would have been seen.
    pub(crate) fn update(
        &mut self,
        seen: &[FloorPoint],
        options: &TrackOptions,
        sees: impl Fn(Vec2) -> bool,
    ) {
        if seen.len() < 2 {
            return;
        }
        if self.is_empty() {
            self.begin(seen);
            return;
        }
        self.register(seen, options);
        if self.contradicts(seen, options) {
            self.begin(seen);
        } else {
            self.rebuild(seen, options, sees);
        }
        while self.nodes.len() > 2 && self.nodes.last().is_some_and(|node| node.weight < WEIGHT_DROPPED) {
            self.nodes.pop();
        }
        self.restation();
    }

    fn begin(&mut self, seen: &[FloorPoint]) {
        self.nodes.clear();
        for point in seen {
            let far_enough = self
                .nodes
                .last()
                .is_none_or(|last| (point.at - last.at).length() >= SPACING_M);
            if far_enough {
                self.push(point);
            }
        }
        self.restation();
    }

    fn push(&mut self, point: &FloorPoint) {
        if self.nodes.len() < NODES_LIMIT {
            self.nodes.push(Node {
                at: point.at,
                weight: 1.0 / (point.sigma_m * point.sigma_m).max(1e-8),
                station_m: 0.0,
            });
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
    }

    fn gate_m(options: &TrackOptions, at: Vec2) -> f64 {
        options.gate_m + options.gate_slope * at.length()
    }

    /// Moves and turns the remembered path so that it fits what is seen: the guess at the vehicle's motion is never
    /// exact. Least squares over shift and turn, with a prior that keeps both small; outliers count less.
    fn register(&mut self, seen: &[FloorPoint], options: &TrackOptions) {
        // Standard deviations of the guess at one step's motion (m, rad), guesses themselves.
        const SHIFT_M: f64 = 0.006;
        const TURN_RAD: f64 = 0.03;
        // Neighbouring rows err together: the frame as a whole is worth this many independent points.
        const WORTH: f64 = 8.0;
        for _ in 0..2 {
            let mut matrix = [[0.0; 3]; 3];
            let mut right = [0.0; 3];
            let mut count = 0.0;
            for point in seen {
                let Some(place) = self.locate(point.at) else {
                    return;
                };
                if place.beyond_m > 0.0 || place.offset_m.abs() > Self::gate_m(options, point.at) {
                    continue;
                }
                // Huber: beyond two standard deviations the pull stays constant.
                let size = place.offset_m.abs() / (2.0 * point.sigma_m.max(0.002));
                let weight = 1.0 / (point.sigma_m * point.sigma_m).max(4e-6) / size.max(1.0);
                let left = place.left;
                let row = [left.x, left.y, left.dot(point.at.perp())];
                for i in 0..3 {
                    for j in 0..3 {
                        matrix[i][j] += weight * row[i] * row[j];
                    }
                    right[i] += weight * row[i] * place.offset_m;
                }
                count += 1.0;
            }
            if count < 3.0 {
                return;
            }
            let scale = (WORTH / count).min(1.0);
            for i in 0..3 {
                for value in &mut matrix[i] {
                    *value *= scale;
                }
                right[i] *= scale;
            }
            matrix[0][0] += 1.0 / (SHIFT_M * SHIFT_M);
            matrix[1][1] += 1.0 / (SHIFT_M * SHIFT_M);
            matrix[2][2] += 1.0 / (TURN_RAD * TURN_RAD);
            let Some([x, y, turn]) = solve(matrix, right) else {
                return;
            };
            let correction = Pose2::new(x, y, turn.clamp(-0.2, 0.2));
            for node in &mut self.nodes {
                node.at = correction.transform(node.at);
            }
        }
    }

    /// Whether most of what is seen beside the remembered piece is not on it: then the memory is wrong.
    fn contradicts(&self, seen: &[FloorPoint], options: &TrackOptions) -> bool {
        let (mut beside, mut wrong) = (0, 0);
        for point in seen {
            if let Some(place) = self.locate(point.at).filter(|place| place.beyond_m <= 0.0) {
                beside += 1;
                if place.offset_m.abs() > Self::gate_m(options, point.at) {
                    wrong += 1;
                }
            }
        }
        wrong >= 3 && 2 * wrong > beside
    }

    /// Joins memory and sight: behind the seen piece what is remembered, along it the weighted mean of both, ahead of it
    /// what is remembered as long as it continues the seen piece and is not refuted by not being seen.
    fn rebuild(&mut self, seen: &[FloorPoint], options: &TrackOptions, sees: impl Fn(Vec2) -> bool) {
        let (Some(first), Some(last)) = (
            seen.first().and_then(|point| self.locate(point.at)),
            seen.last().and_then(|point| self.locate(point.at)),
        ) else {
            return;
        };
        let fade = |node: &Node| Node {
            weight: if sees(node.at) {
                node.weight * UNCONFIRMED_KEPT
            } else {
                node.weight
            },
            ..*node
        };
        let mut joined = std::mem::take(&mut self.scratch);
        joined.clear();
        // No margin here: a node that has just left the picture must not be replaced by one that is still in it.
        let before = self
            .nodes
            .iter()
            .take_while(|node| node.station_m < first.station_m);
        joined.extend(before.copied());

        let mut last_station_m = first.station_m;
        for (index, point) in seen.iter().enumerate() {
            let Some(place) = self.locate(point.at) else {
                continue;
            };
            let after_gap = index > 0 && is_gap(&seen[index - 1], point);
            if after_gap {
                let within = self.nodes.iter().filter(|node| {
                    node.station_m > last_station_m + SPACING_M
                        && node.station_m < place.station_m - SPACING_M
                });
                joined.extend(within.map(fade));
            }
            last_station_m = place.station_m;
            let too_near = joined
                .last()
                .is_some_and(|node| (point.at - node.at).length() < SPACING_M);
            if too_near {
                continue;
            }
            joined.push(self.blended(point, &place, options));
        }

        if let (Some(end), Some(direction)) = (joined.last().copied(), seen_end_direction(seen)) {
            let ahead = self.nodes.iter().filter(|node| node.station_m > last.station_m);
            // Where the seen end is not on the remembered path, what is remembered beyond it is another path.
            let agrees = last.offset_m.abs() <= Self::gate_m(options, end.at);
            let mut continued = false;
            for node in ahead.take_while(|_| agrees) {
                let away = node.at - end.at;
                if !continued && away.length() < SPACING_M {
                    continue;
                }
                // The first must be within 45° of straight on, plus half the gate.
                let (along, aside) = (away.dot(direction), away.dot(direction.perp()).abs());
                if !continued && !(along > 0.0 && aside < along + 0.5 * Self::gate_m(options, node.at)) {
                    break;
                }
                continued = true;
                joined.push(fade(node));
            }
        }
        joined.truncate(NODES_LIMIT);
        drop_spikes(&mut joined);
        if joined.len() >= 2 {
            std::mem::swap(&mut self.nodes, &mut joined);
        }
        self.scratch = joined;
    }

    /// A seen point pulled towards the remembered path by their weights.
    fn blended(&self, point: &FloorPoint, place: &OnPath, options: &TrackOptions) -> Node {
        let weight = 1.0 / (point.sigma_m * point.sigma_m).max(1e-8);
        let unknown = place.beyond_m > 0.0 || place.offset_m.abs() > Self::gate_m(options, point.at);
        let remembered = if unknown {
            0.0
        } else {
            self.weight_at(place.station_m)
        };
        let part = remembered / (remembered + weight);
        Node {
            at: point.at - place.left * (place.offset_m * part),
            weight: (weight + remembered).min(weight * options.sightings),
            station_m: 0.0,
        }
    }

    /// Weight of the remembered path at a station (1/m²); 0 in gaps.
    fn weight_at(&self, station_m: f64) -> f64 {
        let index = self.nodes.partition_point(|node| node.station_m <= station_m);
        if index == 0 || index >= self.nodes.len() {
            return 0.0;
        }
        let (a, b) = (self.nodes[index - 1], self.nodes[index]);
        if b.station_m - a.station_m > GAP_M {
            return 0.0;
        }
        a.weight.min(b.weight)
    }

    /// How much of the path is known ahead of a point (m).
    pub(crate) fn ahead_of(&self, point: Vec2) -> f64 {
        self.locate(point)
            .map_or(0.0, |place| (self.length_m() - place.station_m).max(0.0))
    }

    /// The state relative to the path of a vehicle that stands at `vehicle` (in the present vehicle frame), with the
    /// curvature `preview_m` further on.
    pub(crate) fn state(&self, vehicle: Pose2, preview_m: f64, options: &TrackOptions) -> Option<LineState> {
        let place = self.locate(vehicle.position())?;
        let parabola = self.fit(place.station_m, options.window_m)?;
        let (d_m, theta_rad) = parabola.state(vehicle);
        let ahead = self.fit(place.station_m + preview_m, options.window_m)?;
        Some(LineState {
            d_m,
            theta_rad,
            curvature_per_m: ahead.curvature(),
        })
    }

    /// The sharpest curvature between the vehicle and `reach_m` ahead (1/m, with its sign).
    pub(crate) fn sharpest_ahead(&self, reach_m: f64, options: &TrackOptions) -> f64 {
        let Some(place) = self.locate(Vec2::ZERO) else {
            return 0.0;
        };
        let end_m = self.length_m().min(place.station_m + reach_m);
        let mut sharpest: f64 = 0.0;
        let mut station_m = place.station_m.max(0.0);
        loop {
            if let Some(parabola) = self.fit(station_m, options.window_m) {
                let curvature = parabola.curvature();
                if curvature.abs() > sharpest.abs() {
                    sharpest = curvature;
                }
            }
            station_m += options.window_m.max(0.5 * reach_m / 8.0);
            if station_m > end_m {
                return sharpest;
            }
        }
    }

    /// Weighted parabola through the nodes around a station.
    fn fit(&self, station_m: f64, window_m: f64) -> Option<Parabola> {
        let length_m = self.length_m();
        if self.is_empty() || length_m < 1e-6 {
            return None;
        }
        // At the ends the window slides inwards, so that it always covers its whole length if the memory does.
        let centre_m = station_m
            .max(window_m)
            .min((length_m - window_m).max(0.5 * length_m))
            .max(0.0);
        let (from_m, to_m) = (centre_m - window_m - 1e-9, centre_m + window_m + 1e-9);
        let mut first = self.nodes.partition_point(|node| node.station_m < from_m);
        let mut last = self.nodes.partition_point(|node| node.station_m <= to_m);
        // In a gap (between dashes) the nodes at its ends must do.
        while last - first < 3 && (first > 0 || last < self.nodes.len()) {
            first = first.saturating_sub(1);
            last = (last + 1).min(self.nodes.len());
        }
        let nodes = &self.nodes[first..last];
        let direction = (nodes[nodes.len() - 1].at - nodes[0].at).try_normalize()?;
        let total: f64 = nodes.iter().map(|node| node.weight).sum();
        if !(total > 0.0) {
            return None;
        }
        let origin = nodes.iter().map(|node| node.at * node.weight).sum::<Vec2>() / total;
        let mut matrix = [[0.0; 3]; 3];
        let mut right = [0.0; 3];
        for node in nodes {
            let away = node.at - origin;
            let (along, aside) = (away.dot(direction), away.dot(direction.perp()));
            let row = [1.0, along, along * along];
            // Old and new errors of neighbours hang together: a few millimetres stay, whatever the weights say.
            let weight = 1.0 / (1.0 / node.weight + 4e-6);
            for i in 0..3 {
                for j in 0..3 {
                    matrix[i][j] += weight * row[i] * row[j];
                }
                right[i] += weight * row[i] * aside;
            }
        }
        matrix[2][2] += 4.0 / (CURVATURE_PRIOR_PER_M * CURVATURE_PRIOR_PER_M);
        let [a, b, c] = solve(matrix, right)?;
        Some(Parabola {
            origin,
            direction,
            a,
            b,
            c,
        })
    }
}

impl Parabola {
    fn curvature(&self) -> f64 {
        let slope = 1.0 + self.b * self.b;
        2.0 * self.c / (slope * slope.sqrt())
    }

    /// Distance to the left and relative direction of the nearest point, seen from a vehicle.
    fn state(&self, vehicle: Pose2) -> (f64, f64) {
        let away = vehicle.position() - self.origin;
        let (x, y) = (away.dot(self.direction), away.dot(self.direction.perp()));
        let mut along = x;
        for _ in 0..4 {
            let (height, slope) = (
                self.a + along * (self.b + self.c * along),
                self.b + 2.0 * self.c * along,
            );
            let value = (along - x) + (height - y) * slope;
            let change = 1.0 + slope * slope + (height - y) * 2.0 * self.c;
            along -= value / change.max(0.3);
        }
        let (height, slope) = (
            self.a + along * (self.b + self.c * along),
            self.b + 2.0 * self.c * along,
        );
        let tangent = self.direction + self.direction.perp() * slope;
        let towards = self.direction * (along - x) + self.direction.perp() * (height - y);
        let distance = towards.length();
        let d_m = if tangent.perp_dot(towards) >= 0.0 {
            distance
        } else {
            -distance
        };
        let heading = trig::atan2(tangent.y, tangent.x);
        (d_m, angle::difference(heading, vehicle.heading_rad))
    }
}

/// Whether nothing was seen between two neighbouring points.
fn is_gap(before: &FloorPoint, after: &FloorPoint) -> bool {
    (after.at - before.at).length() > GAP_M.max(3.0 * before.step_m.max(after.step_m))
}

/// Direction of the last 6 cm of what is seen.
fn seen_end_direction(seen: &[FloorPoint]) -> Option<Vec2> {
    let end = seen.last()?.at;
    let from = seen.iter().rev().find(|point| (end - point.at).length() > 0.06);
    (end - from.or(seen.first())?.at).try_normalize()
}

/// Removes nodes at which the path would turn by more than 70°: ragged ends of blobs, and joints of memory and sight
/// that overlap. The lighter of the two neighbours goes.
fn drop_spikes(nodes: &mut Vec<Node>) {
    const COSINE: f64 = 0.34;
    for _ in 0..8 {
        let mut index = 1;
        let before = nodes.len();
        while index + 1 < nodes.len() {
            let (a, b) = (
                nodes[index].at - nodes[index - 1].at,
                nodes[index + 1].at - nodes[index].at,
            );
            if a.dot(b) < COSINE * a.length() * b.length() {
                let next_is_lighter = nodes[index + 1].weight < nodes[index].weight;
                nodes.remove(if next_is_lighter { index + 1 } else { index });
            } else {
                index += 1;
            }
        }
        if nodes.len() == before {
            return;
        }
    }
}

/// Solves a symmetric 3x3 system by elimination with pivoting.
pub(crate) fn solve(mut matrix: [[f64; 3]; 3], mut right: [f64; 3]) -> Option<[f64; 3]> {
    for column in 0..3 {
        let mut pivot = column;
        for row in column + 1..3 {
            if matrix[row][column].abs() > matrix[pivot][column].abs() {
                pivot = row;
            }
        }
        if !(matrix[pivot][column].abs() > 1e-300) {
            return None;
        }
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        for row in column + 1..3 {
            let factor = matrix[row][column] / matrix[column][column];
            for k in column..3 {
                matrix[row][k] -= factor * matrix[column][k];
            }
            right[row] -= factor * right[column];
        }
    }
    let mut solution = [0.0; 3];
    for row in (0..3).rev() {
        let mut value = right[row];
        for k in row + 1..3 {
            value -= matrix[row][k] * solution[k];
        }
        solution[row] = value / matrix[row][row];
    }
    solution.iter().all(|value| value.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(shape: impl Fn(f64) -> Vec2, from: f64, to: f64) -> Vec<FloorPoint> {
        (0..=30)
            .map(|i| FloorPoint {
                at: shape(from + (to - from) * f64::from(i) / 30.0),
                sigma_m: 0.003,
                step_m: 0.01,
            })
            .collect()
    }

    /// Point of a circle of radius 0.5 to the left that passes through the origin, after an arc length.
    fn circle(s: f64) -> Vec2 {
        let (sin, cos) = trig::sincos(s / 0.5);
        Vec2::new(0.5 * sin, 0.5 * (1.0 - cos))
    }

    #[test]
    fn a_circle_seen_ahead_is_continued_to_the_axle() {
        let mut memory = PathMemory::default();
        memory.update(&points(circle, 0.1, 0.4), &TrackOptions::default(), |_| true);
        let state = memory
            .state(Pose2::default(), 0.0, &TrackOptions::default())
            .unwrap();
        assert!(
            state.d_m.abs() < 0.006 && state.theta_rad.abs() < 0.08,
            "{state:?}"
        );
        assert!((state.curvature_per_m - 2.0).abs() < 0.3, "{state:?}");
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
    fn a_wrong_guess_of_the_motion_is_corrected_by_what_is_seen() {
        let options = TrackOptions::default();
        let mut memory = PathMemory::default();
        let straight = |s: f64| Vec2::new(s, 0.02);
        memory.update(&points(straight, 0.1, 0.5), &options, |_| true);
        // The vehicle turned by 0.05 rad that nobody commanded.
        let turned = |s: f64| Pose2::new(0.0, 0.0, 0.05).inverse().transform(straight(s));
        for _ in 0..6 {
            memory.update(&points(turned, 0.1, 0.5), &options, |_| true);
        }
        let state = memory.state(Pose2::default(), 0.0, &options).unwrap();
        assert!(
            (state.theta_rad + 0.05).abs() < 0.01 && (state.d_m - 0.02).abs() < 0.004,
            "{state:?}"
        );
    }

    #[test]
    fn dashes_are_joined() {
        let options = TrackOptions::default();
        let mut memory = PathMemory::default();
        let straight = |s: f64| Vec2::new(s, -0.03);
        let mut seen = points(straight, 0.10, 0.15);
        seen.extend(points(straight, 0.25, 0.30));
        seen.extend(points(straight, 0.40, 0.45));
        memory.update(&seen, &options, |_| true);
        let state = memory.state(Pose2::default(), 0.0, &options).unwrap();
        assert!((state.d_m + 0.03).abs() < 1e-3 && state.theta_rad.abs() < 0.01);
        assert!(memory.length_m() > 0.34);
    }

    #[test]
    fn a_tail_that_turns_out_wrong_is_replaced() {
        let options = TrackOptions::default();
        let mut memory = PathMemory::default();
        // First a reflection makes the line go on straight, then it is seen to bend.
        memory.update(&points(|s| Vec2::new(s, 0.0), 0.1, 0.5), &options, |_| true);
        for _ in 0..8 {
            memory.update(&points(circle, 0.1, 0.5), &options, |_| true);
        }
        let end = memory.points().last().unwrap();
        assert!((end - circle(0.5)).length() < 0.06, "{end}");
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

    #[test]
    fn slow_driving_keeps_what_leaves_the_picture() {
        // Regression: the nearest node was replaced by the nearest sighting in every frame, so that at less than half
        // a spacing per frame nothing was ever remembered behind the picture's lower edge.
        let options = TrackOptions::default();
        let mut memory = PathMemory::default();
        for _ in 0..100 {
            memory.update(&points(|s| Vec2::new(s, 0.0), 0.11, 0.4), &options, |_| true);
            memory.carry(Pose2::new(0.003, 0.0, 0.0), &options);
        }
        assert!(memory.points().next().unwrap().x < -0.1);
        assert!((memory.length_m() - 0.54).abs() < 0.03, "{}", memory.length_m());
    }

    #[test]
    fn equations_are_solved() {
        let solution = solve(
            [[2.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 4.0]],
            [4.0, 10.0, 14.0],
        )
        .unwrap();
        for (value, expected) in solution.iter().zip([1.0, 2.0, 3.0]) {
            assert!((value - expected).abs() < 1e-12);
        }
        assert!(solve([[0.0; 3]; 3], [1.0; 3]).is_none());
    }
}
