//! The driver that is told the true state: for measuring, and for labels that a camera driver learns from.

use crate::follow::{FollowOptions, Follower, Form, LineState, track_m, wheel_speeds};
use crate::options::{DriverError, check};
use crate::response::{ModelBank, Swing};
use crate::speed::SpeedOptions;
use senda_core::{Body, Command, Explanation, Observation, PrivilegedDriver, Stamp, Truth};
use senda_geom::{Curve, Pose2, Vec3, angle};
use serde::{Deserialize, Serialize};

/// Options of the expert.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExpertOptions {
    /// The control law; the document's form is there for comparison.
    pub form: Form,
    /// Its constants.
    pub follow: FollowOptions,
    /// How fast.
    pub speed: SpeedOptions,
    /// How hard it may brake before a curve (m/s²).
    pub braking_mps2: f64,
    /// How late commands act (s). Left out: found while driving, from commands and true yaw rates.
    pub delay_s: Option<f64>,
    /// Time constant with which the vehicle follows (s). Left out: found while driving.
    pub lag_s: Option<f64>,
    /// Keep this far to the left of the path (m).
    pub offset_m: f64,
}

impl Default for ExpertOptions {
    fn default() -> Self {
        Self {
            form: Form::Curve,
            follow: FollowOptions {
                settle_m: 0.12,
                settle_s: 0.3,
                yaw_rate_limit_radps: 100.0,
                ..FollowOptions::default()
            },
            speed: SpeedOptions::default(),
            braking_mps2: 1.0,
            delay_s: None,
            lag_s: None,
            offset_m: 0.0,
        }
    }
}

impl ExpertOptions {
    /// Another cruising speed (m/s), where one is given.
    pub fn set_speed(&mut self, speed_mps: Option<f64>) {
        self.speed.cruise_mps = speed_mps.unwrap_or(self.speed.cruise_mps);
    }

    fn validate(&self) -> Result<(), DriverError> {
        self.speed.validate()?;
        check("braking_mps2", self.braking_mps2, 0.01, 100.0)?;
        check("delay_s", self.delay_s.unwrap_or(0.0), 0.0, 5.0)?;
        check("lag_s", self.lag_s.unwrap_or(0.0), 0.0, 5.0)?;
        check("offset_m", self.offset_m, -100.0, 100.0)
    }
}

/// How far along the path the vehicle may have moved between two steps (m), unless its speed says more: the projection looks no further, so on a
/// path that crosses itself it stays on the right branch.
const WINDOW_M: f64 = 0.4;

/// Follows a path knowing where the vehicle is: feedback on the state that it *will* have when the command acts,
/// curvature of the path fed forward, speed that follows the curve.
pub struct ExpertDriver {
    body: Body,
    path: Curve,
    options: ExpertOptions,
    follower: Follower,
    models: ModelBank,
    station_m: Option<f64>,
    last_stamp: Option<Stamp>,
    speed_mps: f64,
    /// What the vehicle was told last: when, speed (m/s), yaw rate (rad/s).
    told: Option<(Stamp, f64, f64)>,
    swing: Swing,
    log: Log,
}

/// What [`ExpertDriver::explain`] tells.
#[derive(Debug, Clone, Copy, Default)]
struct Log {
    state: LineState,
    desired_angle_rad: f64,
    yaw_rate_radps: f64,
    speed_mps: f64,
    station_m: f64,
    world_from_vehicle: Pose2,
}

impl ExpertDriver {
    /// An expert for a vehicle and the path that it follows, in driving direction.
    pub fn new(body: &Body, path: Curve, options: ExpertOptions) -> Result<Self, DriverError> {
        options.validate()?;
        Ok(Self {
            follower: Follower::new(options.form, options.follow, body)?,
            models: ModelBank::new(options.delay_s, options.lag_s),
            body: body.clone(),
            path,
            options,
            station_m: None,
            last_stamp: None,
            speed_mps: 0.0,
            told: None,
            swing: Swing::default(),
            log: Log::default(),
        })
    }

