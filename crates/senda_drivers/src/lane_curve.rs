//! The lane as a remembered middle with a width: which blobs are its lines, and where they put the middle.

use crate::along_path::AlongPath;
use crate::association::{Beside, POINTS_LEAST, TURN_LIMIT_RAD, beside, direction_at, is_piece_at};
use crate::candidate::{Candidate, FloorPoint};
use crate::lane::LaneShape;
use crate::lane_pair::{Pair, PairSearch};
use crate::path_memory::{PathMemory, TrackOptions};
use crate::sight::Sight;
use senda_geom::{Pose2, Vec2};
use std::cell::RefCell;

/// What a candidate is to the lane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Role {
    /// The left line, or a piece of it.
    Left,
    /// The right line, or a piece of it.
    Right,
    /// A line between the two, such as a dashed centre line.
    Between,
    /// The only line known, of which the side is not.
    Single,
    /// Something else.
    #[default]
    Stranger,
}

/// What is known about the lane's width.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Width {
    /// One line only, and the vehicle stands on it: it is followed itself, as in the document.
    OneLine,
    /// One line only, beside the vehicle: the vehicle is taken to stand in the middle, so that half the width is the
    /// distance to the line.
    Guessed(Role),
    /// Both lines were seen, or the width was given.
    Known,
}

/// The lane's memory.
pub(crate) struct CurveLane {
    shape: LaneShape,
    beside_m: f64,
    /// The middle of the lane; of the line while only one of unknown side is known.
    pub(crate) memory: PathMemory,
    /// Distance between the lines (m), once seen.
    width_m: Option<f64>,
    known: Width,
    /// Where the line between the two runs, to the left of the middle (m), once learned.
    between_m: Option<f64>,
    /// In how many frames it was seen there.
    between_frames: u32,
    roles: Vec<Role>,
    seen: Vec<FloorPoint>,
    order: AlongPath,
    strange_frames: u32,
    undecided_frames: u32,
    empty_frames: u32,
    unmatched_frames: u32,
    pairs: PairSearch,
    scratch: RefCell<Vec<f64>>,
}

/// So many frames in a row that show a lane elsewhere and nothing where it should be make it jump.
const STRANGE_FRAMES: u32 = 4;
/// After so many frames with candidates of which none matches, the far end of the memory is forgotten ...
pub(crate) const UNMATCHED_FRAMES: u32 = 3;
/// ... except for this much ahead of the axle (m).
pub(crate) const TRUSTED_AHEAD_M: f64 = 0.12;
/// After so many frames without any line one that the picture's side cuts must do, or the other contrast.
const EMPTY_FRAMES: u32 = 10;
/// After so many frames that show lines but no lane, the strongest line must do.
const UNDECIDED_FRAMES: u32 = 10;
/// A single line nearer than this part of half the vehicle's width is below it, not beside it: wheels stand on neither.
const ON_THE_LINE_PART: f64 = 0.5;
/// Part of the difference by which a frame that shows both lines changes the lane's width.
const WIDTH_LEARNED: f64 = 0.1;
/// A line between the two counts as one after so many frames in which it kept its place: reflections do not.
const BETWEEN_FRAMES: u32 = 40;
/// Keeping its place means within this (m).
const BETWEEN_STEADY_M: f64 = 0.015;
/// Half the length over which a line's direction is taken (m), at least.
const TANGENT_M: f64 = 0.04;

impl CurveLane {
    /// `beside_m`: half the vehicle's width, or at what distance else a single line is followed.
    pub(crate) fn new(shape: LaneShape, beside_m: f64) -> Self {
        Self {
            beside_m,
            width_m: shape.width_m,
            shape,
            memory: PathMemory::default(),
            known: Width::Known,
            between_m: None,
            between_frames: 0,
            roles: Vec::new(),
            seen: Vec::new(),
            order: AlongPath::default(),
            strange_frames: 0,
            undecided_frames: 0,
            empty_frames: 0,
            unmatched_frames: 0,
            pairs: PairSearch::default(),
            scratch: RefCell::new(Vec::new()),
        }
    }

    /// What the candidates of the last frame are.
    pub(crate) fn roles(&self) -> &[Role] {
        &self.roles
    }

    /// The lane's width (m), once known.
    pub(crate) fn width_m(&self) -> Option<f64> {
        self.width_m
    }

    /// How many lines the last frame showed.
    pub(crate) fn lines(&self) -> usize {
        let has = |role: Role| usize::from(self.roles.contains(&role));
        has(Role::Left) + has(Role::Right) + has(Role::Single)
    }

