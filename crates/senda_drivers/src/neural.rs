//! A network at the wheel (A11 in SPEC): the model file says how pictures are prepared and what the answers mean.

use crate::options::{DriverError, check};
use crate::speed::SpeedOptions;
use senda_core::{Body, Command, Drive, Driver, Explanation, Image, Observation, Stamp, Steering, Turn};
use senda_geom::trig;
use senda_nets::{Eye, Inference, Model, OutputSpec};
use serde::{Deserialize, Serialize};

/// What one output of a network means. Targets and answers are around -1..1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Answer {
    /// Front-wheel angle as a part of full lock, left positive: -1 full right, 1 full left. Vehicles without front wheels
    /// steer as a car as long as their track is wide, with 45° of lock.
    Steering,
    /// Curvature of the path (1/m) over 2/m, left positive: fits vehicles of any build.
    Curvature,
    /// Speed (m/s) as a part of top speed.
    Speed,
    /// Pedal: -1 full brake, 1 full throttle.
    Throttle,
}

/// Curvature (1/m) that counts as 1: a circle of half a metre, tight for every vehicle here (guess).
const CURVATURE_OF_ONE_PER_M: f64 = 2.0;

/// Lock of vehicles that have no front wheels (rad): 45°.
const LOCK_WITHOUT_FRONT_WHEELS_RAD: f64 = std::f64::consts::FRAC_PI_4;

impl Answer {
    /// All, with their names in model files.
    pub const ALL: [(&'static str, Self); 4] = [
        ("steering", Self::Steering),
        ("curvature", Self::Curvature),
        ("speed", Self::Speed),
        ("throttle", Self::Throttle),
    ];

    /// By its name in model files.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL
            .iter()
            .find(|(known, _)| *known == name)
            .map(|(_, answer)| *answer)
    }

    /// Its name in model files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Steering => "steering",
            Self::Curvature => "curvature",
            Self::Speed => "speed",
            Self::Throttle => "throttle",
        }
    }

    /// The unit as people read it.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Steering => "part of full lock, left positive",
            Self::Curvature => "2/m, left positive",
            Self::Speed => "part of top speed",
            Self::Throttle => "part of full throttle, negative brakes",
        }
    }

    /// How a model file describes it.
    pub fn output(self) -> OutputSpec {
        OutputSpec {
            name: self.name().to_owned(),
            unit: self.unit().to_owned(),
        }
    }

    /// Whether a mirrored picture has the opposite answer.
    pub fn is_turn(self) -> bool {
        matches!(self, Self::Steering | Self::Curvature)
    }

    /// What a network should answer where this command is right. `pedal` is how far the vehicle's own speed control presses
    /// its pedal for a command in m/s, where it has one; without, a throttle is the part of top speed.
    pub fn target(self, body: &Body, command: &Command, pedal: Option<f64>) -> f64 {
        let speed_mps = body.speed_of(command);
        match self {
            Self::Steering => {
                let lock = lock_rad(body);
                body.steering_of(command.turn, speed_mps).clamp(-lock, lock) / lock
            }
            Self::Curvature => {
                let limit = body.curvature_limit_per_m().min(10.0);
                body.curvature_of(command.turn, speed_mps).clamp(-limit, limit) / CURVATURE_OF_ONE_PER_M
            }
            Self::Speed => speed_mps / body.speed_limit_mps,
            Self::Throttle => match command.drive {
                Drive::Throttle(part) => part,
                Drive::SpeedMps(speed) => pedal.unwrap_or(speed / body.speed_limit_mps),
            },
        }
    }
}

pub(crate) fn lock_rad(body: &Body) -> f64 {
    match body.steering {
        Steering::Ackermann {
            steering_limit_rad, ..
        } => steering_limit_rad,
        Steering::Differential { .. } => LOCK_WITHOUT_FRONT_WHEELS_RAD,
    }
}

/// The turn that is a part of full lock, left positive; a curvature for vehicles without front wheels.
pub(crate) fn turn_of_lock(body: &Body, part: f64) -> Turn {
    let angle_rad = part * lock_rad(body);
    match body.steering {
        Steering::Ackermann { .. } => Turn::SteeringRad(angle_rad),
        Steering::Differential { track_m } => Turn::CurvaturePerM(trig::tan(angle_rad) / track_m),
    }
}

/// Frames further apart than so many periods do not follow each other: between the jitter of real cameras and one lost frame.
const GAP_PERIODS: f64 = 1.75;

/// Whether frames are missing between two moments: edits took them out, or the camera lost them.
pub fn is_gap(body: &Body, before: Stamp, after: Stamp) -> bool {
    after.since_s(before).max(0.0) > GAP_PERIODS * body.period_s
}

