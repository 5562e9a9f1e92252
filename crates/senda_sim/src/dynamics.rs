//! From commands to motion: actuators, wheels, battery, in fixed steps.

use crate::random::{Random, Source};
use senda_core::{Body, Command, Drive, Steering, Wheels};
use senda_geom::{Pose2, trig};
use senda_world::{Tyres, VehicleSpec};
use std::collections::VecDeque;

/// Longest step of the dynamics (ns). Actuators are integrated exactly within a step and paths are exact arcs, so
/// only the instants at which commands and noise change are rounded to it.
const LONGEST_STEP_NS: u64 = 5_000_000;

/// How often the wheels' noise is renewed (s), as [`senda_world::VehicleSpec`] promises.
const NOISE_PERIOD_S: f64 = 0.1;

/// The moving vehicle: integrates commands in fixed steps. Knows nothing of worlds and cameras.
#[derive(Debug, Clone)]
pub struct Dynamics {
    spec: VehicleSpec,
    body: Body,
    step_ns: u64,
    steps_per_period: u64,
    delay_steps: u64,
    noise_steps: u64,
    /// What is left of a difference after one step: speed, steering.
    speed_decay: f64,
    steering_decay: f64,
    lasting: Lasting,
    wheel_noise: Random,
    battery_noise: Random,
    queue: VecDeque<(u64, Command)>,
    command: Command,
    step: u64,
    state: State,
}

/// Errors that last for a run.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lasting {
    /// Factors on the wheels' speeds.
    wheels: [f64; 2],
    steering_rad: f64,
}

/// Everything that changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Pose of the vehicle in the world.
    pub world_from_vehicle: Pose2,
    /// Forward speed over the floor (m/s).
    pub speed_mps: f64,
    /// Yaw rate of the vehicle's own (rad/s).
    pub yaw_rate_radps: f64,
    /// Yaw rate that a push adds (rad/s).
    pub pushed_radps: f64,
    /// Angle of the front wheels (rad); 0 without.
    pub steering_rad: f64,
    /// Voltage of the battery under the present load (V); 0 without a battery.
    pub battery_v: f64,
    /// Speed to the left of the rear axle's centre (m/s): not 0 only while tyres slide.
    pub sliding_mps: f64,
    /// Speeds of the left and right driven wheels' rims (m/s).
    wheels_mps: [f64; 2],
    /// Distances that the rims have turned (m).
    turned_m: [f64; 2],
    /// Where the servo stands (rad), and the front wheels behind it.
    servo_rad: f64,
    linkage_rad: f64,
    /// Relative slip of each wheel.
    slip: [f64; 2],
    /// Voltage without load (V).
    rest_v: f64,
    /// Voltage as last measured (V): what the vehicle's own motor controller reckons with.
    measured_v: f64,
}

impl Dynamics {
    /// A vehicle at rest.
    pub fn new(spec: &VehicleSpec, world_from_vehicle: Pose2, seed: u64) -> Self {
        let period_ns = (spec.period_s * 1e9).round().max(1.0) as u64;
        let steps_per_period = period_ns.div_ceil(LONGEST_STEP_NS);
        let step_ns = (period_ns / steps_per_period).max(1);
        let step_s = step_ns as f64 * 1e-9;
        let steps = |time_s: f64| (time_s / step_s).round().max(0.0) as u64;
        let decay = |constant_s: f64| {
            if constant_s > 0.0 {
                trig::exp(-step_s / constant_s)
            } else {
                0.0
            }
        };
        let mut build = Random::new(seed, Source::Build);
        let imbalance = 0.5 * spec.wheels.imbalance_std * build.normal();
        let speed = 1.0 + spec.drive.speed_bias_std * build.normal();
        let start_v = spec.battery.as_ref().map_or(0.0, |battery| battery.start_v);
        Self {
            body: spec.body(),
            step_ns,
            steps_per_period,
            delay_steps: steps(spec.drive.delay_s),
            noise_steps: steps(NOISE_PERIOD_S).max(1),
            speed_decay: decay(spec.drive.speed_time_constant_s),
            steering_decay: decay(spec.drive.steering_time_constant_s),
            lasting: Lasting {
                wheels: [speed - imbalance, speed + imbalance],
                steering_rad: spec.drive.steering_bias_std_rad * build.normal(),
            },
            wheel_noise: Random::new(seed, Source::Wheels),
            battery_noise: Random::new(seed, Source::Battery),
            // Commands come at most once a period; those still on their way wait here.
            queue: VecDeque::with_capacity(64),
            command: Command::STOP,
            step: 0,
            state: State {
                world_from_vehicle,
                speed_mps: 0.0,
                yaw_rate_radps: 0.0,
                pushed_radps: 0.0,
                steering_rad: 0.0,
                sliding_mps: 0.0,
                battery_v: start_v,
                wheels_mps: [0.0; 2],
                turned_m: [0.0; 2],
                servo_rad: 0.0,
                linkage_rad: 0.0,
                slip: [0.0; 2],
                rest_v: start_v,
                measured_v: start_v,
            },
            spec: spec.clone(),
        }
    }

