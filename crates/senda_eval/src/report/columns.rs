//! A recorded run as columns: everything that its plots and its player show.

use super::run::ReportRun;
use super::signals::{self, Column, FRAME_TIME, Scale};
use crate::metrics::{self, Course, Trace};
use senda_core::{Drive, Steering, Truth};
use senda_data::Step;
use senda_geom::angle;

/// A recorded run as columns over its steps.
pub(super) struct Columns {
    /// Time since the run began (s).
    pub(super) time_s: Vec<f64>,
    /// Per cent of lap; `NaN` without a true pose. `None` without a course.
    pub(super) percent: Option<Vec<f64>>,
    /// Whether the vehicle counted as inside the corridor.
    pub(super) inside: Vec<bool>,
    /// Half width of the corridor (m).
    pub(super) half_width_m: Option<f64>,
    /// Everything that is plotted or read out.
    pub(super) list: Vec<Column>,
}

impl Columns {
    pub(super) fn get(&self, key: &str) -> Option<&Column> {
        self.list.iter().find(|column| column.key == key)
    }
}

/// Everything that can be plotted over the steps.
pub(super) fn columns(run: &ReportRun, course: Option<&Course>) -> Columns {
    let steps = &run.recording.steps;
    let body = &run.recording.header.body;
    let scale = Scale::of(body);
    let count = steps.len();
    let mut list = Vec::new();
    let mut add = |key: &str, name: &str, si_name: &str, values: Vec<f64>| {
        list.push(Column::from_si(key, name, si_name, scale, values));
    };
    let mut percent = None;
    let mut inside = vec![true; count];
    if let Some(course) = course {
        let places: Vec<usize> = (0..count).filter(|i| steps[*i].truth.is_some()).collect();
        let truths = crate::summary::truths(run.recording);
        let rows: Trace = metrics::trace(course, &truths);
        let spread = |values: &[f64]| {
            let mut spread = vec![f64::NAN; count];
            for (place, value) in places.iter().zip(values) {
                spread[*place] = *value;
            }
            spread
        };
        for (place, row) in places.iter().zip(&rows.inside) {
            inside[*place] = *row;
        }
        percent = Some(spread(&rows.percent));
        add("offset", "lane error", "offset_m", spread(&rows.offset_m));
        add(
            "heading",
            "heading error",
            "heading_rad",
            spread(&rows.heading_error_rad),
        );
        // As a driver sees it: where the path lies and points to in the vehicle's frame.
        let ahead: Vec<f64> = truths
            .iter()
            .zip(&rows.station_m)
            .map(|(truth, station_m)| {
                angle::difference(
                    course.path.pose_at(*station_m).heading_rad,
                    truth.world_from_vehicle.heading_rad,
                )
            })
            .collect();
        let d: Vec<f64> = rows.offset_m.iter().map(|offset| -offset).collect();
        add("true_d", "true", "d_m", spread(&d));
        add("true_theta", "true", "theta_rad", spread(&ahead));
    }
    let per_step = |value: &dyn Fn(&Step) -> f64| -> Vec<f64> { steps.iter().map(value).collect() };
    let true_or_none =
        |value: fn(&Truth) -> f64| per_step(&|step| step.truth.as_ref().map_or(f64::NAN, value));
    let asked_mps = |step: &Step| body.speed_of(&step.command);
    match body.steering {
        Steering::Differential { .. } => {
            let asked = per_step(&|step| body.yaw_rate_of(step.command.turn, asked_mps(step)));
            add("steering", "commanded", "yaw_rate_radps", asked);
            add(
                "true_steering",
                "driven",
                "yaw_rate_radps",
                true_or_none(|truth| truth.yaw_rate_radps),
            );
        }
        Steering::Ackermann { .. } => {
            let asked = per_step(&|step| body.steering_of(step.command.turn, asked_mps(step)));
            add("steering", "commanded", "steering_rad", asked);
            add(
                "true_steering",
                "driven",
                "steering_rad",
                true_or_none(|truth| truth.steering_rad),
            );
        }
    }
    let pedal = per_step(&|step| match step.command.drive {
        Drive::Throttle(part) => part,
        Drive::SpeedMps(_) => f64::NAN,
    });
    add("throttle", "commanded", "throttle", pedal);
    add("speed", "commanded", "speed_mps", per_step(&asked_mps));
    let driven = per_step(&|step| {
        step.truth
            .map(|t| t.speed_mps)
            .or(step.speed_mps)
            .unwrap_or(f64::NAN)
    });
    add("true_speed", "driven", "speed_mps", driven);
    if run.frame_times_s.len() == count && run.frame_times_s.iter().any(|time| *time > 0.0) {
        add("frame_time", "time spent", FRAME_TIME, run.frame_times_s.to_vec());
    }
    for (name, values) in signals::of_driver(run.recording) {
        add(&format!("signal {name}"), &signals::words(&name), &name, values);
    }
    list.retain(|column| column.values.iter().any(|value| value.is_finite()));
    Columns {
        time_s: steps.iter().map(|step| step.stamp.as_s()).collect(),
        percent: percent.filter(|p| p.iter().any(|value| value.is_finite())),
        inside,
        half_width_m: course.map(|course| course.corridor_half_width_m),
        list,
    }
}