/// Options of the network driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NeuralOptions {
    /// How fast, where the network does not say; curves slow it down by what the network steers.
    pub speed: SpeedOptions,
    /// Throttle that is held instead of a speed (-1 to 1), where the network does not say: B4's control of steering alone.
    pub throttle: Option<f64>,
    /// Largest change of the steering from frame to frame (part of full lock); 0 switches it off. A11: 3° of 50 servo
    /// degrees are 0.06.
    pub change_limit: f64,
    /// Drives although the vehicle's camera is not the one that the network was trained with.
    pub any_camera: bool,
}

impl Default for NeuralOptions {
    fn default() -> Self {
        Self {
            // A13: trained at speed 20 of 100, which is 0.16 m/s of the kit car's 0.8.
            speed: SpeedOptions::constant(0.16),
            throttle: None,
            change_limit: 0.0,
            any_camera: false,
        }
    }
}

impl NeuralOptions {
    /// Another cruising speed (m/s), where one is given.
    pub fn set_speed(&mut self, speed_mps: Option<f64>) {
        self.speed.cruise_mps = speed_mps.unwrap_or(self.speed.cruise_mps);
    }

    fn validate(&self) -> Result<(), DriverError> {
        self.speed.validate()?;
        check("throttle", self.throttle.unwrap_or(0.0), -1.0, 1.0)?;
        check("change_limit", self.change_limit, 0.0, 2.0)
    }
}

/// One network, ready to answer.
struct Brain {
    answers: Vec<Answer>,
    inference: Inference,
    eye: Eye,
}

impl Brain {
    fn new(body: &Body, model: Model, any_camera: bool) -> Result<Self, DriverError> {
        let wrong = |reason: String| DriverError::Model { reason };
        let Some(camera) = body.cameras.first() else {
            return Err(DriverError::NoCamera {
                body: body.name.clone(),
            });
        };
        if !any_camera {
            model.check_camera(camera).map_err(|mismatch| {
                wrong(format!(
                    "{mismatch}; set the option any_camera=true to drive nevertheless"
                ))
            })?;
        }
        let answer = |output: &OutputSpec| {
            Answer::named(&output.name).ok_or_else(|| {
                wrong(format!(
                    "expected outputs named steering, curvature, speed or throttle, but found {:?}",
                    output.name
                ))
            })
        };
        Ok(Self {
            answers: model.outputs.iter().map(answer).collect::<Result<_, _>>()?,
            inference: model.inference(),
            eye: Eye::new(&model.input),
        })
    }

    fn steers(&self) -> bool {
        self.answers.iter().any(|answer| answer.is_turn())
    }

    fn names(&self) -> String {
        let names: Vec<&str> = self.answers.iter().map(|answer| answer.name()).collect();
        names.join(" and ")
    }
}

/// Drives by what a network answers to each picture, or two: one for the steering wheel and one for the pedals.
pub struct NeuralDriver {
    body: Body,
    options: NeuralOptions,
    brains: Vec<Brain>,
    last: Option<Command>,
    last_frame: Option<Stamp>,
    turn: f64,
    curvature_per_m: f64,
    seen: bool,
}

impl NeuralDriver {
    /// For a vehicle and a model. The model's camera must fit the vehicle's first one.
    pub fn new(body: &Body, model: Model, options: NeuralOptions) -> Result<Self, DriverError> {
        options.validate()?;
        let brain = Brain::new(body, model, options.any_camera)?;
        if !brain.steers() {
            return Err(DriverError::Model {
                reason: "expected an output named steering or curvature, but found none".into(),
            });
        }
        Ok(Self {
            body: body.clone(),
            options,
            brains: vec![brain],
            last: None,
            last_frame: None,
            turn: 0.0,
            curvature_per_m: 0.0,
            seen: false,
        })
    }

    /// The same with a second network for the pedals (B4: two separate networks); the first must steer alone.
    pub fn with_throttle(mut self, model: Model) -> Result<Self, DriverError> {
        let brain = Brain::new(&self.body, model, self.options.any_camera)?;
        let wrong = |reason: String| Err(DriverError::Model { reason });
        if brain.steers() || brain.answers.is_empty() {
            return wrong(format!(
                "the second network: expected throttle or speed alone, but found {}",
                brain.names()
            ));
        }
        if let Some(first) = self.brains.iter().find(|brain| brain.answers.len() > 1) {
            return wrong(format!(
                "expected a first network that steers alone beside one for the pedals, but found {}",
                first.names()
            ));
        }
        self.brains.push(brain);
        Ok(self)
    }