    /// The same, rolling straight ahead already.
    pub fn rolling(mut self, speed_mps: f64) -> Self {
        self.state.speed_mps = speed_mps;
        self.state.wheels_mps = [speed_mps; 2];
        self
    }

    /// Length of a step (ns): the largest divisor of the period that is at most 5 ms, in whole nanoseconds.
    pub fn step_ns(&self) -> u64 {
        self.step_ns
    }

    /// Steps between observations.
    pub fn steps_per_period(&self) -> u64 {
        self.steps_per_period
    }

    /// Time since the beginning (ns).
    pub fn time_ns(&self) -> u64 {
        self.step * self.step_ns
    }

    /// The present state.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Shape and limits.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The pedal (-1..1) that the speed control presses now for a command in m/s, on a vehicle with an engine.
    pub fn pedal(&self, command: &Command) -> Option<f64> {
        let engine = self.spec.engine.as_ref()?;
        let Drive::SpeedMps(wanted_mps) = command.drive else {
            return None;
        };
        let [left_mps, right_mps] = self.state.wheels_mps;
        let wanted_mps = wanted_mps.min(self.spec.speed_limit_mps);
        Some(engine.throttle_for(wanted_mps, 0.5 * (left_mps + right_mps)))
    }

    /// Puts the vehicle somewhere else, as a hand would; speeds stay.
    pub fn place(&mut self, world_from_vehicle: Pose2) {
        self.state.world_from_vehicle = world_from_vehicle;
    }

    /// Takes a command, which acts after the vehicle's delay.
    pub fn command(&mut self, command: &Command) {
        if self.delay_steps == 0 {
            self.command = *command;
        } else {
            self.queue.push_back((self.step + self.delay_steps, *command));
        }
    }

