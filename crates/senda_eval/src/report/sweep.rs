//! Many runs: rates with intervals by world, floor, light, speed, and every failure with how to repeat it.

use super::page::{Card, Figure, Page, Row, Section, Table, render};
use super::sweep_delivery::{self, DeliveryRow};
use crate::plot::{Axis, HeatGrid, LinePlot, RateRow, RateRows, Series, Stroke};
use crate::statistics::{Interval, Rate, bootstrap_mean, quantile, rate};
use crate::{Summary, text};
use serde::{Deserialize, Serialize};

/// One run of a sweep.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SweepRun {
    /// Under which name its world is counted: the world's, or a common one for random worlds.
    pub world: String,
    /// What colour the line or the lane's left edge has, in words.
    pub line_colour: String,
    /// What came out; `None` if the run could not be made.
    pub summary: Option<Summary>,
    /// Why it could not be made.
    pub error: String,
    /// The command line that repeats it.
    pub command: String,
    /// Further delay from the camera to the driver (s).
    pub latency_s: f64,
    /// Size of the frames where the sweep says it: columns and rows.
    pub image_px: Option<[u32; 2]>,
    /// Radius of the path's tightest curve (m); none where it is straight or unknown.
    pub tightest_m: Option<f64>,
}

impl SweepRow {
    fn is_of_deliveries(&self) -> bool {
        let deliveries = self.delivery.as_ref().map_or(0, |row| row.correct.count);
        deliveries > 0 && deliveries == self.completed.count
    }
}

impl SweepRun {
    /// Whether the goal was reached without leaving the corridor.
    fn completed(&self) -> bool {
        self.summary.as_ref().is_some_and(|summary| summary.completed)
    }

    /// The same, and the line or lane was never lost on the way.
    fn without_loss(&self) -> bool {
        self.summary
            .as_ref()
            .is_some_and(|summary| summary.completed && summary.lost == 0)
    }
}

/// Rates and means of the runs that share a property.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepRow {
    /// The property: `all`, `world`, `driver`, `vehicle`, `floor`, `light`, `line`, `curves`, `image`, `speed`, `latency`, `direction`.
    pub by: String,
    /// Its value.
    pub value: String,
    /// Runs that reached the goal without leaving the corridor.
    pub completed: Rate,
    /// Those of them that never lost the line or lane.
    pub without_loss: Rate,
    /// Mean lane error over runs (m) with its bootstrap interval.
    pub lane_error_m: Option<Interval>,
    /// 95th percentile of the runs' largest lane error (m).
    pub lane_error_max_p95_m: Option<f64>,
    /// Mean heading error over runs (rad) with its bootstrap interval.
    pub heading_error_rad: Option<Interval>,
    /// What became of packages. Where all runs are deliveries they have no lane errors: streets branch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delivery: Option<DeliveryRow>,
}

/// The figures of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepTable {
    /// First over all runs, then by every property that took more than one value.
    pub rows: Vec<SweepRow>,
    /// Runs that could not be made at all.
    pub errors: u64,
}

/// Resamples of a bootstrap: enough for two digits of an interval.
pub(super) const RESAMPLES: usize = 1000;

/// A property of a run as its value in words.
type Property = fn(&SweepRun, &Summary) -> String;

/// How runs are told apart.
const PROPERTIES: [(&str, Property); 11] = [
    ("driver", |_, s| s.driver.clone()),
    ("vehicle", |_, s| s.vehicle.clone()),
    ("world", |run, _| run.world.clone()),
    ("floor", |_, s| s.floor.clone()),
    ("light", |_, s| s.light.clone()),
    ("line", |run, _| run.line_colour.clone()),
    ("curves", |run, _| curves(run.tightest_m)),
    ("image", |run, _| {
        run.image_px.map_or_else(
            || "the vehicle's own".into(),
            |[width, height]| format!("{width}x{height}"),
        )
    }),
    ("speed", |_, s| {
        s.speed_mps.map_or_else(|| "the driver's own".into(), text::speed)
    }),
    ("latency", |run, _| {
        format!("{} ms", (run.latency_s * 1e3).round())
    }),
    ("direction", |_, s| {
        if s.reversed {
            "reversed".into()
        } else {
            "as drawn".into()
        }
    }),
];

