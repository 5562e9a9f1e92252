//! `hough`: document A's hand-coded lane follower (A4 in SPEC). A mask of the lane's colour, its edges, straight segments
//! in the lower half of the picture, two lines, one servo angle. It knows nothing of the floor plane: all it does
//! happens in the picture.
//!
//! The document tells where it fails: its colours must be chosen anew for every floor and light, and in a curve the
//! outer line crosses the third by which it is recognised. [`Mask::Strength`] and [`Sides::Lean`] are answers to these;
//! [`crate::LaneDriver`] is the better one.

use crate::hough_lanes::{SERVO_STRAIGHT_DEG, ScreenLane, ScreenLine, Sides, View, heading_px};
use crate::hough_mask::EdgeEye;
use crate::loss::{Loss, LossOptions, Mode};
use crate::neural::turn_of_lock;
use crate::options::{DriverError, check};
use crate::speed::SpeedOptions;
use senda_core::{Body, Command, Drive, Driver, Explanation, Image, Observation, Stamp};
use senda_vision::{HoughOptions, HsvRange, Segment};
use serde::{Deserialize, Serialize};

/// What counts as line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mask {
    /// What has one of the colours. A4.
    #[default]
    Colour,
    /// What stands out from both sides as a line of the expected width does, whatever its colour (A5): the residue of
    /// [`senda_vision::LineExtractor`] above its threshold, in the channel and contrast that show the lines best.
    Strength,
}

/// Options of the driver. The defaults are A4's figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HoughDriverOptions {
    /// How fast.
    pub speed: SpeedOptions,
    /// What counts as line.
    pub mask: Mask,
    /// The lane's colours, in OpenCV's units (hue 0..180). A4, pink: 150..180, 50..255, 120..255.
    pub colours: Vec<HsvRange>,
    /// Width of the line that is expected (m), for the mask by local contrast.
    pub line_width_m: f64,
    /// Canny's lower and upper threshold. A4: 200 and 400.
    pub canny: [u16; 2],
    /// This part of the picture, from above, is not looked at. A4: half.
    pub crop_part: f64,
    /// What counts as a segment, in a picture 320 px wide: votes and lengths grow with the picture's width.
    pub segments: HoughOptions,
    /// How segments are given to left and right.
    pub sides: Sides,
    /// The part of the picture's width that is the left line's, and the right line's. A4: a third.
    pub side_part: f64,
    /// Largest change from frame to frame with two lines in sight (servo degrees). A4: 3.
    pub change_limit_deg: f64,
    /// The same with one line. A4: 1.
    pub one_line_change_limit_deg: f64,
    /// Full lock is this far from straight ahead (servo degrees). A2: 40..140.
    pub servo_range_deg: f64,
    /// What happens without a line: only `stop_after_m`, `transition_s` and `patience_s` count, the angle is always
    /// kept.
    pub loss: LossOptions,
}

impl Default for HoughDriverOptions {
    fn default() -> Self {
        Self {
            // A13: speed 20 of 100, which is 0.16 m/s of the kit car's 0.8.
            speed: SpeedOptions::constant(0.16),
            mask: Mask::default(),
            colours: vec![HsvRange {
                low: [150, 50, 120],
                high: [180, 255, 255],
            }],
            line_width_m: 0.02,
            canny: [200, 400],
            crop_part: 0.5,
            segments: HoughOptions::default(),
            sides: Sides::default(),
            side_part: 1.0 / 3.0,
            change_limit_deg: 3.0,
            one_line_change_limit_deg: 1.0,
            servo_range_deg: 50.0,
            loss: LossOptions::default(),
        }
    }
}

impl HoughDriverOptions {
    /// Another cruising speed (m/s), where one is given.
    pub fn set_speed(&mut self, speed_mps: Option<f64>) {
        self.speed.cruise_mps = speed_mps.unwrap_or(self.speed.cruise_mps);
    }