    /// One step. `push_radps` is a yaw rate from outside.
    pub fn advance(&mut self, push_radps: f64) {
        while let Some((at, command)) = self.queue.front()
            && *at <= self.step
        {
            self.command = *command;
            self.queue.pop_front();
        }
        if self.step.is_multiple_of(self.noise_steps) && self.spec.wheels.noise > 0.0 {
            let noise = self.spec.wheels.noise;
            self.state.slip = [0, 1].map(|_| noise * self.wheel_noise.normal());
        }
        let step_s = self.step_ns as f64 * 1e-9;
        let track_m = self.spec.wheels.track_m;
        let limit = self
            .spec
            .drive
            .acceleration_limit_mps2
            .map_or(f64::INFINITY, |limit| limit * step_s);
        let state = &mut self.state;
        match self.spec.steering {
            Steering::Differential { track_m } => {
                let targets = wheel_targets(&self.spec, &self.body, &self.command, track_m);
                for (side, target) in targets.into_iter().enumerate() {
                    let target = driven(&self.spec, state, target) * self.lasting.wheels[side];
                    let speed = &mut state.wheels_mps[side];
                    *speed = approach(*speed, target, self.speed_decay, limit);
                }
                let [left, right] = [0, 1].map(|side| state.wheels_mps[side] * (1.0 - state.slip[side]));
                state.speed_mps = 0.5 * (left + right);
                state.yaw_rate_radps = (right - left) / track_m;
            }
            Steering::Ackermann {
                wheelbase_m,
                steering_limit_rad,
            } => {
                let limit_mps = self.spec.speed_limit_mps;
                let wanted_mps = self.body.speed_of(&self.command).clamp(-limit_mps, limit_mps);
                let wanted_rad = self
                    .body
                    .steering_of(self.command.turn, wanted_mps)
                    .clamp(-steering_limit_rad, steering_limit_rad);
                steer(&self.spec, state, wanted_rad, self.steering_decay, step_s);
                let angle_rad = (state.linkage_rad + self.lasting.steering_rad).clamp(-1.4, 1.4);
                state.steering_rad = angle_rad;
                let axle_mps = 0.5 * (state.wheels_mps[0] + state.wheels_mps[1]);
                let axle_mps = match &self.spec.engine {
                    None => {
                        let target = driven(&self.spec, state, wanted_mps) * self.lasting.wheels[0];
                        approach(axle_mps, target, self.speed_decay, limit)
                    }
                    Some(engine) => {
                        let throttle = match self.command.drive {
                            Drive::Throttle(throttle) => throttle,
                            Drive::SpeedMps(_) => engine.throttle_for(wanted_mps, axle_mps),
                        };
                        engine.speed_after(throttle, axle_mps, limit_mps, step_s)
                    }
                };
                let slip = 0.5 * (state.slip[0] + state.slip[1]);
                state.speed_mps = axle_mps * (1.0 - slip);
                let curvature_per_m = trig::tan(angle_rad) / wheelbase_m;
                match &self.spec.tyres {
                    None => state.yaw_rate_radps = state.speed_mps * curvature_per_m,
                    Some(tyres) => slide(tyres, wheelbase_m, state, step_s),
                }
                let outer = 0.5 * track_m * curvature_per_m;
                state.wheels_mps = [axle_mps * (1.0 - outer), axle_mps * (1.0 + outer)];
            }
        }
        let turning_radps = state.yaw_rate_radps + push_radps;
        state.world_from_vehicle = if state.sliding_mps == 0.0 {
            state
                .world_from_vehicle
                .advance(state.speed_mps, turning_radps, step_s)
        } else {
            // Along its direction of travel instead of its heading.
            let drift_rad = trig::atan2(state.sliding_mps, state.speed_mps);
            let speed_mps = trig::hypot(state.speed_mps, state.sliding_mps);
            let drift = |by_rad: f64| Pose2::new(0.0, 0.0, by_rad);
            state
                .world_from_vehicle
                .compose(drift(drift_rad))
                .advance(speed_mps, turning_radps, step_s)
                .compose(drift(-drift_rad))
        };
        state.pushed_radps = push_radps;
        let signed = self.spec.encoders.as_ref().is_none_or(|encoders| encoders.signed);
        for side in 0..2 {
            let distance_m = state.wheels_mps[side] * step_s;
            state.turned_m[side] += if signed { distance_m } else { distance_m.abs() };
        }
        if let Some(battery) = &self.spec.battery {
            let load =
                0.5 * (state.wheels_mps[0].abs() + state.wheels_mps[1].abs()) / self.spec.speed_limit_mps;
            state.rest_v = (state.rest_v - battery.drain_vps * load * step_s).max(0.0);
            state.battery_v = (state.rest_v - battery.sag_v * load.min(1.0)).max(0.0);
        }
        self.step += 1;
    }

    /// Measures the battery, with its noise. The vehicle's motor controller uses the value until the next call.
    pub fn measure_battery(&mut self) -> Option<f64> {
        let battery = self.spec.battery.as_ref()?;
        self.state.measured_v =
            (self.state.battery_v + battery.noise_v * self.battery_noise.normal()).max(0.0);
        Some(self.state.measured_v)
    }

    /// What the encoders have counted.
    pub fn wheels(&self) -> Option<Wheels> {
        let encoders = self.spec.encoders.as_ref()?;
        let per_m = f64::from(encoders.ticks_per_turn) / self.spec.wheels.circumference_m();
        let [left_ticks, right_ticks] = self.state.turned_m.map(|m| (m * per_m).floor() as i64);
        Some(Wheels {
            left_ticks,
            right_ticks,
        })
    }
}

/// First-order response with a limit on the change.
fn approach(value: f64, target: f64, decay: f64, limit: f64) -> f64 {
    let change = (target - value) * (1.0 - decay);
    value + change.clamp(-limit, limit)
}

/// Speeds (m/s) of the left and right wheel that a command asks for, within the limits: too much speed is taken from
/// both, so that the curvature stays.
fn wheel_targets(spec: &VehicleSpec, body: &Body, command: &Command, track_m: f64) -> [f64; 2] {
    let limit_mps = spec.speed_limit_mps;
    let speed_mps = body.speed_of(command).clamp(-limit_mps, limit_mps);
    let yaw_limit = spec.yaw_rate_limit_radps;
    let yaw_rate = body
        .yaw_rate_of(command.turn, speed_mps)
        .clamp(-yaw_limit, yaw_limit);
    let half = 0.5 * track_m * yaw_rate;
    let targets = [speed_mps - half, speed_mps + half];
    let most = targets[0].abs().max(targets[1].abs());
    if most > limit_mps {
        targets.map(|target| target * limit_mps / most)
    } else {
        targets
    }
}