/// How tight the tightest curve is: radii are told apart by doubling, so that it fits mini cars and roads.
fn curves(tightest_m: Option<f64>) -> String {
    let Some(radius_m) = tightest_m else {
        return "straight".into();
    };
    let mut low_m = 0.125;
    while 2.0 * low_m <= radius_m {
        low_m *= 2.0;
    }
    if radius_m < low_m {
        return format!("radius below {} m", text::short(low_m));
    }
    format!("radius {} to {} m", text::short(low_m), text::short(2.0 * low_m))
}

/// Rates with 95 % intervals, over all runs and by property. Runs that could not be made count as errors, not as losses.
pub fn sweep_table(runs: &[SweepRun]) -> SweepTable {
    let made: Vec<(&SweepRun, &Summary)> = runs
        .iter()
        .filter_map(|run| Some((run, run.summary.as_ref()?)))
        .collect();
    let mut rows = vec![row("all", "all runs", &made)];
    for (by, property) in PROPERTIES {
        let mut values: Vec<(String, Vec<(&SweepRun, &Summary)>)> = Vec::new();
        for (run, summary) in &made {
            let value = property(run, summary);
            match values.iter_mut().find(|(known, _)| *known == value) {
                Some((_, members)) => members.push((run, summary)),
                None => values.push((value, vec![(run, summary)])),
            }
        }
        let number: Option<fn(&SweepRun, &Summary) -> f64> = match by {
            "speed" => Some(|_, summary| summary.speed_mps.unwrap_or(0.0)),
            "latency" => Some(|run, _| run.latency_s),
            "curves" => Some(|run, _| run.tightest_m.unwrap_or(f64::INFINITY)),
            "image" => Some(|run, _| {
                run.image_px
                    .map_or(0.0, |[width, height]| f64::from(width * height))
            }),
            _ => None,
        };
        if let Some(number) = number {
            let first = |members: &[(&SweepRun, &Summary)]| number(members[0].0, members[0].1);
            values.sort_by(|a, b| first(&a.1).total_cmp(&first(&b.1)));
        }
        if values.len() > 1 {
            rows.extend(values.iter().map(|(value, members)| row(by, value, members)));
        }
    }
    SweepTable {
        rows,
        errors: (runs.len() - made.len()) as u64,
    }
}

fn row(by: &str, value: &str, members: &[(&SweepRun, &Summary)]) -> SweepRow {
    let count = members.len() as u64;
    let hits = |good: fn(&SweepRun) -> bool| members.iter().filter(|(run, _)| good(run)).count() as u64;
    let figures = |figure: fn(&Summary) -> Option<f64>| -> Vec<f64> {
        members
            .iter()
            .filter(|(_, summary)| summary.delivery.is_none())
            .filter_map(|(_, summary)| figure(summary))
            .filter(|v| v.is_finite())
            .collect()
    };
    let deliveries: Vec<_> = members
        .iter()
        .filter_map(|(_, summary)| summary.delivery.as_ref())
        .collect();
    SweepRow {
        by: by.into(),
        value: value.into(),
        completed: rate(hits(SweepRun::completed), count),
        without_loss: rate(hits(SweepRun::without_loss), count),
        lane_error_m: bootstrap_mean(&figures(|s| s.lane_error_mean_m), RESAMPLES, 1),
        lane_error_max_p95_m: quantile(&figures(|s| s.lane_error_max_m), 0.95),
        heading_error_rad: bootstrap_mean(&figures(|s| s.heading_error_mean_rad), RESAMPLES, 1),
        delivery: DeliveryRow::of(&deliveries),
    }
}

