//! Which driver sits at the wheel.

use crate::RunError;
use senda_core::{Body, Command, Driver, Explanation, Observation, PrivilegedDriver, Truth};
use senda_drivers::{
    ExpertDriver, ExpertOptions, HoughDriver, HoughDriverOptions, HumanDriver, HumanOptions, LaneDriver,
    LaneOptions, LineDriver, LineOptions, ManualDriver, MissionDriver, MissionOptions, NetworkDetector,
    NeuralDriver, NeuralOptions,
};
use senda_geom::Curve;
use senda_nets::Model;
use senda_toml::nearest_names;
use senda_vision::{ClassicalDetector, Detector};
use serde::de::DeserializeOwned;
use std::path::Path;

/// The name of a person's drive in scenarios and recordings.
pub const MANUAL: &str = "manual";

/// The network driver's option that names a second network, for the pedals.
const THROTTLE_MODEL: &str = "throttle_model";

/// The mission's option that names what finds signs and lights: [`CLASSICAL`], or the file of a trained network.
const DETECTOR: &str = "detector";

/// Drivers' options that name a file.
pub(crate) const FILE_OPTIONS: [&str; 3] = ["model", THROTTLE_MODEL, DETECTOR];
/// Signs and lights by colours and shapes.
const CLASSICAL: &str = "classical";

/// A driver, the one kind of driver that is told the truth, or a person.
pub enum Pilot {
    /// Sees observations only.
    Driver(Box<dyn Driver>),
    /// Sees the true state as well.
    Privileged(Box<dyn PrivilegedDriver>),
    /// A person, who may stand, stray and take time.
    Person(ManualDriver),
}

/// Names of all drivers, with what each does.
pub const DRIVERS: [(&str, &str); 7] = [
    ("line", "follows one line by camera (document C)"),
    ("lane", "stays between two lines by camera (document C)"),
    (
        "hough",
        "steers by straight edges of a lane's pink tape (document A)",
    ),
    (
        "neural",
        "does what a trained network answers (option `model`: its file; `throttle_model`: a second one's for the pedals)",
    ),
    (
        "mission",
        "delivers a package in a warehouse and comes back, by camera (document D)",
    ),
    (
        "expert",
        "is told the true state: for measuring and labelling only",
    ),
    (
        "human",
        "the same with a person's wandering, unrest and pedals: for laps to learn from (document B)",
    ),
];

impl Pilot {
    /// A driver by name. `path` is what the expert follows; the others never see it. `speed_mps` overrides the
    /// driver's own cruising speed, `options` its defaults.
    pub fn named(
        name: &str,
        body: &Body,
        path: Option<&Curve>,
        speed_mps: Option<f64>,
        options: &toml::Table,
    ) -> Result<Self, RunError> {
        Ok(match name {
            "line" => {
                let mut options: LineOptions = parse_options(name, options)?;
                options.set_speed(speed_mps);
                Self::Driver(Box::new(LineDriver::new(body, options)?))
            }
            "lane" => {
                let mut options: LaneOptions = parse_options(name, options)?;
                options.set_speed(speed_mps);
                Self::Driver(Box::new(LaneDriver::new(body, options)?))
            }
            "hough" => {
                let mut options: HoughDriverOptions = parse_options(name, options)?;
                options.set_speed(speed_mps);
                Self::Driver(Box::new(HoughDriver::new(body, options)?))
            }
            "neural" => {
                let mut options = options.clone();
                let model = match options.remove("model") {
                    Some(toml::Value::String(path)) => Model::load(Path::new(&path))?,
                    _ => {
                        return Err(RunError::DriverOptions {
                            driver: name.to_owned(),
                            reason: "expected a model file; give one with --model".to_owned(),
                        });
                    }
                };
                let throttle_model = match options.remove(THROTTLE_MODEL) {
                    None => None,
                    Some(toml::Value::String(path)) => Some(Model::load(Path::new(&path))?),
                    Some(other) => {
                        return Err(RunError::DriverOptions {
                            driver: name.to_owned(),
                            reason: format!(
                                "{THROTTLE_MODEL}: expected a model file in quotes, but found {other}"
                            ),
                        });
                    }
                };
                let mut options: NeuralOptions = parse_options(name, &options)?;
                options.set_speed(speed_mps);
                let driver = NeuralDriver::new(body, model, options)?;
                Self::Driver(Box::new(match throttle_model {
                    Some(model) => driver.with_throttle(model)?,
                    None => driver,
                }))
            }
            "mission" => {
                let mut options = options.clone();
                let detector = options.remove(DETECTOR);
                let mut options: MissionOptions = parse_options(name, &options)?;
                options.set_speed(speed_mps);
                let detector = detector_of(detector.as_ref(), name, &options)?;
                Self::Driver(Box::new(MissionDriver::with_detector(body, options, detector)?))
            }
            "expert" => {
                let mut options: ExpertOptions = parse_options(name, options)?;
                options.set_speed(speed_mps);
                let path = path.ok_or_else(|| RunError::NoTruth {
                    driver: name.to_owned(),
                })?;
                Self::Privileged(Box::new(ExpertDriver::new(body, path.clone(), options)?))
            }
            "human" => {
                let mut options: HumanOptions = parse_options(name, options)?;
                options.set_speed(speed_mps);
                let path = path.ok_or_else(|| RunError::NoTruth {
                    driver: name.to_owned(),
                })?;
                Self::Privileged(Box::new(HumanDriver::new(body, path.clone(), options)?))
            }
            MANUAL => {
                return Err(RunError::DriverOptions {
                    driver: name.to_owned(),
                    reason: "expected a driver, but a person drove; use `senda drive --mode manual`, or name another one with --driver"
                        .to_owned(),
                });
            }
            other => {
                return Err(RunError::UnknownDriver {
                    found: other.to_owned(),
                    nearest: nearest_names(other, &DRIVERS.map(|(name, _)| name))
                        .into_iter()
                        .next(),
                    known: DRIVERS.map(|(name, _)| name).join(", "),
                });
            }
        })
    }

