//! Learning by correction (DAgger: Ross, Gordon, Bagnell 2011): the network drives in random worlds, the expert says at every
//! frame what it should have done, pushes bring it where no good driver would ever be, and all of it is learned.

use crate::{LearnError, Samples};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use senda_core::{Body, Command, Driver, Observation, PrivilegedDriver, Vehicle};
use senda_drivers::{Answer, ExpertDriver, ExpertOptions, NeuralDriver, NeuralOptions};
use senda_nets::{Eye, InputSpec, Model};
use senda_run::Guard;
use senda_sim::{Delivery, Pushes, SimOptions, Simulator, Start};
use senda_world::VehicleSpec;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicUsize, Ordering};

/// What is driven to gather frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gathering {
    /// Families of random worlds, `random-circuit`; each drive takes one at random.
    pub families: Vec<String>,
    /// First seed of the worlds; every drive takes the next one.
    pub first_world: u64,
    /// Ready vehicle or vehicle file.
    pub vehicle: String,
    /// Image width and height (px) that replace the vehicle's own.
    pub image_px: Option<[u32; 2]>,
    /// Speeds (m/s) from slowest to fastest; each drive has its own.
    pub speed_mps: [f64; 2],
    /// Curves are taken so that v²·κ stays below this (m/s²), as the expert's option `speed.lateral_acceleration_mps2`; left out: the
    /// expert's own.
    pub lateral_acceleration_mps2: Option<f64>,
    /// Longest drive (frames).
    pub drive_frames: usize,
    /// Pushes while driving.
    pub pushes: Option<Pushes>,
    /// Starting places to either side of the path, as a part of the corridor's half width.
    pub start_offset: f64,
    /// Starting headings to either side of the path (rad).
    pub start_heading_rad: f64,
    /// How far beside the path drives keep, at most, as a part of the corridor's half width: each one has its own place,
    /// as people have theirs. 0: all drive in the middle.
    pub beside: f64,
    /// The first frames of a drive are not learned: exposure settles (A6 in SPEC).
    pub skip_frames: usize,
    /// How far each drive's cameras are from the vehicle's own, so that a network does not depend on one mounting. A model
    /// that learned with a spread accepts every camera.
    pub cameras: CameraSpread,
}

/// Differences between cameras; every drive draws its own, evenly to both sides. Zero: all are alike.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSpread {
    /// Of the height above the floor, as a part of it.
    pub height: f64,
    /// Of the tilt (rad).
    pub tilt_rad: f64,
    /// Of the focal length, as a part of it.
    pub focal: f64,
}

impl CameraSpread {
    /// Whether all cameras are alike.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Changes the vehicle's cameras, all in the same way. `draw` gives numbers of -1..=1.
    fn apply(&self, spec: &mut VehicleSpec, mut draw: impl FnMut() -> f64) {
        if self.is_none() {
            return;
        }
        let (height, tilt_rad, focal) = (
            1.0 + self.height * draw(),
            self.tilt_rad * draw(),
            1.0 + self.focal * draw(),
        );
        for camera in &mut spec.cameras {
            camera.camera.mounting.z_m *= height;
            camera.camera.mounting.tilt_rad += tilt_rad;
            camera.camera.lens = camera.camera.lens.zoomed(focal);
        }
    }
}

impl Default for Gathering {
    fn default() -> Self {
        Self {
            families: vec!["random-circuit".into()],
            first_world: 1_000_000,
            vehicle: "picar".into(),
            image_px: Some([160, 120]),
            speed_mps: [0.12, 0.3],
            lateral_acceleration_mps2: None,
            drive_frames: 250,
            pushes: Some(Pushes {
                every_s: 1.5,
                lasts_s: 0.4,
                yaw_rate_std_radps: 1.2,
            }),
            start_offset: 0.6,
            start_heading_rad: 0.35,
            beside: 0.0,
            skip_frames: 4,
            cameras: CameraSpread::default(),
        }
    }
}

