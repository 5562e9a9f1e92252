//! A driver on frames that a human drove: what it found and how its steering agrees.

use super::page::{Card, Figure, Page, Row, Table, render};
use super::plots::Group;
use super::run::{self, ReportRun};
use super::signals::{Column, Scale};
use crate::agreement::{self, Agreement};
use crate::plot::{Axis, LinePlot, RateRow, RateRows, Series, Stroke};
use crate::statistics::rate;
use crate::{Summary, text};
use senda_data::Recording;

/// A report that shows a driver's detections on recorded frames, and its steering beside the human's.
///
/// `human` holds the commands as they were recorded, `driven` the same frames with the commands and explanations of the
/// driver; `frame_times_s` is the wall time that it took for each of them (s), empty where unknown.
pub fn real_data_html(page: &Page, human: &Recording, driven: &Recording, frame_times_s: &[f64]) -> String {
    let (reference, answers) = agreement::steerings(human, driven);
    let agreed = agreement::of_recordings(human, driven);
    let scale = Scale::of(&driven.header.body);
    let or_none: Vec<f64> = answers.iter().map(|answer| answer.unwrap_or(f64::NAN)).collect();
    let columns = vec![
        Column::from_si("human", "human", "steering_rad", scale, reference.clone()),
        Column::from_si("driver", "driver", "steering_rad", scale, or_none.clone()),
    ];
    let summary = Summary::from_recording(driven, None).with_frame_times(frame_times_s);
    let shown = ReportRun {
        title: "",
        summary: &summary,
        recording: driven,
        world: None,
        course: None,
        command: &page.command,
        frame_times_s,
        look: None,
    };
    let mut section = run::section_with(&shown, 0, page.frame_budget_bytes, columns);
    section.cards = cards(&summary, &agreed);
    let has_speed = driven.steps.iter().any(|step| step.speed_mps.is_some());
    section.set_figures(figures(&summary, &agreed, has_speed));
    section.groups.insert(
        0,
        Group {
            title: "Agreement with the human".into(),
            intro: "The human's steering is no truth: people react late, look far ahead, and hold still for a while. It is what there is.".into(),
            figures: vec![scatter(&reference, &or_none), found(&agreed)],
            tables: vec![table(&agreed)],
        },
    );
    render(page, vec![section], Vec::new())
}

/// All figures in words. Distance and what is made of it or of a speed are left out where nobody measured one, and what a pose would
/// tell in any case.
fn figures(summary: &Summary, agreed: &Agreement, has_speed: bool) -> Vec<(&'static str, String)> {
    let recorded = format!(
        "{} frames in {} s",
        summary.frames,
        text::fixed(summary.duration_s, 2)
    );
    let of_pose = ["laps", "departures, losses", "lane error", "heading error"];
    let of_speed = ["distance", "steering change"];
    let mut rows = vec![("recorded", recorded)];
    rows.extend(
        summary
            .rows()
            .into_iter()
            .filter(|(label, _)| !of_pose.contains(label) && (has_speed || !of_speed.contains(label))),
    );
    rows.push(("losses", summary.lost.to_string()));
    rows.extend(agreed.rows());
    rows
}

/// What is known on frames that nobody drove on: time and agreement, but no distance or speed of the driver's.
fn cards(summary: &Summary, agreed: &Agreement) -> Vec<Card> {
    let number = |value: Option<f64>| value.map_or("–".into(), |v| text::fixed(v, 2));
    let angle = |value: Option<f64>| value.map_or("–".into(), text::angle);
    let mut cards = vec![
        Card::new(
            "Line or lane found",
            text::percent(agreed.found_rate),
            format!("{} of {} frames", agreed.compared, agreed.frames),
            "Part of the frames in which the driver found what it follows",
            "",
        ),
        Card::new(
            "Correlation",
            number(agreed.correlation),
            "1 is full agreement".into(),
            "Pearson's correlation of the driver's steering with the human's",
            "",
        ),
        Card::new(
            "Same side",
            agreed.sign_agreement.map_or("–".into(), text::percent),
            format!("{} of {} frames", agreed.same_side, agreed.sided),
            "Frames where both steer to the same side, among those where the human steers",
            "",
        ),
        Card::new(
            "Difference, median",
            angle(agreed.median_absolute_error_rad),
            format!("mean {}", angle(agreed.mean_absolute_error_rad)),
            "Absolute difference of the steering angles",
            "",
        ),
        Card::new(
            "Always the median",
            angle(agreed.constant_error_rad),
            "mean difference: the figure to beat".into(),
            "How far a driver would be off that always steers like the human on the median frame",
            "",
        ),
        Card::new(
            "Recorded",
            format!("{} s", text::fixed(summary.duration_s, 1)),
            format!("{} frames", summary.frames),
            "From the first frame to the last",
            "",
        ),
    ];
    cards.extend(run::frame_time_card(summary));
    cards
}

fn scatter(reference: &[f64], answers: &[f64]) -> Figure {
    let points: Vec<[f64; 2]> = reference
        .iter()
        .zip(answers)
        .map(|(a, b)| [a.to_degrees(), b.to_degrees()])
        .collect();
    let most = points
        .iter()
        .flatten()
        .filter(|v| v.is_finite())
        .fold(1.0f64, |most, v| most.max(v.abs()));
    let plot = LinePlot {
        name: "The driver's steering against the human's".into(),
        x: Axis::new("human's steering", "°").ranged(-most, most),
        y: Axis::new("driver's steering", "°").ranged(-most, most),
        series: vec![
            Series {
                points: vec![[-most, -most], [most, most]],
                colour: 6,
                stroke: Stroke::Dashed,
                ..Series::default()
            },
            Series {
                points,
                stroke: Stroke::Dots,
                ..Series::default()
            },
        ],
        width_px: 480.0,
        height_px: 320.0,
        ..LinePlot::default()
    };
    Figure {
        title: "Driver against human".into(),
        svg: plot.svg(),
        caption: "One dot a frame; left is positive. On the dashed line both steer alike; a cloud along it but steeper means that the driver steers more.".into(),
    }
}

fn found(agreed: &Agreement) -> Figure {
    let mut rows = vec![RateRow {
        label: "line or lane found".into(),
        rate: rate(agreed.compared, agreed.frames),
        colour: 0,
    }];
    if agreed.sided > 0 {
        rows.push(RateRow {
            label: "steers to the same side".into(),
            rate: rate(agreed.same_side, agreed.sided),
            colour: 2,
        });
    }
    let figure = RateRows {
        name: "How often the driver found its way and steered to the human's side".into(),
        label: "frames".into(),
        rows,
        range: None,
        width_px: 480.0,
    };
    Figure {
        title: "How often".into(),
        svg: figure.svg(),
        caption: format!(
            "With 95 % intervals (neighbouring frames are alike, so the true intervals are wider). Sides are compared where the human steers by more than {}.",
            text::angle(agreed.dead_band_rad)
        ),
    }
}

fn table(agreed: &Agreement) -> Table {
    let rows = agreed.rows().into_iter().map(|(label, value)| Row {
        cells: vec![label.into(), value],
        tone: "",
    });
    Table {
        caption: "Differences are driver minus human, in the angle of the front wheels.".into(),
        columns: vec!["figure".into(), "value".into()],
        words: 2,
        rows: rows.collect(),
    }
}
