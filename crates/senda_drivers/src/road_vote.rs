//! Which way the road goes, by a vote of everything in sight that may be paint.
//!
//! All lines of a road run beside one another. So for a supposed direction and curvature the points of each of them have one
//! distance to the left, and the distances of all points fall into few narrow heaps; for a wrong one they smear. No line needs to be
//! recognised for that: edges, dashes and centre lines vote together, and images of lamps, which all point at the
//! camera, agree neither with them nor with one another.

use senda_geom::{Vec2, trig};
use senda_vision::Stripe;

/// A point that votes, in the vehicle frame (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Vote {
    pub(crate) at: Vec2,
    pub(crate) weight: f64,
}

impl Vote {
    /// The vote of a point of paint that is near enough. Its weight counts floor in line widths.
    pub(crate) fn of(stripe: &Stripe, line_width_m: f64, range_m: f64) -> Option<Self> {
        // Far away a pixel spans more floor than a line is wide: it counts as one line width at most.
        let weight = stripe.sharpness * (stripe.step_m / line_width_m).min(1.0);
        (weight > 0.0 && stripe.floor.length() < range_m).then_some(Self {
            at: stripe.floor,
            weight,
        })
    }
}

/// Direction and curvature of the road where the vehicle stands, and how the votes lie across it.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct RoadVote {
    /// Directions (rad, left positive) with sine and cosine.
    angles: Vec<(f64, f64, f64)>,
    curvatures_per_m: Vec<f64>,
    /// How well each direction and curvature explains the frames so far; newer ones count more.
    scores: Vec<f64>,
    heap_m: f64,
    half_width_m: f64,
    heaps: Vec<f64>,
    winner: Winner,
}

/// What won.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Winner {
    /// Direction of the road (rad, left positive).
    pub(crate) theta_rad: f64,
    /// Its curvature (1/m, left positive), where the vehicle is.
    pub(crate) curvature_per_m: f64,
    /// How much the votes agree: 1 all in one heap; spread evenly, one over the number of heaps.
    pub(crate) agreement: f64,
}

/// Steps of direction, and of curvature, to either side of straight ahead.
const STEPS: usize = 15;
/// The furthest direction (rad): a vehicle that stands more askew sees little of its road.
const ANGLE_LIMIT_RAD: f64 = 0.9;
/// The sharpest curvature turns by so much over the reach (rad).
const TURN_OVER_REACH_RAD: f64 = 3.0;
/// Width of a heap as part of a line's.
const HEAP_PART: f64 = 0.8;
/// What is straight needs less to be believed: the sharpest curvature counts as so much less.
const SHARPEST_COUNTS: f64 = 0.8;

impl RoadVote {
    /// For lines `line_width_m` wide, up to `reach_m` ahead and `half_width_m` to both sides.
    pub(crate) fn new(line_width_m: f64, reach_m: f64, half_width_m: f64) -> Self {
        let part = |step: usize| step as f64 / STEPS as f64 - 1.0;
        let angles: Vec<_> = (0..=2 * STEPS)
            .map(|step| {
                let angle_rad = ANGLE_LIMIT_RAD * part(step);
                let (sin, cos) = trig::sincos(angle_rad);
                (angle_rad, sin, cos)
            })
            .collect();
        let curvatures_per_m: Vec<_> = (0..=2 * STEPS)
            .map(|step| TURN_OVER_REACH_RAD / reach_m * part(step))
            .collect();
        let heap_m = HEAP_PART * line_width_m;
        let half_width_m = (half_width_m / heap_m).ceil().min(200.0) * heap_m;
        Self {
            scores: vec![0.0; angles.len() * curvatures_per_m.len()],
            heaps: vec![0.0; (2.0 * half_width_m / heap_m).round() as usize],
            angles,
            curvatures_per_m,
            heap_m,
            half_width_m,
            winner: Winner::default(),
        }
    }

    /// Counts a frame's votes. `kept` is the part of the earlier frames' scores that stays, 0..1.
    pub(crate) fn count(&mut self, votes: &[Vote], kept: f64) -> Winner {
        let total: f64 = votes.iter().map(|vote| vote.weight).sum();
        let columns = self.curvatures_per_m.len();
        let sharpest = self.curvatures_per_m[columns - 1];
        let mut best = 0;
        for index in 0..self.scores.len() {
            let (_, sin, cos) = self.angles[index / columns];
            let curvature_per_m = self.curvatures_per_m[index % columns];
            let mut score = 0.0;
            if total > 0.0 {
                self.heap_up(votes, Vec2::new(-sin, cos), curvature_per_m);
                let bend = curvature_per_m / sharpest;
                let squares: f64 = self.neighbours().map(|heap| heap * heap).sum();
                score = squares / (total * total) * (1.0 - (1.0 - SHARPEST_COUNTS) * bend * bend);
            }
            self.scores[index] = kept * self.scores[index] + (1.0 - kept) * score;
            if self.scores[index] > self.scores[best] {
                best = index;
            }
        }
        let (row, column) = (best / columns, best % columns);
        self.winner = Winner {
            theta_rad: self.angles[row].0
                + (self.angles[1].0 - self.angles[0].0) * self.peak(best, columns, row),
            curvature_per_m: self.curvatures_per_m[column]
                + (self.curvatures_per_m[1] - self.curvatures_per_m[0]) * self.peak(best, 1, column),
            agreement: self.scores[best],
        };
        let (sin, cos) = trig::sincos(self.winner.theta_rad);
        self.heap_up(votes, Vec2::new(-sin, cos), self.winner.curvature_per_m);
        self.winner
    }

