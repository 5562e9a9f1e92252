//! A person at the wheel (A1 and A2 in SPEC): keys or a wheel's axes become a servo angle and a speed.
//!
//! ```
//! use senda_drivers::manual::{Key, Input, ManualOptions, Wheel};
//! let mut wheel = Wheel::new(ManualOptions::default()).unwrap();
//! wheel.feel(Input::Key(Key::Go));
//! wheel.feel(Input::Key(Key::Left));
//! assert_eq!((wheel.angle_deg(), wheel.speed_mps()), (87.0, 0.16));
//! wheel.feel(Input::Lost); // the keyboard is gone: stand
//! assert_eq!(wheel.speed_mps(), 0.0);
//! ```
//!
//! What the person does reaches the driver through [`Hands`]: a terminal, a gamepad, or a script ([`KeyScript`]). When the
//! hands are lost, the vehicle stops and does not go again.

use crate::hough_lanes::SERVO_STRAIGHT_DEG;
use crate::neural::turn_of_lock;
use crate::options::{DriverError, check};
use senda_core::{Body, Command, Drive, Driver, Explanation, Observation, Stamp};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Servo degrees from straight on to full lock (A2: 40..140).
const FULL_LOCK_DEG: f64 = 50.0;
/// One press of faster or slower (m/s): an eighth of A4's vehicle's usual speed (guess).
const SPEED_STEP_MPS: f64 = 0.02;
/// A person who has quit or is lost leaves a vehicle that is told to stand for so long (s) before the run ends, so that it
/// does stand: longer than any vehicle here needs to brake.
const STANDING_S: f64 = 0.5;

/// What a key means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Key {
    /// One step further to the left.
    Left,
    /// One step further to the right.
    Right,
    /// Wheels straight.
    Straight,
    /// Drive.
    Go,
    /// Stand.
    Stop,
    /// A little faster.
    Faster,
    /// A little slower.
    Slower,
    /// Stop and end the run.
    Quit,
}

impl Key {
    /// All, with their names in scripts.
    pub const ALL: [(&'static str, Self); 8] = [
        ("left", Self::Left),
        ("right", Self::Right),
        ("straight", Self::Straight),
        ("go", Self::Go),
        ("stop", Self::Stop),
        ("faster", Self::Faster),
        ("slower", Self::Slower),
        ("quit", Self::Quit),
    ];
}

/// What a person does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Input {
    /// Pressed a key.
    Key(Key),
    /// Turned a wheel or stick: part of full lock, left positive.
    Steering(f64),
    /// Moved a pedal or trigger: part of the cruising speed, 0 to 1.
    Pedal(f64),
    /// Is gone: the keyboard's stream has ended, the gamepad was pulled out, the program was interrupted.
    Lost,
}

/// Options of a person's driving.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ManualOptions {
    /// Change of the angle by one press (servo degrees). A2: 1 to 5, usually 3.
    pub step_deg: f64,
    /// Speed after `go` (m/s). As the other drivers of document A.
    pub cruise_mps: f64,
    /// Part of an axis' way around its middle that counts as the middle: worn sticks do not come back to it.
    pub dead_zone: f64,
}

impl Default for ManualOptions {
    fn default() -> Self {
        Self {
            step_deg: 3.0,
            cruise_mps: 0.16,
            dead_zone: 0.08,
        }
    }
}

impl ManualOptions {
    /// Replaces the cruising speed (m/s).
    pub fn set_speed(&mut self, speed_mps: Option<f64>) {
        self.cruise_mps = speed_mps.unwrap_or(self.cruise_mps);
    }

    fn validate(&self) -> Result<(), DriverError> {
        check("step_deg", self.step_deg, 1.0, 5.0)?;
        check("cruise_mps", self.cruise_mps, 0.01, 60.0)?;
        check("dead_zone", self.dead_zone, 0.0, 0.5)
    }
}

/// Where wheel and pedal stand.
#[derive(Debug, Clone, PartialEq)]
pub struct Wheel {
    options: ManualOptions,
    angle_deg: f64,
    cruise_mps: f64,
    pedal: f64,
    end: Option<&'static str>,
}

impl Wheel {
    /// Straight on and standing.
    pub fn new(options: ManualOptions) -> Result<Self, DriverError> {
        options.validate()?;
        Ok(Self {
            angle_deg: SERVO_STRAIGHT_DEG,
            cruise_mps: options.cruise_mps,
            pedal: 0.0,
            end: None,
            options,
        })
    }