    fn validate(&self) -> Result<(), DriverError> {
        self.speed.validate()?;
        self.loss.validate()?;
        check("line_width_m", self.line_width_m, 0.001, 10.0)?;
        check("crop_part", self.crop_part, 0.0, 0.95)?;
        check("side_part", self.side_part, 0.0, 1.0)?;
        check("change_limit_deg", self.change_limit_deg, 0.0, 180.0)?;
        check(
            "one_line_change_limit_deg",
            self.one_line_change_limit_deg,
            0.0,
            180.0,
        )?;
        check("servo_range_deg", self.servo_range_deg, 1.0, 89.0)?;
        // Finer steps would need memory without end.
        check(
            "segments.distance_step_px",
            self.segments.distance_step_px,
            0.1,
            100.0,
        )?;
        check("segments.angle_step_rad", self.segments.angle_step_rad, 1e-3, 1.0)?;
        check("segments.votes", f64::from(self.segments.votes), 1.0, 1e6)
    }
}

/// Pictures smaller than this to a side show nothing (px).
const SMALLEST_SIDE_PX: usize = 16;

/// Steers by straight edges in the picture.
pub struct HoughDriver {
    body: Body,
    camera: senda_geom::Camera,
    options: HoughDriverOptions,
    eye: Option<EdgeEye>,
    view: Option<View>,
    last_stamp: Option<Stamp>,
    last_frame: Option<Stamp>,
    loss: Loss,
    segments: Vec<Segment>,
    lane: ScreenLane,
    /// The servo angle (°) that the lane asked for, and the one that is set.
    wanted_deg: Option<f64>,
    angle_deg: f64,
}

impl HoughDriver {
    /// For a vehicle; its first camera is used.
    pub fn new(body: &Body, options: HoughDriverOptions) -> Result<Self, DriverError> {
        options.validate()?;
        let camera = body.cameras.first().ok_or_else(|| DriverError::NoCamera {
            body: body.name.clone(),
        })?;
        Ok(Self {
            camera: camera.clone(),
            body: body.clone(),
            options,
            eye: None,
            view: None,
            last_stamp: None,
            last_frame: None,
            loss: Loss::default(),
            segments: Vec::new(),
            lane: ScreenLane::default(),
            wanted_deg: None,
            angle_deg: SERVO_STRAIGHT_DEG,
        })
    }

    /// All parameters, for the head of a log (C15).
    pub fn parameters(&self) -> toml::Table {
        crate::options::table(&self.options)
    }

    /// Whether it has found its lane.
    pub fn mode(&self) -> Mode {
        self.loss.mode()
    }

    /// Sees nothing.
    fn close(&mut self) {
        self.segments.clear();
        self.lane = ScreenLane::default();
        self.wanted_deg = None;
    }

    fn look(&mut self, image: &Image) {
        self.close();
        let (width, height) = (image.width(), image.height());
        if width < SMALLEST_SIDE_PX || height < SMALLEST_SIDE_PX {
            return;
        }
        let options = &self.options;
        let eye = match &mut self.eye {
            Some(eye) if eye.fits(width, height) => eye,
            other => other.insert(EdgeEye::new(width, height, &self.camera, options)),
        };
        if self.loss.mode() != Mode::Tracking {
            eye.doubt();
        }
        eye.look(image, options, &mut self.segments);
        let view = View {
            width_px: width as f64,
            top_px: eye.top() as f64,
            bottom_px: height as f64,
        };
        self.view = Some(view);
        self.lane = ScreenLane::from_segments(&self.segments, view, options.sides, options.side_part);
        // No line: the angle is kept.
        let Some(wanted_deg) = self.lane.servo_angle_deg(view) else {
            return;
        };
        self.wanted_deg = Some(wanted_deg);
        let range_deg = options.servo_range_deg;
        let possible_deg = wanted_deg.clamp(SERVO_STRAIGHT_DEG - range_deg, SERVO_STRAIGHT_DEG + range_deg);
        let limit_deg = if self.lane.lines() == 2 {
            options.change_limit_deg
        } else {
            options.one_line_change_limit_deg
        };
        self.angle_deg += (possible_deg - self.angle_deg).clamp(-limit_deg, limit_deg);
    }

