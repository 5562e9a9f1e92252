//! `lane`: stays between two lines by camera (C3 to C6, C8 to C10, C12).

use crate::follow::{FollowOptions, Form, track_m};
use crate::helm::{GOAL_COLOR, Helm, LINE_COLOR, PATH_COLOR, Percept, REFUSED_COLOR};
use crate::lane_curve::{CurveLane, Role};
use crate::lane_document::{Accepted, DocumentLane, PairLimits};
use crate::lane_road::{RoadLane, RoadOptions};
use crate::line::draw_candidate;
use crate::loss::{LossOptions, Mode};
use crate::options::{DriverError, check};
use crate::path_memory::TrackOptions;
use crate::sight::{Sight, SightOptions};
use crate::speed::SpeedOptions;
use senda_core::{Body, Command, Driver, Explanation, Observation};
use senda_geom::{Pose2, Vec2};
use serde::{Deserialize, Serialize};

/// Options of the lane driver. Every figure that the document gives is the default of its form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LaneOptions {
    /// How the lane is described and followed.
    pub form: Form,
    /// How fast.
    pub speed: SpeedOptions,
    /// How the driver looks.
    pub sight: SightOptions,
    /// What makes two lines a lane.
    pub shape: LaneShape,
    /// The remembered path (curve forms).
    pub track: TrackOptions,
    /// How the road is read (form `road`).
    pub road: RoadOptions,
    /// The controller.
    pub follow: FollowOptions,
    /// What happens without a line.
    pub loss: LossOptions,
}

/// C8: what makes two lines a lane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LaneShape {
    /// Distance between the lines (m), where it is known beforehand: lines at another distance are no lane, and it tells the
    /// side of a single one. Left out: measured.
    pub width_m: Option<f64>,
    /// Narrower pairs are one broken line (m). C8: 0.03.
    pub narrowest_m: f64,
    /// Wider pairs are no lane (m). C8: 0.35, for a vehicle 11 cm wide; a kit car's lane may be 0.8 wide.
    pub widest_m: f64,
    /// Directions on the floor differ by less than this (rad). C8: 50°.
    pub orientation_rad: f64,
    /// Document: centroids move less than this on the floor between frames (m). C8: 0.04.
    pub moved_m: f64,
    /// Document: or less than this part of the image's width. C8: 1/8.
    pub moved_part: f64,
    /// A lane elsewhere is taken after a loss if both lines score more than this. C8: 100,000.
    pub reentry_score: f64,
    /// Document: needed in the first frame. C8: 50,000.
    pub first_score: f64,
    /// In the first frame a single line, or the second of two, scores this many times the next. C8: 2.
    pub dominance: f64,
    /// Document: a single known line is followed at this distance (m). Left out: half the distance between the wheels
    /// (C8: 5.5 cm). The curve forms take half the lane's measured width.
    pub one_line_offset_m: Option<f64>,
}

impl Default for LaneShape {
    fn default() -> Self {
        Self {
            width_m: None,
            narrowest_m: 0.03,
            widest_m: 0.35,
            orientation_rad: 50f64.to_radians(),
            moved_m: 0.04,
            moved_part: 0.125,
            reentry_score: 100_000.0,
            first_score: 50_000.0,
            dominance: 2.0,
            one_line_offset_m: None,
        }
    }
}

impl LaneShape {
    fn validate(&self) -> Result<(), DriverError> {
        check("shape.narrowest_m", self.narrowest_m, 0.001, 100.0)?;
        check("shape.widest_m", self.widest_m, self.narrowest_m, 100.0)?;
        check(
            "shape.width_m",
            self.width_m.unwrap_or(self.widest_m),
            self.narrowest_m,
            self.widest_m,
        )?;
        check("shape.orientation_rad", self.orientation_rad, 0.0, 3.2)?;
        check("shape.moved_m", self.moved_m, 1e-6, 100.0)?;
        check("shape.moved_part", self.moved_part, 1e-6, 10.0)?;
        check("shape.reentry_score", self.reentry_score, 0.0, 1e12)?;
        check("shape.first_score", self.first_score, 0.0, 1e12)?;
        check("shape.dominance", self.dominance, 1.0, 1e6)?;
        check(
            "shape.one_line_offset_m",
            self.one_line_offset_m.unwrap_or(0.0),
            0.0,
            100.0,
        )
    }
}

