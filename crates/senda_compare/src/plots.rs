//! Plots of one lap of each row: against per cent of the lap, on the map, in the hard curves, and network against human.

use crate::CompareError;
use crate::figure::Figure;
use crate::job::{Task, Work};
use crate::plan::{Control, Row};
use crate::results::Results;
use crate::work::{Crew, Shop};
use senda_core::{Command, Drive};
use senda_data::Recording;
use senda_eval::Summary;
use senda_eval::metrics::{Course, trace};
use senda_eval::plot::{
    Axis, COLOURS, LinePlot, Map, Rule, Series, Stroke, Track, against_percent, hard_curves,
};
use senda_eval::report::{Part, PartFigure};
use senda_eval::summary::truths;
use senda_geom::Vec2;
use senda_learn::offline;
use senda_nets::Model;
use senda_run::scenario::find_world;
use senda_run::{Ears, drive};
use senda_world::World;
use std::path::PathBuf;

/// A lap of one row that a page shows.
pub struct Shown {
    /// Number of the row.
    pub row: usize,
    /// Seed of its training: the one whose lane error is the middle one of all seeds.
    pub seed: u64,
    /// Title for people.
    pub title: String,
    /// The lap's figures.
    pub summary: Summary,
    /// What the driver's camera saw and what was commanded.
    pub recording: Recording,
    /// File of the network that steered.
    pub steered_by: PathBuf,
}

/// The world of the first judging lap, and that lap of every row, driven again (it is the same lap to the bit).
pub struct Laps {
    /// The world.
    pub world: World,
    /// One lap for each row, in the plan's order.
    pub laps: Vec<Shown>,
}

/// What a network answered to a human's frames, and the human.
pub(crate) struct BesideHuman {
    /// Of the row.
    title: String,
    /// `steering` or `throttle`.
    output: String,
    network: Vec<f64>,
    human: Vec<f64>,
}

impl Shop<'_> {
    /// Drives the first judging lap of every row again, this time with pictures. `None` when somebody interrupted.
    pub(crate) fn show(&self, results: &Results, crew: &Crew) -> Result<Option<Laps>, CompareError> {
        let world = find_world(&self.plan.judging.worlds[0])?;
        let mut laps = Vec::new();
        for (index, row) in self.plan.rows.iter().enumerate() {
            let seed = middle_seed(results, index);
            let unit = self
                .jobs
                .units
                .iter()
                .find(|unit| unit.row == index && unit.seed == seed);
            let Some((unit, lap)) = unit.and_then(|unit| Some((unit, *unit.laps.first()?.1.first()?))) else {
                continue;
            };
            let Work::Drive(scenario) = &self.jobs.tasks[lap].work else {
                continue;
            };
            let scenario = self.with_models(scenario, &unit.models);
            let rows = self.plan.rows.len();
            let mut ears = Ears {
                progress: Box::new(|part| {
                    (crew.progress)(&crate::Progress {
                        done: index,
                        total: rows,
                        part: (index as f64 + part) / rows as f64,
                        title: "laps for the report".into(),
                    });
                }),
                interrupted: Box::new(|| (crew.interrupted)()),
                clock_ns: Box::new(|| 0),
            };
            let (outcome, recording) = drive::recorded_by_first_camera(&scenario, &mut ears)?;
            if outcome.ending == drive::Ending::Interrupted {
                return Ok(None);
            }
            laps.push(Shown {
                row: index,
                seed,
                title: title(row),
                summary: outcome.summary,
                recording,
                steered_by: self.path(unit.models[0]),
            });
        }
        Ok(Some(Laps { world, laps }))
    }

    /// What each row answers to the frames of the first held-out lap, beside the human who drove it.
    pub(crate) fn beside_human(&self, shown: &Laps) -> Result<Vec<BesideHuman>, CompareError> {
        let mut told = Vec::new();
        for lap in &shown.laps {
            let unit = self
                .jobs
                .units
                .iter()
                .find(|unit| unit.row == lap.row && unit.seed == lap.seed);
            let Some(unit) = unit else { continue };
            let judge: &Task = &self.jobs.tasks[unit.offline];
            for (number, path) in unit.models.iter().enumerate() {
                let samples = self.samples(held_out(judge, unit.models.len(), number))?;
                let first = samples.part(|run| {
                    if run.frames.start == 0 {
                        0..run.frames.len()
                    } else {
                        0..0
                    }
                });
                let model = Model::load(&self.path(*path))?;
                let answers = offline::answers(&model, &first);
                let outputs = first.outputs.max(1);
                for (index, output) in model.outputs.iter().enumerate() {
                    let every = |values: &[f32]| {
                        let mine = values.iter().skip(index).step_by(outputs);
                        mine.map(|value| f64::from(*value)).collect()
                    };
                    told.push(BesideHuman {
                        title: lap.title.clone(),
                        output: output.name.clone(),
                        network: every(&answers),
                        human: every(&first.targets),
                    });
                }
            }
        }
        Ok(told)
    }

    /// Jobs whose results the plots need beside the tables'.
    pub(crate) fn needed_for_plots(&self) -> Vec<usize> {
        let mut needed: Vec<usize> = self
            .jobs
            .units
            .iter()
            .flat_map(|unit| {
                let judge = &self.jobs.tasks[unit.offline];
                let count = unit.models.len();
                (0..count).map(move |number| held_out(judge, count, number))
            })
            .collect();
        needed.sort_unstable();
        needed.dedup();
        needed
    }
}

