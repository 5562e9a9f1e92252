//! Where the vehicle was relative to the road: lane error, heading error, laps, departures.

use super::Course;
use crate::statistics::mean;
use senda_core::Truth;
use senda_geom::{Place, Pose2, Tracker, angle, trig};
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// A vehicle that left is back once its offset is below this part of the corridor's half width: without it, driving along
/// the border would count many departures. A guess.
const BACK_INSIDE: f64 = 0.9;

/// Displacements shorter than this have no reliable direction (m); the vehicle's own heading stands for it. A guess: a
/// vehicle at 2 cm/s and 20 frames a second moves by this much.
const SHORTEST_DISPLACEMENT_M: f64 = 1e-3;

/// A run that begins outside the corridor must come in within this many half widths of road. A guess; C16's start, 21.5 cm
/// off, needs three.
const APPROACH_HALF_WIDTHS: f64 = 10.0;

/// NVIDIA's car was taken over when it was this far from the middle of its lane (m; Bojarski et al. 2016, section 7.1), or out of
/// the corridor where that is narrower.
const INTERVENTION_M: f64 = 1.0;

/// What each intervention costs (s): the time to take over, bring the car back and hand over again; the same source.
const INTERVENTION_S: f64 = 6.0;

/// A lap or goal counts when its end is this near (m): where exactly a run is stopped is up to one frame anyway.
const GOAL_TOLERANCE_M: f64 = 0.01;

/// A drive as columns, one row a frame: what the plots show.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Time since the run began (s).
    pub time_s: Vec<f64>,
    /// Station on the path (m), within one lap.
    pub station_m: Vec<f64>,
    /// Road gained since the first row (m); driving backwards subtracts, laps add up.
    pub progress_m: Vec<f64>,
    /// Per cent of the lap (0..100), see [`Course::percent_at`].
    pub percent: Vec<f64>,
    /// Distance from the path (m), left positive: B7 in SPEC with a sign.
    pub offset_m: Vec<f64>,
    /// Direction of the displacement since the row before, minus the road's direction (rad, left positive): B8 in SPEC
    /// with a sign.
    pub heading_error_rad: Vec<f64>,
    /// Whether the vehicle counted as inside the corridor. False from a departure until it is well inside again. A run may
    /// begin outside: the rows until it first comes in count as inside, unless that takes too much road.
    pub inside: Vec<bool>,
    /// True forward speed (m/s).
    pub speed_mps: Vec<f64>,
    /// First row at which the goal was reached. Later rows count in no figure.
    pub finished_at: Option<usize>,
    /// Road that was to be driven (m); `None` without a goal.
    pub goal_m: Option<f64>,
}

impl Trace {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    fn push(
        &mut self,
        course: &Course,
        truth: &Truth,
        place: Place,
        progress_m: f64,
        heading_error_rad: f64,
        inside: bool,
    ) {
        self.time_s.push(truth.stamp.as_s());
        self.station_m.push(place.station_m);
        self.progress_m.push(progress_m);
        self.percent.push(course.percent_at(place.station_m));
        self.offset_m.push(place.offset_m);
        self.heading_error_rad.push(heading_error_rad);
        self.inside.push(inside);
        self.speed_mps.push(truth.speed_mps);
    }

    /// Number of rows that count: up to and including the one at which the goal was reached.
    fn counted(&self) -> usize {
        self.finished_at.map_or(self.len(), |row| row + 1)
    }
}

/// An error's figures. Metres or radians, never negative.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ErrorFigures {
    /// Mean over the road: every metre counts once, undriven road counts as driven outside. The headline.
    pub mean: f64,
    /// Largest value; leaving the corridor counts at least its half width (or 90°).
    pub max: f64,
    /// Mean over time, with the undriven road at the mean speed.
    pub mean_over_time: f64,
    /// Mean over frames as B7 and B8 define it: nothing punished, nothing missing.
    pub mean_as_defined: f64,
    /// Largest value as B7 and B8 define it.
    pub max_as_defined: f64,
}