impl Gathering {
    /// The first key out of its range, with what is expected and what was found.
    pub(crate) fn fault(&self) -> Option<(&'static str, &'static str, String)> {
        let [slow, fast] = self.speed_mps;
        let wrong_size =
            |[width, height]: [u32; 2]| !((8..=4096).contains(&width) && (8..=4096).contains(&height));
        let checks = [
            (
                !self.families.is_empty(),
                "gathering.families",
                "a family of random worlds such as random-circuit",
                "none".to_owned(),
            ),
            (
                (1..=1_000_000).contains(&self.drive_frames),
                "gathering.drive_frames",
                "1 to 1000000",
                self.drive_frames.to_string(),
            ),
            (
                self.skip_frames <= 1_000_000,
                "gathering.skip_frames",
                "0 to 1000000",
                self.skip_frames.to_string(),
            ),
            (
                slow > 0.0 && slow <= fast && fast <= 100.0,
                "gathering.speed_mps",
                "two speeds, the slower one first, more than 0 and at most 100",
                format!("{slow} and {fast}"),
            ),
            (
                self.lateral_acceleration_mps2
                    .is_none_or(|most| most > 0.0 && most <= 100.0),
                "gathering.lateral_acceleration_mps2",
                "more than 0 and at most 100",
                self.lateral_acceleration_mps2.unwrap_or(0.0).to_string(),
            ),
            (
                (0.0..=1.0).contains(&self.start_offset),
                "gathering.start_offset",
                "0 to 1",
                self.start_offset.to_string(),
            ),
            (
                (0.0..=std::f64::consts::FRAC_PI_2).contains(&self.start_heading_rad),
                "gathering.start_heading_rad",
                "0 to 1.57",
                self.start_heading_rad.to_string(),
            ),
            (
                (0.0..=1.0).contains(&self.beside),
                "gathering.beside",
                "0 to 1",
                self.beside.to_string(),
            ),
            (
                (0.0..=0.9).contains(&self.cameras.height),
                "gathering.cameras.height",
                "0 to 0.9",
                self.cameras.height.to_string(),
            ),
            (
                (0.0..=0.5).contains(&self.cameras.tilt_rad),
                "gathering.cameras.tilt_rad",
                "0 to 0.5",
                self.cameras.tilt_rad.to_string(),
            ),
            (
                (0.0..=0.5).contains(&self.cameras.focal),
                "gathering.cameras.focal",
                "0 to 0.5",
                self.cameras.focal.to_string(),
            ),
            (
                !self.image_px.is_some_and(wrong_size),
                "gathering.image_px",
                "a width and a height of 8 to 4096",
                format!("{:?}", self.image_px.unwrap_or_default()),
            ),
        ];
        checks
            .into_iter()
            .find(|(fine, ..)| !fine)
            .map(|(_, key, expected, found)| (key, expected, found))
    }
}

/// Beyond this many half widths of the corridor a drive ends: what the camera sees there is no road any more.
const STRAYED_HALF_WIDTHS: f64 = 1.4;

/// One finished drive.
struct Drive {
    samples: Samples,
    strayed: bool,
}

/// What is gathered, and how frames and answers are prepared.
#[derive(Clone, Copy)]
pub struct Brief<'a> {
    /// Where and how it is driven.
    pub gathering: &'a Gathering,
    /// How frames are prepared.
    pub input: &'a InputSpec,
    /// What the network shall answer.
    pub answers: &'a [Answer],
    /// Seed of everything.
    pub seed: u64,
}

/// What came of it.
pub struct Gathered {
    /// Frames with the expert's answers.
    pub samples: Samples,
    /// Drives made.
    pub drives: usize,
    /// How many of them strayed from the road.
    pub strayed: usize,
}