/// Speed (m/s) that motor and battery make of a wanted one.
fn driven(spec: &VehicleSpec, state: &State, wanted_mps: f64) -> f64 {
    if wanted_mps.abs() < spec.drive.dead_band_mps || wanted_mps == 0.0 {
        return 0.0;
    }
    let Some(motor) = &spec.motor else {
        // Without a motor's figures the battery only lowers top speed.
        return match &spec.battery {
            Some(battery) => {
                let limit_mps = spec.speed_limit_mps * state.battery_v / battery.start_v;
                wanted_mps.clamp(-limit_mps, limit_mps)
            }
            None => wanted_mps,
        };
    };
    let (reckoned_v, true_v) = match &spec.battery {
        Some(battery) => (
            battery.supply_v(state.measured_v),
            battery.supply_v(state.battery_v),
        ),
        None => (motor.reference_v, motor.reference_v),
    };
    let turn_m = spec.wheels.circumference_m();
    let limit = f64::from(motor.value_limit);
    let value = motor.value_for(wanted_mps / turn_m, reckoned_v).round();
    motor.turns_per_s(value.clamp(-limit, limit), true_v) * turn_m
}

/// The dynamic bicycle with linear tyres: side speed and yaw rate after a step, by the implicit Euler method, which is
/// stable at any stiffness and becomes the rolling bicycle towards standstill.
fn slide(tyres: &Tyres, wheelbase_m: f64, state: &mut State, step_s: f64) {
    let speed = state.speed_mps;
    if speed.abs() < 1e-3 {
        (state.sliding_mps, state.yaw_rate_radps) = (0.0, 0.0);
        return;
    }
    let (rear_m, front_m) = (tyres.centre_ahead_m, wheelbase_m - tyres.centre_ahead_m);
    let (front, rear) = (tyres.front_stiffness_npr, tyres.rear_stiffness_npr);
    // Forces act against slip, whichever way the wheels roll.
    let per_speed = 1.0 / speed.abs();
    let side_mps = state.sliding_mps + rear_m * state.yaw_rate_radps;
    let inertia = (tyres.mass_kg / step_s, tyres.yaw_inertia_kgm2 / step_s);
    let cross = (front * front_m - rear * rear_m) * per_speed;
    let a11 = inertia.0 + (front + rear) * per_speed;
    let a12 = cross + tyres.mass_kg * speed;
    let a22 = inertia.1 + (front * front_m * front_m + rear * rear_m * rear_m) * per_speed;
    let steer_force = front * state.steering_rad * speed.signum();
    let b1 = inertia.0 * side_mps + steer_force;
    let b2 = inertia.1 * state.yaw_rate_radps + front_m * steer_force;
    let determinant = a11 * a22 - a12 * cross;
    let side_mps = (b1 * a22 - a12 * b2) / determinant;
    let yaw_rate = (a11 * b2 - cross * b1) / determinant;
    // The floor holds only so much: beyond that the vehicle runs wide.
    let most_radps = tyres.grip_mps2 * per_speed;
    let held = yaw_rate.clamp(-most_radps, most_radps);
    let part = if yaw_rate == 0.0 { 1.0 } else { held / yaw_rate };
    state.yaw_rate_radps = held;
    state.sliding_mps = (side_mps - rear_m * yaw_rate) * part;
}

/// Moves the servo and, through its play, the front wheels.
fn steer(spec: &VehicleSpec, state: &mut State, wanted_rad: f64, decay: f64, step_s: f64) {
    let step_rad = spec.drive.steering_step_rad;
    let target = if step_rad > 0.0 {
        (wanted_rad / step_rad).round() * step_rad
    } else {
        wanted_rad
    };
    let limit = spec
        .drive
        .steering_rate_limit_radps
        .map_or(f64::INFINITY, |limit| limit * step_s);
    state.servo_rad = approach(state.servo_rad, target, decay, limit);
    let play_rad = 0.5 * spec.drive.steering_play_rad;
    state.linkage_rad = state
        .linkage_rad
        .clamp(state.servo_rad - play_rad, state.servo_rad + play_rad);
}

#[cfg(test)]
mod tests;