/// What [`measure`] finds.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Metrics {
    /// Whether the goal was reached without ever leaving the corridor. False without a goal.
    pub completed: bool,
    /// Part of the road to be driven that was driven inside the corridor (0..=1); `None` without a goal.
    pub completion: Option<f64>,
    /// Whole laps driven without leaving the corridor; on an open path 1 for reaching its end.
    pub laps: u32,
    /// Time of each of those laps (s).
    pub lap_times_s: Vec<f64>,
    /// How often the vehicle left the corridor.
    pub departures: u32,
    /// When it first left (s since the first frame).
    pub first_departure_s: Option<f64>,
    /// Where it first left (per cent of lap).
    pub first_departure_percent: Option<f64>,
    /// How often a person would have taken over: further than a metre from the path, or out of the corridor.
    pub interventions: u32,
    /// NVIDIA's autonomy (0..=1): 1 - interventions · 6 s / time. A run that ends where it leaves the road has no second
    /// intervention: read it beside the completion. `None` without time.
    pub autonomy: Option<f64>,
    /// Distance from the path (m); `None` without a single true pose.
    pub lane_error: Option<ErrorFigures>,
    /// Heading error (rad); `None` without a single true pose.
    pub heading_error: Option<ErrorFigures>,
    /// Distance driven (m), whatever its direction.
    pub distance_m: f64,
    /// Road gained at the furthest point (m).
    pub progress_m: f64,
    /// Road driven backwards (m).
    pub reversed_m: f64,
    /// Time from the first frame to the last that counts (s).
    pub duration_s: f64,
    /// Distance driven over time (m/s).
    pub mean_speed_mps: f64,
    /// Mean speed (m/s) on the straightest quarter of the time and on the most curved one, but for the first 2 s; `None` where the road
    /// has no such parts.
    pub speed_by_curvature_mps: Option<[f64; 2]>,
    /// Frames that count.
    pub frames: u64,
}

/// Follows the true poses along the course: one row for each, in order.
pub fn trace(course: &Course, truths: &[Truth]) -> Trace {
    let mut rows = Trace::default();
    if truths.is_empty() {
        return rows;
    }
    let first = truths
        .iter()
        .map(|truth| truth.world_from_vehicle)
        .find(is_a_place);
    let point = first
        .unwrap_or_else(|| course.path.pose_at(course.start_station_m))
        .position();
    // Where the path comes by twice, the branch of the starting line is meant.
    let anywhere = course.path.project(point);
    let at_start = course.path.project_near(point, course.start_station_m, 1.0);
    let begin = if at_start.offset_m.abs() <= anywhere.offset_m.abs() + 1e-6 {
        at_start
    } else {
        anywhere
    };
    let goal_m = course.goal_m(begin.station_m);
    rows.goal_m = goal_m;

    let mut tracker = Tracker::new(begin.station_m);
    let half_width_m = course.corridor_half_width_m;
    let (mut inside, mut approaching) = (true, true);
    let mut before: Option<(senda_geom::Vec2, f64)> = None;
    for truth in truths {
        let pose = truth.world_from_vehicle;
        if !is_a_place(&pose) {
            // Nobody knows where it is: outside, and no further than before.
            inside = false;
            let station_m = rows.station_m.last().copied().unwrap_or(begin.station_m);
            rows.push(
                course,
                truth,
                Place {
                    station_m,
                    offset_m: f64::NAN,
                },
                tracker.travelled_m(),
                f64::NAN,
                false,
            );
            continue;
        }
        let place = tracker.advance(course.path, pose.position());
        let road_rad = course.path.pose_at(place.station_m).heading_rad;
        let limit_m = if inside {
            half_width_m
        } else {
            BACK_INSIDE * half_width_m
        };
        inside = place.offset_m.abs() <= limit_m;
        if approaching {
            approaching = !inside;
            let gone_m = tracker.travelled_m().abs();
            if approaching && gone_m > APPROACH_HALF_WIDTHS * half_width_m {
                // It did not come: it was outside from the beginning.
                rows.inside.fill(false);
                approaching = false;
            }
            inside |= approaching;
        }
        let heading_error_rad = match before {
            Some((from, road_before_rad)) if (pose.position() - from).length() >= SHORTEST_DISPLACEMENT_M => {
                let moved = pose.position() - from;
                // The road's direction half way: exact for a chord of an arc.
                let road_rad = road_before_rad + 0.5 * angle::difference(road_rad, road_before_rad);
                angle::difference(trig::atan2(moved.y, moved.x), road_rad)
            }
            _ => angle::difference(pose.heading_rad, road_rad),
        };
        before = Some((pose.position(), road_rad));

        let progress_m = tracker.travelled_m();
        rows.push(course, truth, place, progress_m, heading_error_rad, inside);
        // Where nothing is left to be driven, nothing is completed.
        let finished = goal_m.is_some_and(|goal| goal > 0.0 && progress_m >= goal - GOAL_TOLERANCE_M);
        if rows.finished_at.is_none() && finished {
            rows.finished_at = Some(rows.len() - 1);
        }
    }
    if approaching {
        rows.inside.fill(false);
    }
    rows
}

/// Whether a pose is one: finite, and nearer than the moon.
fn is_a_place(pose: &Pose2) -> bool {
    pose.x_m.abs() < 1e8 && pose.y_m.abs() < 1e8 && pose.heading_rad.is_finite()
}

