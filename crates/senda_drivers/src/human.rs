//! A person at the wheel, as far as laps for learning need one (B1 in SPEC): steers late and not quite straight, wanders
//! about the middle of the lane, and drives by throttle and brake.

use crate::expert::{ExpertDriver, ExpertOptions};
use crate::follow::FollowOptions;
use crate::options::{DriverError, check};
use crate::speed::SpeedOptions;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use senda_core::{Body, Command, Drive, Explanation, Observation, PrivilegedDriver, Stamp, Truth, Turn};
use senda_geom::{Curve, trig};
use serde::{Deserialize, Serialize};

/// Options of the person.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HumanOptions {
    /// Seed of everything that a person does not do on purpose. Left out: the run's.
    pub seed: u64,
    /// How fast on a straight, and how much slower in curves.
    pub speed: SpeedOptions,
    /// How hard it brakes before a curve (m/s²).
    pub braking_mps2: f64,
    /// Standard deviation of the place beside the path at which it aims (m).
    pub wander_m: f64,
    /// How long it aims there (s).
    pub wander_s: f64,
    /// Standard deviation of the unrest of the hands (part of full lock).
    pub unrest: f64,
    /// How long a hand stays off (s).
    pub unrest_s: f64,
    /// How patiently errors are corrected (s): the steering's settling time.
    pub settle_s: f64,
    /// Pedal per missing speed (1/(m/s)).
    pub pedal_per_mps: f64,
}

impl Default for HumanOptions {
    /// Measures by eye, from the steering of public recordings of the document's simulator: a deviation of about a decimetre
    /// or two, steering that trembles by one or two hundredths of full lock.
    fn default() -> Self {
        Self {
            seed: 1,
            speed: SpeedOptions {
                cruise_mps: 8.0,
                lateral_acceleration_mps2: 2.5,
                curve_yaw_rate_radps: 0.0,
                slowest_part: 0.4,
                acceleration_mps2: 1.8,
            },
            braking_mps2: 2.0,
            wander_m: 0.18,
            wander_s: 5.0,
            unrest: 0.015,
            unrest_s: 0.35,
            settle_s: 0.9,
            pedal_per_mps: 0.35,
        }
    }
}

impl HumanOptions {
    /// Another cruising speed (m/s), where one is given.
    pub fn set_speed(&mut self, speed_mps: Option<f64>) {
        self.speed.cruise_mps = speed_mps.unwrap_or(self.speed.cruise_mps);
    }

    fn validate(&self) -> Result<(), DriverError> {
        self.speed.validate()?;
        check("wander_m", self.wander_m, 0.0, 100.0)?;
        check("wander_s", self.wander_s, 0.01, 1000.0)?;
        check("unrest", self.unrest, 0.0, 1.0)?;
        check("unrest_s", self.unrest_s, 0.01, 1000.0)?;
        check("pedal_per_mps", self.pedal_per_mps, 0.001, 100.0)
    }
}

/// A value that drifts about 0 with a standard deviation and a time of memory (Ornstein and Uhlenbeck's process).
#[derive(Debug, Clone, Copy)]
struct Drift {
    std: f64,
    time_s: f64,
    value: f64,
}

impl Drift {
    fn step(&mut self, dt_s: f64, normal: f64) -> f64 {
        let kept = trig::exp(-dt_s / self.time_s);
        self.value = kept * self.value + self.std * (1.0 - kept * kept).max(0.0).sqrt() * normal;
        self.value
    }
}

/// The expert's eye with a person's hands and feet.
pub struct HumanDriver {
    expert: ExpertDriver,
    body: Body,
    options: HumanOptions,
    random: ChaCha8Rng,
    wander: Drift,
    unrest: Drift,
    last_stamp: Option<Stamp>,
    /// What the pedal needs to hold the speed, learned on the way.
    holding: f64,
    pedal: f64,
    steering: f64,
}

/// How fast what holds the speed is learned (1/s per m/s).
const HOLDING_PER_MPS_S: f64 = 0.08;
/// Time in which a foot follows (s).
const FOOT_S: f64 = 0.25;

impl HumanDriver {
    /// A person for a vehicle and the path that it follows, in driving direction.
    pub fn new(body: &Body, path: Curve, options: HumanOptions) -> Result<Self, DriverError> {
        options.validate()?;
        let expert = ExpertOptions {
            follow: FollowOptions {
                settle_s: options.settle_s,
                ..ExpertOptions::default().follow
            },
            speed: options.speed,
            braking_mps2: options.braking_mps2,
            ..ExpertOptions::default()
        };
        let drift = |std: f64, time_s: f64| Drift {
            std,
            time_s,
            value: 0.0,
        };
        Ok(Self {
            expert: ExpertDriver::new(body, path, expert)?,
            body: body.clone(),
            random: ChaCha8Rng::seed_from_u64(options.seed),
            wander: drift(options.wander_m, options.wander_s),
            unrest: drift(options.unrest, options.unrest_s),
            last_stamp: None,
            holding: 0.0,
            pedal: 0.0,
            steering: 0.0,
            options,
        })
    }