    fn command(&mut self, image: &Image) -> Command {
        let mut turn = Turn::CurvaturePerM(0.0);
        let mut drive = None;
        for brain in &mut self.brains {
            let outputs = brain.inference.run(brain.eye.see(image));
            for (answer, value) in brain.answers.iter().zip(outputs) {
                let value = f64::from(*value);
                match answer {
                    Answer::Steering | Answer::Curvature => {
                        let limit = self.options.change_limit;
                        let mut value = if *answer == Answer::Steering {
                            value.clamp(-1.0, 1.0)
                        } else {
                            value
                        };
                        if limit > 0.0 && self.last.is_some() {
                            value = value.clamp(self.turn - limit, self.turn + limit);
                        }
                        self.turn = value;
                        turn = match answer {
                            Answer::Steering => turn_of_lock(&self.body, value),
                            _ => Turn::CurvaturePerM(value * CURVATURE_OF_ONE_PER_M),
                        };
                    }
                    Answer::Speed => {
                        drive = Some(Drive::SpeedMps(value.clamp(0.0, 1.0) * self.body.speed_limit_mps))
                    }
                    Answer::Throttle => drive = Some(Drive::Throttle(value.clamp(-1.0, 1.0))),
                }
            }
        }
        self.curvature_per_m = self.body.curvature_of(turn, self.options.speed.cruise_mps);
        let drive = match (drive, self.options.throttle) {
            (Some(drive), _) => drive,
            (None, Some(throttle)) => Drive::Throttle(throttle),
            (None, None) => Drive::SpeedMps(self.options.speed.for_curvature(self.curvature_per_m)),
        };
        Command { turn, drive }
    }
}

impl Driver for NeuralDriver {
    fn drive(&mut self, observation: &Observation) -> Command {
        self.seen = false;
        let Some(frame) = observation.first_frame() else {
            // A camera that missed a frame: what was right a moment ago; the guard ends it if it lasts.
            return self.last.unwrap_or(Command::STOP);
        };
        if self
            .last_frame
            .is_some_and(|before| is_gap(&self.body, before, frame.stamp))
        {
            for brain in &mut self.brains {
                brain.eye.forget();
            }
        }
        self.last_frame = Some(frame.stamp);
        self.seen = true;
        let command = self.command(&frame.image);
        self.last = Some(command);
        command
    }