/// The figures of a drive: B7 and B8 in SPEC, laps, departures, speed.
pub fn measure(course: &Course, truths: &[Truth]) -> Metrics {
    measure_trace(course, truths, &trace(course, truths))
}

/// As [`measure`], when the trace is already there.
pub(crate) fn measure_trace(course: &Course, truths: &[Truth], rows: &Trace) -> Metrics {
    let count = rows.counted();
    if count == 0 {
        return Metrics {
            completion: course.laps.map(|_| 0.0),
            ..Metrics::default()
        };
    }
    let (lane, heading) = (counted_lane_error(course, rows), counted_heading_error(rows));
    let mut metrics = Metrics {
        frames: count as u64,
        ..Metrics::default()
    };
    let (mut lane_sums, mut heading_sums) = (Sums::default(), Sums::default());
    let (mut furthest_m, mut inside_m) = (0.0f64, 0.0);
    let mut laps = LapClock::new(course, rows);
    let limit_m = course.corridor_half_width_m.min(INTERVENTION_M);
    let mut taken_over = false;
    // A run that begins outside the corridor must only come in.
    let mut comes_in = lane[0] > course.corridor_half_width_m;
    for i in 0..count {
        if !rows.inside[i] && (i == 0 || rows.inside[i - 1]) {
            metrics.departures += 1;
            if metrics.first_departure_s.is_none() {
                metrics.first_departure_s = Some(rows.time_s[i] - rows.time_s[0]);
                metrics.first_departure_percent = Some(rows.percent[i]);
            }
        }
        comes_in &= lane[i] > limit_m;
        if taken_over {
            taken_over = !rows.inside[i] || lane[i] > BACK_INSIDE * limit_m;
        } else if !rows.inside[i] || (lane[i] > limit_m && !comes_in) {
            taken_over = true;
            metrics.interventions += 1;
        }
        if i > 0 {
            let position = |row: usize| truths[row].world_from_vehicle.position();
            let moved_m = (position(i) - position(i - 1)).length();
            let known = rows.offset_m[i].is_finite() && rows.offset_m[i - 1].is_finite();
            metrics.distance_m += if known { moved_m } else { 0.0 };
            metrics.reversed_m += (rows.progress_m[i - 1] - rows.progress_m[i]).max(0.0);
            let gained_m = (rows.progress_m[i] - furthest_m).max(0.0);
            furthest_m = furthest_m.max(rows.progress_m[i]);
            if rows.inside[i] && rows.inside[i - 1] {
                inside_m += gained_m;
            }
            let step_s = rows.time_s[i] - rows.time_s[i - 1];
            lane_sums.add(0.5 * (lane[i - 1] + lane[i]), gained_m, step_s);
            // The heading error of a row is that of the way to it.
            heading_sums.add(heading[i], gained_m, step_s);
        }
        laps.row(rows, i, furthest_m);
    }
    metrics.duration_s = rows.time_s[count - 1] - rows.time_s[0];
    metrics.mean_speed_mps = if metrics.duration_s > 0.0 {
        metrics.distance_m / metrics.duration_s
    } else {
        0.0
    };
    metrics.speed_by_curvature_mps = super::speed::by_curvature(course, rows, count);
    let lost_s = INTERVENTION_S * f64::from(metrics.interventions);
    metrics.autonomy = (metrics.duration_s > 0.0).then(|| (1.0 - lost_s / metrics.duration_s).max(0.0));
    metrics.progress_m = furthest_m;
    metrics.laps = laps.times_s.len() as u32;
    metrics.lap_times_s = laps.times_s;

    let reached = rows.finished_at.is_some();
    let missing_m = match rows.goal_m {
        Some(goal_m) if !reached => (goal_m - furthest_m).max(0.0),
        _ => 0.0,
    };
    metrics.completed = reached && metrics.departures == 0;
    metrics.completion = rows.goal_m.map(|goal_m| {
        if metrics.completed {
            1.0
        } else if goal_m > 0.0 {
            (inside_m / goal_m).clamp(0.0, 1.0)
        } else {
            0.0
        }
    });
    let gained_mps = if metrics.duration_s > 0.0 {
        furthest_m / metrics.duration_s
    } else {
        0.0
    };
    let missing_s = if gained_mps > 0.0 {
        missing_m / gained_mps
    } else {
        f64::INFINITY
    };
    let undriven = |cost: f64| Missing {
        road_m: missing_m,
        time_s: missing_s,
        cost,
    };
    let raw = |values: &[f64]| -> Vec<f64> {
        values[..count]
            .iter()
            .map(|value| value.abs())
            .filter(|value| value.is_finite())
            .collect()
    };
    let (raw_lane, raw_heading) = (raw(&rows.offset_m), raw(&rows.heading_error_rad));
    metrics.lane_error = Some(lane_sums.figures(&lane, &raw_lane, undriven(course.corridor_half_width_m)));
    metrics.heading_error = Some(heading_sums.figures(&heading, &raw_heading, undriven(FRAC_PI_2)));
    metrics
}