/// Gathers at least `frames` frames, and all that the last group of eight drives gives beyond: the model drives, or without one the expert. Drives are
/// numbered from `first_drive`; number and seed decide everything about a drive, so threads do not matter.
pub fn gather(
    brief: &Brief,
    model: Option<&Model>,
    frames: usize,
    first_drive: u64,
    progress: &(dyn Fn(usize) + Sync),
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Result<Gathered, LearnError> {
    let Brief {
        gathering,
        input,
        answers,
        ..
    } = *brief;
    let mut spec = senda_run::scenario::find_vehicle(&gathering.vehicle)?;
    if let Some([width, height]) = gathering.image_px {
        spec = spec.with_camera_size(width, height);
    }
    let mut all = Samples::new(input.len(), answers.len());
    let (mut drives, mut strayed) = (0usize, 0usize);
    let gathered = AtomicUsize::new(0);
    // Several at a time; a group's size is fixed so that the same drives are made on every machine.
    const GROUP: u64 = 8;
    while all.len() < frames && !interrupted() {
        let first = first_drive + drives as u64;
        let group: Vec<Drive> = (first..first + GROUP)
            .into_par_iter()
            .map(|number| {
                let drive = one(brief, &spec, model, number)?;
                progress(gathered.fetch_add(drive.samples.len(), Ordering::Relaxed) + drive.samples.len());
                Ok(drive)
            })
            .collect::<Result<_, LearnError>>()?;
        for drive in group {
            drives += 1;
            strayed += usize::from(drive.strayed);
            all.append(&drive.samples);
        }
    }
    Ok(Gathered {
        samples: all,
        drives,
        strayed,
    })
}

fn one(brief: &Brief, spec: &VehicleSpec, model: Option<&Model>, number: u64) -> Result<Drive, LearnError> {
    let Brief {
        gathering,
        input,
        answers,
        seed,
    } = *brief;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(number);
    let family = &gathering.families[rng.random_range(0..gathering.families.len())];
    let name = format!("{family}:{}", gathering.first_world + number);
    let mut world = senda_run::scenario::find_world(&name)?;
    if rng.random_bool(0.5) {
        world = world.reversed();
    }
    let mut spread = |half: f64| {
        if half > 0.0 {
            rng.random_range(-half..=half)
        } else {
            0.0
        }
    };
    let start = Start {
        station_m: Some(0.5 * world.path.length_m() * (1.0 + spread(1.0))),
        offset_m: spread(gathering.start_offset) * world.corridor_half_width_m,
        heading_rad: spread(gathering.start_heading_rad),
        speed_mps: 0.0,
    };
    let [slow, fast] = gathering.speed_mps;
    let speed_mps = 0.5 * (slow + fast) + 0.5 * spread(1.0) * (fast - slow);
    let mut spec = spec.clone();
    gathering.cameras.apply(&mut spec, || spread(1.0));
    let beside_m = spread(gathering.beside) * world.corridor_half_width_m;
    let path = world.path.clone();
    let half_width_m = world.corridor_half_width_m;
    let mut simulator = Simulator::new(
        world,
        &spec,
        SimOptions {
            seed: seed ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15),
            start,
            pushes: gathering.pushes,
            delivery: Delivery::Pixels,
            ..SimOptions::default()
        },
    )?;
    let body: Body = simulator.body().clone();
    let mut options = ExpertOptions {
        offset_m: beside_m,
        ..ExpertOptions::default()
    };
    options.set_speed(Some(speed_mps));
    if let Some(lateral) = gathering.lateral_acceleration_mps2 {
        options.speed.lateral_acceleration_mps2 = lateral;
    }
    let mut expert = ExpertDriver::new(&body, path.clone(), options)?;
    let mut network = match model {
        Some(model) => {
            let mut options = NeuralOptions {
                any_camera: true,
                ..NeuralOptions::default()
            };
            options.set_speed(Some(speed_mps));
            Some(NeuralDriver::new(&body, model.clone(), options)?)
        }
        None => None,
    };
    let mut samples = Samples::new(input.len(), answers.len());
    samples.begin_run(&format!("{name}#{number}"), &name);
    let mut guard = Guard::new(&body);
    let mut observation = Observation::default();
    let mut targets = vec![0f32; answers.len()];
    let mut eye = Eye::new(input);
    let mut station_m = None;
    let mut strayed = false;
    for step in 0..gathering.drive_frames + gathering.skip_frames {
        if !simulator.observe(&mut observation)? {
            break;
        }
        let Some(truth) = simulator.truth().copied() else {
            break;
        };
        let position = truth.world_from_vehicle.position();
        let place = match station_m {
            Some(station_m) => {
                // As far as the expert looks: a car moves further between two frames than a toy.
                let moved_m = 2.0 * truth.speed_mps.abs() * body.period_s;
                path.project_near(position, station_m, moved_m.max(0.4))
            }
            None => path.project(position),
        };
        station_m = Some(place.station_m);
        let at_the_end = !path.is_closed() && place.station_m >= path.length_m() - 0.3;
        if at_the_end || place.offset_m.abs() > STRAYED_HALF_WIDTHS * half_width_m {
            strayed = !at_the_end;
            break;
        }
        let right = expert.drive_knowing(&observation, &truth);
        if let Some(frame) = observation.first_frame() {
            let pixels = eye.see_bytes(&frame.image);
            if step >= gathering.skip_frames {
                for (target, answer) in targets.iter_mut().zip(answers) {
                    *target = answer.target(&body, &right, simulator.pedal(&right)) as f32;
                }
                samples.push(pixels, &targets);
            }
        } else {
            samples.skip();
            eye.forget();
        }
        let command = match &mut network {
            Some(network) => {
                let own = network.drive(&observation);
                Command {
                    drive: if answers.iter().all(|answer| answer.is_turn()) {
                        right.drive
                    } else {
                        own.drive
                    },
                    ..own
                }
            }
            None => right,
        };
        let command = guard.check(&observation, command);
        expert.executed(&command);
        simulator.actuate(&command)?;
    }
    Ok(Drive { samples, strayed })
}
