//! The lane on a road that the vehicle only watches: each frame says where the road goes, and a short memory of what the
//! frames before said is not moved by commands. For recordings, whose vehicle does not obey, and for wide cameras.

use crate::follow::LineState;
use crate::lane::LaneShape;
use crate::options::{DriverError, check};
use crate::road_vote::{RoadVote, Vote};
use crate::sight::{ContrastChoice, SightOptions};
use senda_core::Image;
use senda_geom::{Vec2, trig};
use senda_vision::{Contrast, FloorMap, StripeFinder};
use serde::{Deserialize, Serialize};

/// How the road is read in the form `road`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoadOptions {
    /// What the frames before said keeps this part of its weight from frame to frame, 0..1. A guess: two and a half frames.
    pub kept: f64,
    /// How far paint must agree to be a road, 0..1: paint without order, over a lane 0.9 m wide, reaches 0.07.
    pub agreement: f64,
    /// So much line must be in sight, as part of `sight.range_m`, 0..2: two lines all along are 2. A guess.
    pub least_part: f64,
    /// Part of the way to the lane's middle that is steered for: 1 drives in the middle, 0 along the road at the place where
    /// the vehicle is.
    pub centring: f64,
}

impl Default for RoadOptions {
    fn default() -> Self {
        Self {
            kept: 0.6,
            agreement: 0.1,
            least_part: 0.3,
            centring: 1.0,
        }
    }
}

impl RoadOptions {
    pub(crate) fn validate(&self) -> Result<(), DriverError> {
        check("road.kept", self.kept, 0.0, 0.999)?;
        check("road.agreement", self.agreement, 0.0, 1.0)?;
        // Two lines all along the way are twice of it.
        check("road.least_part", self.least_part, 0.0, 2.0)?;
        check("road.centring", self.centring, 0.0, 1.0)
    }
}

/// The lane's memory.
pub(crate) struct RoadLane {
    options: RoadOptions,
    shape: LaneShape,
    line_width_m: f64,
    range_m: f64,
    contrast: Option<Contrast>,
    /// Weight of dark and of light stripes so far.
    shown: [f64; 2],
    finder: Option<StripeFinder>,
    votes: Vec<Vote>,
    road: RoadVote,
    lines: Vec<(f64, f64)>,
    /// Middle of the lane, to the left of the vehicle (m).
    middle_m: Option<f64>,
    /// Distance between the lines (m), once seen.
    width_m: Option<f64>,
    /// Where its lines were seen in the last frame (m to the left).
    seen: [Option<f64>; 2],
    state: Option<LineState>,
}

/// A line of the last frame's lane lies no further from where it was than this part of the lane's width.
const MOVED_PART: f64 = 0.3;
/// A pair is as wide as the lane is known to be, but for this part.
const WIDTH_PART: f64 = 0.35;
/// Part of the difference by which a frame changes the lane's width.
const WIDTH_LEARNED: f64 = 0.1;
/// A line has at least this part of all paint in sight.
const LINE_PART: f64 = 0.07;
/// The vehicle stands no further from the lane's middle than this many half widths.
const FURTHEST: f64 = 1.3;
/// What the frames before showed of dark and light keeps this part.
const SHOWN_KEPT: f64 = 0.9;

impl RoadLane {
    pub(crate) fn new(options: RoadOptions, shape: LaneShape, sight: &SightOptions) -> Self {
        // The lane, and a line of the road beyond it.
        let half_width_m = 1.4 * shape.widest_m;
        Self {
            options,
            width_m: shape.width_m,
            shape,
            line_width_m: sight.line_width_m,
            range_m: sight.range_m,
            contrast: match sight.contrast {
                ContrastChoice::Auto => None,
                ContrastChoice::Dark => Some(Contrast::Dark),
                ContrastChoice::Light => Some(Contrast::Light),
            },
            shown: [0.0; 2],
            finder: None,
            votes: Vec::new(),
            road: RoadVote::new(sight.line_width_m, sight.range_m, half_width_m),
            lines: Vec::new(),
            middle_m: None,
            seen: [None; 2],
            state: None,
        }
    }

    /// One frame. Whether it showed the lane.
    pub(crate) fn update(&mut self, image: &Image, map: &FloorMap) -> bool {
        let fits = |finder: &StripeFinder| finder.is_for(map);
        if !self.finder.as_ref().is_some_and(fits) {
            self.finder = Some(StripeFinder::new(map, self.line_width_m));
        }
        let contrast = self.contrast.unwrap_or_else(|| {
            let shown =
                [Contrast::Dark, Contrast::Light].map(|contrast| self.take_votes(image, map, contrast));
            for (sum, new) in self.shown.iter_mut().zip(shown) {
                *sum = SHOWN_KEPT * *sum + new;
            }
            if self.shown[0] > self.shown[1] {
                Contrast::Dark
            } else {
                Contrast::Light
            }
        });
        let weight = self.take_votes(image, map, contrast);
        let winner = self.road.count(&self.votes, self.options.kept);
        self.road.lines(LINE_PART * weight, &mut self.lines);
        (self.seen, self.state) = ([None; 2], None);
        // A vote's weight counts floor in line widths.
        let enough = weight * self.line_width_m > self.options.least_part * self.range_m
            && winner.agreement > self.options.agreement;
        if !enough {
            return false;
        }
        if !self.take_pair() && !self.take_one() {
            return false;
        }
        let Some(middle_m) = self.middle_m else {
            return false;
        };
        let d_m = self.options.centring * middle_m;
        self.state = Some(LineState {
            d_m,
            theta_rad: winner.theta_rad,
            curvature_per_m: beside(winner.curvature_per_m, d_m),
        });
        true
    }

