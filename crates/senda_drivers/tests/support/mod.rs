//! A floor, a camera and a vehicle for closed loops inside this crate: no light model, no noise but what a test adds.
#![allow(dead_code, reason = "every test file uses its own part of this")]

use senda_core::{Body, Channels, Command, Driver, Explanation, Frame, Image, Observation, Stamp, Steering};
use senda_geom::{Camera, Curve, Lens, Mounting, Pose2, Segment, Vec2, tracker::Tracker};
use std::collections::VecDeque;

/// The robot of document C with its webcam.
pub(crate) fn gopigo(width_px: u32, height_px: u32) -> Body {
    Body {
        name: "gopigo".into(),
        steering: Steering::Differential { track_m: 0.11 },
        width_m: 0.14,
        length_m: 0.2,
        speed_limit_mps: 0.6,
        yaw_rate_limit_radps: 6.0,
        period_s: 0.05,
        encoders: None,
        cameras: vec![Camera {
            name: "center".into(),
            width_px,
            height_px,
            lens: Lens::pinhole(width_px, height_px, 54f64.to_radians(), 42.3f64.to_radians()),
            mounting: Mounting {
                x_m: 0.04,
                y_m: 0.0,
                z_m: 0.095,
                yaw_rad: 0.0,
                tilt_rad: 33f64.to_radians(),
                roll_rad: 0.0,
            },
        }],
    }
}

/// A kit car with a wide camera, for lanes of half a metre.
pub(crate) fn kit_car() -> Body {
    Body {
        name: "kit-car".into(),
        steering: Steering::Ackermann {
            wheelbase_m: 0.25,
            steering_limit_rad: 0.45,
        },
        width_m: 0.2,
        length_m: 0.4,
        speed_limit_mps: 3.0,
        yaw_rate_limit_radps: 6.0,
        period_s: 0.05,
        encoders: None,
        cameras: vec![Camera {
            name: "center".into(),
            width_px: 160,
            height_px: 120,
            lens: Lens::equidistant(160, 120, 120f64.to_radians()),
            mounting: Mounting {
                x_m: 0.15,
                y_m: 0.0,
                z_m: 0.2,
                yaw_rad: 0.0,
                tilt_rad: 25f64.to_radians(),
                roll_rad: 0.0,
            },
        }],
    }
}

/// A painted floor: gray levels on a grid.
pub(crate) struct Floor {
    origin: Vec2,
    width: usize,
    height: usize,
    gray: Vec<u8>,
    outside: u8,
}

const TEXEL_M: f64 = 0.0025;

impl Floor {
    /// An empty floor that covers a path with `margin_m` around it.
    pub(crate) fn around(path: &Curve, margin_m: f64, level: u8) -> Self {
        let points = path.polyline(0.05);
        let margin = Vec2::splat(margin_m);
        let low = points.iter().copied().reduce(Vec2::min).unwrap() - margin;
        let high = points.iter().copied().reduce(Vec2::max).unwrap() + margin;
        let (width, height) = (
            ((high.x - low.x) / TEXEL_M) as usize + 1,
            ((high.y - low.y) / TEXEL_M) as usize + 1,
        );
        Self {
            origin: low,
            width,
            height,
            gray: vec![level; width * height],
            outside: level,
        }
    }

    /// Paints a stripe along a curve, between two stations or all along it.
    pub(crate) fn stripe(&mut self, path: &Curve, width_m: f64, level: u8, stations: Option<(f64, f64)>) {
        let (from, to) = stations.unwrap_or((0.0, path.length_m()));
        let steps = ((to - from) / (0.5 * TEXEL_M)).ceil() as usize;
        let across = (width_m / (0.5 * TEXEL_M)).ceil() as i32;
        for i in 0..=steps {
            let pose =
                path.pose_at((from + (to - from) * i as f64 / steps as f64).min(path.length_m() - 1e-9));
            for j in 0..=across {
                let aside = width_m * (f64::from(j) / f64::from(across) - 0.5);
                self.dot(pose.position() + pose.left() * aside, level);
            }
        }
    }

    /// Dashes of `dash_m` with gaps of `gap_m`.
    pub(crate) fn dashes(&mut self, path: &Curve, width_m: f64, level: u8, dash_m: f64, gap_m: f64) {
        let mut at = 0.0;
        while at + dash_m < path.length_m() {
            self.stripe(path, width_m, level, Some((at, at + dash_m)));
            at += dash_m + gap_m;
        }
    }