    /// A standard normal number (Box and Muller).
    fn normal(&mut self) -> f64 {
        let mut part = || ((self.random.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
        let (radius, turn) = ((-2.0 * trig::log(part())).sqrt(), part());
        radius * trig::cos(2.0 * std::f64::consts::PI * turn)
    }

    /// The foot: more pedal while too slow, less while too fast.
    fn push_pedal(&mut self, wanted_mps: f64, speed_mps: f64, dt_s: f64) -> f64 {
        let missing_mps = wanted_mps - speed_mps;
        let wish = self.options.pedal_per_mps * missing_mps + self.holding;
        if wish.abs() < 1.0 {
            self.holding = (self.holding + HOLDING_PER_MPS_S * missing_mps * dt_s).clamp(-0.2, 0.8);
        }
        let wish = if wanted_mps <= 0.0 {
            -1.0
        } else {
            wish.clamp(-1.0, 1.0)
        };
        self.pedal += (wish - self.pedal) * (1.0 - trig::exp(-dt_s / FOOT_S));
        self.pedal
    }
}

impl PrivilegedDriver for HumanDriver {
    fn drive_knowing(&mut self, observation: &Observation, truth: &Truth) -> Command {
        let dt_s = self.last_stamp.map_or(self.body.period_s, |last| {
            observation.stamp.since_s(last).clamp(0.0, 1.0)
        });
        self.last_stamp = Some(observation.stamp);
        let (aim, hand) = (self.normal(), self.normal());
        let aim_m = self.wander.step(dt_s, aim);
        let unrest = self.unrest.step(dt_s, hand);
        self.expert.aim_beside(aim_m);
        let wish = self.expert.drive_knowing(observation, truth);
        let wanted_mps = self.body.speed_of(&wish);
        let lock_rad = crate::neural::lock_rad(&self.body);
        let wanted_rad = self.body.steering_of(wish.turn, wanted_mps);
        let steering_rad = (wanted_rad + unrest * lock_rad).clamp(-lock_rad, lock_rad);
        self.steering = steering_rad / lock_rad;
        let pedal = self.push_pedal(wanted_mps, truth.speed_mps, dt_s);
        // What was really done, so that the expert learns the vehicle's response and not the hand's.
        self.expert.executed(&Command::steering(steering_rad, wanted_mps));
        Command {
            turn: Turn::SteeringRad(steering_rad),
            drive: Drive::Throttle(pedal),
        }
    }

    fn explain(&self, explanation: &mut Explanation) {
        self.expert.explain(explanation);
        explanation.signal("aim_m", self.wander.value);
        explanation.signal(Explanation::PEDAL, self.pedal);
        explanation.signal("steering", self.steering);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drift_has_its_spread_and_memory() {
        let mut drift = Drift {
            std: 0.2,
            time_s: 2.0,
            value: 0.0,
        };
        let mut person = HumanDriver::new(
            &crate::test_vehicle::car(),
            Curve::from_points(&[senda_geom::Vec2::ZERO, senda_geom::Vec2::new(9.0, 0.0)], false).unwrap(),
            HumanOptions::default(),
        )
        .unwrap();
        let (mut squares, mut products, mut last) = (0.0, 0.0, 0.0);
        let count = 40_000;
        for _ in 0..count {
            let value = drift.step(0.1, person.normal());
            squares += value * value;
            products += value * last;
            last = value;
        }
        let std = (squares / f64::from(count)).sqrt();
        assert!((std - 0.2).abs() < 0.02, "{std}");
        // exp(-0.1 / 2)
        assert!(
            (products / squares - 0.951).abs() < 0.01,
            "{}",
            products / squares
        );
    }

    #[test]
    fn nonsense_is_refused() {
        let path =
            Curve::from_points(&[senda_geom::Vec2::ZERO, senda_geom::Vec2::new(9.0, 0.0)], false).unwrap();
        let options = HumanOptions {
            wander_m: f64::NAN,
            ..HumanOptions::default()
        };
        let error = HumanDriver::new(&crate::test_vehicle::car(), path, options)
            .err()
            .unwrap();
        assert!(error.to_string().contains("wander_m"), "{error}");
    }
}
