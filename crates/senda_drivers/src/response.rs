//! How late and how lazily a vehicle does what it is told, found while driving.

use crate::motion::CommandModel;
use senda_core::{Stamp, Truth};

/// Whether the steering swings from side to side with every step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Swing {
    last: f64,
    change: f64,
    times: u32,
}

impl Swing {
    /// A change by more than this part of full lock is a swing.
    const LARGE: f64 = 0.5;
    /// So many swings in a row, each against the one before, are no curves.
    const MANY: u32 = 4;

    /// Takes the next steering (part of full lock); true once too many swings followed each other.
    pub(crate) fn step(&mut self, steering: f64) -> bool {
        let change = steering - self.last;
        let swings = change.abs().min(self.change.abs()) > Self::LARGE && change * self.change < 0.0;
        self.times = if swings { self.times + 1 } else { 0 };
        (self.last, self.change) = (steering, change);
        let many = self.times >= Self::MANY;
        if many {
            self.times = 0;
        }
        many
    }
}

/// One guess at how the vehicle responds.
pub(crate) struct Model {
    pub(crate) delay_s: f64,
    pub(crate) lag_s: f64,
    pub(crate) motion: CommandModel,
    /// Mean squared difference between guessed and true yaw rate, forgetting over some seconds (rad²/s²).
    error: f64,
}

impl Model {
    /// How late the vehicle is by this guess, all in all (s).
    fn response_s(&self) -> f64 {
        self.delay_s + self.lag_s
    }
}

/// Guesses at delay and lag side by side; the one that explains the true yaw rate best is used.
pub(crate) struct ModelBank {
    models: Vec<Model>,
    best: usize,
}

/// Part of the old error that a step keeps: a memory of some 60 steps.
const ERROR_KEPT: f64 = 0.984;

impl ModelBank {
    /// Guesses within what a vehicle may be; what is known is not guessed.
    pub(crate) fn new(delay_s: Option<f64>, lag_s: Option<f64>) -> Self {
        let delays: Vec<f64> =
            delay_s.map_or_else(|| (0..=12).map(|i| 0.025 * f64::from(i)).collect(), |d| vec![d]);
        let lags: Vec<f64> =
            lag_s.map_or_else(|| vec![0.0, 0.04, 0.08, 0.12, 0.18, 0.25, 0.4], |lag| vec![lag]);
        let mut models = Vec::with_capacity(delays.len() * lags.len());
        for delay_s in &delays {
            for lag_s in &lags {
                models.push(Model {
                    delay_s: *delay_s,
                    lag_s: *lag_s,
                    motion: CommandModel::new(*delay_s, *lag_s),
                    error: 0.0,
                });
            }
        }
        // Until something is known: 0.1 s of delay and 0.08 s of lag, a toy's order of magnitude (guess).
        let best = models
            .iter()
            .enumerate()
            .min_by(|(_, a), (_, b)| {
                let distance = |m: &Model| (m.delay_s - 0.1).abs() + (m.lag_s - 0.08).abs();
                distance(a).total_cmp(&distance(b))
            })
            .map_or(0, |(index, _)| index);
        Self { models, best }
    }

    /// The guess that is used.
    pub(crate) fn best(&self) -> &Model {
        &self.models[self.best]
    }

    /// Gives up every guess that is at least half as slow as the present one, by which the steering swings from side to side.
    /// What the vehicle does would go on to speak for it: one that is swung follows hardly at all.
    pub(crate) fn distrust_slow(&mut self) {
        let slow_s = 0.5 * self.best().response_s();
        if self.models.iter().any(|model| model.response_s() < slow_s) {
            self.models.retain(|model| model.response_s() < slow_s);
            self.best = self.least_error();
        }
    }

    /// The guess with the least error, the first of equals.
    fn least_error(&self) -> usize {
        let errors = self.models.iter().enumerate();
        errors
            .min_by(|(_, a), (_, b)| a.error.total_cmp(&b.error))
            .map_or(0, |(index, _)| index)
    }

    /// Compares all guesses with what the vehicle did.
    pub(crate) fn observe(&mut self, stamp: Stamp, truth: &Truth) {
        for model in &mut self.models {
            model.motion.advance(stamp, None);
            let miss = model.motion.yaw_rate_radps() - truth.yaw_rate_radps;
            model.error = ERROR_KEPT * model.error + (1.0 - ERROR_KEPT) * miss * miss;
            // What is true now is the starting point of the next guess; only the response in between is judged.
            model.motion.correct(truth.speed_mps, truth.yaw_rate_radps);
        }
        let least = self.least_error();
        // Changing needs a clear gain: on a straight all guesses are equally good.
        if self.models[least].error < 0.8 * self.best().error - 1e-7 {
            self.best = least;
        }
    }

    /// Notes what the vehicle was told.
    pub(crate) fn command(&mut self, stamp: Stamp, speed_mps: f64, yaw_rate_radps: f64) {
        for model in &mut self.models {
            model.motion.command(stamp, speed_mps, yaw_rate_radps);
        }
    }
}