    /// No new frame.
    pub(crate) fn close(&mut self) {
        self.roles.clear();
    }

    /// One frame. Whether it showed the lane.
    pub(crate) fn update(
        &mut self,
        sight: &mut Sight,
        now_from_exposure: Pose2,
        track: &TrackOptions,
        lost_m: f64,
    ) -> bool {
        let candidates = sight.whole();
        self.roles.clear();
        self.roles.resize(candidates.len(), Role::Stranger);
        if self.memory.is_empty() {
            return self.begin(sight, now_from_exposure, track);
        }
        if self.known != Width::Known {
            // As soon as a partner shows up the line has a side and the lane a width.
            if let Some(pair) = self.best_pair(candidates, now_from_exposure, track, 1.5) {
                if self.continues(&pair, candidates, now_from_exposure, track) {
                    self.enter(&pair, sight, now_from_exposure, track);
                    return true;
                }
            }
        }
        self.assign(candidates, now_from_exposure, track, lost_m);
        self.collect(candidates, now_from_exposure);
        if self.seen.len() < POINTS_LEAST {
            self.assign_pieces(sight, now_from_exposure, track);
            self.collect(sight.candidates(), now_from_exposure);
        }
        let candidates = sight.whole();
        if self.seen.len() >= POINTS_LEAST {
            // A remembered point of the middle counts as in view when one of the lines beside it is.
            let half = Vec2::new(0.0, 0.5 * self.width_m.unwrap_or(0.0));
            let believed = self.memory.update(&self.seen, track, |floor| {
                sight.sees(floor + half) || sight.sees(floor - half)
            });
            if believed {
                (self.strange_frames, self.unmatched_frames) = (0, 0);
                for (index, role) in self.roles.iter().enumerate() {
                    if matches!(role, Role::Left | Role::Right | Role::Single) {
                        sight.learn(index);
                    }
                }
                return true;
            }
        }
        // A wrong end of the memory can keep everything from matching: without it the next frame may.
        self.unmatched_frames += 1;
        if self.unmatched_frames.is_multiple_of(UNMATCHED_FRAMES) {
            self.memory.shorten(TRUSTED_AHEAD_M);
        }
        // Nothing where the lane should be, but perhaps a lane elsewhere.
        let elsewhere = self.best_pair(candidates, now_from_exposure, track, 1.2);
        let strong = elsewhere.as_ref().is_some_and(|pair| {
            candidates[pair.left].score.min(candidates[pair.right].score) > self.shape.reentry_score
        });
        self.strange_frames = if elsewhere.is_some() {
            self.strange_frames + 1
        } else {
            0
        };
        let exhausted = self.memory.ahead_of(Vec2::ZERO) < 0.02;
        if let Some(pair) = elsewhere {
            if (strong && exhausted) || self.strange_frames >= STRANGE_FRAMES {
                self.enter(&pair, sight, now_from_exposure, track);
                return true;
            }
        }
        self.roles.iter_mut().for_each(|role| *role = Role::Stranger);
        false
    }

    /// Whether a pair contains the one line that is known, on its side.
    fn continues(
        &self,
        pair: &Pair,
        candidates: &[Candidate],
        now_from_exposure: Pose2,
        track: &TrackOptions,
    ) -> bool {
        let half_m = 0.5 * self.width_m.unwrap_or(0.0);
        let lies_at = |index: usize, at_m: f64| {
            self.beside(&candidates[index], now_from_exposure)
                .is_some_and(|beside| (beside.offset_m - at_m).abs() < track.gate_m + 0.02)
        };
        match self.known {
            Width::OneLine => lies_at(pair.left, 0.0) || lies_at(pair.right, 0.0),
            Width::Guessed(Role::Left) => lies_at(pair.left, half_m),
            Width::Guessed(_) => lies_at(pair.right, -half_m),
            Width::Known => false,
        }
    }

