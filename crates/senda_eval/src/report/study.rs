//! The study of the kinematics (C13 in SPEC): traces of d, θ and ω for many constants.

use super::page::{Figure, Page, Row, Section, Table, render};
use crate::plot::{Axis, Band, COLOURS, LinePlot, Series};
use crate::text;

/// One run of the study, in SI.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StudyTrace {
    /// Traces of one group share their plots: the starting state, such as `from −21.5 cm, 44.6°`.
    pub group: String,
    /// What distinguishes it within the group: `Kp 1.1, L 40 cm`.
    pub label: String,
    /// How it ends: `converges`, `unstable`.
    pub verdict: String,
    /// Whether that is good.
    pub good: bool,
    /// How near to its resting place it counts as settled (m).
    pub settled_d_m: f64,
    /// How small its angle must be as well (rad).
    pub settled_theta_rad: f64,
    /// From when on it stays within these limits (s).
    pub settle_time_s: Option<f64>,
    /// How far it goes past the line (m).
    pub overshoot_m: f64,
    /// Moments (s).
    pub time_s: Vec<f64>,
    /// Distance to the line (m).
    pub d_m: Vec<f64>,
    /// Angle to the line (rad).
    pub theta_rad: Vec<f64>,
    /// Yaw rate asked for (rad/s).
    pub omega_radps: Vec<f64>,
}

/// What "settled" means in a study, for people.
pub fn study_limits(d_m: f64, theta_rad: f64) -> String {
    format!(
        "Settled: the true distance stays within {} cm of where the course rests and the true angle within {}°, however noisy \
         the measurement. It rests on the line, unless a bias or a curve moves that place: then it ends \"beside the line\".",
        text::short(100.0 * d_m),
        text::short(theta_rad.to_degrees()),
    )
}

/// A report of a study: for each group the three plots and a table.
pub fn study_html(page: &Page, traces: &[StudyTrace]) -> String {
    let mut groups: Vec<(&str, Vec<&StudyTrace>)> = Vec::new();
    for trace in traces {
        match groups.iter_mut().find(|(name, _)| *name == trace.group) {
            Some((_, members)) => members.push(trace),
            None => groups.push((&trace.group, vec![trace])),
        }
    }
    let mut sections = vec![summary(traces, &groups)];
    sections.extend(groups.iter().map(|(name, members)| section(name, members)));
    render(page, Vec::new(), sections)
}

fn summary(traces: &[StudyTrace], groups: &[(&str, Vec<&StudyTrace>)]) -> Section {
    let rows = groups.iter().flat_map(|(name, members)| {
        members.iter().map(move |trace| Row {
            cells: vec![
                (*name).to_owned(),
                trace.label.clone(),
                trace.verdict.clone(),
                trace
                    .settle_time_s
                    .map_or_else(|| "never".into(), |t| format!("{} s", text::fixed(t, 1))),
                text::length(trace.overshoot_m),
            ],
            tone: if trace.good { "" } else { "bad" },
        })
    });
    let limits = traces.first().map_or_else(String::new, |trace| {
        study_limits(trace.settled_d_m, trace.settled_theta_rad) + " "
    });
    Section {
        title: "Result".into(),
        tables: vec![Table {
            caption: limits + "Shaded rows do not converge to the line in the time studied.",
            columns: ["start", "constants", "verdict", "settled after", "overshoot"]
                .map(String::from)
                .to_vec(),
            words: 3,
            rows: rows.collect(),
        }],
        ..Section::default()
    }
}

/// More traces than colours are drawn in plots of their own.
fn section(name: &str, members: &[&StudyTrace]) -> Section {
    let mut figures = Vec::new();
    let parts = members.len().div_ceil(COLOURS);
    for (part, chosen) in members.chunks(COLOURS).enumerate() {
        let suffix = if parts > 1 {
            format!(" ({} of {parts})", part + 1)
        } else {
            String::new()
        };
        type Values = fn(&StudyTrace) -> &[f64];
        let (d_m, theta_rad) = (chosen[0].settled_d_m, chosen[0].settled_theta_rad);
        let kinds: [(&str, &str, f64, f64, Values, String); 3] = [
            (
                "Distance d",
                "cm",
                100.0,
                100.0 * d_m,
                |t| &t.d_m,
                format!(
                    "True distance from the axle to the line. Green: within {} cm.",
                    text::short(100.0 * d_m)
                ),
            ),
            (
                "Angle θ",
                "°",
                180.0 / std::f64::consts::PI,
                theta_rad.to_degrees(),
                |t| &t.theta_rad,
                format!(
                    "True angle between the vehicle and the line. Green: within {}°.",
                    text::short(theta_rad.to_degrees())
                ),
            ),
            (
                "Yaw rate ω",
                "°/s",
                180.0 / std::f64::consts::PI,
                0.0,
                |t| &t.omega_radps,
                "What the controller asks for; flat tops are its limit.".to_owned(),
            ),
        ];
        for (title, unit, factor, band, values, caption) in kinds {
            let series = chosen.iter().enumerate().map(|(i, trace)| Series {
                name: trace.label.clone(),
                points: trace
                    .time_s
                    .iter()
                    .zip(values(trace))
                    .map(|(t, v)| [*t, v * factor])
                    .collect(),
                colour: i,
                ..Series::default()
            });
            let plot = LinePlot {
                name: format!("{title} over time, {name}"),
                x: Axis::new("time", "s"),
                y: Axis::new(title.rsplit(' ').next().unwrap_or(title), unit).including(0.0),
                series: series.collect(),
                bands: if band > 0.0 {
                    vec![Band {
                        y: [-band, band],
                        name: String::new(),
                    }]
                } else {
                    Vec::new()
                },
                width_px: 480.0,
                height_px: 270.0,
                ..LinePlot::default()
            };
            figures.push(Figure {
                title: format!("{title}{suffix}"),
                svg: plot.svg(),
                caption,
            });
        }
    }
    Section {
        title: name.to_owned(),
        figures,
        ..Section::default()
    }
}
