//! Vehicles: body, drive train, wheels, battery and cameras, from TOML files.

mod camera;
mod drive;
mod engine;
mod tyres;

pub use camera::{CameraSpec, Exposure, ImageNoise};
pub use drive::{Battery, DriveTrain, Encoders, Motor, Wheels};
pub use engine::Engine;
pub use tyres::Tyres;

use crate::error::{Warning, WorldError};
use crate::reader::{Source, Table};
use crate::world::{read_text, stem};
use crate::writer::Document;
use senda_core::{Body, Steering};
use senda_geom::{Camera, trig};
use std::f64::consts::PI;
use std::path::Path;

/// Everything that a simulator needs to know about a vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleSpec {
    /// Name, such as `gopigo`.
    pub name: String,
    /// One sentence for lists; may be empty.
    pub description: String,
    /// How it turns.
    pub steering: Steering,
    /// Overall width (m).
    pub width_m: f64,
    /// Overall length (m).
    pub length_m: f64,
    /// From its rear end to the axle's centre, the origin of the vehicle frame (m).
    pub axle_from_rear_m: f64,
    /// Top speed (m/s).
    pub speed_limit_mps: f64,
    /// Speed (m/s) of a run for which nobody says one; `None`: the driver's own.
    pub cruise_mps: Option<f64>,
    /// Largest yaw rate that it can reach (rad/s).
    pub yaw_rate_limit_radps: f64,
    /// Time between observations (s).
    pub period_s: f64,
    /// From command to motion.
    pub drive: DriveTrain,
    /// The driven wheels.
    pub wheels: Wheels,
    /// Tyres that slide, on a front-steered vehicle; `None`: it rolls without slipping.
    pub tyres: Option<Tyres>,
    /// Engine and brakes, on a front-steered vehicle that is driven by throttle; `None`: it obeys in m/s.
    pub engine: Option<Engine>,
    /// Encoders on the driven wheels; `None`: it has none.
    pub encoders: Option<Encoders>,
    /// Relation of motor value, wheel speed and voltage; `None`: ideal motors that obey in m/s.
    pub motor: Option<Motor>,
    /// The battery; `None`: none is modelled.
    pub battery: Option<Battery>,
    /// One to three cameras; the first is the one that single-camera drivers use.
    pub cameras: Vec<CameraSpec>,
}

impl VehicleSpec {
    /// Reads a vehicle from TOML text. `source_name` (a file name) appears in messages.
    pub fn parse(source_name: &str, toml: &str) -> Result<(Self, Vec<Warning>), WorldError> {
        let source = Source::new(source_name, toml);
        let mut table = source.table()?;
        if toml.trim().is_empty() {
            return Err(table.problem(
                "",
                "a vehicle",
                "an empty file",
                "start from a copy of vehicles/gopigo.toml",
            ));
        }
        let spec = Self::read(&mut table)?;
        let mut warnings = Vec::new();
        if spec.axle_from_rear_m > spec.length_m {
            warnings.push(table.warning("axle_from_rear_m", "the axle lies ahead of the vehicle's front"));
        }
        let track_m = match spec.steering {
            Steering::Differential { track_m } => track_m,
            Steering::Ackermann { .. } => spec.wheels.track_m,
        };
        if track_m > spec.width_m {
            warnings.push(table.warning("width_m", "the wheels stand wider apart than the vehicle is wide"));
        }
        table.finish()?;
        Ok((spec, warnings))
    }

    /// Reads a vehicle file.
    pub fn load(path: &Path) -> Result<(Self, Vec<Warning>), WorldError> {
        let text = read_text(path, "vehicle")?;
        Self::parse(&path.display().to_string(), &text)
    }

