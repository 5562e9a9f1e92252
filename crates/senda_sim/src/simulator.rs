//! The simulated vehicle in its world: a [`Vehicle`] with everything that a real one does wrong.

use crate::dynamics::Dynamics;
use crate::options::{Images, SimError, SimOptions};
use crate::random::{Random, Source};
use crate::render::Scene;
use crate::sensor::{CameraSensor, Moment};
use senda_core::{Body, Command, Frame, Observation, Stamp, Truth, Vehicle, VehicleError};
use senda_geom::{Camera, Pose2, Vec2, trig};
use senda_world::{VehicleSpec, World};
use std::sync::Arc;

/// A vehicle in a world. Observations come at the vehicle's period, the first at time 0, at rest.
#[derive(Debug)]
pub struct Simulator {
    world: Arc<World>,
    scene: Option<Arc<Scene>>,
    spec: VehicleSpec,
    options: SimOptions,
    dynamics: Dynamics,
    cameras: Vec<CameraSensor>,
    losses: Random,
    /// Poses and speeds of the latest steps, the newest last, as a ring.
    past: Vec<Past>,
    pushes: Option<Pushing>,
    truth: Truth,
    station_m: f64,
    observations: u64,
    spare: Vec<Frame>,
    speedometer: Speedometer,
}

#[derive(Debug, Clone, Copy, Default)]
struct Past {
    world_from_vehicle: Pose2,
    speed_mps: f64,
    yaw_rate_radps: f64,
}

impl Simulator {
    /// A vehicle at its start. Paints the world's floor, unless no images are asked for.
    pub fn new(world: World, spec: &VehicleSpec, options: SimOptions) -> Result<Self, SimError> {
        options.check()?;
        let scene = (options.images != Images::Never && !spec.cameras.is_empty()).then(|| {
            let texel_m = options.metres_per_texel.unwrap_or_else(|| fitting_texel_m(spec));
            Arc::new(Scene::new(&world, texel_m))
        });
        Self::assemble(Arc::new(world), scene, spec, options)
    }

    /// The same in a scene that is ready: painting a floor costs more than many frames, so runs in one world share it.
    /// `options.metres_per_texel` is not looked at.
    pub fn in_scene(
        world: Arc<World>,
        scene: Arc<Scene>,
        spec: &VehicleSpec,
        options: SimOptions,
    ) -> Result<Self, SimError> {
        options.check()?;
        Self::assemble(world, Some(scene), spec, options)
    }

