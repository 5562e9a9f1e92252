//! Document D's mission: read a package's code, find its depot by signs and codes, obey the light, come back (D9, D10).
//!
//! [`chart`] says which steps there are and what leads from one to the next; this module tells whether a condition holds and
//! what is done in a step. It sees frames and nothing else: the order of depots, the layout and the true state are unknown to it.

pub mod chart;
mod codes;
mod conditions;
mod halt;
mod helm;
mod look;
mod options;
mod perceive;

pub use options::MissionOptions;

use crate::options::DriverError;
use chart::{ALWAYS, CHART, Step, To, When};
use codes::Codes;
use halt::Halt;
use helm::Remembered;
use look::{LightSeen, Signs};
use senda_core::{Body, Command, Driver, Explanation, Observation, Stamp, Turn};
use senda_geom::trig;
use senda_vision::{ClassicalDetector, Detection, Detector, QrCode, QrReader, StreetEyes, StreetView};

/// Drives a delivery.
pub struct MissionDriver {
    body: Body,
    options: MissionOptions,
    detector: Box<dyn Detector>,
    eyes: Option<StreetEyes>,
    reader: QrReader,
    view: StreetView,
    step: Step,
    /// The step to which a lost line returns.
    back: Step,
    /// Why it failed, or what it could not do.
    reason: Option<String>,
    clock: Clock,
    way: Way,
    goal: Option<u8>,
    codes: Codes,
    signs: Signs,
    light: LightSeen,
    beyond: Remembered,
    halt: Halt,
    counts: Counts,
    /// How often the line has been lost since the last stop.
    losses: u32,
    /// On its way back from a depot that is not the goal, whose crossing is still ahead.
    depot_ahead: bool,
    last: Command,
    delivered: bool,
    events: Vec<String>,
    detections: Vec<Detection>,
    seen_codes: Vec<QrCode>,
}

/// Times (s).
#[derive(Debug, Clone, Copy, Default)]
struct Clock {
    now: Stamp,
    began: Stamp,
    /// When a frame came, when the line was seen, when a crossing.
    frame: Stamp,
    line: Stamp,
    crossing: Stamp,
    /// Since when it stands (command zero).
    stands: Option<Stamp>,
}

/// What the vehicle believes to have driven: from its commands, behind which it lags.
#[derive(Debug, Clone, Copy, Default)]
struct Way {
    speed_mps: f64,
    yaw_rate_radps: f64,
    /// Since the step began, since the last stop (m).
    step_m: f64,
    stop_m: f64,
    /// Turned since it stood square to the street (rad).
    turned_rad: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    frames: u32,
    crossing: u32,
    junction: u32,
    below: u32,
    found: u32,
    empty: u32,
    /// Part of the sweep in search: which way it turns, and how often it has been all around.
    leg: u32,
}

/// Speed and yaw rate follow commands with about this time constant (s): delay and motors.
const LAG_S: f64 = 0.15;
/// After a stop its own crossing is not the next one until this far on (m).
const PAST_CROSSING_M: f64 = 0.45;
/// Without a picture for so long it stands (s).
const BLIND_STOP_S: f64 = 0.4;
/// Without a line for so long it is lost (s).
const LOST_S: f64 = 0.7;

impl MissionDriver {
    /// With the classical detector.
    pub fn new(body: &Body, options: MissionOptions) -> Result<Self, DriverError> {
        let classical = ClassicalDetector::new(options.classical);
        Self::with_detector(body, options, Box::new(classical))
    }

    /// With another detector.
    pub fn with_detector(
        body: &Body,
        options: MissionOptions,
        detector: Box<dyn Detector>,
    ) -> Result<Self, DriverError> {
        options.check()?;
        if body.cameras.is_empty() {
            return Err(DriverError::NoCamera {
                body: body.name.clone(),
            });
        }
        Ok(Self {
            reader: QrReader::new(options.codes),
            body: body.clone(),
            options,
            detector,
            eyes: None,
            view: StreetView::default(),
            step: Step::WaitPackage,
            back: Step::WaitPackage,
            reason: None,
            clock: Clock::default(),
            way: Way::default(),
            goal: None,
            codes: Codes::default(),
            signs: Signs::default(),
            light: LightSeen::default(),
            beyond: Remembered::default(),
            halt: Halt::default(),
            counts: Counts::default(),
            losses: 0,
            depot_ahead: false,
            last: Command::STOP,
            delivered: false,
            events: Vec::new(),
            detections: Vec::new(),
            seen_codes: Vec::new(),
        })
    }

    /// The present step.
    pub fn step(&self) -> Step {
        self.step
    }

    /// Why the mission failed, or what it could not do; `None` while all is well.
    pub fn reason(&self) -> Option<&str> {
        self.reason.as_deref()
    }

    fn in_step_s(&self) -> f64 {
        self.clock.now.since_s(self.clock.began)
    }

    /// Since when no picture has come (s).
    fn blind_s(&self) -> f64 {
        self.clock.now.since_s(self.clock.frame)
    }