    /// The command for this observation. A privileged driver without a true state stops.
    pub fn drive(&mut self, observation: &Observation, truth: Option<&Truth>) -> Command {
        match (self, truth) {
            (Self::Driver(driver), _) => driver.drive(observation),
            (Self::Person(driver), _) => driver.drive(observation),
            (Self::Privileged(driver), Some(truth)) => driver.drive_knowing(observation, truth),
            (Self::Privileged(_), None) => Command::STOP,
        }
    }

    /// As [`Driver::explain`].
    pub fn explain(&self, explanation: &mut Explanation) {
        match self {
            Self::Driver(driver) => driver.explain(explanation),
            Self::Person(driver) => driver.explain(explanation),
            Self::Privileged(driver) => driver.explain(explanation),
        }
    }

    /// As [`Driver::is_done`].
    pub fn is_done(&self) -> bool {
        match self {
            Self::Driver(driver) => driver.is_done(),
            Self::Person(driver) => driver.is_done(),
            Self::Privileged(_) => false,
        }
    }
}

/// What finds signs and lights for a mission: by colours and shapes unless a trained network is named.
fn detector_of(
    named: Option<&toml::Value>,
    driver: &str,
    options: &MissionOptions,
) -> Result<Box<dyn Detector>, RunError> {
    match named {
        None => Ok(Box::new(ClassicalDetector::new(options.classical))),
        Some(toml::Value::String(name)) if name == CLASSICAL => {
            Ok(Box::new(ClassicalDetector::new(options.classical)))
        }
        Some(toml::Value::String(path)) => {
            let refused = |error: &dyn std::fmt::Display| RunError::DriverOptions {
                driver: driver.to_owned(),
                reason: format!("{DETECTOR}: {error}"),
            };
            let model = Model::load(Path::new(path)).map_err(|error| refused(&error))?;
            let detector =
                NetworkDetector::new(&model, options.sure as f32).map_err(|error| refused(&error))?;
            Ok(Box::new(detector))
        }
        Some(other) => Err(RunError::DriverOptions {
            driver: driver.to_owned(),
            reason: format!(
                "detector: expected {CLASSICAL:?} or the file of a trained detector in quotes, but found {other}"
            ),
        }),
    }
}

/// What is wrong with a driver's options.
pub(crate) struct Refused {
    /// The key that is to blame, with its tables, as `follow.settle_m`; empty where none can be named.
    pub(crate) key: String,
    /// In words, with the nearest known key.
    pub(crate) reason: String,
}

/// Checks options without making the driver or reading its files. Unknown drivers are none of its business.
pub(crate) fn check_options(name: &str, options: &toml::Table) -> Result<(), Refused> {
    let mut options = options.clone();
    match name {
        "line" => read_options::<LineOptions>(&options, &[]).map(drop),
        "lane" => read_options::<LaneOptions>(&options, &[]).map(drop),
        "hough" => read_options::<HoughDriverOptions>(&options, &[]).map(drop),
        "neural" => {
            let files = ["model", THROTTLE_MODEL];
            for file in files {
                options.remove(file);
            }
            read_options::<NeuralOptions>(&options, &files).map(drop)
        }
        "mission" => {
            options.remove(DETECTOR);
            read_options::<MissionOptions>(&options, &[DETECTOR]).map(drop)
        }
        "expert" => read_options::<ExpertOptions>(&options, &[]).map(drop),
        "human" => read_options::<HumanOptions>(&options, &[]).map(drop),
        _ => Ok(()),
    }
}

/// Reads options; `taken` are the keys that were taken out before, which a complaint about an unknown one names too.
fn read_options<T: DeserializeOwned>(options: &toml::Table, taken: &[&str]) -> Result<T, Refused> {
    options.clone().try_into().map_err(|error: toml::de::Error| {
        // "in `follow.kp`" is a line of its own.
        let whole = error.to_string();
        let place = whole
            .lines()
            .find_map(|line| line.strip_prefix("in `")?.strip_suffix('`'));
        let mut message = error.message().to_owned();
        if place.is_none() {
            let taken: String = taken.iter().map(|key| format!("`{key}`, ")).collect();
            message = message.replacen("expected one of `", &format!("expected one of {taken}`"), 1);
        }
        let said = senda_toml::with_nearest(&message);
        let unknown = said
            .strip_prefix("unknown field `")
            .and_then(|rest| rest.split('`').next());
        let key: Vec<&str> = place.into_iter().chain(unknown).collect();
        Refused {
            key: key.join("."),
            reason: match place {
                Some(place) => format!("{place}: {said}"),
                None => said,
            },
        }
    })
}

fn parse_options<T: DeserializeOwned>(driver: &str, options: &toml::Table) -> Result<T, RunError> {
    read_options(options, &[]).map_err(|refused| RunError::DriverOptions {
        driver: driver.to_owned(),
        reason: refused.reason,
    })
}
