//! Which two lines look like a lane around the vehicle (C8).

use crate::association::{Beside, beside};
use crate::candidate::{Candidate, FloorPoint};
use crate::lane::LaneShape;
use crate::path_memory::{PathMemory, TrackOptions};
use senda_geom::{Pose2, Vec2};

/// A possible lane: two candidates by their indices.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    pub(crate) left: usize,
    pub(crate) right: usize,
    /// Distance between the two (m).
    pub(crate) width_m: f64,
    cost: f64,
}

/// Looks for the pair; owns the memory that this needs.
#[derive(Debug, Clone, Default)]
pub(crate) struct PairSearch {
    /// Each candidate as a path.
    paths: Vec<PathMemory>,
    points: Vec<FloorPoint>,
    scratch: Vec<f64>,
}

/// Only so many candidates, those with the largest scores, are tried.
const CANDIDATES_LIMIT: usize = 8;
/// A pair whose width differs by more than this part from the one that was given is not the lane (guess).
const OTHER_WIDTH_PART: f64 = 0.35;

impl PairSearch {
    /// The two candidates that most look like a lane around the vehicle. `known_m` is the width expected, where there is
    /// one; `furthest` limits where the vehicle stands in it: 0 in the middle, 1 on one of the lines.
    pub(crate) fn best(
        &mut self,
        candidates: &[Candidate],
        now_from_exposure: Pose2,
        (shape, known_m): (&LaneShape, Option<f64>),
        track: &TrackOptions,
        furthest: f64,
    ) -> Option<Pair> {
        let count = candidates.len().min(CANDIDATES_LIMIT);
        let candidates = &candidates[..count];
        self.take_paths(candidates, now_from_exposure, track);
        let mut best: Option<Pair> = None;
        for right in 0..count {
            for left in 0..count {
                if candidates[left].centroid.x >= candidates[right].centroid.x {
                    continue;
                }
                let Some(beside) = self.beside([left, right], candidates, now_from_exposure) else {
                    continue;
                };
                let width_m = beside.offset_m;
                // Half as wide are an edge and the line between the two.
                let is_other = |given_m: f64| (width_m / given_m - 1.0).abs() > OTHER_WIDTH_PART;
                if shape.width_m.is_some_and(is_other) {
                    continue;
                }
                if width_m < shape.narrowest_m
                    || width_m > shape.widest_m
                    || beside.spread_m > 0.015 + 0.12 * width_m
                    || beside.turn_rad.abs() > shape.orientation_rad
                {
                    continue;
                }
                // Where the vehicle stands in it: -1 right line, 0 middle, 1 left line.
                let place = self.paths[right]
                    .locate(Vec2::ZERO)
                    .map_or(1.0, |place| 2.0 * place.offset_m / width_m - 1.0);
                if place.abs() > furthest {
                    continue;
                }
                let score = candidates[left].score.min(candidates[right].score);
                let mut cost = place.abs() + 4.0 * beside.spread_m / width_m - score / 100_000.0;
                if let Some(known_m) = known_m {
                    cost += 4.0 * (width_m / known_m - 1.0).abs();
                }
                if best.is_none_or(|pair| cost < pair.cost) {
                    best = Some(Pair {
                        left,
                        right,
                        width_m,
                        cost,
                    });
                }
            }
        }
        best
    }

    fn take_paths(&mut self, candidates: &[Candidate], now_from_exposure: Pose2, track: &TrackOptions) {
        if self.paths.len() < candidates.len() {
            self.paths.resize_with(CANDIDATES_LIMIT, PathMemory::default);
        }
        for (path, candidate) in self.paths.iter_mut().zip(candidates) {
            self.points.clear();
            self.points
                .extend(candidate.points.iter().map(|point| FloorPoint {
                    at: now_from_exposure.transform(point.at),
                    ..*point
                }));
            path.clear();
            path.update(&self.points, track, |_| true);
        }
    }

    /// How far the left line runs beside the right one. In a curve one of the two is seen further back than the other, so
    /// both are taken as the path for the other, and the more parallel answer counts.
    fn beside(
        &mut self,
        [left, right]: [usize; 2],
        candidates: &[Candidate],
        now_from_exposure: Pose2,
    ) -> Option<Beside> {
        let mut seen_from = |path: usize, line: usize| {
            beside(
                &self.paths[path],
                &candidates[line].points,
                now_from_exposure,
                &mut self.scratch,
            )
        };
        let from_right = seen_from(right, left);
        let from_left = seen_from(left, right).map(|seen| Beside {
            offset_m: -seen.offset_m,
            turn_rad: -seen.turn_rad,
            ..seen
        });
        match (from_right, from_left) {
            (Some(a), Some(b)) if b.spread_m < a.spread_m => Some(b),
            (Some(a), _) => Some(a),
            (None, b) => b,
        }
    }
}