    /// The servo angle (degrees): 90 straight on, smaller is left, 40 to 140 (A2).
    pub fn angle_deg(&self) -> f64 {
        self.angle_deg
    }

    /// The speed asked for (m/s).
    pub fn speed_mps(&self) -> f64 {
        self.pedal * self.cruise_mps
    }

    /// Why the drive is over, once it is.
    pub fn end(&self) -> Option<&'static str> {
        self.end
    }

    /// One thing that the person did. After quitting or being lost nothing counts any more. Numbers that are none are not felt.
    pub fn feel(&mut self, input: Input) {
        if self.end.is_some() {
            return;
        }
        match input {
            Input::Key(Key::Left) => self.turn_to(self.angle_deg - self.options.step_deg),
            Input::Key(Key::Right) => self.turn_to(self.angle_deg + self.options.step_deg),
            Input::Key(Key::Straight) => self.turn_to(SERVO_STRAIGHT_DEG),
            Input::Key(Key::Go) => self.pedal = 1.0,
            Input::Key(Key::Stop) => self.pedal = 0.0,
            Input::Key(Key::Faster) => self.cruise_mps = (self.cruise_mps + SPEED_STEP_MPS).min(60.0),
            Input::Key(Key::Slower) => {
                self.cruise_mps = (self.cruise_mps - SPEED_STEP_MPS).max(SPEED_STEP_MPS);
            }
            Input::Key(Key::Quit) => self.stop("the person has ended the drive"),
            Input::Lost => self.stop("nobody is at the wheel any more"),
            Input::Steering(part) if part.is_finite() => {
                self.turn_to(SERVO_STRAIGHT_DEG - FULL_LOCK_DEG * self.beyond_dead_zone(part));
            }
            Input::Pedal(part) if part.is_finite() => {
                self.pedal = self.beyond_dead_zone(part).clamp(0.0, 1.0);
            }
            Input::Steering(_) | Input::Pedal(_) => {}
        }
    }

    fn turn_to(&mut self, angle_deg: f64) {
        self.angle_deg = angle_deg.clamp(
            SERVO_STRAIGHT_DEG - FULL_LOCK_DEG,
            SERVO_STRAIGHT_DEG + FULL_LOCK_DEG,
        );
    }

    fn stop(&mut self, why: &'static str) {
        self.pedal = 0.0;
        self.end = Some(why);
    }

    /// 0 within the dead zone, from there evenly up to ±1.
    fn beyond_dead_zone(&self, part: f64) -> f64 {
        let dead = self.options.dead_zone;
        let beyond = (part.abs().min(1.0) - dead).max(0.0) / (1.0 - dead);
        beyond.copysign(part)
    }
}

/// Whoever holds the wheel.
pub trait Hands: Send {
    /// Called once a step, before the command is decided: shows the person what there is to see, waits until it is time for
    /// this step where a person needs time, and adds what was done since the last one.
    fn step(&mut self, observation: &Observation, wheel: &Wheel, inputs: &mut Vec<Input>);
}

/// A driver that does what hands do.
pub struct ManualDriver {
    body: Body,
    wheel: Wheel,
    hands: Box<dyn Hands>,
    inputs: Vec<Input>,
    standing_since: Option<Stamp>,
    now: Stamp,
    event: Option<&'static str>,
}

impl ManualDriver {
    /// Hands at the wheel of a vehicle.
    pub fn new(body: &Body, options: ManualOptions, hands: Box<dyn Hands>) -> Result<Self, DriverError> {
        Ok(Self {
            body: body.clone(),
            wheel: Wheel::new(options)?,
            hands,
            inputs: Vec::new(),
            standing_since: None,
            now: Stamp::default(),
            event: None,
        })
    }
}

impl Driver for ManualDriver {
    fn drive(&mut self, observation: &Observation) -> Command {
        self.now = observation.stamp;
        self.inputs.clear();
        self.hands.step(observation, &self.wheel, &mut self.inputs);
        let had_ended = self.wheel.end().is_some();
        for input in &self.inputs {
            self.wheel.feel(*input);
        }
        self.event = self.wheel.end().filter(|_| !had_ended);
        if self.wheel.end().is_some() {
            self.standing_since.get_or_insert(self.now);
        }
        let lock_part = (SERVO_STRAIGHT_DEG - self.wheel.angle_deg()) / FULL_LOCK_DEG;
        Command {
            // Also while standing: A3's label is the angle of that instant.
            turn: turn_of_lock(&self.body, lock_part),
            drive: Drive::SpeedMps(self.wheel.speed_mps().min(self.body.speed_limit_mps)),
        }
    }

