//! Figures of a drive, as pure functions of what was recorded.
//!
//! Three rules hold for every headline figure:
//! 1. **A metre of road counts once**, when it is first reached. Standing still, shuttling back and forth or driving
//!    the good part twice changes no mean.
//! 2. **Leaving the corridor never improves a figure.** Outside, the distance counts as it is (at least the corridor's
//!    half width), the heading error at least 90°; the lap does not count; and the road that was not driven, because the
//!    run ended before its goal, counts as driven outside.
//! 3. **Errors are taken from the true pose**, not from what the driver believes.
//!
//! Beside them stand the same figures as document B defines them (B7, B8 in SPEC: per frame, nothing punished), so that
//! published tables can be compared.

mod drive;
mod losses;
mod smoothness;
mod speed;

pub use crate::summary::Summary;
pub use drive::{ErrorFigures, Metrics, Trace, measure, trace};
pub use losses::{LOSS_S, Losses, losses};
pub use smoothness::{Motion, Smoothness, smoothness};

use senda_geom::Curve;
use senda_world::World;

/// What is to be driven: the yardstick of a run.
#[derive(Debug, Clone, Copy)]
pub struct Course<'a> {
    /// The path that the vehicle should follow, in driving direction.
    pub path: &'a Curve,
    /// Largest offset from the path that still counts as on the road (m).
    pub corridor_half_width_m: f64,
    /// Station where a lap begins, 0 per cent (m).
    pub start_station_m: f64,
    /// How many laps were to be driven. On an open path any number means: to its end. `None`: no goal, as in a run that
    /// lasts a given time or was interrupted by hand; then nothing is missing at its end.
    pub laps: Option<f64>,
    /// How far before the end of an open path the goal is (m): there a camera already sees past the end.
    pub open_end_m: f64,
}

impl<'a> Course<'a> {
    /// The course that a world lays out, for a number of laps (see [`Course::laps`]): at most one on an open path.
    pub fn of(world: &'a World, laps: Option<f64>) -> Self {
        Self {
            path: &world.path,
            corridor_half_width_m: world.corridor_half_width_m,
            start_station_m: world.start_station_m,
            laps: laps.map(|laps| {
                if world.path.is_closed() {
                    laps
                } else {
                    laps.min(1.0)
                }
            }),
            open_end_m: 0.0,
        }
    }

    /// Per cent of the lap (0..100) at a station (m). On an open path: of its length.
    pub fn percent_at(&self, station_m: f64) -> f64 {
        let length_m = self.path.length_m();
        if self.path.is_closed() {
            100.0 * self.path.normalise_station(station_m - self.start_station_m) / length_m
        } else {
            100.0 * station_m.clamp(0.0, length_m) / length_m
        }
    }

    /// Road to be driven from a first station (m); `None` without a goal.
    fn goal_m(&self, first_station_m: f64) -> Option<f64> {
        let laps = self.laps?;
        Some(if self.path.is_closed() {
            laps.max(0.0) * self.path.length_m()
        } else {
            (self.path.length_m() - self.open_end_m - first_station_m).max(0.0)
        })
    }
}