impl Default for LaneOptions {
    fn default() -> Self {
        Self {
            form: Form::default(),
            // C16: the document's lane runs at up to 16 cm/s.
            speed: SpeedOptions {
                cruise_mps: 0.16,
                ..SpeedOptions::default()
            },
            sight: SightOptions::default(),
            shape: LaneShape::default(),
            track: TrackOptions::default(),
            road: RoadOptions::default(),
            follow: FollowOptions::default(),
            loss: LossOptions::default(),
        }
    }
}

impl LaneOptions {
    /// Another cruising speed (m/s), where one is given.
    pub fn set_speed(&mut self, speed_mps: Option<f64>) {
        self.speed.cruise_mps = speed_mps.unwrap_or(self.speed.cruise_mps);
    }
}

/// Stays between two lines.
pub struct LaneDriver {
    options: LaneOptions,
    sight: Sight,
    helm: Helm,
    lane: Lane,
    found: bool,
    predicted: Pose2,
}

/// The lane in one form or the other.
enum Lane {
    Document(DocumentLane, Option<Accepted>),
    Curve(Box<CurveLane>),
    Road(Box<RoadLane>),
}

impl LaneDriver {
    /// A lane driver for a vehicle; its first camera is used.
    pub fn new(body: &Body, options: LaneOptions) -> Result<Self, DriverError> {
        let shape = &options.shape;
        shape.validate()?;
        options.road.validate()?;
        let beside_m = shape.one_line_offset_m.unwrap_or(0.5 * track_m(body));
        let lane = if options.form == Form::Road {
            Lane::Road(Box::new(RoadLane::new(options.road, *shape, &options.sight)))
        } else if options.form == Form::Document {
            let limits = PairLimits {
                narrowest_m: shape.narrowest_m,
                widest_m: shape.widest_m,
                orientation_rad: shape.orientation_rad,
                moved_m: shape.moved_m,
                moved_part: shape.moved_part,
                reentry_score: shape.reentry_score,
                first_score: shape.first_score,
                dominance: shape.dominance,
                one_line_offset_m: beside_m,
            };
            Lane::Document(DocumentLane::new(limits), None)
        } else {
            Lane::Curve(Box::new(CurveLane::new(*shape, beside_m)))
        };
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
            lane,
            options,
            found: false,
            predicted: Pose2::default(),
        })
    }

    /// All parameters, for the head of a log (C15).
    pub fn parameters(&self) -> toml::Table {
        crate::options::table(&self.options)
    }

    /// Whether it has found its lane.
    pub fn mode(&self) -> Mode {
        self.helm.mode()
    }
}