    /// A filled circle: a stain, a reflection.
    pub(crate) fn disc(&mut self, centre: Vec2, radius_m: f64, level: u8) {
        let steps = (radius_m / TEXEL_M).ceil() as i32;
        for j in -steps..=steps {
            for i in -steps..=steps {
                let away = Vec2::new(f64::from(i), f64::from(j)) * TEXEL_M;
                if away.length() <= radius_m {
                    self.dot(centre + away, level);
                }
            }
        }
    }

    /// Speckles the whole floor by ± `amplitude`, in grains of some millimetres.
    pub(crate) fn speckle(&mut self, amplitude: i32) {
        for j in 0..self.height {
            for i in 0..self.width {
                let grain = mix((i as u64 / 2) << 32 | (j as u64 / 2));
                let change = (grain % (2 * amplitude as u64 + 1)) as i32 - amplitude;
                let gray = &mut self.gray[j * self.width + i];
                *gray = (i32::from(*gray) + change).clamp(0, 255) as u8;
            }
        }
    }

    fn dot(&mut self, at: Vec2, level: u8) {
        let place = (at - self.origin) / TEXEL_M;
        if place.x >= 0.0 && place.y >= 0.0 {
            let (i, j) = (place.x as usize, place.y as usize);
            if i < self.width && j < self.height {
                self.gray[j * self.width + i] = level;
            }
        }
    }

    fn at(&self, point: Vec2) -> u8 {
        let place = (point - self.origin) / TEXEL_M;
        if !(place.x >= 0.0 && place.y >= 0.0) {
            return self.outside;
        }
        let (i, j) = (place.x as usize, place.y as usize);
        if i < self.width && j < self.height {
            self.gray[j * self.width + i]
        } else {
            self.outside
        }
    }
}

/// SplitMix64: a hash for speckles.
fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Draws what a camera sees of a floor: four rays a pixel.
pub(crate) struct Eye {
    rays: Vec<[Option<Vec2>; 4]>,
    width: usize,
    height: usize,
}

impl Eye {
    pub(crate) fn new(camera: &Camera) -> Self {
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let mut rays = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let ray = |dx: f64, dy: f64| camera.floor_from_pixel(Vec2::new(x as f64 + dx, y as f64 + dy));
                rays.push([ray(0.25, 0.25), ray(0.75, 0.25), ray(0.25, 0.75), ray(0.75, 0.75)]);
            }
        }
        Self { rays, width, height }
    }

    pub(crate) fn draw(&self, floor: &Floor, world_from_vehicle: Pose2, image: &mut Image) {
        image.reshape(self.width, self.height, Channels::Gray);
        let (forward, left) = (world_from_vehicle.forward(), world_from_vehicle.left());
        let position = world_from_vehicle.position();
        for (pixel, rays) in image.pixels_mut().iter_mut().zip(&self.rays) {
            let mut sum = 0;
            for ray in rays {
                sum += match ray {
                    Some(point) => u32::from(floor.at(position + forward * point.x + left * point.y)),
                    None => 130,
                };
            }
            *pixel = (sum / 4) as u8;
        }
    }
}

/// What a closed loop showed.
#[derive(Debug, Default, Clone)]
pub(crate) struct Lap {
    pub(crate) travelled_m: f64,
    pub(crate) mean_m: f64,
    pub(crate) largest_m: f64,
    pub(crate) stopped_after_m: Option<f64>,
    pub(crate) steps: usize,
    pub(crate) commands: Vec<Command>,
    pub(crate) offsets_m: Vec<f64>,
    pub(crate) headings_rad: Vec<f64>,
}

/// A driver under observation: how long it was without its line.
pub(crate) struct Watched<D> {
    pub(crate) driver: D,
    /// Steps since the line was last seen.
    gap: usize,
    /// The longest such gap after the line was first seen (steps).
    pub(crate) longest_gap: usize,
    seen: bool,
}

impl<D: Driver> Watched<D> {
    pub(crate) fn new(driver: D) -> Self {
        Self {
            driver,
            gap: 0,
            longest_gap: 0,
            seen: false,
        }
    }
}

impl<D: Driver> Driver for Watched<D> {
    fn drive(&mut self, observation: &Observation) -> Command {
        let command = self.driver.drive(observation);
        let mut explanation = Explanation::default();
        self.driver.explain(&mut explanation);
        let found = explanation
            .signals
            .iter()
            .any(|signal| signal.name == "found" && signal.value > 0.0);
        self.seen |= found;
        self.gap = if found { 0 } else { self.gap + 1 };
        if self.seen {
            self.longest_gap = self.longest_gap.max(self.gap);
        }
        command
    }

    fn explain(&self, explanation: &mut Explanation) {
        self.driver.explain(explanation);
    }

    fn is_done(&self) -> bool {
        self.driver.is_done()
    }
}

