//! The figures of one run as a table for people and as JSON for programs.

use crate::delivery::Delivery;
use crate::metrics::{self, Course, Losses, Metrics, Motion, Smoothness};
use crate::odometry::{self, OdometryError};
use crate::text;
use senda_core::{Body, Truth};
use senda_data::Recording;
use serde::{Deserialize, Serialize};

/// [`Summary::ended`] of a run that somebody interrupted.
pub const INTERRUPTED: &str = "interrupted";

/// One run in figures. Field names and units are those of the JSON form.
///
/// Figures that need the true pose are `null` on a vehicle that does not know it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Summary {
    /// Name of the world.
    pub world: String,
    /// Name of the vehicle.
    pub vehicle: String,
    /// Name of the driver.
    pub driver: String,
    /// Name of the light.
    pub light: String,
    /// Name of the floor.
    pub floor: String,
    /// Whether the world was driven the other way round.
    pub reversed: bool,
    /// Seed of the run.
    pub seed: u64,
    /// Speed that the driver was asked to hold (m/s).
    pub speed_mps: Option<f64>,
    /// Laps that were to be driven.
    pub laps_wanted: Option<f64>,
    /// Why the run ended, in words: `goal reached`, `left the corridor`, `line lost`, `time over`.
    pub ended: String,
    /// How many commands the guard replaced by a stop: pictures too old, or commands that are no numbers.
    pub guard_stops: u64,
    /// Whether the goal was reached without ever leaving the corridor.
    pub completed: bool,
    /// Part of the road to be driven that was driven inside the corridor (0..=1).
    pub completion: Option<f64>,
    /// Whole laps without leaving the corridor.
    pub laps: u32,
    /// How often the vehicle left the corridor.
    pub departures: u32,
    /// When it first left (s).
    pub first_departure_s: Option<f64>,
    /// Where it first left (per cent of lap).
    pub first_departure_percent: Option<f64>,
    /// How often a person would have taken over: further than a metre from the path, or out of the corridor.
    pub interventions: u32,
    /// NVIDIA's autonomy (0..=1): 1 - interventions · 6 s / time.
    pub autonomy: Option<f64>,
    /// How often the driver lost the line or lane: not seen for half a second or longer ([`metrics::LOSS_S`]).
    pub lost: u32,
    /// How often it was missing for a frame or more, losses included.
    pub gaps: u32,
    /// Part of the frames in which the driver found the line or lane (0..=1).
    pub found_rate: Option<f64>,
    /// Mean distance from the path over the road (m); see [`metrics`] for what leaving costs.
    pub lane_error_mean_m: Option<f64>,
    /// Largest distance from the path (m).
    pub lane_error_max_m: Option<f64>,
    /// Mean angle between displacement and road, over the road (rad).
    pub heading_error_mean_rad: Option<f64>,
    /// Largest angle between displacement and road (rad).
    pub heading_error_max_rad: Option<f64>,
    /// The same means over time, and over frames as document B defines them.
    pub other_means: OtherMeans,
    /// Mean time of the laps that count (s).
    pub lap_time_s: Option<f64>,
    /// Time of each lap that counts (s).
    pub lap_times_s: Vec<f64>,
    /// Distance driven (m).
    pub distance_m: f64,
    /// Time from the first frame to the last (s).
    pub duration_s: f64,
    /// Distance over time (m/s).
    pub mean_speed_mps: f64,
    /// Mean speed on the straightest quarter of the time (m/s), but for the first 2 s; `None` where the road is as curved everywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub straight_speed_mps: Option<f64>,
    /// Mean speed on the most curved quarter (m/s).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curve_speed_mps: Option<f64>,
    /// How calmly it was driven.
    pub smoothness: Smoothness,
    /// How far odometry, by the wheels alone, ends from the true pose (C14); `None` without encoders.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub odometry: Option<OdometryError>,
    /// Frames driven on.
    pub frames: u64,
    /// Digest of the whole trajectory; equal runs have equal digests.
    pub digest: String,
    /// Time the driver needed for a frame, mean (s of wall time); not repeatable.
    pub frame_time_mean_s: Option<f64>,
    /// The same, 95th percentile (s of wall time).
    pub frame_time_p95_s: Option<f64>,
    /// Wall time of the whole run (s); not repeatable.
    pub wall_s: f64,
    /// In a warehouse: what became of the package. Then `completed` means a whole delivery.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delivery: Option<Delivery>,
}

