//! One run in a report: key figures, player, map, plots.

use super::columns::{Columns, columns};
use super::delivery;
use super::frames::{self, Film, Look};
use super::page::{Card, Figure, Row, Section, Table};
use super::plots::{self, Group};
use super::signals::{Column, fixed_numbers};
use crate::Summary;
use crate::metrics::Course;
use crate::odometry;
use crate::plot::{Map, MapStyle, Stroke, Track, hard_curves};
use crate::text;
use senda_core::Truth;
use senda_data::Recording;
use senda_geom::{Pose2, Vec2};
use senda_world::World;
use serde::Serialize;
use serde_json::{Value, json};

/// A run to report on.
#[derive(Debug, Clone, Copy)]
pub struct ReportRun<'a> {
    /// Title of the run; empty: made of driver and world.
    pub title: &'a str,
    /// Its figures.
    pub summary: &'a Summary,
    /// What was recorded.
    pub recording: &'a Recording,
    /// The world it was driven in, as it was driven (reversed if it was); `None` on a real vehicle.
    pub world: Option<&'a World>,
    /// The yardstick that the figures were taken with; `None`: that of the world.
    pub course: Option<Course<'a>>,
    /// The command line that repeats the run; empty for none.
    pub command: &'a str,
    /// Wall time that the driver took for each step (s); empty where unknown.
    pub frame_times_s: &'a [f64],
    /// What a network looked at, for the player.
    pub look: Option<&'a Look>,
}

/// What the template shows of a run.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct RunSection {
    id: String,
    title: String,
    place: String,
    verdict: String,
    good: bool,
    mini: String,
    teaser: String,
    chips: Vec<(&'static str, String)>,
    pub(super) cards: Vec<Card>,
    size: Option<[usize; 2]>,
    looks: bool,
    frames_caption: String,
    map: String,
    map_caption: String,
    pub(super) groups: Vec<Group>,
    /// Row of the data, time and words.
    events: Vec<(usize, String, String)>,
    /// Title, text, and whether it is for copying.
    details: Vec<(String, String, bool)>,
    data: String,
}

/// More steps than these are thinned for the page's script; plots and figures use all.
const MOST_ROWS: usize = 6000;
/// Events beyond this number are not listed.
const MOST_EVENTS: usize = 300;

/// Builds the section of run number `index`, with at most `budget_bytes` of camera frames.
pub(super) fn section(run: &ReportRun, index: usize, budget_bytes: usize) -> RunSection {
    section_with(run, index, budget_bytes, Vec::new())
}

/// As [`section`], with further columns.
pub(super) fn section_with(
    run: &ReportRun,
    index: usize,
    budget_bytes: usize,
    more: Vec<Column>,
) -> RunSection {
    // A delivery leads over many streets: the world's path is no yardstick for it.
    let course = match run.summary.delivery {
        Some(_) => None,
        None => run
            .course
            .or_else(|| run.world.map(|world| Course::of(world, run.summary.laps_wanted))),
    };
    let mut columns = columns(run, course.as_ref());
    columns.list.extend(more);
    let film = frames::film(run.recording, budget_bytes, run.look);
    let stride = run.recording.steps.len().div_ceil(MOST_ROWS).max(1);
    let events = events(run.recording, stride);
    let summary = run.summary;
    let (verdict, good) = summary.verdict();
    let map = match (run.world, &course) {
        (Some(world), _) => Some(Map::of_world(world)),
        (None, course) => course.as_ref().map(Map::of_course),
    };
    let map = map.map(|map| with_tracks(run, map, &columns));
    let enlarged = match (&map, &course) {
        (Some(map), Some(course)) => hard_curve_group(map, course),
        _ => None,
    };
    let (map, mini) = map.map(maps).unwrap_or_default();
    let mut groups: Vec<Group> = summary.delivery.iter().map(delivery::group).collect();
    groups.extend(plots::groups(&columns));
    groups.extend(enlarged);
    RunSection {
        id: format!("run-{}", index + 1),
        title: title(run),
        place: [&summary.floor, &summary.light].map(String::as_str).into_iter().filter(|s| !s.is_empty()).collect::<Vec<_>>().join(", "),
        verdict,
        good,
        mini,
        teaser: teaser(summary),
        chips: chips(summary),
        cards: cards(summary),
        map,
        map_caption: "The path of the vehicle's axle (blue) over the painted lines (grey), true to scale; dashed, where the vehicle has encoders, the path that they alone tell of. The bar across is the start, the arrow the driving direction; the shaded strip is the corridor.".into(),
        groups,
        data: data(run, &columns, &film, &events, stride),
        size: film.size,
        looks: run.look.is_some(),
        frames_caption: film.caption,
        events: events.into_iter().take(MOST_EVENTS).map(|(row, time_s, words)| (row, format!("{} s", text::fixed(time_s, 2)), words)).collect(),
        details: details(run),
    }
}