/// The job of a model's held-out frames: an offline judgement needs its models, then the training and the held-out frames of each.
fn held_out(judge: &Task, models: usize, number: usize) -> usize {
    judge.needs[models + 2 * number + 1]
}

fn title(row: &Row) -> String {
    format!("{}, {}", row.name, row.control.title())
}

/// The seed whose lane error is the middle one.
fn middle_seed(results: &Results, row: usize) -> u64 {
    let mut seeds: Vec<(f64, u64)> = results.rows[row]
        .first()
        .into_iter()
        .flatten()
        .map(|trained| {
            (
                Figure::Lane
                    .of(&trained.laps, &trained.offline)
                    .unwrap_or(f64::INFINITY),
                trained.seed,
            )
        })
        .collect();
    seeds.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    seeds
        .get(seeds.len().saturating_sub(1) / 2)
        .map_or(1, |(_, seed)| *seed)
}

/// A lap as columns against per cent.
struct Columns {
    percent: Vec<f64>,
    steering_deg: Vec<f64>,
    throttle: Vec<f64>,
    offset_m: Vec<f64>,
    heading_deg: Vec<f64>,
    track: Vec<Vec2>,
    inside: Vec<bool>,
}

fn columns(lap: &Shown, world: &World) -> Columns {
    let course = Course::of(world, Some(1.0));
    let truths = truths(&lap.recording);
    let rows = trace(&course, &truths);
    let body = &lap.recording.header.body;
    let steps = || lap.recording.steps.iter().filter(|step| step.truth.is_some());
    let steering = |command: &Command| {
        body.steering_of(command.turn, body.speed_of(command))
            .to_degrees()
    };
    Columns {
        percent: rows.percent,
        steering_deg: steps().map(|step| steering(&step.command)).collect(),
        throttle: steps()
            .map(|step| match step.command.drive {
                Drive::Throttle(part) => part,
                Drive::SpeedMps(_) => f64::NAN,
            })
            .collect(),
        offset_m: rows.offset_m,
        heading_deg: rows
            .heading_error_rad
            .iter()
            .map(|rad| rad.to_degrees())
            .collect(),
        track: truths
            .iter()
            .map(|truth| truth.world_from_vehicle.position())
            .collect(),
        inside: rows.inside,
    }
}

/// All plots of the laps.
pub(crate) fn parts(rows: &[Row], shown: &Laps, beside_human: &[BesideHuman]) -> Vec<Part> {
    let mut parts = Vec::new();
    let all: Vec<(usize, Columns)> = shown
        .laps
        .iter()
        .map(|lap| (lap.row, columns(lap, &shown.world)))
        .collect();
    for (_, control) in Control::ALL {
        let chosen: Vec<(&Row, &Columns)> = all
            .iter()
            .map(|(row, columns)| (&rows[*row], columns))
            .filter(|(row, _)| row.control == control)
            .collect();
        let groups = chosen.len().div_ceil(COLOURS);
        for (number, group) in chosen.chunks(COLOURS).enumerate() {
            let suffix = if groups > 1 {
                format!(" ({} of {groups})", number + 1)
            } else {
                String::new()
            };
            parts.push(Part {
                title: format!("Plots: {}{suffix}", control.title()),
                intro: format!(
                    "One lap of {} for each network, of the seed in the middle of all by lane error. Against per cent of the lap.",
                    shown.world.name
                ),
                figures: group_figures(group, &shown.world),
                ..Part::default()
            });
        }
    }
    let figures: Vec<PartFigure> = beside_human.iter().map(human_figure).collect();
    if !figures.is_empty() {
        parts.push(Part {
            title: "Frame by frame, network against human".into(),
            intro: "The steering and throttle that a human gave on the first held-out lap, and what each network answers to the same frames (B6).".into(),
            figures,
            ..Part::default()
        });
    }
    parts
}