    /// Part of full lock, left positive.
    fn lock_part(&self) -> f64 {
        (SERVO_STRAIGHT_DEG - self.angle_deg) / self.options.servo_range_deg
    }
}

impl Driver for HoughDriver {
    fn drive(&mut self, observation: &Observation) -> Command {
        let dt_s = match self.last_stamp {
            Some(last) => observation.stamp.since_s(last).clamp(0.0, 1.0),
            None => self.body.period_s.clamp(0.0, 1.0),
        };
        self.last_stamp = Some(observation.stamp);
        match observation
            .frame(&self.camera.name)
            .or_else(|| observation.first_frame())
        {
            // A frame that was seen already; those of recordings without times have 0 everywhere and are all new.
            Some(frame) if frame.stamp.ns != 0 && self.last_frame == Some(frame.stamp) => {}
            Some(frame) => {
                self.last_frame = Some(frame.stamp);
                self.look(&frame.image);
            }
            None => self.close(),
        }
        let speed = &self.options.speed;
        let found = self.lane.lines() > 0;
        let mode = self.loss.step(found, dt_s, speed.cruise_mps, &self.options.loss);
        if matches!(mode, Mode::NeverSeen | Mode::Stopped) {
            return Command::STOP;
        }
        let turn = turn_of_lock(&self.body, self.lock_part());
        let curvature_per_m = self.body.curvature_of(turn, speed.cruise_mps);
        Command {
            turn,
            drive: Drive::SpeedMps(speed.for_curvature(curvature_per_m)),
        }
    }

    fn explain(&self, explanation: &mut Explanation) {
        explanation.signal("angle_deg", self.angle_deg);
        explanation.signal("wanted_angle_deg", self.wanted_deg.unwrap_or(f64::NAN));
        explanation.signal("turn", self.lock_part());
        explanation.signal("lines", self.lane.lines() as f64);
        explanation.signal("segments", self.segments.len() as f64);
        explanation.signal("found", if self.lane.lines() > 0 { 1.0 } else { 0.0 });
        explanation.signal("mode", self.loss.mode().number());
        if let Some(event) = self.loss.event() {
            explanation.event(event);
        }
        let Some(view) = self.view else { return };
        for segment in &self.segments {
            let ends = [segment.from, segment.to].map(|[u, v]| [u as f32 + 0.5, v as f32 + 0.5]);
            explanation.polyline(ends, SEGMENT_COLOR, false);
        }
        let (top, bottom) = (view.top_px as f32, view.bottom_px as f32);
        let mut across = |near_px: f64, far_px: f64, color| {
            explanation.polyline([[near_px as f32, bottom], [far_px as f32, top]], color, false);
        };
        for ScreenLine { near_px, far_px } in [self.lane.left, self.lane.right].into_iter().flatten() {
            across(near_px, far_px, crate::helm::LINE_COLOR);
        }
        let heading_px = heading_px(view, self.angle_deg);
        across(0.5 * view.width_px, heading_px, crate::helm::REFUSED_COLOR);
    }

    fn is_done(&self) -> bool {
        self.loss.mode() == Mode::Stopped
    }
}