/// A table of all runs.
pub(super) fn comparison(runs: &[ReportRun]) -> Section {
    let columns = [
        "run",
        "result",
        "floor",
        "light",
        "speed",
        "laps",
        "left",
        "lost",
        "lane error",
        "max",
        "heading error",
        "max",
        "lap time",
    ];
    let or_dash = |value: Option<String>| value.unwrap_or_else(|| "–".into());
    let rows = runs.iter().map(|run| {
        let s = run.summary;
        let cells = vec![
            title(run),
            s.verdict().0,
            s.floor.clone(),
            s.light.clone(),
            or_dash(s.speed_mps.map(text::speed)),
            s.laps.to_string(),
            s.departures.to_string(),
            s.lost.to_string(),
            or_dash(s.lane_error_mean_m.map(text::length)),
            or_dash(s.lane_error_max_m.map(text::length)),
            or_dash(s.heading_error_mean_rad.map(text::angle)),
            or_dash(s.heading_error_max_rad.map(text::angle)),
            or_dash(s.lap_time_s.map(|t| format!("{} s", text::fixed(t, 1)))),
        ];
        Row {
            cells,
            tone: if s.verdict().1 { "" } else { "bad" },
        }
    });
    let table = Table {
        caption: "Means per metre of road. Left: how often the vehicle left the corridor. Lost: how often the driver lost sight of the line or lane.".into(),
        columns: columns.map(String::from).to_vec(),
        words: 4,
        rows: rows.collect(),
    };
    Section {
        title: "All runs".into(),
        tables: vec![table],
        ..Section::default()
    }
}

fn title(run: &ReportRun) -> String {
    if !run.title.is_empty() {
        return run.title.to_owned();
    }
    let summary = run.summary;
    let reversed = if summary.reversed { ", reversed" } else { "" };
    if summary.world.is_empty() {
        format!("{} on {}", summary.driver, summary.vehicle)
    } else {
        format!("{} on {}{reversed}", summary.driver, summary.world)
    }
}

fn teaser(summary: &Summary) -> String {
    if let Some(delivery) = &summary.delivery {
        return format!(
            "{} stops, {} s",
            delivery.stops.len(),
            text::fixed(delivery.time_s, 1)
        );
    }
    match (summary.lane_error_mean_m, summary.heading_error_mean_rad) {
        (Some(lane), Some(heading)) => {
            format!("{} · {} mean error", text::length(lane), text::angle(heading))
        }
        _ => format!("{} frames", summary.frames),
    }
}

fn chips(summary: &Summary) -> Vec<(&'static str, String)> {
    let direction = if summary.world.is_empty() {
        String::new()
    } else if summary.reversed {
        "reversed".into()
    } else {
        "as drawn".into()
    };
    [
        ("world", summary.world.clone()),
        ("direction", direction),
        ("driver", summary.driver.clone()),
        ("vehicle", summary.vehicle.clone()),
        ("floor", summary.floor.clone()),
        ("light", summary.light.clone()),
        (
            "speed asked",
            summary.speed_mps.map_or(String::new(), text::speed),
        ),
        ("seed", summary.seed.to_string()),
    ]
    .into_iter()
    .filter(|(_, value)| !value.is_empty())
    .collect()
}