    fn read(table: &mut Table) -> Result<Self, WorldError> {
        let name = table
            .optional_string("name")?
            .unwrap_or_else(|| stem(table.source().name()).to_owned());
        let description = table.optional_string("description")?.unwrap_or_default();
        let steering = match table.optional_table("steering")? {
            Some(steering) => read_steering(steering)?,
            None => return Err(table.missing("steering", "a table with kind and measures")),
        };
        let width_m = table.required_f64("width_m", 0.01, 10.0)?;
        let length_m = table.required_f64("length_m", 0.01, 20.0)?;
        let axle_from_rear_m = table.f64("axle_from_rear_m", 0.0, 20.0, length_m * 0.25)?;
        let speed_limit_mps = table.required_f64("speed_limit_mps", 0.01, 100.0)?;
        let cruise_mps = table.optional_f64("cruise_mps", 0.01, speed_limit_mps)?;
        let tightest_radps = match steering {
            Steering::Differential { track_m } => 2.0 * speed_limit_mps / track_m,
            Steering::Ackermann {
                wheelbase_m,
                steering_limit_rad,
            } => speed_limit_mps * trig::tan(steering_limit_rad) / wheelbase_m,
        };
        let yaw_rate_limit_radps = table
            .optional_angle("yaw_rate_limit_radps", "yaw_rate_limit_degps", 0.01, 1000.0)?
            .unwrap_or(tightest_radps);
        let period_s = match table.optional_f64("rate_hz", 0.5, 1000.0)? {
            Some(_) if table.has("period_s") => {
                return Err(table.problem("rate_hz", "either rate_hz or period_s", "both", "remove one"));
            }
            Some(rate_hz) => 1.0 / rate_hz,
            None => table.f64("period_s", 0.001, 2.0, 0.05)?,
        };
        let drive = match table.optional_table("drive")? {
            Some(drive) => DriveTrain::read(drive)?,
            None => DriveTrain::default(),
        };
        let wheels = match table.optional_table("wheels")? {
            Some(wheels) => Wheels::read(wheels, &steering)?,
            None => return Err(table.missing("wheels", "a table with diameter_m")),
        };
        let tyres = match (table.optional_table("tyres")?, &steering) {
            (Some(tyres), Steering::Ackermann { wheelbase_m, .. }) => Some(Tyres::read(tyres, *wheelbase_m)?),
            (Some(_), Steering::Differential { .. }) => {
                return Err(table.problem(
                    "tyres",
                    "tyres on a front-steered vehicle",
                    "a differential one",
                    "remove the table: a differential vehicle rolls without slipping",
                ));
            }
            (None, _) => None,
        };
        let engine = match (table.optional_table("engine")?, &steering) {
            (Some(engine), Steering::Ackermann { .. }) => Some(Engine::read(engine)?),
            (Some(_), Steering::Differential { .. }) => {
                return Err(table.problem(
                    "engine",
                    "an engine on a front-steered vehicle",
                    "a differential one",
                    "remove the table: a differential vehicle's wheels are driven one by one",
                ));
            }
            (None, _) => None,
        };
        let encoders = table
            .optional_table("encoders")?
            .map(Encoders::read)
            .transpose()?;
        let motor = table.optional_table("motor")?.map(Motor::read).transpose()?;
        let battery = table.optional_table("battery")?.map(Battery::read).transpose()?;
        let items = table.tables("cameras")?;
        if items.len() > 3 {
            return Err(table.problem("cameras", "at most three cameras", format!("{}", items.len()), ""));
        }
        let mut cameras: Vec<CameraSpec> = Vec::new();
        for item in items {
            let (item_key, at) = (item.key_path(""), item.span());
            let camera = CameraSpec::read(item)?;
            if cameras
                .iter()
                .any(|known| known.camera.name == camera.camera.name)
            {
                return Err(table.source().problem(
                    at,
                    item_key,
                    "cameras with different names",
                    format!("{:?} twice", camera.camera.name),
                    "",
                ));
            }
            cameras.push(camera);
        }
        Ok(Self {
            name,
            description,
            steering,
            width_m,
            length_m,
            axle_from_rear_m,
            speed_limit_mps,
            cruise_mps,
            yaw_rate_limit_radps,
            period_s,
            drive,
            wheels,
            tyres,
            engine,
            encoders,
            motor,
            battery,
            cameras,
        })
    }