/// What is done to the picture of a step.
type Spoil<'a> = Box<dyn Fn(usize, &mut Image) + 'a>;

/// A closed loop: floor, camera, unicycle with a delay.
pub(crate) struct Loop<'a> {
    pub(crate) body: &'a Body,
    pub(crate) floor: &'a Floor,
    pub(crate) path: &'a Curve,
    pub(crate) start: Pose2,
    pub(crate) start_station_m: f64,
    pub(crate) delay_steps: usize,
    pub(crate) goal_m: f64,
    pub(crate) seconds: f64,
    /// The first part of the way is not judged (m).
    pub(crate) settle_m: f64,
    /// Changes a frame before the driver sees it: step, image.
    pub(crate) spoil: Spoil<'a>,
}

impl<'a> Loop<'a> {
    pub(crate) fn new(body: &'a Body, floor: &'a Floor, path: &'a Curve) -> Self {
        Self {
            body,
            floor,
            path,
            start: path.pose_at(0.0),
            start_station_m: 0.0,
            delay_steps: 1,
            goal_m: path.length_m(),
            seconds: 200.0,
            settle_m: 0.3,
            spoil: Box::new(|_, _| {}),
        }
    }

    pub(crate) fn drive(&self, driver: &mut dyn Driver) -> Lap {
        let eye = Eye::new(&self.body.cameras[0]);
        let mut observation = Observation {
            frames: vec![Frame {
                camera: "center".into(),
                ..Frame::default()
            }],
            ..Observation::default()
        };
        let mut lap = Lap::default();
        let mut pose = self.start;
        let mut tracker = Tracker::new(self.start_station_m);
        let mut late: VecDeque<Command> = (0..self.delay_steps).map(|_| Command::STOP).collect();
        let (mut sum, mut count) = (0.0, 0.0);
        let mut was_standing = true;
        for step in 0..(self.seconds / self.body.period_s) as usize {
            observation.stamp = Stamp::from_s(step as f64 * self.body.period_s);
            observation.frames[0].stamp = observation.stamp;
            eye.draw(self.floor, pose, &mut observation.frames[0].image);
            (self.spoil)(step, &mut observation.frames[0].image);
            let command = driver.drive(&observation);
            assert!(command.is_finite());
            lap.commands.push(command);
            late.push_back(command);
            let acting = late.pop_front().unwrap();
            let speed = self.body.speed_of(&acting).min(self.body.speed_limit_mps);
            let limit = self
                .body
                .yaw_rate_limit_radps
                .min(self.body.curvature_limit_per_m() * speed);
            let rate = self.body.yaw_rate_of(acting.turn, speed).clamp(-limit, limit);
            pose = pose.advance(speed, rate, self.body.period_s);

            let place = tracker.advance(self.path, pose.position());
            lap.steps = step;
            lap.travelled_m = tracker.travelled_m();
            lap.offsets_m.push(place.offset_m);
            lap.headings_rad.push(senda_geom::angle::difference(
                pose.heading_rad,
                self.path.pose_at(place.station_m).heading_rad,
            ));
            if lap.travelled_m > self.settle_m {
                lap.largest_m = lap.largest_m.max(place.offset_m.abs());
                (sum, count) = (sum + place.offset_m.abs(), count + 1.0);
            }
            let standing = speed < 1e-6;
            if standing && !was_standing {
                lap.stopped_after_m = Some(lap.travelled_m);
            }
            was_standing = standing;
            if lap.travelled_m >= self.goal_m || driver.is_done() && standing {
                break;
            }
        }
        lap.mean_m = if count > 0.0 { sum / count } else { f64::NAN };
        lap
    }
}

/// Straight, left and right arcs of a radius, straight: an S.
pub(crate) fn s_curve(radius_m: f64) -> Curve {
    let pieces = [
        Segment::straight(0.6),
        Segment::arc(radius_m, 1.4),
        Segment::arc(radius_m, -2.4),
        Segment::arc(radius_m, 1.0),
        Segment::straight(0.8),
    ];
    Curve::from_segments(Pose2::default(), &pieces, 0.01, false).unwrap()
}

/// A circle to the left.
pub(crate) fn circle(radius_m: f64) -> Curve {
    let turn = [Segment::arc(radius_m, 2.0 * std::f64::consts::PI)];
    Curve::from_segments(Pose2::default(), &turn, 0.01, true).unwrap()
}

/// A straight path along x.
pub(crate) fn straight(length_m: f64) -> Curve {
    Curve::from_segments(Pose2::default(), &[Segment::straight(length_m)], 0.01, false).unwrap()
}
