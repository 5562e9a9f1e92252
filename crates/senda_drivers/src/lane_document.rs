//! C8: the document's matching of two lines from frame to frame.

use crate::candidate::Candidate;
use crate::follow::LineState;
use senda_geom::Vec2;

/// Limits of C8.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PairLimits {
    /// Lanes are at least this wide (m).
    pub(crate) narrowest_m: f64,
    /// And at most this (m).
    pub(crate) widest_m: f64,
    /// The two directions on the floor differ by less than this (rad).
    pub(crate) orientation_rad: f64,
    /// A centroid moves less than this on the floor between frames (m) ...
    pub(crate) moved_m: f64,
    /// ... or less than this part of the image's width.
    pub(crate) moved_part: f64,
    /// Pairs scoring more than this each re-enter directly.
    pub(crate) reentry_score: f64,
    /// Needed in the first frame with more than two candidates.
    pub(crate) first_score: f64,
    /// The second must score this many times the third in the first frame.
    pub(crate) dominance: f64,
    /// A single known line is followed at this distance (m).
    pub(crate) one_line_offset_m: f64,
}

/// Which line a single one is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Left,
    Right,
    Unknown,
}

/// A line as last seen.
#[derive(Debug, Clone, Copy)]
struct Mark {
    u_px: f64,
    floor: Option<Vec2>,
}

impl Mark {
    fn of(candidate: &Candidate) -> Self {
        Self {
            u_px: candidate.centroid.x,
            floor: candidate.centroid_on_floor,
        }
    }
}

/// What was accepted last.
#[derive(Debug, Clone, Copy)]
enum Known {
    Nothing,
    One(Side, Mark),
    Both(Mark, Mark),
}

/// What a frame showed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Accepted {
    /// Index of the left line's candidate.
    pub(crate) left: Option<usize>,
    /// Index of the right line's candidate.
    pub(crate) right: Option<usize>,
    /// Index of a line of unknown side.
    pub(crate) unknown: Option<usize>,
    /// The path.
    pub(crate) path: LineState,
}

impl Accepted {
    /// Number of lines: the document's mode.
    pub(crate) fn lines(&self) -> usize {
        [self.left, self.right, self.unknown].iter().flatten().count()
    }
}

/// The matching's memory.
#[derive(Debug, Clone)]
pub(crate) struct DocumentLane {
    limits: PairLimits,
    known: Known,
    lost: bool,
}

impl DocumentLane {
    pub(crate) fn new(limits: PairLimits) -> Self {
        Self {
            limits,
            known: Known::Nothing,
            lost: false,
        }
    }

    /// One frame: candidates with the largest score first, and the width of the picture (px).
    pub(crate) fn step(&mut self, candidates: &[Candidate], width_px: f64) -> Option<Accepted> {
        let accepted = match (candidates, self.known) {
            ([], _) => None,
            (_, Known::Nothing) => self.first(candidates),
            (_, Known::One(side, mark)) => self
                .reenter(candidates)
                .or_else(|| self.after_one(candidates, side, mark, width_px)),
            (_, Known::Both(left, right)) => self
                .reenter(candidates)
                .or_else(|| self.after_both(candidates, left, right, width_px)),
        };
        self.lost = accepted.is_none();
        if let Some(accepted) = &accepted {
            let mark = |index: Option<usize>| index.map(|index| Mark::of(&candidates[index]));
            self.known = match (mark(accepted.left), mark(accepted.right), mark(accepted.unknown)) {
                (Some(left), Some(right), _) => Known::Both(left, right),
                (Some(left), None, _) => Known::One(Side::Left, left),
                (None, Some(right), _) => Known::One(Side::Right, right),
                (None, None, Some(one)) => Known::One(Side::Unknown, one),
                (None, None, None) => self.known,
            };
        }
        accepted
    }

    /// Nothing is known yet.
    fn first(&self, candidates: &[Candidate]) -> Option<Accepted> {
        let limits = &self.limits;
        match candidates {
            [] => None,
            [_] => self.one(candidates, 0, Side::Unknown),
            [best, _] => self.pair(candidates, 0, 1).or_else(|| {
                (best.score > limits.first_score).then(|| self.one(candidates, 0, Side::Unknown))?
            }),
            [best, second, third, ..] => {
                let both =
                    second.score > limits.first_score && second.score >= limits.dominance * third.score;
                let lane = if both { self.pair(candidates, 0, 1) } else { None };
                let single = best.score > limits.first_score && best.score >= limits.dominance * second.score;
                lane.or_else(|| single.then(|| self.one(candidates, 0, Side::Unknown))?)
            }
        }
    }

    /// After a loss: two very strong lines that make a lane are taken wherever they are.
    fn reenter(&self, candidates: &[Candidate]) -> Option<Accepted> {
        let strong = self.lost && candidates.get(1)?.score > self.limits.reentry_score;
        strong.then(|| self.pair(candidates, 0, 1))?
    }