    /// Says that the vehicle was given another command than the last answer: somebody else drives, and the expert only
    /// says what would be right.
    pub fn executed(&mut self, command: &Command) {
        if let Some((_, speed_mps, yaw_rate_radps)) = &mut self.told {
            *speed_mps = self.body.speed_of(command);
            *yaw_rate_radps = self.body.yaw_rate_of(command.turn, *speed_mps);
        }
        self.swing = Swing::default();
    }

    /// Aims this far to the left of the path (m) from now on.
    pub fn aim_beside(&mut self, offset_m: f64) {
        self.options.offset_m = offset_m;
    }

    /// All parameters, for the head of a log (C15).
    pub fn parameters(&self) -> toml::Table {
        crate::options::table(&self.options)
    }

    /// How late commands act and with which time constant the vehicle follows, as far as known (s, s).
    pub fn vehicle_response(&self) -> (f64, f64) {
        let model = self.models.best();
        (model.delay_s, model.lag_s)
    }

    /// The speed (m/s) that lets the vehicle brake in time for every curve ahead.
    fn speed_before_curves(&self, station_m: f64) -> f64 {
        let options = &self.options;
        let cruise_mps = options.speed.cruise_mps;
        let reach_m = 0.1 + 0.5 * cruise_mps * cruise_mps / options.braking_mps2;
        let tightest = self.body.curvature_limit_per_m();
        let rate_limit = self.body.yaw_rate_limit_radps;
        let mut speed_mps = cruise_mps;
        let steps = (reach_m / 0.05).ceil().min(200.0) as usize;
        for i in 0..=steps {
            let ahead_m = reach_m * i as f64 / steps as f64;
            let curvature = self.path.curvature_at(station_m + ahead_m);
            let mut allowed = options.speed.for_curvature(curvature);
            if rate_limit > 0.0 && curvature.abs() > 1e-6 && curvature.abs() < tightest {
                // Keep a tenth of the yaw rate for corrections.
                allowed = allowed.min(0.9 * rate_limit / curvature.abs());
            }
            speed_mps = speed_mps.min((allowed * allowed + 2.0 * options.braking_mps2 * ahead_m).sqrt());
        }
        speed_mps
    }
}

impl PrivilegedDriver for ExpertDriver {
    fn drive_knowing(&mut self, observation: &Observation, truth: &Truth) -> Command {
        let stamp = observation.stamp;
        let dt_s = self
            .last_stamp
            .map_or(self.body.period_s, |last| stamp.since_s(last).clamp(0.0, 1.0));
        self.last_stamp = Some(stamp);
        if let Some((when, speed_mps, yaw_rate_radps)) = self.told.take() {
            self.models.command(when, speed_mps, yaw_rate_radps);
        }
        self.models.observe(stamp, truth);

        // Where the vehicle will be when this command has taken hold.
        let model = self.models.best();
        // It holds for a period, so its middle is half a period later.
        let ahead_s = model.delay_s + model.lag_s + 0.5 * self.body.period_s.clamp(0.0, 0.5);
        let pose = truth.world_from_vehicle.compose(model.motion.predict(ahead_s));
        let position = pose.position();
        let place = match self.station_m {
            Some(station_m) => {
                let moved_m = 2.0 * truth.speed_mps.abs() * dt_s;
                self.path.project_near(position, station_m, WINDOW_M.max(moved_m))
            }
            None => self.path.project(position),
        };
        self.station_m = Some(place.station_m);
        let on_path = self.path.pose_at(place.station_m);
        let state = LineState {
            d_m: self.options.offset_m - place.offset_m,
            theta_rad: angle::difference(on_path.heading_rad, pose.heading_rad),
            curvature_per_m: self.path.curvature_at(place.station_m),
        };

        let away = position - on_path.position();
        let past_the_end = !self.path.is_closed()
            && place.station_m >= self.path.length_m() - 1e-9
            && away.dot(on_path.forward()) > 0.1;
        let wanted_mps = if past_the_end {
            0.0
        } else {
            self.speed_before_curves(place.station_m)
        };
        let acceleration = self.options.speed.acceleration_mps2;
        self.speed_mps = if acceleration > 0.0 {
            let begin_mps = 0.2 * self.options.speed.cruise_mps;
            wanted_mps.min(self.speed_mps.max(begin_mps) + acceleration * dt_s)
        } else {
            wanted_mps
        };

        let steer = self.follower.step(state, self.speed_mps, dt_s);
        self.told = Some((stamp, self.speed_mps, steer.yaw_rate_radps));
        let most_radps = self.follower.yaw_rate_limit_radps(self.speed_mps);
        if self.swing.step(steer.yaw_rate_radps / most_radps) {
            self.models.distrust_slow();
        }
        self.log = Log {
            state,
            desired_angle_rad: steer.desired_angle_rad,
            yaw_rate_radps: steer.yaw_rate_radps,
            speed_mps: self.speed_mps,
            station_m: place.station_m,
            world_from_vehicle: truth.world_from_vehicle,
        };
        if self.speed_mps > 1e-6 {
            Command::curvature(steer.yaw_rate_radps / self.speed_mps, self.speed_mps)
        } else {
            Command::STOP
        }
    }

