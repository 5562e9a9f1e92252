//! `line`: follows one line by camera (C3 to C7, C9, C10, C12).

use crate::along_path::AlongPath;
use crate::association::{POINTS_LEAST, TURN_LIMIT_RAD, beside, is_piece_at};
use crate::candidate::{Candidate, FloorPoint};
use crate::follow::{FollowOptions, Form, LineState};
use crate::helm::{GOAL_COLOR, Helm, LINE_COLOR, PATH_COLOR, Percept, REFUSED_COLOR};
use crate::lane_curve::{TRUSTED_AHEAD_M, UNMATCHED_FRAMES};
use crate::loss::{LossOptions, Mode};
use crate::options::{DriverError, check};
use crate::path_memory::{PathMemory, TrackOptions};
use crate::sight::{Sight, SightOptions};
use crate::speed::SpeedOptions;
use senda_core::{Body, Command, Driver, Explanation, Observation};
use senda_geom::{Pose2, Vec2};
use serde::{Deserialize, Serialize};

/// Options of the line driver. Every figure that the document gives is the default of its form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LineOptions {
    /// How the line is described and followed.
    pub form: Form,
    /// How fast.
    pub speed: SpeedOptions,
    /// How the driver looks.
    pub sight: SightOptions,
    /// Which of several candidates is the line.
    pub choice: ChoiceOptions,
    /// The remembered path (curve forms).
    pub track: TrackOptions,
    /// The controller.
    pub follow: FollowOptions,
    /// What happens without a line.
    pub loss: LossOptions,
}

/// C7: which candidate is the line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ChoiceOptions {
    /// The best candidate must score this many times the second. C7: 2.
    pub dominance: f64,
    /// After a loss a line is taken back if its centroid is within this part of the image's width of where it left.
    /// C8 gives 1/8 for a lane; the document says "near" for one line.
    pub near_part: f64,
    /// After a loss a line with at least this score is taken back anywhere. C8: 100,000.
    pub large_score: f64,
    /// Curve forms: something else than the remembered path is believed after so many frames in a row that show it and
    /// nothing on the path.
    pub jump_frames: u32,
    /// Curve forms: if no candidate dominates from the beginning for this long (s), the one nearest to straight ahead is
    /// taken.
    pub undecided_s: f64,
}

impl Default for ChoiceOptions {
    fn default() -> Self {
        Self {
            dominance: 2.0,
            near_part: 0.125,
            large_score: 100_000.0,
            jump_frames: 4,
            undecided_s: 1.0,
        }
    }
}

impl Default for LineOptions {
    fn default() -> Self {
        Self {
            form: Form::default(),
            speed: SpeedOptions::default(),
            sight: SightOptions::default(),
            choice: ChoiceOptions::default(),
            track: TrackOptions::default(),
            follow: FollowOptions::default(),
            loss: LossOptions::default(),
        }
    }
}

impl LineOptions {
    /// Another cruising speed (m/s), where one is given.
    pub fn set_speed(&mut self, speed_mps: Option<f64>) {
        self.speed.cruise_mps = speed_mps.unwrap_or(self.speed.cruise_mps);
    }

    fn validate(&self) -> Result<(), DriverError> {
        check("choice.dominance", self.choice.dominance, 1.0, 1e6)?;
        check("choice.near_part", self.choice.near_part, 0.0, 1.0)?;
        check("choice.large_score", self.choice.large_score, 0.0, 1e12)?;
        check("choice.undecided_s", self.choice.undecided_s, 0.0, 3600.0)
    }
}

/// Follows one line.
pub struct LineDriver {
    options: LineOptions,
    sight: Sight,
    helm: Helm,
    memory: PathMemory,
    /// Image column where the line was last seen (px).
    last_u_px: Option<f64>,
    /// Accepted in this frame: indices into the candidates.
    accepted: Vec<usize>,
    /// Points of the accepted candidates in the present vehicle frame.
    seen: Vec<FloorPoint>,
    order: AlongPath,
    group: Group,
    elsewhere_frames: u32,
    unmatched_frames: u32,
    undecided_s: f64,
    found: bool,
    predicted: Pose2,
}

impl LineDriver {
    /// A line driver for a vehicle; its first camera is used.
    pub fn new(body: &Body, options: LineOptions) -> Result<Self, DriverError> {
        options.validate()?;
        if options.form == Form::Road {
            return Err(DriverError::NoRoad { driver: "line" });
        }
        Ok(Self {
            sight: Sight::new(body, &options.sight)?,
            helm: Helm::new(
                body,
                options.form,
                &options.follow,
                &options.track,
                &options.speed,
                &options.loss,
            )?,
            options,
            memory: PathMemory::default(),
            last_u_px: None,
            accepted: Vec::new(),
            seen: Vec::new(),
            order: AlongPath::default(),
            group: Group::default(),
            elsewhere_frames: 0,
            unmatched_frames: 0,
            undecided_s: 0.0,
            found: false,
            predicted: Pose2::default(),
        })
    }

    /// All parameters, for the head of a log (C15).
    pub fn parameters(&self) -> toml::Table {
        crate::options::table(&self.options)
    }