impl Driver for LaneDriver {
    fn drive(&mut self, observation: &Observation) -> Command {
        let motion = self.helm.begin(observation);
        let track = self.options.track;
        if let Lane::Curve(lane) = &mut self.lane {
            lane.memory.carry(motion, &track);
        }
        match self.sight.new_frame(observation) {
            Some(frame) => {
                let now_from_exposure = self.helm.at_exposure(observation, frame.stamp);
                if !matches!(self.lane, Lane::Road(_)) {
                    self.sight.look(frame);
                }
                self.found = match &mut self.lane {
                    Lane::Road(lane) => self
                        .sight
                        .map_for(frame)
                        .is_some_and(|map| lane.update(&frame.image, map)),
                    Lane::Document(lane, accepted) => {
                        *accepted = lane.step(self.sight.candidates(), self.sight.width_px());
                        accepted.is_some()
                    }
                    Lane::Curve(lane) => {
                        let lost_m = self.helm.loss.lost_s() * self.options.speed.cruise_mps;
                        lane.update(&mut self.sight, now_from_exposure, &track, lost_m)
                    }
                };
            }
            None => {
                self.sight.close();
                self.found = self.found && observation.first_frame().is_some();
                match &mut self.lane {
                    Lane::Document(_, accepted) => *accepted = None,
                    Lane::Curve(lane) => lane.close(),
                    Lane::Road(lane) => lane.close(),
                }
            }
        }

        self.predicted = self.helm.predicted();
        let percept = match &mut self.lane {
            Lane::Document(_, accepted) => Percept {
                found: self.found,
                state: accepted.map(|accepted| accepted.path),
                ..Percept::default()
            },
            Lane::Curve(lane) => self.helm.perceive(&mut lane.memory, self.found),
            Lane::Road(lane) => Percept {
                found: self.found,
                state: lane.state(),
                sharpest_per_m: lane.state().map_or(0.0, |state| state.curvature_per_m),
                known_m: lane.range_m(),
                side: 0.0,
            },
        };
        let command = self.helm.steer(percept);
        if self.helm.mode() == Mode::Tracking {
            self.sight.settle();
        }
        command
    }

    fn explain(&self, explanation: &mut Explanation) {
        self.helm.explain(explanation, &self.sight);
        let role_of = |index: usize| match &self.lane {
            Lane::Document(_, Some(accepted)) => {
                let is = |which: Option<usize>| which == Some(index);
                if is(accepted.left) {
                    Role::Left
                } else if is(accepted.right) {
                    Role::Right
                } else if is(accepted.unknown) {
                    Role::Single
                } else {
                    Role::Stranger
                }
            }
            Lane::Document(_, None) | Lane::Road(_) => Role::Stranger,
            Lane::Curve(lane) => lane.roles().get(index).copied().unwrap_or_default(),
        };
        for (index, candidate) in self.sight.candidates().iter().enumerate() {
            let (color, word) = match role_of(index) {
                Role::Left => (LINE_COLOR, "left"),
                Role::Right => (LINE_COLOR, "right"),
                Role::Single => (LINE_COLOR, "line"),
                Role::Between => (GOAL_COLOR, "between"),
                Role::Stranger => (REFUSED_COLOR, ""),
            };
            draw_candidate(candidate, explanation, color);
            if !word.is_empty() {
                let at = [candidate.centroid.x as f32 + 3.0, candidate.centroid.y as f32];
                explanation.text(at, word, color);
            }
        }
        let (lines, width_m) = match &self.lane {
            Lane::Document(_, accepted) => (accepted.map_or(0, |accepted| accepted.lines()), None),
            Lane::Road(lane) => {
                // d tells where the middle was seen, whatever part of the way to it is steered for.
                let d = explanation.signals.iter_mut().find(|signal| signal.name == "d_m");
                if let (Some(d), Some(middle_m)) = (d.filter(|d| d.value.is_finite()), lane.middle_m()) {
                    d.value = middle_m;
                }
                for (is_path, points) in lane.drawn() {
                    let color = if is_path { PATH_COLOR } else { LINE_COLOR };
                    self.sight.draw_floor_line(explanation, points.into_iter(), color);
                }
                (lane.lines(), lane.width_m())
            }
            Lane::Curve(lane) => {
                self.sight
                    .draw_floor_line(explanation, lane.memory.points(), PATH_COLOR);
                self.sight.draw_floor_point(
                    explanation,
                    self.predicted.transform(Vec2::new(0.15, 0.0)),
                    GOAL_COLOR,
                );
                (lane.lines(), lane.width_m())
            }
        };
        explanation.signal("lines", lines as f64);
        explanation.signal("lane_width_m", width_m.unwrap_or(f64::NAN));
    }

    fn is_done(&self) -> bool {
        self.helm.mode() == Mode::Stopped
    }
}