    fn after_one(&self, candidates: &[Candidate], side: Side, mark: Mark, width_px: f64) -> Option<Accepted> {
        let matched = self.nearest(candidates, mark, width_px, None)?;
        // The nearest other candidate that makes a lane with it, on the right side.
        let mut others: Vec<usize> = (0..candidates.len()).filter(|index| *index != matched).collect();
        let u = candidates[matched].centroid.x;
        others.sort_by(|a, b| {
            let distance = |index: usize| (candidates[index].centroid.x - u).abs();
            distance(*a).total_cmp(&distance(*b))
        });
        for other in others {
            if let Some(lane) = self.pair(candidates, matched, other) {
                let keeps_side = match side {
                    Side::Left => lane.left == Some(matched),
                    Side::Right => lane.right == Some(matched),
                    Side::Unknown => true,
                };
                if keeps_side {
                    return Some(lane);
                }
            }
        }
        self.one(candidates, matched, side)
    }

    fn after_both(
        &self,
        candidates: &[Candidate],
        left: Mark,
        right: Mark,
        width_px: f64,
    ) -> Option<Accepted> {
        let l = self.nearest(candidates, left, width_px, None);
        let r = self.nearest(candidates, right, width_px, None);
        match (l, r) {
            (Some(l), Some(r)) if l != r => self.pair(candidates, l, r).or_else(|| {
                // Only one of the two is right: the one that moved less.
                let moved = |index: usize, mark: Mark| (candidates[index].centroid.x - mark.u_px).abs();
                if moved(l, left) <= moved(r, right) {
                    self.one(candidates, l, Side::Left)
                } else {
                    self.one(candidates, r, Side::Right)
                }
            }),
            (Some(l), Some(r)) => {
                // One candidate for both: it is the nearer one; the other may still have a second choice.
                let to_left = (candidates[l].centroid.x - left.u_px).abs();
                let to_right = (candidates[r].centroid.x - right.u_px).abs();
                let (side, mark) = if to_left <= to_right {
                    (Side::Left, right)
                } else {
                    (Side::Right, left)
                };
                let second = self.nearest(candidates, mark, width_px, Some(l));
                second
                    .and_then(|second| self.pair(candidates, l, second))
                    .or_else(|| self.one(candidates, l, side))
            }
            (Some(l), None) => self.one(candidates, l, Side::Left),
            (None, Some(r)) => self.one(candidates, r, Side::Right),
            (None, None) => None,
        }
    }

    /// The candidate nearest to where a line was, if it is near enough (C8).
    fn nearest(
        &self,
        candidates: &[Candidate],
        mark: Mark,
        width_px: f64,
        without: Option<usize>,
    ) -> Option<usize> {
        let limits = &self.limits;
        let mut best = (f64::INFINITY, None);
        for (index, candidate) in candidates.iter().enumerate() {
            if Some(index) == without {
                continue;
            }
            let on_floor_m = match (candidate.centroid_on_floor, mark.floor) {
                (Some(now), Some(then)) => (now - then).length(),
                _ => f64::INFINITY,
            };
            let in_image = (candidate.centroid.x - mark.u_px).abs() / width_px.max(1.0);
            // Both as parts of their limits; one of the two must hold.
            let distance = (on_floor_m / limits.moved_m).min(in_image / limits.moved_part);
            if distance < 1.0 && distance < best.0 {
                best = (distance, Some(index));
            }
        }
        best.1
    }

    /// Two candidates as a lane, whatever their order, if they can be one.
    fn pair(&self, candidates: &[Candidate], a: usize, b: usize) -> Option<Accepted> {
        let limits = &self.limits;
        let (state_a, state_b) = (candidates[a].straight?, candidates[b].straight?);
        // The left line is further to the left of the axle.
        let (l, r, left, right) = if state_a.d_m > state_b.d_m {
            (a, b, state_a, state_b)
        } else {
            (b, a, state_b, state_a)
        };
        let width_m = left.d_m - right.d_m;
        // On the floor: in the picture the two lines of a lane 20 cm wide differ by 85° on a straight already, so the
        // document's 50° can only mean the angles of its states.
        let turn = senda_geom::angle::difference(left.theta_rad, right.theta_rad).abs();
        let possible = turn < limits.orientation_rad
            && width_m >= limits.narrowest_m
            && width_m <= limits.widest_m
            && candidates[l].centroid.x < candidates[r].centroid.x;
        possible.then_some(Accepted {
            left: Some(l),
            right: Some(r),
            unknown: None,
            path: LineState {
                d_m: 0.5 * (left.d_m + right.d_m),
                theta_rad: 0.5 * (left.theta_rad + right.theta_rad),
                curvature_per_m: 0.0,
            },
        })
    }