fn group_figures(group: &[(&Row, &Columns)], world: &World) -> Vec<PartFigure> {
    type Values = fn(&Columns) -> &[f64];
    let kinds: [(&str, &str, &str, Values, &str); 4] = [
        (
            "Steering",
            "steering",
            "°",
            |c| &c.steering_deg,
            "Commanded angle of the front wheels; left is positive.",
        ),
        (
            "Throttle",
            "throttle",
            "",
            |c| &c.throttle,
            "Commanded pedal, negative brakes.",
        ),
        (
            "Lane error",
            "lane error",
            "m",
            |c| &c.offset_m,
            "Distance from the middle of the road; left is positive. Dotted: the edges.",
        ),
        (
            "Heading error",
            "heading error",
            "°",
            |c| &c.heading_deg,
            "Direction of the displacement against the road's.",
        ),
    ];
    let mut figures = Vec::new();
    for (title, label, unit, values, caption) in kinds {
        let series: Vec<Series> = group
            .iter()
            .enumerate()
            .filter(|(_, (_, columns))| values(columns).iter().any(|value| value.is_finite()))
            .map(|(colour, (row, columns))| Series {
                name: row.name.clone(),
                key: String::new(),
                points: against_percent(&columns.percent, values(columns)),
                colour,
                stroke: Stroke::Thin,
            })
            .collect();
        if series.is_empty() {
            continue;
        }
        let half_m = world.corridor_half_width_m;
        let edges = [half_m, -half_m].map(|y| Rule {
            y,
            name: String::new(),
        });
        let plot = LinePlot {
            name: format!("{title} against per cent of the lap"),
            x: Axis::new("lap", "%").ranged(0.0, 100.0),
            y: Axis::new(label, unit).including(0.0),
            rules: if label == "lane error" {
                edges.to_vec()
            } else {
                Vec::new()
            },
            series,
            width_px: 980.0,
            height_px: 300.0,
            ..LinePlot::default()
        };
        figures.push(PartFigure {
            title: title.into(),
            svg: plot.svg(),
            caption: caption.into(),
        });
    }
    figures.push(map_figure(group, world, None));
    for (number, curve) in hard_curves(&Course::of(world, None)).into_iter().enumerate() {
        let mut figure = map_figure(group, world, Some(curve.window));
        figure.title = format!("Hard curve {}", number + 1);
        figure.caption = format!("The curve at {:.0} % of the lap, enlarged.", curve.percent);
        figures.push(figure);
    }
    figures
}

fn map_figure(group: &[(&Row, &Columns)], world: &World, window: Option<[Vec2; 2]>) -> PartFigure {
    let mut map = Map::of_world(world);
    map.window = window;
    map.tracks = group
        .iter()
        .enumerate()
        .map(|(colour, (row, columns))| Track {
            name: row.name.clone(),
            points: columns.track.clone(),
            inside: columns.inside.clone(),
            colour,
            stroke: Stroke::Thin,
        })
        .collect();
    (map.width_px, map.max_height_px) = (980.0, 620.0);
    PartFigure {
        title: "Driven path".into(),
        svg: map.svg(),
        caption: "From above, true to scale.".into(),
    }
}

fn human_figure(told: &BesideHuman) -> PartFigure {
    let series = |name: &str, values: &[f64], colour: usize| Series {
        name: name.into(),
        key: String::new(),
        points: values
            .iter()
            .enumerate()
            .map(|(frame, value)| [frame as f64, *value])
            .collect(),
        colour,
        stroke: Stroke::Thin,
    };
    let plot = LinePlot {
        name: format!("{} of a human and of {}", told.output, told.title),
        x: Axis::new("frame", ""),
        y: Axis::new(&told.output, "").including(0.0),
        series: vec![
            series("human", &told.human, 6),
            series("network", &told.network, 0),
        ],
        width_px: 980.0,
        height_px: 220.0,
        ..LinePlot::default()
    };
    PartFigure {
        title: format!("{}: {}", told.title, told.output),
        svg: plot.svg(),
        caption: match told.output.as_str() {
            "steering" => "Parts of full lock, left positive.".into(),
            _ => "Brakes -1 to full throttle 1.".to_owned(),
        },
    }
}