    fn explain(&self, explanation: &mut Explanation) {
        let log = &self.log;
        explanation.signal("d_m", log.state.d_m);
        explanation.signal("theta_rad", log.state.theta_rad);
        explanation.signal("curvature_per_m", log.state.curvature_per_m);
        explanation.signal("desired_angle_rad", log.desired_angle_rad);
        explanation.signal("omega_radps", log.yaw_rate_radps);
        explanation.signal("speed_mps", log.speed_mps);
        let (left, right) = wheel_speeds(log.speed_mps, log.yaw_rate_radps, track_m(&self.body));
        explanation.signal("left_mps", left);
        explanation.signal("right_mps", right);
        explanation.signal("found", 1.0);
        let Some(camera) = self.body.cameras.first() else {
            return;
        };
        // The path for the next metre, in the picture.
        let vehicle_from_world = log.world_from_vehicle.inverse();
        let points = (0..=20).filter_map(|i| {
            let on_path = self.path.pose_at(log.station_m + 0.05 * f64::from(i));
            let point =
                vehicle_from_world.transform(on_path.position() + on_path.left() * self.options.offset_m);
            let inside = point.x > camera.mounting.x_m;
            let pixel = camera.pixel_from_point(Vec3::new(point.x, point.y, 0.0))?;
            inside.then_some([pixel.x as f32, pixel.y as f32])
        });
        explanation.polyline(points, "#2ecc40", false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_vehicle::{DelayedVehicle, car, gopigo};
    use senda_geom::Segment;
    use std::f64::consts::PI;

    /// Two straights and two half circles with clothoids between.
    fn circuit(radius_m: f64) -> Curve {
        let turn = |k: f64| {
            let ease = 0.25;
            let arc = (PI - ease * k) / k;
            [
                Segment::clothoid(ease, 0.0, k),
                Segment {
                    length_m: arc,
                    start_curvature_per_m: k,
                    end_curvature_per_m: k,
                },
                Segment::clothoid(ease, k, 0.0),
            ]
        };
        let mut pieces = vec![Segment::straight(1.0)];
        pieces.extend(turn(1.0 / radius_m));
        pieces.push(Segment::straight(1.0));
        pieces.extend(turn(1.0 / radius_m));
        Curve::from_segments(Pose2::default(), &pieces, 0.01, true).unwrap()
    }

    /// Mean and largest |offset| over a lap, after the first half metre.
    fn lap(
        body: &Body,
        path: &Curve,
        options: ExpertOptions,
        delay_s: f64,
        lag_s: f64,
        offset_m: f64,
    ) -> (f64, f64) {
        let mut driver = ExpertDriver::new(body, path.clone(), options).unwrap();
        let start = path.pose_at(0.0);
        let start = Pose2::new(start.x_m, start.y_m + offset_m, start.heading_rad);
        let mut vehicle = DelayedVehicle::new(body, start, delay_s, lag_s);
        let mut observation = Observation::default();
        let (mut sum, mut count, mut most) = (0.0, 0.0f64, 0.0f64);
        let mut travelled = 0.0;
        let mut tracker = senda_geom::tracker::Tracker::new(0.0);
        for _ in 0..4000 {
            observation.stamp = vehicle.stamp();
            let truth = vehicle.truth();
            let command = driver.drive_knowing(&observation, &truth);
            assert!(command.is_finite());
            let place = tracker.advance(path, truth.world_from_vehicle.position());
            travelled = tracker.travelled_m();
            if travelled > 0.7 {
                (sum, count, most) = (
                    sum + place.offset_m.abs(),
                    count + 1.0,
                    most.max(place.offset_m.abs()),
                );
            }
            if travelled > path.length_m() {
                break;
            }
            vehicle.step(&command, body.period_s);
        }
        assert!(travelled > path.length_m(), "drove only {travelled} m");
        (sum / count, most)
    }

    #[test]
    fn stays_within_5_mm_with_a_delayed_vehicle_both_ways_round() {
        for (body, radius, speed) in [(gopigo(), 0.35, 0.16), (gopigo(), 0.5, 0.3), (car(), 0.8, 0.8)] {
            for path in [circuit(radius), circuit(radius).reversed()] {
                for (delay_s, lag_s) in [(0.0, 0.0), (0.1, 0.1), (0.2, 0.05)] {
                    let mut options = ExpertOptions::default();
                    options.set_speed(Some(speed));
                    let (mean, most) = lap(&body, &path, options, delay_s, lag_s, 0.05);
                    assert!(
                        mean < 0.005 && most < 0.03,
                        "{} {delay_s} {lag_s}: {mean} {most}",
                        body.name
                    );
                }
            }
        }
    }

    #[test]
    fn finds_the_vehicles_delay_while_driving() {
        let path = circuit(0.4);
        let mut driver = ExpertDriver::new(&gopigo(), path.clone(), ExpertOptions::default()).unwrap();
        let mut vehicle = DelayedVehicle::new(&gopigo(), path.pose_at(0.0), 0.2, 0.0);
        let mut observation = Observation::default();
        for _ in 0..600 {
            observation.stamp = vehicle.stamp();
            let command = driver.drive_knowing(&observation, &vehicle.truth());
            vehicle.step(&command, 0.05);
        }
        let (delay_s, lag_s) = driver.vehicle_response();
        assert!((delay_s + lag_s - 0.2).abs() < 0.051, "{delay_s} {lag_s}");
    }

    #[test]
    fn slows_down_before_a_curve_and_stops_after_the_end() {
        let pieces = [
            Segment::straight(2.0),
            Segment::arc(0.5, PI / 2.0),
            Segment::straight(0.5),
        ];
        let path = Curve::from_segments(Pose2::default(), &pieces, 0.01, false).unwrap();
        let mut options = ExpertOptions::default();
        options.speed = SpeedOptions {
            cruise_mps: 1.0,
            lateral_acceleration_mps2: 0.5,
            ..options.speed
        };
        let mut driver = ExpertDriver::new(&car(), path.clone(), options).unwrap();
        let mut vehicle = DelayedVehicle::new(&car(), path.pose_at(0.0), 0.0, 0.0);
        let mut observation = Observation::default();
        let mut in_curve = 0.0f64;
        for _ in 0..400 {
            observation.stamp = vehicle.stamp();
            let truth = vehicle.truth();
            let command = driver.drive_knowing(&observation, &truth);
            vehicle.step(&command, 0.05);
            let station = path.project(truth.world_from_vehicle.position()).station_m;
            if (2.0..2.7).contains(&station) {
                in_curve = in_curve.max(vehicle.truth().speed_mps);
            }
        }
        assert!(in_curve <= 0.56, "{in_curve}");
        assert_eq!(vehicle.truth().speed_mps, 0.0);
        let end = path.pose_at(path.length_m());
        assert!((vehicle.truth().world_from_vehicle.position() - end.position()).length() < 0.3);
    }
}