    /// Whether it has found its line.
    pub fn mode(&self) -> Mode {
        self.helm.mode()
    }

    /// C7 as the document has it; the accepted candidate's state.
    fn choose_document(&mut self) -> Option<LineState> {
        let candidates = self.sight.candidates();
        let index = dominant(candidates, self.options.choice.dominance)?;
        let best = &candidates[index];
        if self.helm.mode() == Mode::Lost && !self.near_where_it_left(best) {
            return None;
        }
        let state = best.straight?;
        self.last_u_px = Some(best.centroid.x);
        self.accepted.push(index);
        Some(state)
    }

    fn near_where_it_left(&self, candidate: &Candidate) -> bool {
        let choice = &self.options.choice;
        let near = self
            .last_u_px
            .is_none_or(|u| (candidate.centroid.x - u).abs() < choice.near_part * self.sight.width_px());
        near || candidate.score > choice.large_score
    }

    /// The curve forms' choice: candidates on the remembered path; without one, as C7 with dashes counted together.
    fn choose_on_path(&mut self) {
        let track = self.options.track;
        let lost_m = self.helm.loss.lost_s() * self.options.speed.cruise_mps;
        if !self.memory.is_empty() {
            for (index, candidate) in self.sight.whole().iter().enumerate() {
                if fits(
                    &self.memory,
                    &candidate.points,
                    &track,
                    lost_m,
                    &mut self.group.scratch,
                ) {
                    self.accepted.push(index);
                }
            }
            if self.accepted.is_empty() {
                self.accept_pieces();
            }
            if !self.accepted.is_empty() {
                (self.elsewhere_frames, self.unmatched_frames) = (0, 0);
                return;
            }
            let candidates = self.sight.whole();
            // A wrong end of the memory can keep everything from matching: without it the next frame may.
            self.unmatched_frames += u32::from(!candidates.is_empty());
            if self.unmatched_frames >= UNMATCHED_FRAMES {
                self.unmatched_frames = 0;
                self.memory.shorten(TRUSTED_AHEAD_M);
            }
        }
        let candidates = self.sight.whole();
        let Some(group) = self.group.dominant(
            candidates,
            self.options.choice.dominance,
            &track,
            &mut self.accepted,
        ) else {
            self.accepted.clear();
            return;
        };
        let best = &candidates[group];
        let believed = match self.helm.mode() {
            Mode::NeverSeen => true,
            Mode::Lost if self.memory.ahead_of(Vec2::ZERO) < 0.02 => self.near_where_it_left(best),
            _ => best.score > self.options.choice.large_score || !self.memory.is_empty(),
        };
        self.elsewhere_frames += 1;
        let jump = self.memory.is_empty()
            || self.helm.mode() == Mode::NeverSeen
            || self.elsewhere_frames >= self.options.choice.jump_frames;
        if believed && jump {
            self.memory.clear();
            self.elsewhere_frames = 0;
        } else {
            self.accepted.clear();
        }
    }

    /// No whole candidate is on the remembered path, but perhaps dashes or what a reflection leaves of the line.
    fn accept_pieces(&mut self) {
        self.sight.look_closer();
        let whole = self.sight.whole().len();
        for (index, piece) in self.sight.candidates().iter().enumerate().skip(whole) {
            let on_path = is_piece_at(
                &self.memory,
                piece,
                0.0,
                &self.options.track,
                Pose2::default(),
                &mut self.group.scratch,
            );
            if on_path {
                self.accepted.push(index);
            }
        }
    }

    /// Standing before several equal candidates for a while: the one nearest to straight ahead. Standing before none: a
    /// line that the picture's side cuts, and then perhaps the contrast is the other one.
    fn choose_undecided(&mut self) {
        if self.helm.mode() != Mode::NeverSeen || !self.accepted.is_empty() {
            self.undecided_s = 0.0;
            return;
        }
        self.undecided_s += self.helm.dt_s();
        let limit_s = self.options.choice.undecided_s;
        if self.sight.whole().is_empty() {
            if self.undecided_s > 0.5 * limit_s {
                self.sight.look_aside();
                if self.sight.candidates().is_empty() {
                    self.undecided_s = 0.0;
                    self.sight.doubt();
                } else {
                    self.accepted.push(0);
                }
            }
            return;
        }
        if self.undecided_s < limit_s {
            return;
        }
        let distance =
            |candidate: &Candidate| candidate.straight.map_or(f64::INFINITY, |state| state.d_m.abs());
        let nearest = self
            .sight
            .candidates()
            .iter()
            .enumerate()
            .min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
        if let Some((index, _)) = nearest {
            self.accepted.push(index);
        }
    }

    /// Collects the accepted points in the present vehicle frame, from near to far.
    fn collect(&mut self, now_from_exposure: Pose2) {
        self.seen.clear();
        for index in &self.accepted {
            let candidate = &self.sight.candidates()[*index];
            self.seen.extend(candidate.points.iter().map(|point| FloorPoint {
                at: now_from_exposure.transform(point.at),
                ..*point
            }));
        }
        if self.accepted.len() > 1 {
            self.order.sort(&self.memory, &self.seen);
            self.order.put(&mut self.seen);
        }
        for index in &self.accepted {
            self.sight.learn(*index);
        }
        if let Some(first) = self.accepted.first() {
            self.last_u_px = Some(self.sight.candidates()[*first].centroid.x);
        }
    }
}