    /// Integrates what the last command should have done.
    fn reckon(&mut self, elapsed_s: f64) {
        let wanted_mps = self.body.speed_of(&self.last);
        let wanted_radps = match self.last.turn {
            Turn::YawRateRadps(rate) => rate,
            other => self.body.yaw_rate_of(other, wanted_mps),
        };
        let part = (elapsed_s / LAG_S).min(1.0);
        let way = &mut self.way;
        way.speed_mps += (wanted_mps - way.speed_mps) * part;
        way.yaw_rate_radps += (wanted_radps - way.yaw_rate_radps) * part;
        let (forward_m, turned_rad) = (way.speed_mps * elapsed_s, way.yaw_rate_radps * elapsed_s);
        way.step_m += forward_m.abs();
        way.stop_m += forward_m.abs();
        way.turned_rad += turned_rad;
        self.beyond.moved(forward_m, turned_rad);
    }

    /// Takes the first transition of the chart whose condition holds.
    fn advance(&mut self) {
        let is_over = matches!(self.step, Step::Home | Step::Failed);
        if let Some(when) = ALWAYS.into_iter().find(|when| !is_over && self.holds(*when)) {
            self.enter(when, Step::Failed);
            return;
        }
        let next = CHART
            .iter()
            .filter(|transition| transition.from == self.step)
            .find(|transition| self.holds(transition.when));
        if let Some(transition) = next {
            let to = match transition.to {
                To::Step(step) => step,
                To::Back => self.back,
            };
            self.enter(transition.when, to);
        }
    }

    fn enter(&mut self, when: When, to: Step) {
        let from = self.step;
        let mut event = format!("{} -> {}: {}", from.name(), to.name(), when.words());
        match (when, to) {
            (When::PackageRead, _) => {
                self.goal = self.codes.package;
                event += &format!(", I{}", self.goal.unwrap_or(0));
            }
            (When::GoalsCode | When::OthersCode, _) => {
                event += &format!(", F{}", self.codes.depot.unwrap_or(0));
            }
            (When::SignAndLight | When::SignAndNoLight, _) => {
                event += &format!(", sign {}", self.signs.digit().unwrap_or(0));
            }
            _ => {}
        }
        let reason = if when == When::OthersCode {
            let (found, goal) = (self.codes.depot.unwrap_or(0), self.goal.unwrap_or(0));
            Some(format!(
                "expected depot {goal}, but found the code of depot {found}; brings the package back"
            ))
        } else {
            (to == Step::Failed).then(|| self.why(when, from))
        };
        if let Some(reason) = reason {
            event += &format!("; {reason}");
            self.reason = Some(reason);
        }
        self.events.push(event);
        if from == Step::Unload {
            self.delivered = true;
        }
        if to == Step::FindLine {
            self.back = from;
            self.losses += 1;
        }
        if to == Step::Return && from != Step::FindLine && from != Step::CrossBack {
            self.depot_ahead = when == When::OthersCode;
        }
        // Leaving a stop: its codes and its crossing are behind.
        if matches!(from, Step::WaitPackage | Step::FaceStreet | Step::Unload) {
            self.codes = Codes::default();
            self.way.stop_m = 0.0;
            self.losses = 0;
        }
        if matches!(to, Step::CrossJunction | Step::CrossBack)
            && let Some(junction) = self.view.junction
        {
            self.beyond = Remembered::of(&junction.beyond);
        }
        match when {
            // Nor is it one from a little further on.
            When::NoCrossingThere => self.way.stop_m = 0.0,
            // Should it be none, the way to it counts: a crossing is not looked for for ever.
            When::CrossingAhead => {}
            _ => self.way.step_m = 0.0,
        }
        if when == When::NoLightThere {
            self.light = self.light.refuted();
        } else if to == Step::Search {
            (self.signs, self.light) = (Signs::default(), LightSeen::default());
            self.way.turned_rad = self.view.crossing.map_or(0.0, |crossing| -crossing.angle_rad);
        }
        if to == Step::FindLine {
            self.way.turned_rad = 0.0;
        }
        if to == Step::WaitGreen {
            self.light.begin_waiting(self.clock.now);
        }
        self.counts = Counts {
            frames: self.counts.frames,
            empty: self.counts.empty,
            ..Counts::default()
        };
        self.halt = Halt::default();
        (self.clock.began, self.clock.stands) = (self.clock.now, None);
        self.step = to;
    }