/// A report of a sweep.
pub fn sweep_html(page: &Page, runs: &[SweepRun]) -> String {
    let table = sweep_table(runs);
    let mut sections = vec![overview(&table)];
    sections.extend(speeds(&table));
    sections.extend(grid(runs));
    sections.push(failures(runs));
    render(page, Vec::new(), sections)
}

/// Failures listed with a command each; the rest is only counted.
const MOST_FAILURES: usize = 200;

fn overview(table: &SweepTable) -> Section {
    let only_deliveries = table.rows.first().is_some_and(SweepRow::is_of_deliveries);
    let (what, meaning) = if only_deliveries {
        (
            "Whole deliveries",
            "Delivered to the right depot, returned, no red light passed, never off the streets.",
        )
    } else {
        (
            "Runs without a loss",
            "Goal reached, never outside the corridor, line or lane never lost.",
        )
    };
    let drawn = |by: &str| -> Vec<&SweepRow> { table.rows.iter().filter(|row| row.by == by).collect() };
    // One axis for all, so that figures can be compared.
    let range = RateRows::fitting_range(table.rows.iter().map(|row| &row.without_loss));
    let figure = |by: &str, rows: &[&SweepRow]| {
        let title = if by == "all" {
            what.to_owned()
        } else {
            format!("{what}, by {by}")
        };
        let rows = rows
            .iter()
            .map(|row| RateRow {
                label: row.value.clone(),
                rate: row.without_loss,
                colour: 0,
            })
            .collect();
        let rates = RateRows {
            name: title.clone(),
            label: what.to_lowercase(),
            rows,
            range: Some(range),
            width_px: 560.0,
        };
        Figure {
            title,
            svg: rates.svg(),
            caption: format!("{meaning} Lines: 95 % intervals."),
        }
    };
    let mut figures: Vec<Figure> = PROPERTIES
        .iter()
        .map(|(by, _)| (*by, drawn(by)))
        // Beyond some 60 values a list is read better in the table.
        .filter(|(_, rows)| (2..=60).contains(&rows.len()))
        .map(|(by, rows)| figure(by, &rows))
        .collect();
    if figures.is_empty() {
        figures.push(figure("all", &drawn("all")));
    }
    Section {
        title: "Rates".into(),
        intro: if table.errors > 0 {
            format!(
                "{} runs could not be made at all; they are listed below and counted nowhere.",
                table.errors
            )
        } else {
            String::new()
        },
        cards: table
            .rows
            .first()
            .map(|all| cards(table, all))
            .unwrap_or_default(),
        grid: "wide",
        figures,
        tables: match sweep_delivery::table(table) {
            Some(deliveries) if only_deliveries => vec![deliveries],
            deliveries => std::iter::once(rates_table(table)).chain(deliveries).collect(),
        },
        ..Section::default()
    }
}

/// The whole sweep in large type.
fn cards(table: &SweepTable, all: &SweepRow) -> Vec<Card> {
    let interval = |rate: &Rate| format!("95 % interval {}", percent_range(rate));
    let mut cards = vec![Card::new(
        "Runs",
        all.completed.count.to_string(),
        match table.errors {
            0 => String::new(),
            errors => format!("{errors} more could not be run"),
        },
        "Runs that could be made",
        if table.errors > 0 { "bad" } else { "" },
    )];
    let mut rate_card = |title: &str, rate: &Rate, meaning: &str| {
        let value = text::percent(rate.interval.value);
        cards.push(Card::new(title, value, interval(rate), meaning, ""));
    };
    if all.is_of_deliveries() {
        rate_card(
            "Whole",
            &all.completed,
            "Delivered to the right depot, returned, no red light passed, never off the streets",
        );
    } else {
        rate_card(
            "Without a loss",
            &all.without_loss,
            "Goal reached, never outside the corridor, line or lane never lost",
        );
        rate_card(
            "Completed",
            &all.completed,
            "Goal reached without leaving the corridor",
        );
    }
    cards.extend(all.delivery.iter().flat_map(sweep_delivery::cards));
    if let Some(error) = all.lane_error_m {
        let detail = format!(
            "95 % interval {} – {}",
            text::length(error.low),
            text::length(error.high)
        );
        cards.push(Card::new(
            "Lane error, mean",
            text::length(error.value),
            detail,
            "Mean over runs",
            "",
        ));
    }
    if let Some(error) = all.heading_error_rad {
        let detail = format!(
            "95 % interval {} – {}",
            text::angle(error.low),
            text::angle(error.high)
        );
        cards.push(Card::new(
            "Heading error, mean",
            text::angle(error.value),
            detail,
            "Mean over runs",
            "",
        ));
    }
    cards
}

