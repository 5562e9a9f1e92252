//! The lane as a remembered middle with a width: which blobs are its lines, and where they put the middle.

use crate::lane::LaneShape;
use crate::path_memory::{PathMemory, TrackOptions};
use crate::sight::{Candidate, FloorPoint, Sight};
use senda_geom::{Pose2, Vec2};

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
    roles: Vec<Role>,
    seen: Vec<FloorPoint>,
    strange_frames: u32,
}

/// Where a candidate lies beside a path: median offset and the offsets' median deviation (m).
#[derive(Debug, Clone, Copy)]
struct Beside {
    offset_m: f64,
    spread_m: f64,
}

/// A possible lane.
struct Pair {
    left: usize,
    right: usize,
    width_m: f64,
    cost: f64,
}

/// So many frames in a row that show a lane elsewhere and nothing where it should be make it jump.
const STRANGE_FRAMES: u32 = 4;
/// Part of the difference by which a frame that shows both lines changes the lane's width.
const WIDTH_LEARNED: f64 = 0.1;
/// Half the length over which a line's direction is taken (m), at least.
const TANGENT_M: f64 = 0.04;

impl CurveLane {
    /// `beside_m`: a single line further away than this is beside the vehicle, not below it.
    pub(crate) fn new(shape: LaneShape, beside_m: f64) -> Self {
        Self {
            beside_m,
            width_m: shape.width_m,
            shape,
            memory: PathMemory::default(),
            known: Width::Known,
            between_m: None,
            roles: Vec::new(),
            seen: Vec::new(),
            strange_frames: 0,
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
        sight: &Sight,
        now_from_exposure: Pose2,
        track: &TrackOptions,
        lost_m: f64,
    ) -> bool {
        let candidates = sight.candidates();
        self.roles.clear();
        self.roles.resize(candidates.len(), Role::Stranger);
        if candidates.is_empty() {
            return false;
        }
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
        if self.seen.len() >= 3 {
            self.strange_frames = 0;
            // A remembered point of the middle counts as in view when one of the lines beside it is.
            let half = Vec2::new(0.0, 0.5 * self.width_m.unwrap_or(0.0));
            self.memory.update(&self.seen, track, |floor| {
                sight.sees(floor + half) || sight.sees(floor - half)
            });
            return true;
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
            self.beside(&self.memory, &candidates[index], now_from_exposure)
                .is_some_and(|beside| (beside.offset_m - at_m).abs() < track.gate_m + 0.02)
        };
        match self.known {
            Width::OneLine => lies_at(pair.left, 0.0) || lies_at(pair.right, 0.0),
            Width::Guessed(Role::Left) => lies_at(pair.left, half_m),
            Width::Guessed(_) => lies_at(pair.right, -half_m),
            Width::Known => false,
        }
    }

    fn begin(&mut self, sight: &Sight, now_from_exposure: Pose2, track: &TrackOptions) -> bool {
        let candidates = sight.candidates();
        if let Some(pair) = self.best_pair(candidates, now_from_exposure, track, 0.8) {
            self.enter(&pair, sight, now_from_exposure, track);
            return true;
        }
        // One line only: the strongest, if it is clearly that.
        let best = &candidates[0];
        let rival = candidates.get(1).map_or(0.0, |second| second.score);
        if best.points.len() < 3 || best.score < self.shape.dominance * rival {
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
        if distance_m > self.beside_m {
            // Standing far from the line the vehicle is not in the middle, or the line is not of this lane.
            let guess_m = (2.0 * distance_m).min(0.75 * self.shape.widest_m);
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
        let candidates = sight.candidates();
        self.roles.iter_mut().for_each(|role| *role = Role::Stranger);
        self.roles[pair.left] = Role::Left;
        self.roles[pair.right] = Role::Right;
        self.width_m = Some(pair.width_m);
        self.between_m = None;
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
                if let Some(beside) = self.beside(&self.memory, candidate, now_from_exposure) {
                    if beside.offset_m.abs() < slack_m + 0.5 * beside.spread_m {
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
            let Some(beside) = self.beside(&self.memory, candidate, now_from_exposure) else {
                continue;
            };
            let near = |at_m: f64| (beside.offset_m - at_m).abs() < gate_m && beside.spread_m < gate_m;
            self.roles[index] = if near(half_m) {
                Role::Left
            } else if near(-half_m) {
                Role::Right
            } else if beside.offset_m.abs() < half_m {
                Role::Between
            } else {
                Role::Stranger
            };
        }
        self.learn(candidates, now_from_exposure);
    }

    /// Width of the lane, and where a line between the two runs.
    fn learn(&mut self, candidates: &[Candidate], now_from_exposure: Pose2) {
        let mean_of = |role: Role| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (candidate, _) in candidates.iter().zip(&self.roles).filter(|(_, r)| **r == role) {
                if let Some(beside) = self.beside(&self.memory, candidate, now_from_exposure) {
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
            self.between_m = Some(known + WIDTH_LEARNED * (between - known));
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
                    Some(between_m) if !has_edge => -between_m,
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
        let memory = &self.memory;
        let station = |at: Vec2| memory.locate(at).map_or(at.x, |place| place.station_m);
        self.seen.sort_by(|a, b| station(a.at).total_cmp(&station(b.at)));
        average_along(&mut self.seen, |point| station(point.at));
    }

    /// Where a candidate lies beside a path.
    fn beside(&self, path: &PathMemory, candidate: &Candidate, now_from_exposure: Pose2) -> Option<Beside> {
        if candidate.points.len() < 3 {
            return None;
        }
        let mut offsets: Vec<f64> = candidate
            .points
            .iter()
            .filter_map(|point| path.locate(now_from_exposure.transform(point.at)))
            .filter(|place| place.beyond_m < 0.5)
            .map(|place| place.offset_m)
            .collect();
        if offsets.len() < 3 || 2 * offsets.len() < candidate.points.len() {
            return None;
        }
        let offset_m = median(&mut offsets);
        for offset in &mut offsets {
            *offset = (*offset - offset_m).abs();
        }
        Some(Beside {
            offset_m,
            spread_m: median(&mut offsets),
        })
    }

    /// The two candidates that most look like a lane around the vehicle.
    /// `furthest` limits where the vehicle stands in it: 0 in the middle, 1 on one of the lines.
    fn best_pair(
        &self,
        candidates: &[Candidate],
        now_from_exposure: Pose2,
        track: &TrackOptions,
        furthest: f64,
    ) -> Option<Pair> {
        const CANDIDATES_LIMIT: usize = 8;
        let shape = &self.shape;
        let count = candidates.len().min(CANDIDATES_LIMIT);
        let mut paths: Vec<PathMemory> = Vec::with_capacity(count);
        for candidate in &candidates[..count] {
            let mut path = PathMemory::default();
            let points: Vec<FloorPoint> = candidate
                .points
                .iter()
                .map(|point| FloorPoint {
                    at: now_from_exposure.transform(point.at),
                    ..*point
                })
                .collect();
            path.update(&points, track, |_| true);
            paths.push(path);
        }
        let mut best: Option<Pair> = None;
        for right in 0..count {
            for left in 0..count {
                if left == right {
                    continue;
                }
                let Some(beside) = self.beside(&paths[right], &candidates[left], now_from_exposure) else {
                    continue;
                };
                let width_m = beside.offset_m;
                let turn = match (candidates[left].straight, candidates[right].straight) {
                    (Some(a), Some(b)) => senda_geom::angle::difference(a.theta_rad, b.theta_rad),
                    _ => continue,
                };
                let wrong_order = candidates[left].centroid.x >= candidates[right].centroid.x;
                if width_m < shape.narrowest_m
                    || width_m > shape.widest_m
                    || beside.spread_m > 0.015 + 0.12 * width_m
                    || turn.abs() > shape.orientation_rad
                    || wrong_order
                {
                    continue;
                }
                // Where the vehicle stands in it: -1 right line, 0 middle, 1 left line.
                let place = paths[right]
                    .locate(Vec2::ZERO)
                    .map_or(1.0, |place| 2.0 * place.offset_m / width_m - 1.0);
                if place.abs() > furthest {
                    continue;
                }
                let score = candidates[left].score.min(candidates[right].score);
                let mut cost = place.abs() + 4.0 * beside.spread_m / width_m - score / 100_000.0;
                if let Some(known_m) = shape.width_m.or(self.width_m) {
                    cost += 4.0 * (width_m / known_m - 1.0).abs();
                }
                if best.as_ref().is_none_or(|pair| cost < pair.cost) {
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
}

/// Direction of a line at one of its points: least squares over `reach_m` to both sides, and over at least five points.
fn direction_at(points: &[FloorPoint], index: usize, reach_m: f64) -> Vec2 {
    let at = points[index].at;
    let near = |point: &FloorPoint| (point.at - at).length() <= reach_m;
    let mut first = index
        - points[..index]
            .iter()
            .rev()
            .take_while(|point| near(point))
            .count();
    let mut last = index + 1 + points[index + 1..].iter().take_while(|point| near(point)).count();
    // At the ends the window reaches further in.
    let wanted = 5.min(points.len());
    if last - first < wanted {
        last = (first + wanted).min(points.len());
        first = last - wanted;
    }
    let window = &points[first..last];
    let count = window.len() as f64;
    let middle = window.iter().map(|point| point.at).sum::<Vec2>() / count;
    // Along the chord, so that steep lines are fitted as well as flat ones.
    let Some(chord) = (window[window.len() - 1].at - window[0].at).try_normalize() else {
        return Vec2::X;
    };
    let (mut along_along, mut along_aside) = (0.0, 0.0);
    for point in window {
        let away = point.at - middle;
        let along = away.dot(chord);
        along_along += along * along;
        along_aside += along * away.dot(chord.perp());
    }
    let slope = if along_along > 0.0 {
        along_aside / along_along
    } else {
        0.0
    };
    (chord + chord.perp() * slope).normalize()
}

/// Averages points of the same centimetre of the path: where both lines show the middle, it is their mean.
fn average_along(points: &mut Vec<FloorPoint>, station: impl Fn(&FloorPoint) -> f64) {
    const BIN_M: f64 = 0.01;
    let mut kept = 0;
    let mut from = 0;
    while from < points.len() {
        let begin_m = station(&points[from]);
        let mut to = from + 1;
        while to < points.len() && station(&points[to]) < begin_m + BIN_M {
            to += 1;
        }
        let group = &points[from..to];
        let weight = |point: &FloorPoint| 1.0 / (point.sigma_m * point.sigma_m).max(1e-8);
        let total: f64 = group.iter().map(weight).sum();
        let mean = group.iter().map(|point| point.at * weight(point)).sum::<Vec2>() / total;
        let sigma_m = group
            .iter()
            .fold(f64::INFINITY, |least, point| least.min(point.sigma_m));
        let step_m = group.iter().fold(0.0, |most: f64, point| most.max(point.step_m));
        points[kept] = FloorPoint {
            at: mean,
            sigma_m,
            step_m,
        };
        kept += 1;
        from = to;
    }
    points.truncate(kept);
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