/// Segments as Hough found them.
const SEGMENT_COLOR: &str = "#ffdc00";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_vehicle::{car, gopigo};
    use senda_core::{Channels, Frame, Turn};

    const FLOOR: [u8; 3] = [180, 178, 170];
    const PINK: [u8; 3] = [226, 70, 142];
    const BLUE: [u8; 3] = [40, 80, 190];

    /// A picture with lines 14 px wide at 320x240, each from a column in the lowest row to one in the middle row.
    fn picture(width: usize, colour: [u8; 3], lines: &[[f64; 2]]) -> Image {
        let height = width * 3 / 4;
        let scale = width as f64 / 320.0;
        let mut image = Image::new(width, height, Channels::Rgb);
        for y in 0..height {
            let up = (height - y) as f64 / (height as f64 / 2.0);
            for (x, pixel) in image.row_mut(y).as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let on_line = lines.iter().any(|[near, far]| {
                    let middle = (near + up * (far - near)) * scale;
                    (x as f64 + 0.5 - middle).abs() < 7.0 * scale && up < 1.4
                });
                *pixel = if on_line { colour } else { FLOOR };
            }
        }
        image
    }

    /// Both lines of a lane seen from its middle, shifted.
    fn lane(shift: f64) -> Vec<[f64; 2]> {
        vec![[20.0 + shift, 80.0 + shift], [300.0 + shift, 240.0 + shift]]
    }

    fn driver(options: HoughDriverOptions) -> HoughDriver {
        HoughDriver::new(&car(), options).unwrap()
    }

    /// Shows a picture a number of times; the servo angle in the end.
    fn show(driver: &mut HoughDriver, image: &Image, times: usize) -> f64 {
        for _ in 0..times {
            let seen = Observation {
                stamp: Stamp::from_s(driver.last_stamp.map_or(0.05, Stamp::as_s) + 0.05),
                frames: vec![Frame {
                    image: image.clone(),
                    ..Frame::default()
                }],
                ..Observation::default()
            };
            driver.drive(&seen);
        }
        driver.angle_deg
    }

    #[test]
    fn a_lane_straight_ahead_keeps_the_wheels_straight() {
        let mut driver = driver(HoughDriverOptions::default());
        let angle_deg = show(&mut driver, &picture(320, PINK, &lane(0.0)), 20);
        assert!((angle_deg - 90.0).abs() < 1.0, "{angle_deg}");
        assert_eq!((driver.lane.lines(), driver.mode()), (2, Mode::Tracking));
    }

    #[test]
    fn a_lane_that_leads_left_turns_left_by_three_degrees_a_frame() {
        for (shift, sign) in [(-30.0, -1.0), (30.0, 1.0)] {
            let mut driver = driver(HoughDriverOptions::default());
            let image = picture(320, PINK, &lane(shift));
            assert!((show(&mut driver, &image, 1) - (90.0 + 3.0 * sign)).abs() < 1e-9);
            assert!((show(&mut driver, &image, 1) - (90.0 + 6.0 * sign)).abs() < 1e-9);
            // 30 columns in 120 rows: 14°.
            let angle_deg = show(&mut driver, &image, 20);
            assert!((angle_deg - (90.0 + 14.0 * sign)).abs() < 1.0, "{angle_deg}");
        }
    }

    #[test]
    fn one_line_turns_with_it_by_one_degree_a_frame() {
        let mut driver = driver(HoughDriverOptions::default());
        let right = picture(320, PINK, &lane(0.0)[1..]);
        assert!((show(&mut driver, &right, 4) - 86.0).abs() < 1e-9);
        // 60 columns in 120 rows: 26.6° to the left.
        let angle_deg = show(&mut driver, &right, 60);
        assert!((angle_deg - 63.4).abs() < 1.5, "{angle_deg}");
        assert_eq!(driver.lane.lines(), 1);
    }

    #[test]
    fn without_a_line_the_angle_is_kept_until_the_vehicle_stops() {
        let mut driver = driver(HoughDriverOptions::default());
        let turned_deg = show(&mut driver, &picture(320, PINK, &lane(-30.0)), 20);
        let nothing = picture(320, PINK, &[]);
        assert_eq!(show(&mut driver, &nothing, 20), turned_deg);
        assert_eq!(driver.mode(), Mode::Lost);
        // 35 cm at 16 cm/s.
        assert_eq!(show(&mut driver, &nothing, 30), turned_deg);
        assert!(driver.is_done());
    }

    #[test]
    fn full_lock_is_at_40_and_140_and_left_is_positive() {
        let mut car = driver(HoughDriverOptions::default());
        let image = picture(320, PINK, &[[60.0, -140.0]]);
        // Leans so far that it asks for less than 40°.
        let angle_deg = show(&mut car, &image, 100);
        assert!((40.0 - 1e-9..41.0).contains(&angle_deg), "{angle_deg}");
        let Turn::SteeringRad(angle_rad) = turn_of_lock(&car.body, car.lock_part()) else {
            panic!("a car is steered by its wheels");
        };
        assert!(angle_rad > 0.48 && angle_rad <= 0.5 + 1e-12, "{angle_rad}");
        let robot = HoughDriver::new(&gopigo(), HoughDriverOptions::default()).unwrap();
        assert!(matches!(turn_of_lock(&robot.body, 0.5), Turn::CurvaturePerM(left) if left > 0.0));
    }

    #[test]
    fn pictures_of_half_the_size_give_the_same_angle() {
        let angle_deg = |width| {
            show(
                &mut driver(HoughDriverOptions::default()),
                &picture(width, PINK, &lane(-20.0)),
                30,
            )
        };
        assert!((angle_deg(160) - angle_deg(320)).abs() < 1.5);
        assert!((angle_deg(640) - angle_deg(320)).abs() < 1.5);
    }

    #[test]
    fn other_colours_need_their_range_or_the_mask_by_local_contrast() {
        let blue = picture(320, BLUE, &lane(-30.0));
        let mut colour_blind = driver(HoughDriverOptions::default());
        assert_eq!(show(&mut colour_blind, &blue, 5), 90.0);
        assert_eq!(colour_blind.mode(), Mode::NeverSeen);
        let ranges: HoughDriverOptions = toml::from_str(
            "colours = [{ low = [20, 50, 50], high = [35, 255, 255] }, { low = [100, 50, 50], high = [130, 255, 255] }]",
        )
        .unwrap();
        assert!((show(&mut driver(ranges), &blue, 20) - 76.0).abs() < 1.0);
        let strength: HoughDriverOptions = toml::from_str("mask = \"strength\"").unwrap();
        for colour in [BLUE, PINK, [30, 30, 30], [240, 240, 240]] {
            let angle_deg = show(
                &mut driver(strength.clone()),
                &picture(320, colour, &lane(-30.0)),
                20,
            );
            assert!((angle_deg - 76.0).abs() < 2.5, "{colour:?} {angle_deg}");
        }
    }

    #[test]
    fn the_explanation_shows_segments_lines_and_heading() {
        let mut driver = driver(HoughDriverOptions::default());
        show(&mut driver, &picture(320, PINK, &lane(0.0)), 3);
        let mut explanation = Explanation::default();
        driver.explain(&mut explanation);
        assert_eq!(explanation.shapes.len(), driver.segments.len() + 3);
        assert!(driver.segments.len() >= 4, "{:?}", driver.segments);
        let value = |name: &str| {
            let signal = explanation.signals.iter().find(|signal| signal.name == name);
            signal.unwrap().value
        };
        assert_eq!((value("found"), value("lines")), (1.0, 2.0));
        assert_eq!(value("angle_deg"), driver.angle_deg);
    }

    #[test]
    fn options_out_of_range_are_refused_with_their_key() {
        for (toml, key) in [
            ("crop_part = 1.5", "crop_part"),
            ("[segments]\nangle_step_rad = 0.0", "segments.angle_step_rad"),
            ("servo_range_deg = nan", "servo_range_deg"),
        ] {
            let options: HoughDriverOptions = toml::from_str(toml).unwrap();
            let message = HoughDriver::new(&car(), options).err().unwrap().to_string();
            assert!(message.contains(key), "{message}");
        }
    }
}