    fn one(&self, candidates: &[Candidate], index: usize, side: Side) -> Option<Accepted> {
        let state = candidates[index].straight?;
        let offset_m = self.limits.one_line_offset_m;
        let (left, right, unknown, shift_m) = match side {
            Side::Left => (Some(index), None, None, -offset_m),
            Side::Right => (None, Some(index), None, offset_m),
            Side::Unknown => (None, None, Some(index), 0.0),
        };
        Some(Accepted {
            left,
            right,
            unknown,
            path: LineState {
                d_m: state.d_m + shift_m,
                ..state
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits() -> PairLimits {
        PairLimits {
            narrowest_m: 0.03,
            widest_m: 0.35,
            orientation_rad: 50f64.to_radians(),
            moved_m: 0.04,
            moved_part: 0.125,
            reentry_score: 100_000.0,
            first_score: 50_000.0,
            dominance: 2.0,
            one_line_offset_m: 0.055,
        }
    }

    /// A line `d_m` to the left of the axle, seen at column `u_px`.
    fn candidate(d_m: f64, u_px: f64, score: f64) -> Candidate {
        Candidate {
            score,
            centroid: Vec2::new(u_px, 60.0),
            centroid_on_floor: Some(Vec2::new(0.25, d_m)),
            straight: Some(LineState {
                d_m,
                ..LineState::default()
            }),
            ..Candidate::default()
        }
    }

    fn turned(mut candidate: Candidate, theta_rad: f64) -> Candidate {
        candidate.straight.as_mut().unwrap().theta_rad = theta_rad;
        candidate
    }

    #[test]
    fn a_pair_in_the_first_frame_is_a_lane_and_its_path_is_the_mean() {
        let mut lane = DocumentLane::new(limits());
        let seen = [candidate(0.12, 40.0, 6e4), candidate(-0.08, 120.0, 5e4)];
        let accepted = lane.step(&seen, 160.0).unwrap();
        assert_eq!((accepted.left, accepted.right), (Some(0), Some(1)));
        assert!((accepted.path.d_m - 0.02).abs() < 1e-12);
    }

    #[test]
    fn a_known_line_alone_is_followed_beside_and_an_unknown_one_on_it() {
        let mut lane = DocumentLane::new(limits());
        lane.step(&[candidate(0.1, 40.0, 6e4), candidate(-0.1, 120.0, 6e4)], 160.0);
        let left = lane.step(&[candidate(0.1, 42.0, 6e4)], 160.0).unwrap();
        assert!(left.left == Some(0) && (left.path.d_m - 0.045).abs() < 1e-12);
        let both = lane
            .step(&[candidate(0.1, 42.0, 6e4), candidate(-0.1, 118.0, 6e4)], 160.0)
            .unwrap();
        assert_eq!(both.lines(), 2);
        let right = lane.step(&[candidate(-0.1, 118.0, 6e4)], 160.0).unwrap();
        assert!(right.right == Some(0) && (right.path.d_m + 0.045).abs() < 1e-12);

        let mut fresh = DocumentLane::new(limits());
        let unknown = fresh.step(&[candidate(0.1, 42.0, 6e4)], 160.0).unwrap();
        assert!(unknown.unknown == Some(0) && (unknown.path.d_m - 0.1).abs() < 1e-12);
    }

    #[test]
    fn far_jumps_are_lost_until_two_strong_lines_come() {
        let mut lane = DocumentLane::new(limits());
        lane.step(&[candidate(0.1, 20.0, 6e4), candidate(-0.1, 70.0, 6e4)], 160.0);
        let elsewhere = [candidate(0.3, 100.0, 6e4), candidate(0.2, 150.0, 6e4)];
        assert!(lane.step(&elsewhere, 160.0).is_none());
        assert!(lane.step(&elsewhere, 160.0).is_none());
        let strong = [candidate(0.3, 100.0, 2e5), candidate(0.2, 150.0, 1.5e5)];
        assert_eq!(lane.step(&strong, 160.0).unwrap().lines(), 2);
    }

    #[test]
    fn impossible_pairs_are_no_lanes() {
        for (a, b) in [
            (candidate(0.1, 40.0, 6e4), candidate(0.08, 120.0, 6e4)), // 2 cm: a cut line
            (candidate(0.3, 40.0, 6e4), candidate(-0.1, 120.0, 6e4)), // 40 cm
            (candidate(-0.1, 40.0, 6e4), candidate(0.1, 120.0, 6e4)), // left is right of right
            (
                candidate(0.1, 40.0, 6e4),
                turned(candidate(-0.1, 120.0, 6e4), 1.2),
            ),
        ] {
            let accepted = DocumentLane::new(limits()).step(&[a, b], 160.0).unwrap();
            assert_eq!(accepted.lines(), 1);
        }
    }

    #[test]
    fn with_many_candidates_the_nearest_to_the_last_lines_are_tried() {
        let mut lane = DocumentLane::new(limits());
        lane.step(&[candidate(0.1, 40.0, 6e4), candidate(-0.1, 120.0, 6e4)], 160.0);
        let seen = [
            candidate(0.0, 80.0, 9e4), // a stripe in the middle of the lane
            candidate(-0.11, 124.0, 6e4),
            candidate(0.09, 38.0, 5e4),
        ];
        let accepted = lane.step(&seen, 160.0).unwrap();
        assert_eq!((accepted.left, accepted.right), (Some(2), Some(1)));
    }

    #[test]
    fn in_the_first_frame_three_alike_are_refused() {
        let seen = [
            candidate(0.1, 40.0, 6e4),
            candidate(0.0, 80.0, 6e4),
            candidate(-0.1, 120.0, 6e4),
        ];
        assert!(DocumentLane::new(limits()).step(&seen, 160.0).is_none());
    }
}