    /// The resolved copy: every default written out. `parse(to_toml())` gives the same vehicle.
    pub fn to_toml(&self) -> String {
        let mut document = Document::default();
        document.text("name", &self.name);
        if !self.description.is_empty() {
            document.text("description", &self.description);
        }
        document.number("width_m", self.width_m);
        document.number("length_m", self.length_m);
        document.number("axle_from_rear_m", self.axle_from_rear_m);
        document.number("speed_limit_mps", self.speed_limit_mps);
        if let Some(cruise_mps) = self.cruise_mps {
            document.number("cruise_mps", cruise_mps);
        }
        document.number("yaw_rate_limit_radps", self.yaw_rate_limit_radps);
        document.number("period_s", self.period_s);
        document.header("steering");
        match self.steering {
            Steering::Differential { track_m } => {
                document.text("kind", "differential");
                document.number("track_m", track_m);
            }
            Steering::Ackermann {
                wheelbase_m,
                steering_limit_rad,
            } => {
                document.text("kind", "ackermann");
                document.number("wheelbase_m", wheelbase_m);
                document.number("steering_limit_rad", steering_limit_rad);
            }
        }
        self.drive.write(&mut document);
        self.wheels.write(&mut document, &self.steering);
        if let Some(tyres) = &self.tyres {
            tyres.write(&mut document);
        }
        if let Some(engine) = &self.engine {
            engine.write(&mut document);
        }
        if let Some(encoders) = &self.encoders {
            encoders.write(&mut document);
        }
        if let Some(motor) = &self.motor {
            motor.write(&mut document);
        }
        if let Some(battery) = &self.battery {
            battery.write(&mut document);
        }
        for camera in &self.cameras {
            camera.write(&mut document);
        }
        document.finish()
    }

    /// The vehicle as its driver may know it.
    pub fn body(&self) -> Body {
        Body {
            name: self.name.clone(),
            steering: self.steering,
            width_m: self.width_m,
            length_m: self.length_m,
            speed_limit_mps: self.speed_limit_mps,
            yaw_rate_limit_radps: self.yaw_rate_limit_radps,
            period_s: self.period_s,
            encoders: self.encoders.as_ref().map(|encoders| senda_core::Encoders {
                tick_m: self.wheels.circumference_m() / f64::from(encoders.ticks_per_turn),
                track_m: self.wheels.track_m,
                signed: encoders.signed,
            }),
            cameras: self
                .cameras
                .iter()
                .map(|camera| camera.camera.clone())
                .collect::<Vec<Camera>>(),
        }
    }

    /// The same vehicle whose cameras deliver images of another size (px) with the same view.
    pub fn with_camera_size(mut self, width_px: u32, height_px: u32) -> Self {
        for camera in &mut self.cameras {
            camera.camera = camera.camera.resized(width_px, height_px);
        }
        self
    }

    /// The same vehicle with another top speed (m/s).
    pub fn with_top_speed(mut self, speed_limit_mps: f64) -> Self {
        self.yaw_rate_limit_radps *= speed_limit_mps / self.speed_limit_mps;
        self.speed_limit_mps = speed_limit_mps;
        self.cruise_mps = self.cruise_mps.map(|cruise_mps| cruise_mps.min(speed_limit_mps));
        self
    }

    /// The same vehicle with another time between observations (s).
    pub fn with_period(mut self, period_s: f64) -> Self {
        self.period_s = period_s;
        self
    }

    /// The same vehicle with another delay from command to motion (s).
    pub fn with_delay(mut self, delay_s: f64) -> Self {
        self.drive.delay_s = delay_s;
        self
    }

    /// The same vehicle with frames handed over as pixels, not as JPEG: faster to simulate.
    pub fn with_raw_frames(mut self) -> Self {
        for camera in &mut self.cameras {
            camera.jpeg_quality = None;
        }
        self
    }
}

fn read_steering(mut table: Table) -> Result<Steering, WorldError> {
    let steering = match table.required_word("kind", &["differential", "ackermann"])? {
        "differential" => Steering::Differential {
            track_m: table.required_f64("track_m", 0.005, 10.0)?,
        },
        _ => {
            let wheelbase_m = table.required_f64("wheelbase_m", 0.005, 20.0)?;
            let limit = table.optional_angle("steering_limit_rad", "steering_limit_deg", 0.01, PI * 0.45)?;
            Steering::Ackermann {
                wheelbase_m,
                steering_limit_rad: limit
                    .ok_or_else(|| table.missing("steering_limit_deg", "an angle from 0.6 to 81 degrees"))?,
            }
        }
    };
    table.finish()?;
    Ok(steering)
}