    /// No new frame.
    pub(crate) fn close(&mut self) {
        (self.seen, self.state) = ([None; 2], None);
    }

    /// Where the path lies.
    pub(crate) fn state(&self) -> Option<LineState> {
        self.state
    }

    /// The lane's width (m), once known.
    pub(crate) fn width_m(&self) -> Option<f64> {
        self.width_m
    }

    /// How many lines of the lane the last frame showed.
    pub(crate) fn lines(&self) -> usize {
        self.seen.iter().flatten().count()
    }

    /// Where the lane's middle was last seen, to the left of the vehicle (m).
    pub(crate) fn middle_m(&self) -> Option<f64> {
        self.middle_m
    }

    /// How far ahead the road is known (m).
    pub(crate) fn range_m(&self) -> f64 {
        self.range_m
    }

    /// The lane's lines and the path, for drawing: whether it is the path, and its points on the floor.
    pub(crate) fn drawn(&self) -> impl Iterator<Item = (bool, Vec<Vec2>)> + '_ {
        let path = self.state.map(|state| (true, state.d_m));
        let lines = self.seen.iter().flatten().map(|offset_m| (false, *offset_m));
        lines.chain(path).filter_map(|(is_path, offset_m)| {
            let state = self.state?;
            Some((is_path, self.points(state, offset_m)))
        })
    }

    /// Points beside the road that runs through a state, at an offset to the left of the vehicle.
    fn points(&self, state: LineState, offset_m: f64) -> Vec<Vec2> {
        const POINTS: i32 = 24;
        let curvature_per_m = beside(state.curvature_per_m, offset_m - state.d_m);
        let (sin, cos) = trig::sincos(state.theta_rad);
        let left = Vec2::new(-sin, cos);
        let step_m = self.range_m / f64::from(POINTS);
        let (mut at, mut heading_rad) = (left * offset_m, state.theta_rad);
        (0..=POINTS)
            .map(|_| {
                let from = at;
                let (sin, cos) = trig::sincos(heading_rad + 0.5 * curvature_per_m * step_m);
                at += Vec2::new(cos, sin) * step_m;
                heading_rad += curvature_per_m * step_m;
                from
            })
            .collect()
    }

    fn take_votes(&mut self, image: &Image, map: &FloorMap, contrast: Contrast) -> f64 {
        self.votes.clear();
        let Some(finder) = &mut self.finder else {
            return 0.0;
        };
        for stripe in finder.find(image, map, contrast) {
            self.votes
                .extend(Vote::of(stripe, self.line_width_m, self.range_m));
        }
        self.votes.iter().map(|vote| vote.weight).sum()
    }

    /// The two lines that most look like the lane around the vehicle.
    fn take_pair(&mut self) -> bool {
        let total: f64 = self.votes.iter().map(|vote| vote.weight).sum();
        let mut best: Option<(f64, f64, f64)> = None;
        for (index, (right_m, right_weight)) in self.lines.iter().enumerate() {
            for (left_m, left_weight) in &self.lines[index + 1..] {
                let width_m = left_m - right_m;
                let middle_m = 0.5 * (left_m + right_m);
                let strange = self
                    .width_m
                    .map_or(0.0, |known_m| (width_m / known_m - 1.0).abs());
                let place = (2.0 * middle_m / width_m).abs();
                let possible = width_m > self.shape.narrowest_m
                    && width_m < self.shape.widest_m
                    && place < FURTHEST
                    && strange < WIDTH_PART;
                if !possible {
                    continue;
                }
                let moved = self
                    .middle_m
                    .map_or(0.0, |before_m| (middle_m - before_m).abs() / width_m);
                let cost = place + 3.0 * strange + 2.0 * moved - 4.0 * right_weight.min(*left_weight) / total;
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, *right_m, *left_m));
                }
            }
        }
        let Some((_, right_m, left_m)) = best else {
            return false;
        };
        let width_m = left_m - right_m;
        let known_m = self.width_m.unwrap_or(width_m);
        self.width_m = Some(known_m + WIDTH_LEARNED * (width_m - known_m));
        self.middle_m = Some(0.5 * (left_m + right_m));
        self.seen = [Some(right_m), Some(left_m)];
        true
    }

    /// One line, at the side at which it was, or must be.
    fn take_one(&mut self) -> bool {
        let (Some(width_m), Some(before_m)) = (self.width_m, self.middle_m) else {
            return false;
        };
        let half_m = 0.5 * width_m;
        let places = self
            .lines
            .iter()
            .flat_map(|(at_m, _)| [(0, *at_m, at_m + half_m), (1, *at_m, at_m - half_m)]);
        let nearest = places.min_by(|a, b| (a.2 - before_m).abs().total_cmp(&(b.2 - before_m).abs()));
        let Some((side, at_m, middle_m)) =
            nearest.filter(|(.., middle_m)| (middle_m - before_m).abs() < MOVED_PART * width_m)
        else {
            return false;
        };
        self.middle_m = Some(middle_m);
        self.seen[side] = Some(at_m);
        true
    }
}

/// Curvature of what runs `left_m` to the left of a road.
fn beside(curvature_per_m: f64, left_m: f64) -> f64 {
    curvature_per_m / (1.0 - curvature_per_m * left_m).max(0.2)
}