    fn command(&mut self) -> Command {
        let speed_mps = self.options.speed_mps;
        if self.blind_s() > BLIND_STOP_S {
            return Command::STOP;
        }
        match self.step {
            Step::WaitPackage | Step::Unload | Step::Home | Step::Failed => Command::STOP,
            Step::ToArea
            | Step::ToJunction
            | Step::TakeStreet
            | Step::ToDepot
            | Step::Return
            | Step::ToStart => {
                helm::along(&self.view, &self.options, speed_mps).unwrap_or(Command {
                    // A moment without a line: on as before, slower.
                    drive: senda_core::Drive::SpeedMps(0.5 * speed_mps),
                    ..self.last
                })
            }
            Step::StopAtArea | Step::StopAtDepot | Step::StopAtStart => {
                self.halt.command(&self.view, &self.options, self.clock.now)
            }
            Step::Search | Step::FindLine => self.sweep(),
            Step::WaitGreen => {
                let goal_rad = self.light.watch_from_rad();
                let left_rad = goal_rad - self.way.turned_rad;
                if left_rad.abs() < 0.06 {
                    Command::STOP
                } else {
                    helm::turn(left_rad, self.options.turn_radps)
                }
            }
            Step::FaceStreet => helm::turn(self.street_angle_rad(), self.options.turn_radps),
            Step::CrossJunction | Step::CrossBack => {
                let (intercept_m, slope) = (self.beyond.left_at(0.0), self.beyond.slope());
                if let Some(seen) = self
                    .eyes
                    .as_ref()
                    .and_then(|eyes| eyes.line_near(intercept_m, slope, 0.05, self.beyond.starts_m()))
                    // Of a short piece only the place counts.
                    && ((seen.slope - slope).abs() < 0.3 || seen.span_m[1] - seen.span_m[0] < 0.15)
                {
                    self.beyond.corrected(&seen);
                }
                self.beyond.command(speed_mps)
            }
        }
    }

    /// Turns in place to one side, to the other and back; stands for a moment first.
    fn sweep(&mut self) -> Command {
        if self.in_step_s() < 0.6 {
            return Command::STOP;
        }
        let goal_rad = look::leg_rad(self.counts.leg, self.options.search_rad);
        let left_rad = goal_rad - self.way.turned_rad;
        if left_rad.abs() < 0.08 {
            self.counts.leg += 1;
        }
        helm::turn(left_rad, self.options.turn_radps)
    }
}

impl Driver for MissionDriver {
    fn drive(&mut self, observation: &Observation) -> Command {
        self.events.clear();
        let elapsed_s = observation.stamp.since_s(self.clock.now).clamp(0.0, 0.5);
        self.clock.now = observation.stamp;
        self.reckon(elapsed_s);
        let empty = observation
            .battery_v
            .is_some_and(|battery_v| battery_v < self.options.empty_v);
        self.counts.empty = if empty { self.counts.empty + 1 } else { 0 };
        self.look(observation);
        self.advance();
        self.last = self.command();
        // What it does not see does not count as standing before something.
        if self.last == Command::STOP && self.blind_s() <= BLIND_STOP_S {
            self.clock.stands.get_or_insert(self.clock.now);
        } else {
            self.clock.stands = None;
        }
        self.last
    }

    fn explain(&self, explanation: &mut Explanation) {
        for event in &self.events {
            explanation.event(event.as_str());
        }
        let nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
        explanation.signal("step", self.step.number() as f64);
        explanation.signal("goal", nan(self.goal.map(f64::from)));
        explanation.signal("sign", nan(self.signs.digit().map(f64::from)));
        explanation.signal(
            "crossing_m",
            nan(self.view.crossing.map(|crossing| crossing.distance_m)),
        );
        explanation.signal(
            "crossing_angle_rad",
            nan(self.view.crossing.map(|crossing| crossing.angle_rad)),
        );
        explanation.signal(
            "junction_m",
            nan(self.view.junction.map(|junction| junction.distance_m)),
        );
        if let Some(eyes) = &self.eyes {
            let points = self
                .view
                .line
                .points
                .iter()
                .filter_map(|point| eyes.pixel(*point));
            explanation.polyline(points, "cyan", false);
            if let Some(crossing) = &self.view.crossing {
                let end = |left_m: f64| {
                    let ahead_m =
                        crossing.distance_m - trig::tan(crossing.angle_rad.clamp(-1.0, 1.0)) * left_m;
                    eyes.pixel(senda_geom::Vec2::new(ahead_m, left_m))
                };
                explanation.polyline([end(0.1), end(-0.1)].into_iter().flatten(), "white", false);
            }
        }
        for detection in &self.detections {
            let [left, top, right, bottom] = detection.box_px;
            explanation.polyline(
                [[left, top], [right, top], [right, bottom], [left, bottom]],
                "yellow",
                true,
            );
            let words = format!("{} {:.2}", detection.class.name(), detection.confidence);
            explanation.text([left, top - 3.0], words, "yellow");
        }
        for code in &self.seen_codes {
            explanation.polyline(code.corners_px, "magenta", true);
            explanation.text(code.corners_px[0], code.text.as_str(), "magenta");
        }
        explanation.text([6.0, 34.0], self.step.name(), "white");
    }

    fn is_done(&self) -> bool {
        let over = matches!(self.step, Step::Home | Step::Failed);
        over && self.in_step_s() > 0.5
    }
}

#[cfg(test)]
mod tests;