/// Means beside the headline.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct OtherMeans {
    /// Lane error over time (m).
    pub lane_error_over_time_m: Option<f64>,
    /// Heading error over time (rad).
    pub heading_error_over_time_rad: Option<f64>,
    /// Mean lane error over frames, nothing punished: B7 in SPEC to the letter (m).
    pub lane_error_as_defined_m: Option<f64>,
    /// Largest lane error, nothing punished (m).
    pub lane_error_max_as_defined_m: Option<f64>,
    /// Mean heading error over frames, nothing punished: B8 in SPEC to the letter (rad).
    pub heading_error_as_defined_rad: Option<f64>,
    /// Largest heading error, nothing punished (rad).
    pub heading_error_max_as_defined_rad: Option<f64>,
}

impl Summary {
    /// From figures already taken. Names, digest and wall times are the caller's to fill in.
    pub fn from_figures(metrics: &Metrics, losses: &Losses, smoothness: &Smoothness) -> Self {
        let (lane, heading) = (metrics.lane_error, metrics.heading_error);
        Self {
            completed: metrics.completed,
            completion: metrics.completion,
            laps: metrics.laps,
            departures: metrics.departures,
            first_departure_s: metrics.first_departure_s,
            first_departure_percent: metrics.first_departure_percent,
            interventions: metrics.interventions,
            autonomy: metrics.autonomy,
            lost: losses.lost,
            gaps: losses.gaps,
            found_rate: losses.found_rate,
            lane_error_mean_m: lane.map(|e| e.mean),
            lane_error_max_m: lane.map(|e| e.max),
            heading_error_mean_rad: heading.map(|e| e.mean),
            heading_error_max_rad: heading.map(|e| e.max),
            other_means: OtherMeans {
                lane_error_over_time_m: lane.map(|e| e.mean_over_time),
                heading_error_over_time_rad: heading.map(|e| e.mean_over_time),
                lane_error_as_defined_m: lane.map(|e| e.mean_as_defined),
                lane_error_max_as_defined_m: lane.map(|e| e.max_as_defined),
                heading_error_as_defined_rad: heading.map(|e| e.mean_as_defined),
                heading_error_max_as_defined_rad: heading.map(|e| e.max_as_defined),
            },
            lap_time_s: crate::statistics::mean(&metrics.lap_times_s),
            lap_times_s: metrics.lap_times_s.clone(),
            distance_m: metrics.distance_m,
            duration_s: metrics.duration_s,
            mean_speed_mps: metrics.mean_speed_mps,
            straight_speed_mps: metrics.speed_by_curvature_mps.map(|[straight, _]| straight),
            curve_speed_mps: metrics.speed_by_curvature_mps.map(|[_, curved]| curved),
            smoothness: *smoothness,
            frames: metrics.frames,
            ..Self::default()
        }
    }

    /// From a recording and the course it was driven on; without a course (a real vehicle) only what needs no true pose.
    pub fn from_recording(recording: &Recording, course: Option<&Course>) -> Self {
        let truths = truths(recording);
        let measured = match course {
            Some(course) if !truths.is_empty() => metrics::measure(course, &truths),
            _ => without_truth(recording),
        };
        let losses = metrics::losses(
            recording
                .steps
                .iter()
                .map(|step| (step.stamp.as_s(), &step.explanation)),
        );
        let smoothness = metrics::smoothness(&motions(recording));
        Self {
            vehicle: recording.header.body.name.clone(),
            driver: recording.header.driver.clone(),
            reversed: recording.header.reversed,
            seed: recording.header.seed,
            laps_wanted: course.and_then(|course| course.laps),
            odometry: odometry::of_recording(recording).map(|(_, error)| error),
            ..Self::from_figures(&measured, &losses, &smoothness)
        }
    }