    fn explain(&self, explanation: &mut Explanation) {
        explanation.signal("angle_deg", self.wheel.angle_deg());
        explanation.signal("speed_mps", self.wheel.speed_mps());
        if let Some(event) = self.event {
            explanation.event(event);
        }
    }

    fn is_done(&self) -> bool {
        self.standing_since
            .is_some_and(|since| self.now.since_s(since) >= STANDING_S)
    }
}

/// Keys with their times, from a file: a demonstration that can be repeated. After the last one the hands are gone.
///
/// One key a line, time first (s since the run began, not decreasing): `1.25 left`. What follows a `#` is a remark.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyScript {
    keys: Vec<(Stamp, Key)>,
    next: usize,
}

/// A line of a [`KeyScript`] that is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{name}:{line}: expected {expected}, but found `{found}`")]
pub struct KeyScriptError {
    /// The file's name.
    pub name: String,
    /// Which line, from 1.
    pub line: usize,
    /// What was expected.
    pub expected: String,
    /// What was found.
    pub found: String,
}

impl KeyScript {
    /// Reads a script. `name` is only for messages.
    pub fn parse(name: &str, text: &str) -> Result<Self, KeyScriptError> {
        let mut keys: Vec<(Stamp, Key)> = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            let wrong = |expected: String| KeyScriptError {
                name: name.to_owned(),
                line: index + 1,
                expected,
                found: line.to_owned(),
            };
            let (time, word) = line
                .split_once(char::is_whitespace)
                .ok_or_else(|| wrong("a time and a key, such as `1.25 left`".into()))?;
            // A day: longer than any battery, and far from where nanoseconds overflow.
            let time_s: f64 = time
                .parse()
                .ok()
                .filter(|time_s| (0.0..=86_400.0).contains(time_s))
                .ok_or_else(|| wrong("a time from 0 to 86400 s".into()))?;
            let key = Key::ALL
                .iter()
                .find(|(known, _)| *known == word.trim())
                .map(|(_, key)| *key)
                .ok_or_else(|| wrong(format!("one of {}", Key::ALL.map(|(name, _)| name).join(", "))))?;
            let stamp = Stamp::from_s(time_s);
            if keys.last().is_some_and(|(before, _)| *before > stamp) {
                return Err(wrong("a time that is not before the line above".into()));
            }
            keys.push((stamp, key));
        }
        Ok(Self { keys, next: 0 })
    }
}

