//! From a perceived path to a command: what `line` and `lane` share after they have seen.

use crate::follow::{FollowOptions, Follower, Form, LineState, Steer, track_m, wheel_speeds};
use crate::loss::{Loss, LossOptions, Mode, WhileLost};
use crate::motion::CommandModel;
use crate::options::DriverError;
use crate::path_memory::{PathMemory, TrackOptions};
use crate::sight::Sight;
use crate::speed::SpeedOptions;
use senda_core::{Body, Command, Explanation, Observation, Stamp};
use senda_geom::{Pose2, trig};
use senda_vision::Contrast;

/// What a driver's tracking made of a frame.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Percept {
    /// Whether this frame showed the line (or lane).
    pub(crate) found: bool,
    /// Where the path lies for a vehicle at [`Helm::predicted`] (curve forms) or now (document's form).
    pub(crate) state: Option<LineState>,
    /// The sharpest curvature ahead (1/m).
    pub(crate) sharpest_per_m: f64,
    /// How much of the path is known ahead (m).
    pub(crate) known_m: f64,
    /// Side to which the path left: +1 left, -1 right, 0 unknown.
    pub(crate) side: f64,
}

/// With less of the path known ahead than this it is at its end (m).
const KNOWN_LEAST_M: f64 = 0.02;

/// Follows, stops when lost, and keeps what the log wants.
pub(crate) struct Helm {
    body: Body,
    form: Form,
    track: TrackOptions,
    speed: SpeedOptions,
    loss_options: LossOptions,
    while_lost: WhileLost,
    follower: Follower,
    pub(crate) model: CommandModel,
    pub(crate) loss: Loss,
    last_stamp: Option<Stamp>,
    dt_s: f64,
    speed_mps: f64,
    yaw_rate_radps: f64,
    percept: Percept,
    steer: Steer,
}

impl Helm {
    pub(crate) fn new(
        body: &Body,
        form: Form,
        follow: &FollowOptions,
        track: &TrackOptions,
        speed: &SpeedOptions,
        loss: &LossOptions,
    ) -> Result<Self, DriverError> {
        track.validate()?;
        speed.validate()?;
        loss.validate()?;
        let default_while_lost = match form {
            Form::Document | Form::Road => WhileLost::Hold,
            Form::Curve | Form::PurePursuit => WhileLost::Search,
        };
        Ok(Self {
            follower: Follower::new(form, *follow, body)?,
            body: body.clone(),
            form,
            track: *track,
            // The document knows no curvature, so its speed is constant.
            speed: if form == Form::Document {
                SpeedOptions::constant(speed.cruise_mps)
            } else {
                *speed
            },
            loss_options: *loss,
            while_lost: loss.while_lost.unwrap_or(default_while_lost),
            model: CommandModel::new(track.delay_s, track.lag_s),
            loss: Loss::default(),
            last_stamp: None,
            dt_s: body.period_s,
            speed_mps: 0.0,
            yaw_rate_radps: 0.0,
            percept: Percept::default(),
            steer: Steer::default(),
        })
    }

    /// Begins a step: how the vehicle has moved since the last one (its new frame in the old one).
    pub(crate) fn begin(&mut self, observation: &Observation) -> Pose2 {
        let stamp = observation.stamp;
        self.dt_s = match self.last_stamp {
            Some(last) => stamp.since_s(last).clamp(0.0, 1.0),
            None => self.body.period_s.clamp(0.0, 1.0),
        };
        self.last_stamp = Some(stamp);
        self.model.advance(stamp, observation.speed_mps)
    }

    /// Time since the last step (s).
    pub(crate) fn dt_s(&self) -> f64 {
        self.dt_s
    }

    /// Where the vehicle stood when a frame was exposed, in the present vehicle frame.
    pub(crate) fn at_exposure(&self, observation: &Observation, frame: Stamp) -> Pose2 {
        let age_s = observation.stamp.since_s(frame);
        if !(age_s > 0.0 && age_s < 1.0) {
            return Pose2::default();
        }
        Pose2::default()
            .advance(self.model.speed_mps(), self.model.yaw_rate_radps(), age_s)
            .inverse()
    }

    /// Where the vehicle will be when a command given now has taken hold, in the present vehicle frame.
    /// It holds for a period, so its middle is half a period later.
    pub(crate) fn predicted(&self) -> Pose2 {
        let half_period_s = 0.5 * self.body.period_s.clamp(0.0, 0.5);
        self.model
            .predict(self.track.delay_s + self.track.lag_s + half_period_s)
    }

    /// What the remembered path means for the command that comes now. A memory that leads backwards is dropped.
    pub(crate) fn perceive(&self, memory: &mut PathMemory, found: bool) -> Percept {
        let predicted = self.predicted();
        let known_m = memory.ahead_of(predicted.position());
        let side = memory
            .points()
            .last()
            .map_or(self.percept.side, |end| end.y.signum());
        let usable = known_m > KNOWN_LEAST_M || found;
        let state = if usable {
            memory.state(predicted, self.preview_m(), &self.track)
        } else {
            None
        };
        if usable && state.is_none() {
            memory.clear();
        }
        Percept {
            found: found && state.is_some(),
            state,
            sharpest_per_m: memory.sharpest_ahead(self.slow_down_reach_m(), &self.track),
            known_m,
            side,
        }
    }

