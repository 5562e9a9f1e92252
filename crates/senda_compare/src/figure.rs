//! The figures that rows are compared by.

use crate::work::Offline;
use senda_eval::Summary;
use senda_eval::statistics::{Interval, mean};
use serde::Serialize;

/// A figure of a row trained with one seed. Smaller is better, but for those that say otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Figure {
    /// Mean distance to the middle of the road over its metres; road outside and undriven road count as outside (m).
    Lane,
    /// Mean distance to the middle of the road over the frames driven: B7 in SPEC to the letter (m).
    LaneMean,
    /// Largest one: B7 (m).
    LaneMax,
    /// Mean heading error over the road's metres, leaving punished (degrees).
    Heading,
    /// Mean heading error over the frames driven: B8 in SPEC to the letter (degrees).
    HeadingMean,
    /// Largest one: B8 (degrees).
    HeadingMax,
    /// Unsteadiness: root mean square of the change of the commanded yaw rate a second (rad/s²).
    Smoothness,
    /// RMSE of the steering against a human on laps never learned from (part of full lock).
    Rmse,
    /// The same on the laps that were learned from, as the document's authors measured it.
    RmseTraining,
    /// RMSE of the throttle on laps never learned from; none for rows that only steer.
    RmseThrottle,
    /// The same on the laps that were learned from.
    RmseThrottleTraining,
    /// NVIDIA's autonomy: per cent of the time that nobody would have had to take over, at 6 s for each time further than a metre
    /// from the middle.
    Autonomy,
    /// Part of the laps that were driven without leaving the road (per cent).
    Clean,
    /// Part of the lap that was driven when the run ended (per cent). A car that stands still leaves no road: autonomy,
    /// unsteadiness and first departures say something beside this one only.
    Driven,
    /// Time to the first departure; a lap without one counts with its length (s).
    FirstDeparture,
}

impl Figure {
    /// All.
    pub const ALL: [Self; 15] = [
        Self::Lane,
        Self::LaneMean,
        Self::LaneMax,
        Self::Heading,
        Self::HeadingMean,
        Self::HeadingMax,
        Self::Smoothness,
        Self::Rmse,
        Self::RmseTraining,
        Self::RmseThrottle,
        Self::RmseThrottleTraining,
        Self::Autonomy,
        Self::Clean,
        Self::Driven,
        Self::FirstDeparture,
    ];

    /// Its word in plans and results.
    pub fn word(self) -> &'static str {
        match self {
            Self::Lane => "lane",
            Self::LaneMean => "lane-mean",
            Self::LaneMax => "lane-max",
            Self::Heading => "heading",
            Self::HeadingMean => "heading-mean",
            Self::HeadingMax => "heading-max",
            Self::Smoothness => "smoothness",
            Self::Rmse => "rmse",
            Self::RmseTraining => "rmse-training",
            Self::RmseThrottle => "rmse-throttle",
            Self::RmseThrottleTraining => "rmse-throttle-training",
            Self::Autonomy => "autonomy",
            Self::Clean => "clean",
            Self::Driven => "driven",
            Self::FirstDeparture => "first-departure",
        }
    }

    /// By its word; the first one where none has it.
    pub fn named(word: &str) -> Self {
        Self::ALL
            .into_iter()
            .find(|figure| figure.word() == word)
            .unwrap_or(Self::Lane)
    }

    /// Heading of its column, with the unit.
    pub fn title(self) -> &'static str {
        match self {
            Self::Lane => "lane error, leaving punished (m)",
            Self::LaneMean => "lane mean (m)",
            Self::LaneMax => "lane max (m)",
            Self::Heading => "heading error, leaving punished (°)",
            Self::HeadingMean => "heading mean (°)",
            Self::HeadingMax => "heading max (°)",
            Self::Smoothness => "unsteadiness (rad/s²)",
            Self::Rmse => "RMSE, unseen laps",
            Self::RmseTraining => "RMSE, training laps",
            Self::RmseThrottle => "RMSE of throttle, unseen laps",
            Self::RmseThrottleTraining => "RMSE of throttle, training laps",
            Self::Autonomy => "autonomy (%)",
            Self::Clean => "laps on the road (%)",
            Self::Driven => "of the lap driven (%)",
            Self::FirstDeparture => "first departure after (s)",
        }
    }

    /// Decimals that tell something.
    pub fn decimals(self) -> usize {
        match self {
            Self::Rmse | Self::RmseTraining | Self::RmseThrottle | Self::RmseThrottleTraining => 4,
            Self::Lane | Self::LaneMean | Self::LaneMax | Self::Smoothness => 3,
            Self::Heading | Self::HeadingMean | Self::HeadingMax => 2,
            Self::Autonomy => 1,
            Self::Clean | Self::Driven | Self::FirstDeparture => 0,
        }
    }

    /// Whether larger is better.
    pub fn more_is_better(self) -> bool {
        matches!(
            self,
            Self::Autonomy | Self::Clean | Self::Driven | Self::FirstDeparture
        )
    }

    /// An interval without what the figure cannot be: none is below 0, no part above 100 %. One without ends stays so.
    pub fn possible(self, interval: Interval) -> Interval {
        let is_part = matches!(self, Self::Autonomy | Self::Clean | Self::Driven);
        let most = if is_part { 100.0 } else { f64::INFINITY };
        if interval.low.is_finite() {
            let (low, high) = (interval.low.max(0.0), interval.high.min(most));
            Interval {
                low,
                high,
                ..interval
            }
        } else {
            interval
        }
    }

    /// Its value for one lap; `None` where a lap has none.
    pub fn of_lap(self, lap: &Summary) -> Option<f64> {
        let other = &lap.other_means;
        match self {
            Self::Lane => lap.lane_error_mean_m,
            Self::LaneMean => other.lane_error_as_defined_m,
            Self::LaneMax => other.lane_error_max_as_defined_m,
            Self::Heading => lap.heading_error_mean_rad.map(f64::to_degrees),
            Self::HeadingMean => other.heading_error_as_defined_rad.map(f64::to_degrees),
            Self::HeadingMax => other.heading_error_max_as_defined_rad.map(f64::to_degrees),
            Self::Smoothness => lap.smoothness.command_change_radps2,
            Self::Autonomy => lap.autonomy.map(|part| 100.0 * part),
            Self::Clean => Some(if lap.completed { 100.0 } else { 0.0 }),
            Self::Driven => lap.completion.map(|part| 100.0 * part.min(1.0)),
            Self::FirstDeparture => Some(lap.first_departure_s.unwrap_or(lap.duration_s)),
            Self::Rmse | Self::RmseTraining | Self::RmseThrottle | Self::RmseThrottleTraining => None,
        }
    }

    /// Its value for a row trained with one seed: the mean over the laps, or the offline error.
    pub fn of(self, laps: &[Summary], offline: &Offline) -> Option<f64> {
        let named = |name: &str| offline.answers.iter().find(|answer| answer.name == name);
        match self {
            Self::Rmse => named("steering").map(|answer| answer.held_out),
            Self::RmseTraining => named("steering").map(|answer| answer.training),
            Self::RmseThrottle => named("throttle").map(|answer| answer.held_out),
            Self::RmseThrottleTraining => named("throttle").map(|answer| answer.training),
            _ => {
                let values: Option<Vec<f64>> = laps.iter().map(|lap| self.of_lap(lap)).collect();
                mean(&values?)
            }
        }
    }
}
