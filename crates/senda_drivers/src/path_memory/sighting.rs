//! What is seen becomes memory: the guess at the vehicle's motion is corrected by it, and old and new are averaged.

use super::{NODES_LIMIT, Node, OnPath, PathMemory, SPACING_M, TrackOptions, arc::solve};
use crate::candidate::FloorPoint;
use senda_geom::{Pose2, Vec2};

/// Neighbours further apart than this have a gap between them, such as between dashes (m).
const GAP_M: f64 = 0.05;
/// Sightings in a row that contradict the memory before they are believed.
const CONTRADICTIONS_BELIEVED: u32 = 4;
/// A node that is in view but not confirmed keeps this part of its weight per sighting.
const UNCONFIRMED_KEPT: f64 = 0.75;
/// A node at the far end below this weight is dropped (1/m²): 10 cm of standard deviation.
const WEIGHT_DROPPED: f64 = 100.0;

impl PathMemory {
    /// Takes over what is seen now: points of the path from near to far, already in the present vehicle frame.
    /// `sees` tells whether a floor point is in the picture, where a line would have been seen. `false`: what is seen is
    /// not this path, and was not believed.
    pub(crate) fn update(
        &mut self,
        seen: &[FloorPoint],
        options: &TrackOptions,
        sees: impl Fn(Vec2) -> bool,
    ) -> bool {
        if seen.len() < 2 {
            return false;
        }
        if self.is_empty() {
            self.begin(seen);
            return true;
        }
        if self.contradicts(seen, options) {
            self.contradictions += 1;
            if self.contradictions < CONTRADICTIONS_BELIEVED {
                return false;
            }
            self.begin(seen);
        } else {
            self.register(seen, options);
            self.rebuild(seen, options, sees);
        }
        self.contradictions = 0;
        while self.nodes.len() > 2 && self.nodes.last().is_some_and(|node| node.weight < WEIGHT_DROPPED) {
            self.nodes.pop();
        }
        self.restation();
        true
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

#[cfg(test)]
mod tests {
    use super::super::tests::{circle, points};
    use super::*;

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
}