fn rates_table(table: &SweepTable) -> Table {
    let columns = [
        "by",
        "value",
        "runs",
        "completed",
        "95 % interval",
        "without a loss",
        "95 % interval",
        "lane error, mean",
        "95 % interval",
        "max, 95 % below",
        "heading error, mean",
    ];
    let mut before = "";
    let rows = table.rows.iter().map(|row| {
        let first = row.by != before;
        before = &row.by;
        Row {
            cells: cells(row, first),
            tone: if first { "first" } else { "" },
        }
    });
    Table {
        caption: "Completed: the goal was reached without leaving the corridor. Without a loss: and the line or lane was never lost. Rates with Wilson's intervals, means over runs with bootstrap intervals.".into(),
        columns: columns.map(String::from).to_vec(),
        words: 2,
        rows: rows.collect(),
    }
}

pub(super) fn percent_range(rate: &Rate) -> String {
    format!(
        "{} – {}",
        text::fixed(100.0 * rate.interval.low, 1),
        text::percent(rate.interval.high)
    )
}

fn cells(row: &SweepRow, first: bool) -> Vec<String> {
    let dash = || "–".to_owned();
    vec![
        if first { row.by.clone() } else { String::new() },
        row.value.clone(),
        row.completed.count.to_string(),
        text::percent(row.completed.interval.value),
        percent_range(&row.completed),
        text::percent(row.without_loss.interval.value),
        percent_range(&row.without_loss),
        row.lane_error_m.map_or_else(dash, |i| text::length(i.value)),
        row.lane_error_m.map_or_else(dash, |i| {
            format!("{} – {}", text::length(i.low), text::length(i.high))
        }),
        row.lane_error_max_p95_m.map_or_else(dash, text::length),
        row.heading_error_rad.map_or_else(dash, |i| text::angle(i.value)),
    ]
}

/// Losses against speed, where the sweep varied it.
fn speeds(table: &SweepTable) -> Option<Section> {
    let rows: Vec<&SweepRow> = table.rows.iter().filter(|row| row.by == "speed").collect();
    let speed_cmps = |row: &SweepRow| -> Option<f64> {
        let (number, unit) = row.value.split_once(' ')?;
        let factor = if unit == "m/s" { 100.0 } else { 1.0 };
        number.parse::<f64>().ok().map(|number| number * factor)
    };
    let line = |pick: fn(&Interval) -> f64| -> Vec<[f64; 2]> {
        rows.iter()
            .filter_map(|row| Some([speed_cmps(row)?, 100.0 * (1.0 - pick(&row.without_loss.interval))]))
            .collect()
    };
    let losses = line(|interval| interval.value);
    if losses.len() < 2 {
        return None;
    }
    let series = [
        ("losses", losses, Stroke::Line, 1),
        ("95 % interval", line(|interval| interval.low), Stroke::Dashed, 6),
        ("", line(|interval| interval.high), Stroke::Dashed, 6),
    ]
    .map(|(name, points, stroke, colour)| Series {
        name: name.into(),
        points,
        colour,
        stroke,
        ..Series::default()
    });
    let plot = LinePlot {
        name: "Runs with a loss against speed".into(),
        x: Axis::new("speed", "cm/s"),
        y: Axis::new("runs with a loss", "%").including(0.0),
        series: series.to_vec(),
        rules: vec![crate::plot::Rule {
            y: 1.0,
            name: "1 %".into(),
        }],
        width_px: 560.0,
        height_px: 280.0,
        ..LinePlot::default()
    };
    Some(Section {
        title: "Losses against speed".into(),
        grid: "wide",
        figures: vec![Figure {
            title: "Runs with a loss".into(),
            svg: plot.svg(),
            caption: "Everything but runs that reached the goal without leaving the corridor and without losing sight.".into(),
        }],
        ..Section::default()
    })
}