    /// Adds the driver's wall times, one for each frame (s).
    pub fn with_frame_times(mut self, times_s: &[f64]) -> Self {
        self.frame_time_mean_s = crate::statistics::mean(times_s);
        self.frame_time_p95_s = crate::statistics::quantile(times_s, 0.95);
        self
    }

    /// One word for how it went, and whether that is good.
    pub fn verdict(&self) -> (String, bool) {
        if self.completed {
            return ("completed".into(), true);
        }
        if self.ended == INTERRUPTED {
            let place = self.completion.map_or(String::new(), |part| {
                format!(" after {} %", text::fixed(100.0 * part, 0))
            });
            return (format!("{INTERRUPTED}{place}"), false);
        }
        if let Some(delivery) = &self.delivery {
            return (delivery.headline(), false);
        }
        if self.departures > 0 {
            let place = self
                .first_departure_percent
                .map_or(String::new(), |p| format!(" at {p:.0} % of the lap"));
            return (format!("left the corridor{place}"), false);
        }
        match (self.completion, self.laps_wanted) {
            (Some(part), Some(_)) => {
                let why = match self.ended.as_str() {
                    "" => String::new(),
                    ended => format!(": {ended}"),
                };
                (
                    format!("stopped after {} %{why}", text::fixed(100.0 * part, 0)),
                    false,
                )
            }
            _ if !self.ended.is_empty() => (self.ended.clone(), true),
            _ => ("recorded".into(), true),
        }
    }

    /// Whether the errors count road that was to be driven and was not; an interrupted run's do not.
    pub fn has_undriven_road(&self) -> bool {
        !self.completed && self.ended != INTERRUPTED
    }