    /// Where between the steps the top lies (steps): that of the parabola through the best score and its two neighbours.
    fn peak(&self, best: usize, stride: usize, place: usize) -> f64 {
        if place == 0 || place == 2 * STEPS {
            return 0.0;
        }
        let (before, top, after) = (
            self.scores[best - stride],
            self.scores[best],
            self.scores[best + stride],
        );
        let bend = before - 2.0 * top + after;
        if bend < 0.0 {
            0.5 * (before - after) / bend
        } else {
            0.0
        }
    }

    fn heap_up(&mut self, votes: &[Vote], left: Vec2, curvature_per_m: f64) {
        self.heaps.fill(0.0);
        for vote in votes {
            let Some(offset_m) = offset(vote.at, left, curvature_per_m) else {
                continue;
            };
            let heap = (offset_m + self.half_width_m) / self.heap_m;
            if heap >= 0.0 {
                if let Some(heap) = self.heaps.get_mut(heap as usize) {
                    *heap += vote.weight;
                }
            }
        }
    }

    /// Neighbouring heaps taken together: where a line lies on the border of two.
    fn neighbours(&self) -> impl Iterator<Item = f64> + '_ {
        self.heaps.windows(2).map(|pair| pair[0] + pair[1])
    }

    /// The lines beside the winner, from right to left: offset to the left of the vehicle (m), and weight.
    pub(crate) fn lines(&self, least_weight: f64, lines: &mut Vec<(f64, f64)>) {
        /// Lines are at least so many heaps apart.
        const APART: usize = 3;
        lines.clear();
        let joined = |index: usize| self.heaps[index] + self.heaps[index + 1];
        let count = self.heaps.len().saturating_sub(1);
        for index in 0..count {
            let weight = joined(index);
            let around = index.saturating_sub(APART)..(index + APART + 1).min(count);
            // Of two equal ones the first.
            let is_top = weight >= least_weight
                && around
                    .clone()
                    .all(|other| weight > joined(other) || (weight == joined(other) && index <= other));
            if !is_top {
                continue;
            }
            let near = index.saturating_sub(1)..(index + 2).min(count);
            let (mut sum, mut moment) = (0.0, 0.0);
            for other in near {
                sum += joined(other);
                moment += joined(other) * (other as f64 + 1.0);
            }
            lines.push((moment / sum * self.heap_m - self.half_width_m, weight));
        }
    }
}

/// How far a point lies to the left of the circle (or straight line) through the vehicle's place with a normal `left` and a
/// curvature: circles around one centre run beside one another.
fn offset(at: Vec2, left: Vec2, curvature_per_m: f64) -> Option<f64> {
    let bent = 2.0 * left.dot(at) - curvature_per_m * at.length_squared();
    let root = 1.0 - curvature_per_m * bent;
    // On the far side of the centre a road would have turned right round.
    (root > 0.0).then(|| bent / (1.0 + root.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a line beside a road with a direction and curvature.
    fn line(theta_rad: f64, curvature_per_m: f64, offset_m: f64) -> impl Iterator<Item = Vote> {
        let (sin, cos) = trig::sincos(theta_rad);
        let (ahead, left) = (Vec2::new(cos, sin), Vec2::new(-sin, cos));
        (2..30).map(move |i| {
            let turn = 0.05 * f64::from(i) * curvature_per_m;
            let (s, c) = trig::sincos(turn);
            let at = ahead * ((1.0 / curvature_per_m - offset_m) * s)
                + left * (1.0 / curvature_per_m - (1.0 / curvature_per_m - offset_m) * c);
            Vote { at, weight: 1.0 }
        })
    }

    #[test]
    fn two_lines_and_dashes_agree_on_direction_and_curvature_among_lamps() {
        for (theta, curvature) in [(0.3, -0.8), (-0.2, 0.5), (0.05, 1.1), (0.0, 0.01)] {
            let mut votes: Vec<Vote> = line(theta, curvature, -0.3)
                .chain(line(theta, curvature, 0.25))
                .collect();
            votes.extend(
                line(theta, curvature, -0.02)
                    .enumerate()
                    .filter(|(i, _)| i % 6 < 3)
                    .map(|(_, vote)| vote),
            );
            // Lamps: lines towards the camera.
            for lamp in [-0.4, 0.1, 0.7] {
                votes.extend((6..20).map(|i| {
                    let (sin, cos) = trig::sincos(lamp);
                    Vote {
                        at: Vec2::new(cos, sin) * (0.05 * f64::from(i)),
                        weight: 0.4,
                    }
                }));
            }
            let mut road = RoadVote::new(0.05, 1.7, 1.2);
            let winner = road.count(&votes, 0.0);
            // Direction and curvature make up for one another a little.
            assert!((winner.theta_rad - theta).abs() < 0.08, "{winner:?} {theta}");
            assert!(
                (winner.curvature_per_m - curvature).abs() < 0.1,
                "{winner:?} {curvature}"
            );
            let mut lines = Vec::new();
            road.lines(0.1 * votes.len() as f64, &mut lines);
            for expected in [-0.3, -0.02, 0.25] {
                assert!(
                    lines.iter().any(|(at, _)| (at - expected).abs() < 0.03),
                    "{expected} {lines:?}"
                );
            }
        }
    }

    #[test]
    fn without_votes_nothing_agrees() {
        let mut road = RoadVote::new(0.02, 1.0, 0.4);
        assert_eq!(road.count(&[], 0.0).agreement, 0.0);
        // What was known fades.
        let votes: Vec<Vote> = line(0.0, 0.01, 0.1).collect();
        let sure = road.count(&votes, 0.6).agreement;
        assert!(sure > 0.2 && road.count(&[], 0.6).agreement < 0.61 * sure);
    }
}