/// Losses by floor and light, where the sweep varied both.
fn grid(runs: &[SweepRun]) -> Option<Section> {
    let made: Vec<(&SweepRun, &Summary)> = runs
        .iter()
        .filter_map(|run| Some((run, run.summary.as_ref()?)))
        .collect();
    let distinct = |pick: fn(&Summary) -> &String| {
        let mut values: Vec<String> = Vec::new();
        for (_, summary) in &made {
            if !values.contains(pick(summary)) {
                values.push(pick(summary).clone());
            }
        }
        values
    };
    let (floors, lights) = (distinct(|s| &s.floor), distinct(|s| &s.light));
    if floors.len() < 2 || lights.len() < 2 {
        return None;
    }
    let cell = |floor: &String, light: &String| {
        let here: Vec<&SweepRun> = made
            .iter()
            .filter(|(_, s)| s.floor == *floor && s.light == *light)
            .map(|(run, _)| *run)
            .collect();
        let lost = here.iter().filter(|run| !run.without_loss()).count();
        (!here.is_empty()).then(|| {
            (
                lost as f64 / here.len() as f64,
                format!("{lost} of {}", here.len()),
            )
        })
    };
    let values = floors
        .iter()
        .map(|floor| lights.iter().map(|light| cell(floor, light)).collect())
        .collect();
    let heat = HeatGrid {
        name: "Runs with a loss by floor and light".into(),
        rows: floors,
        columns: lights,
        values,
        range: [0.0, 0.2],
        full_is_bad: true,
    };
    Some(Section {
        title: "Floor and light together".into(),
        grid: "wide",
        figures: vec![Figure {
            title: "Runs with a loss".into(),
            svg: heat.svg(),
            caption: "Full colour: one run in five or more.".into(),
        }],
        ..Section::default()
    })
}

fn failures(runs: &[SweepRun]) -> Section {
    let failed: Vec<&SweepRun> = runs.iter().filter(|run| !run.without_loss()).collect();
    let words = |run: &SweepRun| match &run.summary {
        None => format!("{}: could not be made: {}", run.world, run.error),
        Some(s) => {
            let speed = s
                .speed_mps
                .map_or(String::new(), |speed| format!(", {}", text::speed(speed)));
            let verdict = s.verdict().0;
            let lost = match s.lost {
                0 => String::new(),
                1 => ", line lost once".into(),
                n => format!(", line lost {n} times"),
            };
            format!(
                "{} on {}, {}, {}{speed}, seed {}: {verdict}{lost}",
                s.driver, s.world, s.floor, s.light, s.seed
            )
        }
    };
    let intro = match failed.len() {
        0 => "None.".into(),
        n if n > MOST_FAILURES => {
            format!("{n} runs; the first {MOST_FAILURES} with the command that repeats each.")
        }
        n => format!("{n} runs, each with the command that repeats it."),
    };
    Section {
        title: "Failures".into(),
        intro,
        commands: failed
            .iter()
            .take(MOST_FAILURES)
            .map(|run| (words(run), run.command.clone()))
            .collect(),
        ..Section::default()
    }
}