fn cards(summary: &Summary) -> Vec<Card> {
    let mut cards = summary.delivery.as_ref().map(delivery::cards).unwrap_or_default();
    let follows_path = summary.delivery.is_none();
    let mut card =
        |label, figure, detail, hint, tone| cards.push(Card::new(label, figure, detail, hint, tone));
    if let (true, Some(mean), Some(max)) = (follows_path, summary.lane_error_mean_m, summary.lane_error_max_m)
    {
        let undriven = if summary.has_undriven_road() {
            "; undriven road counts as outside"
        } else {
            ""
        };
        card(
            "Lane error, mean",
            text::length(mean),
            format!("max {}{undriven}", text::length(max)),
            "Distance of the axle from the middle of the line or lane, averaged over the road (B7)",
            "",
        );
    }
    if let (true, Some(lane), Some(heading)) = (
        follows_path && summary.has_undriven_road(),
        summary.other_means.lane_error_as_defined_m,
        summary.other_means.heading_error_as_defined_rad,
    ) {
        card(
            "Lane error where it drove",
            text::length(lane),
            format!("heading error {}", text::angle(heading)),
            "The mean over the frames alone: road that was not driven counts for nothing here",
            "",
        );
    }
    if let (true, Some(mean), Some(max)) = (
        follows_path,
        summary.heading_error_mean_rad,
        summary.heading_error_max_rad,
    ) {
        card(
            "Heading error, mean",
            text::angle(mean),
            format!("max {}", text::angle(max)),
            "Angle between the vehicle's displacement and the road, averaged over the road (B8)",
            "",
        );
    }
    if let Some(part) = summary.completion.filter(|_| follows_path) {
        let wanted = summary
            .laps_wanted
            .map_or(String::new(), |laps| format!(" of {}", text::short(laps)));
        let tone = if summary.completed { "good" } else { "bad" };
        card(
            "Driven inside the corridor",
            text::percent(part),
            format!(
                "{}{wanted} {}",
                summary.laps,
                if summary.laps_wanted == Some(1.0) {
                    "lap"
                } else {
                    "laps"
                }
            ),
            "Part of the road to be driven that was driven inside the corridor",
            tone,
        );
    }
    if let Some(time) = summary.lap_time_s {
        card(
            "Lap time",
            format!("{} s", text::fixed(time, 1)),
            format!("{} on average", text::speed(summary.mean_speed_mps)),
            "Mean time of the laps that never left the corridor",
            "",
        );
    } else {
        card(
            "Duration",
            format!("{} s", text::fixed(summary.duration_s, 1)),
            format!("{} on average", text::speed(summary.mean_speed_mps)),
            "From the first frame to the last",
            "",
        );
    }
    card(
        "Distance driven",
        text::length(summary.distance_m),
        format!("{} frames", summary.frames),
        "Length of the driven path",
        "",
    );
    if let Some(odometry) = &summary.odometry {
        card(
            "Odometry ends off by",
            text::length(odometry.end_error_m),
            format!("heading {}", text::angle(odometry.end_error_rad)),
            "Distance from the true position at the end to the one reckoned from the wheels' encoders alone (C14)",
            "",
        );
    }
    if summary.completion.is_some() && follows_path {
        let tone = if summary.departures > 0 { "bad" } else { "" };
        card(
            "Left the corridor",
            times(summary.departures),
            summary.first_departure_percent.map_or_else(
                || {
                    if summary.has_undriven_road() {
                        "never as far as it drove".into()
                    } else {
                        "never outside".into()
                    }
                },
                |p| format!("first at {} % of the lap", text::fixed(p, 0)),
            ),
            "Episodes outside the corridor",
            tone,
        );
    }
    if let Some(found) = summary.found_rate {
        let tone = if summary.lost > 0 { "bad" } else { "" };
        card(
            "Line or lane seen",
            text::percent(found),
            format!("lost {}", times(summary.lost)),
            "Part of the frames in which the driver found what it follows",
            tone,
        );
    }
    if let (Some(change), Some(per_m)) = (
        summary.smoothness.command_change_radps2,
        summary.smoothness.command_change_radps_per_m,
    ) {
        card(
            "Steering change",
            format!("{} rad/s²", text::short(change)),
            format!("{} rad/s per metre", text::short(per_m)),
            "Root mean square of the change of the commanded yaw rate: smaller is calmer",
            "",
        );
    }
    cards.extend(frame_time_card(summary));
    cards
}