    /// How far ahead the curvature is taken (m).
    fn preview_m(&self) -> f64 {
        self.track.preview_m + self.track.preview_s * self.speed_mps
    }

    /// How far ahead curves slow the vehicle down (m).
    fn slow_down_reach_m(&self) -> f64 {
        0.15 + 0.7 * self.speed.cruise_mps
    }

    pub(crate) fn mode(&self) -> Mode {
        self.loss.mode()
    }

    /// Ends a step: the command.
    pub(crate) fn steer(&mut self, percept: Percept) -> Command {
        let mode = self.loss.step(
            percept.found,
            self.dt_s,
            self.speed.cruise_mps,
            &self.loss_options,
        );
        self.percept = percept;
        let cruise_mps = self.speed.cruise_mps;
        let (speed_mps, yaw_rate_radps) = match (mode, percept.state) {
            (Mode::NeverSeen | Mode::Stopped, _) => {
                self.follower.reset();
                (0.0, 0.0)
            }
            (_, Some(state)) => {
                let speed_mps = self.speed.next(self.speed_mps, percept.sharpest_per_m, self.dt_s);
                self.steer = self.follower.step(state, speed_mps, self.dt_s);
                (speed_mps, self.steer.yaw_rate_radps)
            }
            (_, None) => match self.while_lost {
                WhileLost::Hold => (self.speed_mps, self.yaw_rate_radps),
                WhileLost::Search => {
                    self.follower.reset();
                    let speed_mps = self.loss_options.search_speed_part * cruise_mps;
                    let curvature =
                        (1.0 / self.loss_options.search_radius_m).min(self.body.curvature_limit_per_m());
                    (speed_mps, percept.side * curvature * speed_mps)
                }
            },
        };
        (self.speed_mps, self.yaw_rate_radps) = (speed_mps, yaw_rate_radps);
        if let Some(stamp) = self.last_stamp {
            self.model.command(stamp, speed_mps, yaw_rate_radps);
        }
        if speed_mps > 1e-6 {
            Command::curvature(yaw_rate_radps / speed_mps, speed_mps)
        } else {
            Command::STOP
        }
    }

    /// Signals of C15 and events, and the path and look-ahead in the picture.
    pub(crate) fn explain(&self, explanation: &mut Explanation, sight: &Sight) {
        let statistics = sight.statistics();
        explanation.signal("mean", statistics.mean);
        explanation.signal("max", statistics.max);
        explanation.signal("threshold", statistics.threshold);
        let light = sight.contrast().map_or(f64::NAN, |contrast| match contrast {
            Contrast::Dark => 0.0,
            Contrast::Light => 1.0,
        });
        explanation.signal("light_line", light);
        let known = self.percept.state;
        explanation.signal("d_m", known.map_or(f64::NAN, |state| state.d_m));
        explanation.signal("theta_rad", known.map_or(f64::NAN, |state| state.theta_rad));
        explanation.signal(
            "curvature_per_m",
            known.map_or(f64::NAN, |state| state.curvature_per_m),
        );
        let desired = known.map_or(f64::NAN, |_| self.steer.desired_angle_rad);
        explanation.signal("desired_angle_rad", desired);
        explanation.signal("omega_radps", self.yaw_rate_radps);
        explanation.signal("speed_mps", self.speed_mps);
        let (left, right) = wheel_speeds(self.speed_mps, self.yaw_rate_radps, track_m(&self.body));
        explanation.signal("left_mps", left);
        explanation.signal("right_mps", right);
        explanation.signal("found", if self.percept.found { 1.0 } else { 0.0 });
        explanation.signal("mode", self.loss.mode().number());
        explanation.signal("lost_s", self.loss.lost_s());
        explanation.signal("known_m", self.percept.known_m);
        if let Some(event) = self.loss.event() {
            explanation.event(event);
        }
        if let (Form::Document, Some(state)) = (self.form, known) {
            // The straight line that is followed.
            let (sin, cos) = trig::sincos(state.theta_rad);
            let direction = senda_geom::Vec2::new(cos, sin);
            let foot = direction.perp() * state.d_m;
            sight.draw_floor_line(
                explanation,
                (2..=16).map(|i| foot + direction * (0.04 * f64::from(i))),
                PATH_COLOR,
            );
        }
    }
}

/// The path to follow.
pub(crate) const PATH_COLOR: &str = "#2ecc40";
/// Accepted lines.
pub(crate) const LINE_COLOR: &str = "#0074d9";
/// Candidates that were not accepted.
pub(crate) const REFUSED_COLOR: &str = "#ff4136";
/// The look-ahead point.
pub(crate) const GOAL_COLOR: &str = "#ffdc00";