/// Distance from the path as it counts: outside at least the corridor's half width.
fn counted_lane_error(course: &Course, rows: &Trace) -> Vec<f64> {
    let half_width_m = course.corridor_half_width_m;
    rows.offset_m[..rows.counted()]
        .iter()
        .zip(&rows.inside)
        .map(|(offset, inside)| {
            if *inside {
                offset.abs()
            } else {
                offset.abs().max(half_width_m)
            }
        })
        .collect()
}

/// Heading error as it counts: outside at least 90°.
fn counted_heading_error(rows: &Trace) -> Vec<f64> {
    rows.heading_error_rad[..rows.counted()]
        .iter()
        .zip(&rows.inside)
        .map(|(error, inside)| {
            if *inside {
                error.abs()
            } else {
                error.abs().max(FRAC_PI_2)
            }
        })
        .collect()
}

/// Road that the run owed when it ended, and what each metre of it costs.
struct Missing {
    road_m: f64,
    time_s: f64,
    cost: f64,
}

/// Weighted sums of an error.
#[derive(Default)]
struct Sums {
    by_road: f64,
    road_m: f64,
    by_time: f64,
    time_s: f64,
}

impl Sums {
    fn add(&mut self, error: f64, gained_m: f64, step_s: f64) {
        self.by_road += error * gained_m;
        self.road_m += gained_m;
        self.by_time += error * step_s;
        self.time_s += step_s;
    }

    /// `counted` is the error of each frame with departures punished and never empty, `raw` without.
    fn figures(&self, counted: &[f64], raw: &[f64], missing: Missing) -> ErrorFigures {
        let mean_of_frames = mean(counted).unwrap_or(0.0);
        let owed = missing.road_m > 0.0;
        let mean_over_time = if owed && missing.time_s.is_infinite() {
            missing.cost.max(mean_of_frames)
        } else if owed {
            (self.by_time + missing.time_s * missing.cost) / (self.time_s + missing.time_s)
        } else if self.time_s > 0.0 {
            self.by_time / self.time_s
        } else {
            mean_of_frames
        };
        let road_m = self.road_m + missing.road_m;
        let over_road = if road_m > 0.0 {
            (self.by_road + missing.road_m * missing.cost) / road_m
        } else {
            mean_over_time
        };
        let max = counted.iter().copied().fold(0.0, f64::max);
        ErrorFigures {
            mean: over_road,
            max: if owed { max.max(missing.cost) } else { max },
            mean_over_time,
            mean_as_defined: mean(raw).unwrap_or(mean_of_frames),
            max_as_defined: raw.iter().copied().fold(0.0, f64::max),
        }
    }
}

/// Notices the ends of laps and keeps the times of those that stayed inside.
struct LapClock {
    length_m: f64,
    ended: u32,
    began_s: f64,
    clean: bool,
    closed: bool,
    times_s: Vec<f64>,
}

impl LapClock {
    fn new(course: &Course, rows: &Trace) -> Self {
        let closed = course.path.is_closed();
        let to_the_end_m = course.path.length_m() - course.open_end_m - rows.station_m[0];
        Self {
            length_m: if closed {
                course.path.length_m()
            } else {
                to_the_end_m
            },
            ended: 0,
            began_s: rows.time_s[0],
            clean: true,
            closed,
            times_s: Vec::new(),
        }
    }

    fn row(&mut self, rows: &Trace, i: usize, furthest_m: f64) {
        self.clean &= rows.inside[i];
        if self.length_m <= GOAL_TOLERANCE_M || (!self.closed && self.ended > 0) {
            return;
        }
        let end_m = f64::from(self.ended + 1) * self.length_m;
        if i == 0 || furthest_m < end_m - GOAL_TOLERANCE_M {
            return;
        }
        let (from_m, to_m) = (rows.progress_m[i - 1], rows.progress_m[i]);
        let part = if to_m > from_m {
            ((end_m - from_m) / (to_m - from_m)).clamp(0.0, 1.0)
        } else {
            1.0
        };
        let end_s = rows.time_s[i - 1] + part * (rows.time_s[i] - rows.time_s[i - 1]);
        if self.clean {
            self.times_s.push(end_s - self.began_s);
        }
        self.ended += 1;
        self.began_s = end_s;
        self.clean = rows.inside[i];
    }
}

#[cfg(test)]
#[path = "drive_tests.rs"]
mod tests;