/// How long the driver took; `None` where nobody measured it.
pub(super) fn frame_time_card(summary: &Summary) -> Option<Card> {
    let (mean_s, p95_s) = (summary.frame_time_mean_s?, summary.frame_time_p95_s?);
    Some(Card::new(
        "Time a frame",
        format!("{} ms", text::short(1e3 * mean_s)),
        format!("95 % below {} ms", text::short(1e3 * p95_s)),
        "Wall time that the driver needed for one frame",
        "",
    ))
}

fn times(count: u32) -> String {
    match count {
        0 => "never".into(),
        1 => "once".into(),
        n => format!("{n} times"),
    }
}

/// Title of the list of figures.
const ALL_FIGURES: &str = "All figures";

/// A figure a line.
fn listed(figures: Vec<(&'static str, String)>) -> String {
    let line = |(label, value): (&str, String)| format!("{label}: {value}");
    figures.into_iter().map(line).collect::<Vec<_>>().join("\n")
}

impl RunSection {
    /// Other figures in place of the summary's.
    pub(super) fn set_figures(&mut self, figures: Vec<(&'static str, String)>) {
        for (title, text, _) in &mut self.details {
            if title == ALL_FIGURES {
                *text = listed(figures);
                return;
            }
        }
    }
}

fn details(run: &ReportRun) -> Vec<(String, String, bool)> {
    let header = &run.recording.header;
    let mut details = Vec::new();
    if !run.command.is_empty() {
        details.push(("Repeat this run".into(), run.command.to_owned(), true));
    }
    if !header.scenario.is_empty() {
        details.push((
            "Scenario with all settings (TOML)".into(),
            header.scenario.clone(),
            true,
        ));
    }
    if let Some(world) = &header.world {
        details.push(("World as it was driven (TOML)".into(), world.clone(), true));
    }
    details.push((ALL_FIGURES.into(), listed(run.summary.rows()), true));
    if !run.recording.warnings.is_empty() {
        details.push((
            format!("Warnings ({})", run.recording.warnings.len()),
            run.recording.warnings.join("\n"),
            false,
        ));
    }
    details
}

/// Events as row of the data, time (s) and words; repeated neighbours once.
fn events(recording: &Recording, stride: usize) -> Vec<(usize, f64, String)> {
    let mut events: Vec<(usize, f64, String)> = Vec::new();
    let mut before: &[String] = &[];
    for (i, step) in recording.steps.iter().enumerate() {
        for event in step
            .explanation
            .events
            .iter()
            .filter(|event| !before.contains(event))
        {
            events.push((i / stride, step.stamp.as_s(), text::printable(event)));
        }
        before = &step.explanation.events;
    }
    events
}

/// The map with the driven path, and the one that the wheels tell of.
fn with_tracks(run: &ReportRun, mut map: Map, columns: &Columns) -> Map {
    let steps = &run.recording.steps;
    let points = steps
        .iter()
        .map(|s| s.truth.map_or(Vec2::NAN, |t| t.world_from_vehicle.position()))
        .collect();
    map.name = format!("Driven path on the map of {}", run.summary.world);
    map.tracks = vec![Track {
        name: "driven path".into(),
        points,
        inside: columns.inside.clone(),
        ..Track::default()
    }];
    if let Some((path, _)) = odometry::of_recording(run.recording) {
        map.tracks.push(Track {
            name: "odometry".into(),
            points: path.iter().map(Pose2::position).collect(),
            colour: 1,
            stroke: Stroke::Dashed,
            ..Track::default()
        });
    }
    let body = &run.recording.header.body;
    map.vehicle_m = Some([body.length_m, body.width_m]);
    map
}

/// The hard curves enlarged (B9); `None` where the road goes straight.
fn hard_curve_group(map: &Map, course: &Course) -> Option<Group> {
    let figures: Vec<Figure> = hard_curves(course)
        .into_iter()
        .enumerate()
        .map(|(number, curve)| {
            let title = format!("Hard curve {}", number + 1);
            let [low, high] = curve.window;
            let is_inside = |point: &Vec2| low.cmple(*point).all() && point.cmple(high).all();
            let driven = map.tracks.first().map_or(&[][..], |track| &track.points);
            let was_reached = driven.iter().any(is_inside);
            let mut enlarged = map.clone();
            enlarged.name = format!("{title}, enlarged");
            enlarged.window = Some(curve.window);
            // The vehicle that the player moves is on the whole map.
            enlarged.vehicle_m = None;
            (enlarged.width_px, enlarged.max_height_px) = (480.0, 320.0);
            Figure {
                title,
                svg: enlarged.svg(),
                caption: format!(
                    "The curve at {} % of the lap: {} the painted lines and the corridor, true to scale.",
                    text::fixed(curve.percent, 0),
                    if was_reached {
                        "the driven path over"
                    } else {
                        "not reached in this run;"
                    }
                ),
            }
        })
        .collect();
    (!figures.is_empty()).then(|| Group {
        title: "Hard curves".into(),
        intro: "Where the road turns most, enlarged.".into(),
        figures,
        tables: Vec::new(),
    })
}

/// The map, large and as a thumbnail.
fn maps(mut map: Map) -> (String, String) {
    map.width_px = 430.0;
    map.max_height_px = 380.0;
    let large = map.svg();
    map.style = MapStyle::Mini;
    (map.width_px, map.max_height_px) = (74.0, 62.0);
    (large, map.svg())
}

/// What the page's script needs.
fn data(
    run: &ReportRun,
    columns: &Columns,
    film: &Film,
    events: &[(usize, f64, String)],
    stride: usize,
) -> String {
    let thin = |values: &[f64]| -> Vec<f64> { values.iter().step_by(stride).copied().collect() };
    let truth = |value: &dyn Fn(&Truth) -> f64| -> Vec<f64> {
        run.recording
            .steps
            .iter()
            .step_by(stride)
            .map(|s| s.truth.as_ref().map_or(f64::NAN, value))
            .collect()
    };
    let mut by_key = serde_json::Map::new();
    for column in &columns.list {
        by_key.insert(
            column.key.clone(),
            Column {
                values: thin(&column.values),
                ..column.clone()
            }
            .json(),
        );
    }
    let readout: Vec<[&str; 2]> = [
        ["offset", "lane error"],
        ["heading", "heading error"],
        ["human", "human"],
        ["driver", "driver"],
        ["steering", "steering"],
        ["true_speed", "speed"],
        ["signal d_m", "d, driver"],
        ["signal theta_rad", "θ, driver"],
        ["signal found", "found"],
        ["frame_time", "time spent"],
    ]
    .into_iter()
    .filter(|[key, _]| columns.get(key).is_some())
    .collect();
    let frames: Vec<Value> = film
        .frames
        .iter()
        .map(|frame| {
            let mut frame = frame.clone();
            frame["step"] = json!(frame["step"].as_u64().unwrap_or(0) as usize / stride);
            frame
        })
        .collect();
    // The newest first: the script takes the first that is near.
    let events: Vec<Value> = events
        .iter()
        .rev()
        .take(MOST_EVENTS)
        .map(|(row, _, words)| json!([row, words]))
        .collect();
    text::script_json(&json!({
        "t": fixed_numbers(&thin(&columns.time_s), 3),
        "percent": columns.percent.as_ref().map(|p| fixed_numbers(&thin(p), 2)),
        "x": fixed_numbers(&truth(&|t: &Truth| t.world_from_vehicle.x_m), 4),
        "y": fixed_numbers(&truth(&|t| t.world_from_vehicle.y_m), 4),
        "heading": fixed_numbers(&truth(&|t| t.world_from_vehicle.heading_rad.to_degrees()), 1),
        "columns": by_key,
        "readout": readout,
        "frames": frames,
        "look_area": run.look.map(|look| look.area),
        "events": events,
    }))
}