    fn explain(&self, explanation: &mut Explanation) {
        explanation.signal("turn", self.turn);
        explanation.signal("curvature_per_m", self.curvature_per_m);
        explanation.signal("found", f64::from(u8::from(self.seen)));
        let Some(camera) = self.body.cameras.first() else {
            return;
        };
        // A11's heading line: the path of the next half metre if the wheels stay as they are.
        let points = (1..=10).filter_map(|i| {
            let along_m = 0.05 * f64::from(i);
            let angle = self.curvature_per_m * along_m;
            let (x_m, y_m) = if angle.abs() < 1e-6 {
                (along_m, 0.0)
            } else {
                let (sin, cos) = trig::sincos(angle);
                (sin / self.curvature_per_m, (1.0 - cos) / self.curvature_per_m)
            };
            if x_m <= camera.mounting.x_m {
                return None;
            }
            let pixel = camera.pixel_from_point(senda_geom::Vec3::new(x_m, y_m, 0.0))?;
            Some([pixel.x as f32, pixel.y as f32])
        });
        explanation.polyline(points, "#ff4136", false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_vehicle::gopigo;
    use senda_core::{Channels, Frame, Image, Stamp};
    use senda_nets::{InputSpec, Network, Provenance, View, Weights};

    fn model(forgets: bool) -> Model {
        let network = Network::named("lstm-tinypilotnet").unwrap();
        Model {
            weights: Weights::random(&network, 3),
            input: InputSpec::of(network.input()),
            network,
            outputs: vec![Answer::Curvature.output()],
            provenance: Provenance::default(),
            grids: vec![],
            detection: None,
            forgets,
        }
    }

    fn picture(number: usize) -> Observation {
        let pixels = (0..160 * 120 * 3)
            .map(|i| (i * (31 + 7 * number) % 251) as u8)
            .collect();
        let image = Image::from_pixels(160, 120, Channels::Rgb, pixels).unwrap();
        Observation {
            frames: vec![Frame {
                camera: "center".into(),
                stamp: Stamp::default(),
                image,
                encoded: None,
            }],
            ..Observation::default()
        }
    }

    fn turns(driver: &mut NeuralDriver, numbers: &[usize]) -> Vec<Turn> {
        let drive = |number: &usize| driver.drive(&picture(*number)).turn;
        numbers.iter().map(drive).collect()
    }

    fn driver(forgets: bool) -> NeuralDriver {
        NeuralDriver::new(&gopigo(), model(forgets), NeuralOptions::default()).unwrap()
    }

    /// A driver is made for every run, so that is where its memory begins.
    #[test]
    fn a_memory_lasts_from_frame_to_frame_and_begins_anew_with_every_run() {
        let mut first = driver(false);
        let run = turns(&mut first, &[0, 1, 2, 2, 2]);
        assert_eq!(turns(&mut driver(false), &[0, 1, 2, 2, 2]), run);
        assert_ne!(run[2], run[3]);
        assert_ne!(turns(&mut driver(false), &[2])[0], run[2]);
    }

    #[test]
    fn a_network_that_learned_from_single_frames_remembers_none() {
        let mut driver = driver(true);
        let run = turns(&mut driver, &[2, 0, 1, 2, 2]);
        assert_eq!(run[0], run[3]);
        assert_eq!(run[0], run[4]);
        assert_ne!(run[0], run[1]);
    }

    fn with_answers(answers: &[Answer], seed: u64) -> Model {
        let network = Network::named("tinypilotnet").unwrap();
        let network = network.with_outputs(answers.len()).unwrap();
        Model {
            weights: Weights::random(&network, seed),
            input: InputSpec::for_network(&network, &View::default()).unwrap(),
            network,
            outputs: answers.iter().map(|answer| answer.output()).collect(),
            forgets: false,
            ..model(false)
        }
    }

    /// B4: one network steers, another one has the pedals, and neither changes what the other answers.
    #[test]
    fn a_second_network_has_the_pedals() {
        let new = |answers: &[Answer], seed| {
            NeuralDriver::new(&gopigo(), with_answers(answers, seed), NeuralOptions::default())
        };
        let alone = new(&[Answer::Steering], 1).unwrap().drive(&picture(0));
        let pedals = with_answers(&[Answer::Throttle], 2);
        let mut both = new(&[Answer::Steering], 1)
            .unwrap()
            .with_throttle(pedals.clone())
            .unwrap();
        let command = both.drive(&picture(0));
        assert_eq!(command.turn, alone.turn);
        let mut inference = pedals.inference();
        let expected = inference.run(Eye::new(&pedals.input).see(&picture(0).frames[0].image))[0];
        assert_eq!(
            command.drive,
            Drive::Throttle(f64::from(expected).clamp(-1.0, 1.0))
        );

        let error =
            |driver: NeuralDriver, model: Model| driver.with_throttle(model).err().unwrap().to_string();
        let steers = new(&[Answer::Steering], 1).unwrap();
        assert!(error(steers, with_answers(&[Answer::Steering], 3)).contains("found steering"));
        let does_both = new(&[Answer::Steering, Answer::Throttle], 1).unwrap();
        assert!(error(does_both, pedals.clone()).contains("found steering and throttle"));
        let error = NeuralDriver::new(&gopigo(), pedals, NeuralOptions::default())
            .err()
            .unwrap();
        assert!(error.to_string().contains("steering or curvature"));
    }

    #[test]
    fn a_fixed_throttle_is_held_where_the_network_only_steers() {
        let options = NeuralOptions {
            throttle: Some(0.05),
            ..NeuralOptions::default()
        };
        let drive = |answers: &[Answer]| {
            let model = with_answers(answers, 1);
            NeuralDriver::new(&gopigo(), model, options.clone())
                .unwrap()
                .drive(&picture(0))
                .drive
        };
        assert_eq!(drive(&[Answer::Steering]), Drive::Throttle(0.05));
        assert_ne!(
            drive(&[Answer::Steering, Answer::Throttle]),
            Drive::Throttle(0.05)
        );
        let options = NeuralOptions {
            throttle: Some(1.5),
            ..NeuralOptions::default()
        };
        let error = NeuralDriver::new(&gopigo(), with_answers(&[Answer::Steering], 1), options)
            .err()
            .unwrap();
        assert!(error.to_string().contains("throttle"), "{error}");
    }

    #[test]
    fn stacked_frames_begin_anew_after_a_gap() {
        let network = Network::named("stacked-tinypilotnet").unwrap();
        let model = Model {
            weights: Weights::random(&network, 3),
            input: InputSpec::for_network(&network, &View::default()).unwrap(),
            network,
            ..model(false)
        };
        let new = || NeuralDriver::new(&gopigo(), model.clone(), NeuralOptions::default()).unwrap();
        let period_s = gopigo().period_s;
        let at = |number: usize, periods: f64| {
            let mut observation = picture(number);
            observation.frames[0].stamp = Stamp::from_s(periods * period_s);
            observation
        };
        let mut driver = new();
        driver.drive(&at(0, 0.0));
        let follows = driver.drive(&at(1, 1.0)).turn;
        let after_gap = driver.drive(&at(1, 3.0)).turn;
        assert_eq!(new().drive(&at(1, 0.0)).turn, after_gap);
        assert_ne!(follows, after_gap);
    }
}