impl Hands for KeyScript {
    fn step(&mut self, observation: &Observation, _wheel: &Wheel, inputs: &mut Vec<Input>) {
        while let Some((stamp, key)) = self.keys.get(self.next) {
            if *stamp > observation.stamp {
                return;
            }
            inputs.push(Input::Key(*key));
            self.next += 1;
        }
        inputs.push(Input::Lost);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_vehicle;
    use proptest::prelude::*;

    fn wheel() -> Wheel {
        Wheel::new(ManualOptions::default()).unwrap()
    }

    #[test]
    fn keys_turn_by_a_step_left_is_smaller_and_limits_hold() {
        let mut wheel = wheel();
        wheel.feel(Input::Key(Key::Left));
        assert_eq!(wheel.angle_deg(), 87.0);
        for _ in 0..40 {
            wheel.feel(Input::Key(Key::Left));
        }
        assert_eq!(wheel.angle_deg(), 40.0);
        for _ in 0..80 {
            wheel.feel(Input::Key(Key::Right));
        }
        assert_eq!(wheel.angle_deg(), 140.0);
        wheel.feel(Input::Key(Key::Straight));
        assert_eq!(wheel.angle_deg(), 90.0);
    }

    #[test]
    fn steps_of_one_to_five_degrees_are_taken_and_others_refused() {
        let of = |step_deg| {
            Wheel::new(ManualOptions {
                step_deg,
                ..ManualOptions::default()
            })
        };
        assert!(of(1.0).is_ok() && of(5.0).is_ok());
        for wrong in [0.5, 6.0, f64::NAN] {
            assert!(of(wrong).unwrap_err().to_string().contains("step_deg"));
        }
    }

    #[test]
    fn it_stands_until_told_to_go() {
        let mut wheel = wheel();
        assert_eq!(wheel.speed_mps(), 0.0);
        wheel.feel(Input::Key(Key::Go));
        wheel.feel(Input::Key(Key::Faster));
        assert!((wheel.speed_mps() - 0.18).abs() < 1e-12);
        for _ in 0..50 {
            wheel.feel(Input::Key(Key::Slower));
        }
        assert!(wheel.speed_mps() > 0.0);
        wheel.feel(Input::Key(Key::Stop));
        assert_eq!(wheel.speed_mps(), 0.0);
    }

    #[test]
    fn after_being_lost_or_quitting_nothing_moves_it_again() {
        for end in [Input::Lost, Input::Key(Key::Quit)] {
            let mut wheel = wheel();
            wheel.feel(Input::Key(Key::Go));
            wheel.feel(end);
            for after in [Input::Key(Key::Go), Input::Pedal(1.0), Input::Steering(1.0)] {
                wheel.feel(after);
            }
            assert_eq!((wheel.speed_mps(), wheel.angle_deg()), (0.0, 90.0));
            assert!(wheel.end().is_some());
        }
    }

    #[test]
    fn an_axis_to_the_left_is_a_smaller_angle_and_its_middle_is_dead() {
        let mut wheel = wheel();
        wheel.feel(Input::Steering(0.07));
        assert_eq!(wheel.angle_deg(), 90.0);
        wheel.feel(Input::Steering(1.0));
        assert_eq!(wheel.angle_deg(), 40.0);
        wheel.feel(Input::Steering(-0.54));
        assert!((wheel.angle_deg() - 115.0).abs() < 1e-9);
        wheel.feel(Input::Steering(f64::NAN));
        assert!((wheel.angle_deg() - 115.0).abs() < 1e-9);
        wheel.feel(Input::Pedal(0.05));
        assert_eq!(wheel.speed_mps(), 0.0);
        wheel.feel(Input::Pedal(-1.0));
        assert_eq!(wheel.speed_mps(), 0.0);
    }

    #[test]
    fn scripts_press_keys_in_time_and_then_the_vehicle_stops_and_the_drive_is_over() {
        let script = KeyScript::parse("keys", "0 go # away\n\n0.1 left\n0.1 left\n0.30 straight\n").unwrap();
        let body = test_vehicle::gopigo();
        let mut driver = ManualDriver::new(&body, ManualOptions::default(), Box::new(script)).unwrap();
        let mut seen = Vec::new();
        for number in 0..40 {
            let observation = Observation {
                stamp: Stamp::from_ns(number * 50_000_000),
                ..Observation::default()
            };
            let command = driver.drive(&observation);
            seen.push((driver.wheel.angle_deg(), body.speed_of(&command)));
            if driver.is_done() {
                break;
            }
        }
        assert_eq!(seen[0], (90.0, 0.16));
        assert_eq!(seen[2], (84.0, 0.16));
        // The last key and the end of the script come together: it stands, and half a second later the drive is over.
        assert_eq!(seen[6], (90.0, 0.0));
        assert_eq!(seen.len(), 17);
    }

    #[test]
    fn mistakes_in_scripts_are_named_with_their_line() {
        let refused = |text: &str| KeyScript::parse("keys", text).unwrap_err().to_string();
        assert!(refused("0 go\n1 jump").contains("keys:2: expected one of left"));
        assert!(refused("soon go").contains("expected a time"));
        assert!(refused("NaN go").contains("expected a time"));
        assert!(refused("go").contains("`1.25 left`"));
        assert!(refused("2 go\n1 stop").contains("not before"));
    }

    proptest! {
        #[test]
        fn any_script_is_taken_or_refused(text in "[0-9a-z #.\\n-]{0,80}") {
            let _ = KeyScript::parse("keys", &text);
        }

        #[test]
        fn whatever_hands_do_the_angle_stays_within_40_and_140(
            inputs in proptest::collection::vec((0..10usize, -2.0..2.0f64), 0..60),
        ) {
            let mut wheel = wheel();
            for (kind, part) in inputs {
                wheel.feel(match kind {
                    8 => Input::Steering(part),
                    9 => Input::Pedal(part),
                    key => Input::Key(Key::ALL[key].1),
                });
                prop_assert!((40.0..=140.0).contains(&wheel.angle_deg()));
                prop_assert!(wheel.speed_mps() >= 0.0);
            }
        }
    }
}