    fn assemble(
        world: Arc<World>,
        scene: Option<Arc<Scene>>,
        spec: &VehicleSpec,
        options: SimOptions,
    ) -> Result<Self, SimError> {
        let start = &options.start;
        let station_m = world
            .path
            .normalise_station(start.station_m.unwrap_or(world.start_station_m));
        let at = world.path.pose_at(station_m);
        let world_from_vehicle = at.compose(Pose2::new(0.0, start.offset_m, start.heading_rad));
        let dynamics = Dynamics::new(spec, world_from_vehicle, options.seed).rolling(start.speed_mps);
        let cameras = match &scene {
            Some(scene) if options.images != Images::Never => spec
                .cameras
                .iter()
                .enumerate()
                .take(options.cameras.unwrap_or(usize::MAX))
                .map(|(index, camera)| CameraSensor::new(camera, index, scene, &options))
                .collect(),
            _ => Vec::new(),
        };
        let step_s = dynamics.step_ns() as f64 * 1e-9;
        let longest_s = spec
            .cameras
            .iter()
            .map(|camera| camera.latency_s + options.extra_latency_s)
            .fold(0.0, f64::max);
        let here = Past {
            world_from_vehicle,
            speed_mps: start.speed_mps,
            ..Past::default()
        };
        let mut simulator = Self {
            past: vec![here; (longest_s / step_s).round() as usize + 1],
            losses: Random::new(options.seed, Source::Losses(0)),
            pushes: options
                .pushes
                .map(|pushes| Pushing::new(pushes, Random::new(options.seed, Source::Pushes))),
            speedometer: Speedometer::new(spec),
            truth: Truth::default(),
            observations: 0,
            spare: Vec::new(),
            world,
            scene,
            spec: spec.clone(),
            dynamics,
            cameras,
            station_m,
            options,
        };
        simulator.truth = simulator.true_state();
        Ok(simulator)
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// What the cameras see; `None` without images.
    pub fn scene(&self) -> Option<&Arc<Scene>> {
        self.scene.as_ref()
    }

    /// Displaces the vehicle, as a hand would: to the left of where it stands (m) and turned left (rad).
    pub fn displace(&mut self, left_m: f64, turned_rad: f64) {
        let here = self.dynamics.state().world_from_vehicle;
        let there = here.compose(Pose2::new(0.0, left_m, turned_rad));
        self.dynamics.place(there);
    }

    fn true_state(&self) -> Truth {
        let state = self.dynamics.state();
        Truth {
            stamp: Stamp::from_ns(self.dynamics.time_ns()),
            world_from_vehicle: state.world_from_vehicle,
            speed_mps: state.speed_mps,
            yaw_rate_radps: state.yaw_rate_radps + state.pushed_radps,
            steering_rad: state.steering_rad,
            battery_v: state.battery_v,
        }
    }

    /// Moves on to the next observation.
    fn advance(&mut self) {
        let step_s = self.dynamics.step_ns() as f64 * 1e-9;
        for _ in 0..self.dynamics.steps_per_period() {
            let push = self.pushes.as_mut().map_or(0.0, |pushes| pushes.at(step_s));
            self.dynamics.advance(push);
            let state = self.dynamics.state();
            let steps = self.dynamics.time_ns() / self.dynamics.step_ns();
            let slot = (steps % self.past.len() as u64) as usize;
            self.past[slot] = Past {
                world_from_vehicle: state.world_from_vehicle,
                speed_mps: state.speed_mps,
                yaw_rate_radps: state.yaw_rate_radps + state.pushed_radps,
            };
        }
    }

    /// Exposes all cameras.
    fn picture(&mut self, observation: &mut Observation) -> Result<(), VehicleError> {
        let Some(scene) = self.scene.clone() else {
            self.spare.append(&mut observation.frames);
            return Ok(());
        };
        let step_ns = self.dynamics.step_ns();
        let steps = self.dynamics.time_ns() / step_ns;
        let every = match self.options.images {
            Images::Always => 1,
            Images::Every(count) => u64::from(count.max(1)),
            Images::Never => 0,
        };
        self.spare.append(&mut observation.frames);
        if every == 0 || !self.observations.is_multiple_of(every) {
            return Ok(());
        }
        // The pictures of a moment are lost together: a driver that looks at the first camera must never be shown another one's.
        let lost = self.options.lost_frames > 0.0 && self.losses.uniform() < self.options.lost_frames;
        let elapsed_s = every as f64 * (step_ns * self.dynamics.steps_per_period()) as f64 * 1e-9;
        for (index, camera) in self.cameras.iter_mut().enumerate() {
            let latency_s = self.spec.cameras[index].latency_s + self.options.extra_latency_s;
            let late = ((latency_s * 1e9 / step_ns as f64).round() as u64).min(self.past.len() as u64 - 1);
            // Before the beginning the vehicle stood where it starts.
            let then = self.past[(steps.saturating_sub(late) % self.past.len() as u64) as usize];
            let position = then.world_from_vehicle.position();
            let moment = Moment {
                stamp: Stamp::from_ns(steps.saturating_sub(late) * step_ns),
                world_from_vehicle: then.world_from_vehicle,
                speed_mps: then.speed_mps,
                yaw_rate_radps: then.yaw_rate_radps,
                light_level: self
                    .world
                    .light_level_at(nearest(&self.world, position, self.station_m)),
            };
            let mut frame = self.spare.pop().unwrap_or_default();
            let outcome = camera.expose(&scene, &moment, elapsed_s, &mut frame);
            if lost || outcome.is_err() {
                self.spare.push(frame);
            } else {
                observation.frames.push(frame);
            }
            outcome.map_err(|error| VehicleError::Sensor {
                sensor: format!("camera {}", self.spec.cameras[index].camera.name),
                reason: error.to_string(),
            })?;
        }
        Ok(())
    }
}

impl Vehicle for Simulator {
    fn body(&self) -> &Body {
        self.dynamics.body()
    }

    fn observe(&mut self, observation: &mut Observation) -> Result<bool, VehicleError> {
        let next_ns = if self.observations == 0 {
            0
        } else {
            self.dynamics.time_ns() + self.dynamics.step_ns() * self.dynamics.steps_per_period()
        };
        if let Some(duration_s) = self.options.duration_s
            && next_ns as f64 * 1e-9 > duration_s
        {
            return Ok(false);
        }
        if self.observations > 0 {
            self.advance();
        }
        self.truth = self.true_state();
        observation.stamp = self.truth.stamp;
        if self.scene.is_some() {
            self.station_m = nearest(
                &self.world,
                self.truth.world_from_vehicle.position(),
                self.station_m,
            );
        }
        self.picture(observation)?;
        observation.battery_v = self.dynamics.measure_battery();
        observation.wheels = self.dynamics.wheels();
        observation.speed_mps = self.speedometer.read(observation);
        self.observations += 1;
        Ok(true)
    }