    fn begin(&mut self, sight: &mut Sight, now_from_exposure: Pose2, track: &TrackOptions) -> bool {
        if sight.whole().is_empty() {
            // Perhaps a line that the picture's side cuts; else perhaps lines of the other contrast.
            self.empty_frames += 1;
            if self.empty_frames <= EMPTY_FRAMES {
                return false;
            }
            sight.look_aside();
            self.roles.resize(sight.candidates().len(), Role::Stranger);
            if sight.candidates().is_empty() {
                self.empty_frames = 0;
                sight.doubt();
                return false;
            }
        } else {
            self.empty_frames = 0;
        }
        let candidates = sight.candidates();
        if let Some(pair) = self.best_pair(candidates, now_from_exposure, track, 0.8) {
            self.enter(&pair, sight, now_from_exposure, track);
            return true;
        }
        // One line only: the strongest, if it is clearly that, or if nothing better came up for a while.
        let best = &candidates[0];
        let rival = candidates.get(1).map_or(0.0, |second| second.score);
        let clear = best.score >= self.shape.dominance * rival;
        self.undecided_frames = if clear { 0 } else { self.undecided_frames + 1 };
        if best.points.len() < POINTS_LEAST || !(clear || self.undecided_frames > UNDECIDED_FRAMES) {
            return false;
        }
        self.roles[0] = Role::Single;
        self.known = Width::OneLine;
        self.collect(candidates, now_from_exposure);
        self.memory.clear();
        self.memory.update(&self.seen, track, |floor| sight.sees(floor));
        let Some(state) = self.memory.state(Pose2::default(), 0.0, track) else {
            return true;
        };
        let distance_m = state.d_m.abs();
        if distance_m > ON_THE_LINE_PART * self.beside_m {
            // A lane has room for the vehicle; but standing far from the line the vehicle is not in the middle, or the
            // line is not of this lane.
            let guess_m = (2.0 * distance_m.max(self.beside_m)).min(0.75 * self.shape.widest_m);
            let width_m = self.shape.width_m.unwrap_or(guess_m);
            let side = if state.d_m > 0.0 { Role::Left } else { Role::Right };
            self.memory.shift(if side == Role::Left {
                -0.5 * width_m
            } else {
                0.5 * width_m
            });
            self.width_m = Some(width_m);
            self.roles[0] = side;
            self.known = if self.shape.width_m.is_some() {
                Width::Known
            } else {
                Width::Guessed(side)
            };
        }
        true
    }

    /// Takes over a pair as the lane.
    fn enter(&mut self, pair: &Pair, sight: &Sight, now_from_exposure: Pose2, track: &TrackOptions) {
        let candidates = sight.whole();
        self.roles.iter_mut().for_each(|role| *role = Role::Stranger);
        self.roles[pair.left] = Role::Left;
        self.roles[pair.right] = Role::Right;
        self.width_m = Some(pair.width_m);
        (self.between_m, self.between_frames) = (None, 0);
        self.known = Width::Known;
        self.strange_frames = 0;
        self.memory.clear();
        self.collect(candidates, now_from_exposure);
        self.memory.update(&self.seen, track, |floor| sight.sees(floor));
    }

    /// Gives every candidate its role by where it lies beside the remembered middle.
    fn assign(
        &mut self,
        candidates: &[Candidate],
        now_from_exposure: Pose2,
        track: &TrackOptions,
        lost_m: f64,
    ) {
        let slack_m = track.gate_m + 0.2 * lost_m;
        if self.known == Width::OneLine {
            for (index, candidate) in candidates.iter().enumerate() {
                if let Some(beside) = self.beside(candidate, now_from_exposure) {
                    let gate_m = slack_m + track.gate_slope * beside.range_m + 0.5 * beside.spread_m;
                    if beside.offset_m.abs() < gate_m && beside.turn_rad.abs() < TURN_LIMIT_RAD {
                        self.roles[index] = Role::Single;
                    }
                }
            }
            return;
        }
        let Some(width_m) = self.width_m else { return };
        let half_m = 0.5 * width_m;
        // Never so wide that a line could be taken for the middle.
        let gate_m = slack_m.max(0.15 * width_m).min(0.35 * width_m);
        for (index, candidate) in candidates.iter().enumerate() {
            let Some(beside) = self.beside(candidate, now_from_exposure) else {
                continue;
            };
            let gate_m = gate_m + track.gate_slope * beside.range_m;
            let along = beside.turn_rad.abs() < TURN_LIMIT_RAD && beside.spread_m < gate_m;
            let near = |at_m: f64| along && (beside.offset_m - at_m).abs() < gate_m;
            self.roles[index] = if near(half_m) {
                Role::Left
            } else if near(-half_m) {
                Role::Right
            } else if along && beside.offset_m.abs() < half_m {
                Role::Between
            } else {
                Role::Stranger
            };
        }
        self.learn(candidates, now_from_exposure);
    }