    /// The figures as label and value for people: centimetres and degrees beside SI.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let both = |mean: Option<f64>, max: Option<f64>, show: fn(f64) -> String| match (mean, max) {
            (Some(mean), Some(max)) => format!("mean {}, max {}", show(mean), show(max)),
            _ => "unknown: no true pose".into(),
        };
        let mut rows = vec![
            ("result", self.verdict().0),
            (
                "laps",
                match self.laps_wanted {
                    Some(wanted) => format!("{} of {}", self.laps, text::short(wanted)),
                    None => self.laps.to_string(),
                },
            ),
            (
                "departures, losses",
                format!("{}, {}", self.departures, self.lost),
            ),
            (
                "lane error",
                both(self.lane_error_mean_m, self.lane_error_max_m, text::length_both),
            ),
            (
                "heading error",
                both(
                    self.heading_error_mean_rad,
                    self.heading_error_max_rad,
                    text::angle_both,
                ),
            ),
        ];
        if self.has_undriven_road() {
            let other = &self.other_means;
            if let (Some(lane), Some(heading)) =
                (other.lane_error_as_defined_m, other.heading_error_as_defined_rad)
            {
                rows.push((
                    "  where it drove",
                    format!(
                        "mean {} and {}; above, undriven road counts as outside",
                        text::length(lane),
                        text::angle_both(heading)
                    ),
                ));
            }
        }
        if self.guard_stops > 0 {
            rows.push((
                "guard",
                format!("replaced {} commands by a stop", self.guard_stops),
            ));
        }
        if let Some(time_s) = self.first_departure_s {
            let percent = self.first_departure_percent.map_or(String::new(), |percent| {
                format!(", {} % of the lap", text::fixed(percent, 0))
            });
            rows.push((
                "first left",
                format!("after {} s{percent}", text::fixed(time_s, 2)),
            ));
        }
        if let Some(autonomy) = self.autonomy.filter(|_| self.interventions > 0) {
            rows.push((
                "autonomy",
                format!(
                    "{} %: {} interventions of 6 s (NVIDIA's measure)",
                    text::fixed(100.0 * autonomy, 1),
                    self.interventions
                ),
            ));
        }
        if let Some(time_s) = self.lap_time_s {
            rows.push(("lap time", format!("{} s", text::fixed(time_s, 2))));
        }
        rows.push((
            "distance",
            format!(
                "{} in {} s, {} on average",
                text::length(self.distance_m),
                text::fixed(self.duration_s, 2),
                text::speed(self.mean_speed_mps)
            ),
        ));
        // At a speed that is held there is nothing to tell.
        if let (Some(straight), Some(curved)) = (self.straight_speed_mps, self.curve_speed_mps)
            && (straight - curved).abs() > 0.02 * straight.abs()
        {
            let words = format!(
                "{} where it is straightest, {} in curves",
                text::speed(straight),
                text::speed(curved)
            );
            rows.push(("speed", words));
        }
        if let Some(odometry) = &self.odometry {
            rows.push((
                "odometry",
                format!(
                    "ends {} and {} from the true pose",
                    text::length(odometry.end_error_m),
                    text::angle(odometry.end_error_rad)
                ),
            ));
        }
        if let Some(found) = self.found_rate {
            rows.push((
                "line seen",
                format!("in {} % of {} frames", text::fixed(100.0 * found, 1), self.frames),
            ));
        }
        if let Some(roughness) = self.smoothness.command_change_radps2 {
            let per_m = self.smoothness.command_change_radps_per_m.unwrap_or(f64::NAN);
            rows.push((
                "steering change",
                format!(
                    "{} rad/s² RMS, {} rad/s per m",
                    text::short(roughness),
                    text::short(per_m)
                ),
            ));
        }
        if let (Some(mean), Some(p95)) = (self.frame_time_mean_s, self.frame_time_p95_s) {
            rows.push((
                "time a frame",
                format!(
                    "{} ms, 95 % below {} ms",
                    text::short(1e3 * mean),
                    text::short(1e3 * p95)
                ),
            ));
        }
        if !self.digest.is_empty() {
            rows.push(("digest", self.digest.clone()));
        }
        rows
    }

    /// An aligned table for the terminal, ending with a newline. Text from files is made harmless for terminals.
    pub fn text(&self) -> String {
        let mut title = format!("{} drives {} on {}", self.driver, self.vehicle, self.world);
        for part in [&self.floor, &self.light] {
            if !part.is_empty() {
                title += &format!(", {part}");
            }
        }
        if self.reversed {
            title += ", reversed";
        }
        title += &format!(", seed {}", self.seed);
        let rows = self.rows();
        let width = rows
            .iter()
            .map(|(label, _)| label.chars().count())
            .max()
            .unwrap_or(0);
        let mut out = text::printable(&title) + "\n";
        for (label, value) in rows {
            let pad = " ".repeat(width - label.chars().count());
            out += &format!("  {label}{pad}  {}\n", text::printable(&value));
        }
        out
    }
}

/// The true poses of a recording, in order. Steps without one are left out.
pub fn truths(recording: &Recording) -> Vec<Truth> {
    recording.steps.iter().filter_map(|step| step.truth).collect()
}

/// What smoothness needs, from a recording.
pub fn motions(recording: &Recording) -> Vec<Motion> {
    let body: &Body = &recording.header.body;
    recording
        .steps
        .iter()
        .map(|step| {
            Motion::of(
                body,
                step.stamp.as_s(),
                &step.command,
                step.truth.as_ref(),
                step.speed_mps,
            )
        })
        .collect()
}

/// Time, distance and frames of a run whose true pose nobody knows: distance from measured, else commanded, speed.
fn without_truth(recording: &Recording) -> Metrics {
    let rows = motions(recording);
    let distance_m: f64 = rows
        .windows(2)
        .map(|w| (0.5 * (w[0].speed_mps + w[1].speed_mps) * (w[1].time_s - w[0].time_s)).abs())
        .sum();
    let duration_s = match (rows.first(), rows.last()) {
        (Some(first), Some(last)) => last.time_s - first.time_s,
        _ => 0.0,
    };
    Metrics {
        distance_m,
        duration_s,
        mean_speed_mps: if duration_s > 0.0 {
            distance_m / duration_s
        } else {
            0.0
        },
        frames: rows.len() as u64,
        ..Metrics::default()
    }
}