    fn actuate(&mut self, command: &Command) -> Result<(), VehicleError> {
        if !command.is_finite() {
            return Err(VehicleError::Actuator {
                actuator: "drive".into(),
                reason: format!(
                    "expected numbers, but found {command:?}; check the driver, or guard its commands"
                ),
            });
        }
        self.dynamics.command(command);
        Ok(())
    }

    fn pedal(&self, command: &Command) -> Option<f64> {
        self.dynamics.pedal(command)
    }

    fn truth(&self) -> Option<&Truth> {
        Some(&self.truth)
    }
}

/// Station of a point near where it was a moment ago; anywhere when it is far from there.
fn nearest(world: &World, point: Vec2, station_m: f64) -> f64 {
    // A road is wider than a taped lane, and what drives on it moves further between two looks.
    let around_m = 0.5f64.max(world.corridor_half_width_m);
    let place = world.path.project_near(point, station_m, 0.1 + around_m);
    if place.offset_m.abs() < around_m {
        return place.station_m;
    }
    world.path.project(point).station_m
}

/// Side of a texel (m) that is right for the sharpest camera: three pixels where it sees the floor closest, about one
/// in the middle of its picture. Painting costs by the texel, and real lenses are soft up close.
pub fn fitting_texel_m(spec: &VehicleSpec) -> f64 {
    let pixel_m = |camera: &Camera| {
        let (u, v) = (
            f64::from(camera.width_px) / 2.0,
            f64::from(camera.height_px) - 1.0,
        );
        let left = camera.floor_from_pixel(Vec2::new(u - 0.5, v))?;
        let right = camera.floor_from_pixel(Vec2::new(u + 0.5, v))?;
        Some((left - right).length())
    };
    let finest_m = spec
        .cameras
        .iter()
        .filter_map(|camera| pixel_m(&camera.camera))
        .fold(f64::INFINITY, f64::min);
    if finest_m.is_finite() {
        (3.0 * finest_m).clamp(0.0015, 0.02)
    } else {
        0.002
    }
}

/// Pushes in progress.
#[derive(Debug, Clone)]
struct Pushing {
    pushes: crate::options::Pushes,
    random: Random,
    wait_s: f64,
    left_s: f64,
    yaw_rate_radps: f64,
}

impl Pushing {
    fn new(pushes: crate::options::Pushes, mut random: Random) -> Self {
        let wait_s = exponential(&mut random, pushes.every_s);
        Self {
            pushes,
            random,
            wait_s,
            left_s: 0.0,
            yaw_rate_radps: 0.0,
        }
    }

    /// Yaw rate of this step.
    fn at(&mut self, step_s: f64) -> f64 {
        if self.left_s > 0.0 {
            self.left_s -= step_s;
            return self.yaw_rate_radps;
        }
        self.wait_s -= step_s;
        if self.wait_s <= 0.0 {
            self.wait_s = exponential(&mut self.random, self.pushes.every_s);
            self.left_s = self.pushes.lasts_s;
            self.yaw_rate_radps = self.pushes.yaw_rate_std_radps * self.random.normal();
        }
        0.0
    }
}

fn exponential(random: &mut Random, mean: f64) -> f64 {
    -mean * trig::log(1.0 - random.uniform())
}

/// Speed from encoder ticks over a short time, on vehicles whose encoders are fine enough for it.
#[derive(Debug, Clone)]
struct Speedometer {
    m_per_tick: Option<f64>,
    /// Time (ns) and sum of both wheels' ticks of the latest observations, as a ring.
    past: [(u64, i64); 4],
    count: usize,
}

/// Coarser encoders (the GoPiGo's 18 ticks) count less than a tick an observation: no speed comes of that.
const TICKS_FOR_SPEED: u32 = 200;

impl Speedometer {
    fn new(spec: &VehicleSpec) -> Self {
        let m_per_tick = spec
            .encoders
            .as_ref()
            .filter(|encoders| encoders.ticks_per_turn >= TICKS_FOR_SPEED)
            .map(|encoders| spec.wheels.circumference_m() / f64::from(encoders.ticks_per_turn));
        Self {
            m_per_tick,
            past: [(0, 0); 4],
            count: 0,
        }
    }

    fn read(&mut self, observation: &Observation) -> Option<f64> {
        let (m_per_tick, wheels) = (self.m_per_tick?, observation.wheels?);
        let now = (observation.stamp.ns, wheels.left_ticks + wheels.right_ticks);
        let oldest = if self.count < self.past.len() {
            self.past[0]
        } else {
            self.past[self.count % self.past.len()]
        };
        self.past[self.count % 4] = now;
        self.count += 1;
        let elapsed_s = (now.0 - oldest.0) as f64 * 1e-9;
        Some(if elapsed_s > 0.0 {
            0.5 * (now.1 - oldest.1) as f64 * m_per_tick / elapsed_s
        } else {
            0.0
        })
    }
}