impl Driver for LineDriver {
    fn drive(&mut self, observation: &Observation) -> Command {
        let motion = self.helm.begin(observation);
        self.memory.carry(motion, &self.options.track);
        let mut state = None;
        if let Some(frame) = self.sight.new_frame(observation) {
            let now_from_exposure = self.helm.at_exposure(observation, frame.stamp);
            self.sight.look(frame);
            self.accepted.clear();
            if self.options.form == Form::Document {
                state = self.choose_document();
                self.found = state.is_some();
            } else {
                self.choose_on_path();
                self.choose_undecided();
                self.collect(now_from_exposure);
                let sight = &self.sight;
                self.found = self.seen.len() >= POINTS_LEAST
                    && self
                        .memory
                        .update(&self.seen, &self.options.track, |floor| sight.sees(floor));
            }
        } else {
            self.sight.close();
            self.accepted.clear();
            // A camera slower than the loop is no loss; one that delivers nothing is.
            self.found = self.found && observation.first_frame().is_some();
        }

        let percept = if self.options.form == Form::Document {
            Percept {
                found: self.found,
                state,
                ..Percept::default()
            }
        } else {
            self.predicted = self.helm.predicted();
            self.helm.perceive(&mut self.memory, self.found)
        };
        let command = self.helm.steer(percept);
        if self.helm.mode() == Mode::Tracking {
            self.sight.settle();
        }
        command
    }

    fn explain(&self, explanation: &mut Explanation) {
        self.helm.explain(explanation, &self.sight);
        for (index, candidate) in self.sight.candidates().iter().enumerate() {
            let color = if self.accepted.contains(&index) {
                LINE_COLOR
            } else {
                REFUSED_COLOR
            };
            draw_candidate(candidate, explanation, color);
        }
        if self.options.form != Form::Document {
            self.sight
                .draw_floor_line(explanation, self.memory.points(), PATH_COLOR);
            self.sight.draw_floor_point(
                explanation,
                self.predicted.transform(Vec2::new(0.15, 0.0)),
                GOAL_COLOR,
            );
        }
    }

    fn is_done(&self) -> bool {
        self.helm.mode() == Mode::Stopped
    }
}

/// C7: the best candidate, if it scores enough more than the second.
fn dominant(candidates: &[Candidate], dominance: f64) -> Option<usize> {
    match candidates {
        [] => None,
        [_] => Some(0),
        [best, second, ..] => (best.score >= dominance * second.score).then_some(0),
    }
}

/// C7 with dashes counted together; owns the memory that matching needs.
#[derive(Debug, Default)]
struct Group {
    path: PathMemory,
    scratch: Vec<f64>,
}

impl Group {
    /// As C7, but candidates that continue the best one (dashes, a line cut by a reflection) count with it. Their
    /// indices are left in `group`.
    fn dominant(
        &mut self,
        candidates: &[Candidate],
        dominance: f64,
        track: &TrackOptions,
        group: &mut Vec<usize>,
    ) -> Option<usize> {
        group.clear();
        let best = candidates.first()?;
        group.push(0);
        let mut score = best.score;
        let mut rival: f64 = 0.0;
        self.path.clear();
        self.path.update(&best.points, track, |_| true);
        for (index, candidate) in candidates.iter().enumerate().skip(1) {
            if fits(&self.path, &candidate.points, track, 0.0, &mut self.scratch) {
                group.push(index);
                score += candidate.score;
            } else {
                rival = rival.max(candidate.score);
            }
        }
        (best.points.len() >= POINTS_LEAST && score >= dominance * rival).then_some(0)
    }
}

/// Whether a candidate lies on the path or its continuation, and along it. `scratch` is working memory.
fn fits(
    path: &PathMemory,
    points: &[FloorPoint],
    track: &TrackOptions,
    lost_m: f64,
    scratch: &mut Vec<f64>,
) -> bool {
    let near = points
        .iter()
        .filter(|point| {
            path.locate(point.at).is_some_and(|place| {
                let gate_m = track.gate_m + track.gate_slope * point.at.length() + 0.2 * lost_m;
                place.offset_m.abs() < gate_m + 0.4 * place.beyond_m.min(0.25) && place.beyond_m < 0.6
            })
        })
        .count();
    2 * near > points.len()
        && beside(path, points, Pose2::default(), scratch)
            .is_some_and(|beside| beside.turn_rad.abs() < TURN_LIMIT_RAD)
}

/// A candidate's middle points over the picture.
pub(crate) fn draw_candidate(candidate: &Candidate, explanation: &mut Explanation, color: &str) {
    if candidate.pixels.len() > 1 {
        explanation.polyline(candidate.pixels.iter().copied(), color, false);
    }
    explanation.circle(
        [candidate.centroid.x as f32, candidate.centroid.y as f32],
        2.0,
        color,
    );
}