    /// No whole candidate is one of the lines, but perhaps dashes or what reflections leave of them.
    fn assign_pieces(&mut self, sight: &mut Sight, now_from_exposure: Pose2, track: &TrackOptions) {
        sight.look_closer();
        let half_m = 0.5 * self.width_m.unwrap_or(0.0);
        let places: &[(Role, f64)] = if self.known == Width::OneLine {
            &[(Role::Single, 0.0)]
        } else {
            &[(Role::Left, half_m), (Role::Right, -half_m)]
        };
        for piece in &sight.candidates()[sight.whole().len()..] {
            let scratch = &mut self.scratch.borrow_mut();
            let place = places.iter().find(|(_, offset_m)| {
                is_piece_at(&self.memory, piece, *offset_m, track, now_from_exposure, scratch)
            });
            self.roles.push(place.map_or(Role::Stranger, |(role, _)| *role));
        }
    }

    /// Width of the lane, and where a line between the two runs.
    fn learn(&mut self, candidates: &[Candidate], now_from_exposure: Pose2) {
        let mean_of = |role: Role| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (candidate, _) in candidates.iter().zip(&self.roles).filter(|(_, r)| **r == role) {
                if let Some(beside) = self.beside(candidate, now_from_exposure) {
                    let count = candidate.points.len() as f64;
                    (sum, weight) = (sum + beside.offset_m * count, weight + count);
                }
            }
            (weight >= 5.0).then(|| sum / weight)
        };
        let (left, right, between) = (mean_of(Role::Left), mean_of(Role::Right), mean_of(Role::Between));
        if let (Some(left), Some(right), Some(width_m)) = (left, right, self.width_m) {
            let learned = width_m + WIDTH_LEARNED * ((left - right) - width_m);
            self.width_m = Some(learned.clamp(self.shape.narrowest_m, self.shape.widest_m));
        }
        if let (Some(between), true) = (between, left.is_some() || right.is_some()) {
            let known = self.between_m.unwrap_or(between);
            if (between - known).abs() < BETWEEN_STEADY_M {
                self.between_frames += 1;
                self.between_m = Some(known + WIDTH_LEARNED * (between - known));
            } else {
                (self.between_m, self.between_frames) = (None, 0);
            }
        }
    }

    /// The middle of the lane as the candidates show it, in the present vehicle frame, along the path.
    fn collect(&mut self, candidates: &[Candidate], now_from_exposure: Pose2) {
        self.seen.clear();
        let half_m = 0.5 * self.width_m.unwrap_or(0.0);
        let has_edge = self
            .roles
            .iter()
            .any(|role| matches!(role, Role::Left | Role::Right));
        for (candidate, role) in candidates.iter().zip(&self.roles) {
            let shift_m = match role {
                Role::Left => -half_m,
                Role::Right => half_m,
                Role::Single => 0.0,
                // The line between stands in when neither edge is seen.
                Role::Between => match self.between_m {
                    Some(between_m) if !has_edge && self.between_frames >= BETWEEN_FRAMES => -between_m,
                    _ => continue,
                },
                Role::Stranger => continue,
            };
            let tangent_m = TANGENT_M.max(0.3 * half_m);
            for (index, point) in candidate.points.iter().enumerate() {
                let direction = direction_at(&candidate.points, index, tangent_m);
                let at = now_from_exposure.transform(point.at + direction.perp() * shift_m);
                self.seen.push(FloorPoint {
                    at,
                    // What the direction's error does to a point shifted sideways is along the path: little.
                    sigma_m: point.sigma_m + 0.02 * shift_m.abs(),
                    step_m: point.step_m,
                });
            }
        }
        self.order.sort(&self.memory, &self.seen);
        self.order.average(&mut self.seen);
    }

    /// Where a candidate lies beside the remembered middle.
    fn beside(&self, candidate: &Candidate, now_from_exposure: Pose2) -> Option<Beside> {
        beside(
            &self.memory,
            &candidate.points,
            now_from_exposure,
            &mut self.scratch.borrow_mut(),
        )
    }

    /// The two candidates that most look like a lane around the vehicle.
    fn best_pair(
        &mut self,
        candidates: &[Candidate],
        now_from_exposure: Pose2,
        track: &TrackOptions,
        furthest: f64,
    ) -> Option<Pair> {
        let known_m = self.shape.width_m.or(self.width_m);
        self.pairs.best(
            candidates,
            now_from_exposure,
            (&self.shape, known_m),
            track,
            furthest,
        )
    }
}
