//! `senda sweep`: many runs, rates with intervals.

use super::{
    drive::{ScenarioFlags, parse_size},
    report::{as_command, command_line},
    write_file,
};
use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::Args;
use senda_eval::{
    report::{Page, SweepRun, sweep_html, sweep_table},
    statistics::{Interval, Rate},
};
use senda_run::sweep::{self, Line, Plan};
use std::{collections::BTreeSet, path::PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Sweep file (TOML); flags override its keys
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    #[command(flatten)]
    flags: ScenarioFlags,
    /// Worlds, separated by commas; `random-line:100..200` stands for a hundred
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    worlds: Vec<String>,
    /// Drivers to compare
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    drivers: Vec<String>,
    /// Lights
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    lights: Vec<String>,
    /// Floors
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    floors: Vec<String>,
    /// Speeds in m/s
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    speeds: Vec<f64>,
    /// Further delays from the camera to the driver, in s
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    latencies: Vec<f64>,
    /// Image sizes, such as 160x120,123x92
    #[arg(long, value_delimiter = ',', value_name = "LIST", value_parser = parse_size)]
    images: Vec<[u32; 2]>,
    /// Also drive the other way round
    #[arg(long)]
    both_directions: bool,
    /// Starting places differ by up to this many m to either side
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    spread_offset: Option<f64>,
    /// Starting headings differ by up to this many degrees to either side
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    spread_heading_deg: Option<f64>,
    /// Starting places differ by up to this many m along the path
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    spread_station: Option<f64>,
    /// Seeds for each combination
    #[arg(long, value_name = "N")]
    seeds: Option<u64>,
    /// Draw N runs at random from all combinations
    #[arg(long, value_name = "N")]
    sample: Option<usize>,
    /// Threads; without it one for each core
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// Keep results in this file, and go on from it when it exists
    #[arg(long, value_name = "FILE")]
    results: Option<PathBuf>,
    /// Write a report (one HTML file)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print rates and intervals as JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn plan(&self) -> Result<Plan> {
        let mut plan = match &self.plan {
            Some(path) => Plan::load(path)?,
            None => Plan::once(self.flags.scenario()?),
        };
        if self.plan.is_some() {
            plan.base = self.flags.over(plan.base)?;
        }
        let list = |into: &mut Vec<String>, from: &[String]| {
            if !from.is_empty() {
                *into = from.to_vec();
            }
        };
        list(&mut plan.worlds, &self.worlds);
        list(&mut plan.drivers, &self.drivers);
        list(&mut plan.lights, &self.lights);
        list(&mut plan.floors, &self.floors);
        if !self.speeds.is_empty() {
            plan.speeds_mps.clone_from(&self.speeds);
        }
        if !self.latencies.is_empty() {
            plan.latencies_s.clone_from(&self.latencies);
        }
        if !self.images.is_empty() {
            plan.images_px.clone_from(&self.images);
        }
        // A single value given as a scenario flag beats the list of a sweep file.
        let one = |into: &mut Vec<String>, flag: &Option<String>, listed: bool| {
            if flag.is_some() && !listed {
                into.clear();
            }
        };
        one(&mut plan.worlds, &self.flags.world, !self.worlds.is_empty());
        one(&mut plan.drivers, &self.flags.driver, !self.drivers.is_empty());
        one(&mut plan.lights, &self.flags.light, !self.lights.is_empty());
        one(&mut plan.floors, &self.flags.floor, !self.floors.is_empty());
        if self.flags.speed.is_some() && self.speeds.is_empty() {
            plan.speeds_mps.clear();
        }
        if self.flags.latency.is_some() && self.latencies.is_empty() {
            plan.latencies_s.clear();
        }
        if self.flags.image.is_some() && self.images.is_empty() {
            plan.images_px.clear();
        }
        plan.both_directions |= self.both_directions;
        plan.start_spread.offset_m = self.spread_offset.unwrap_or(plan.start_spread.offset_m);
        if let Some(degrees) = self.spread_heading_deg {
            plan.start_spread.heading_rad = degrees.to_radians();
        }
        plan.start_spread.station_m = self.spread_station.unwrap_or(plan.start_spread.station_m);
        plan.seeds = self.seeds.unwrap_or(plan.seeds);
        plan.sample = self.sample.or(plan.sample);
        Ok(plan)
    }
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let plan = arguments.plan()?;
    // What cannot be read is complained of by the runs.
    for note in plan.base.notes().unwrap_or_default() {
        tell!("warning: {note}");
    }
    let output = Output {
        title: "Sweep",
        warnings: vec![],
        jobs: arguments.jobs,
        results: arguments.results,
        report: arguments.report,
        json: arguments.json,
    };
    drive_all(&plan, &output)
}

/// How a plan is run, and where its results go.
pub(crate) struct Output {
    /// Heading of the report.
    pub(crate) title: &'static str,
    /// What the reader of the results should know.
    pub(crate) warnings: Vec<String>,
    /// Threads.
    pub(crate) jobs: Option<usize>,
    /// File to keep results in.
    pub(crate) results: Option<PathBuf>,
    /// Report to write.
    pub(crate) report: Option<PathBuf>,
    /// JSON instead of a table.
    pub(crate) json: bool,
}

/// Runs a plan and tells the rates.
pub(crate) fn drive_all(plan: &Plan, output: &Output) -> Result<()> {
    plan.check()?;
    let mut warnings = output.warnings.clone();
    let repeated = plan.repeated()?;
    if repeated > 0 {
        let words = format!(
            "{repeated} runs equal others in everything and are left out: each is run and counted once"
        );
        tell!("warning: {words}");
        warnings.push(words);
    }
    let jobs = output.jobs.unwrap_or(0);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(jobs)
        .thread_name(|index| format!("sweep-{index}"))
        .build()
        .context("cannot start threads")?;
    let began_ns = terminal::clock_ns();
    let bar = terminal::bar("sweep");
    let progress = |done: usize, total: usize| {
        bar.set_position((1000 * done / total.max(1)) as u64);
        bar.set_message(format!("sweep {done}/{total}"));
    };
    let lines = pool.install(|| {
        sweep::run(
            plan,
            output.results.as_deref(),
            &progress,
            &terminal::interrupted,
            &terminal::clock_ns,
        )
    })?;
    bar.finish_and_clear();
    let wall_s = terminal::seconds_since(began_ns);
    let total = plan.runs()?.len();
    let interrupted = lines.len() < total;
    let mut head = Page::new(output.title, &command_line());
    if let Some(words) = driven_alike(&lines) {
        tell!("warning: {words}");
        warnings.push(words);
    }
    head.notes.clone_from(&warnings);
    if interrupted {
        head.notes
            .push(format!("Interrupted after {} of {total} runs.", lines.len()));
        let again = match &output.results {
            Some(path) => format!("run the same command again to go on from {}", path.display()),
            None => "give --results FILE to be able to go on".to_owned(),
        };
        tell!("interrupted after {} of {total} runs: {again}", lines.len());
    }
    let runs: Vec<SweepRun> = lines.iter().map(sweep_run).collect();
    let table = sweep_table(&runs);
    if let Some(path) = &output.report {
        write_file(path, sweep_html(&head, &runs).as_bytes())?;
        tell!("report: {}", path.display());
    }
    if output.json {
        let value = serde_json::json!({
            "runs": lines.len(),
            "wanted": total,
            "interrupted": interrupted,
            "warnings": warnings,
            "errors": table.errors,
            "wall_s": wall_s,
            "rows": table.rows,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return whole(&runs, table.errors, interrupted);
    }
    say!(
        "{:30} {:>6}  {:>24}  {:>24}  {:>12}",
        "",
        "runs",
        "completed",
        "without a loss",
        "lane error"
    )?;
    for row in &table.rows {
        let error = row
            .lane_error_m
            .map_or("-".to_owned(), |error| format!("{:.2} cm", error.value * 100.0));
        say!(
            "{:30} {:>6}  {:>24}  {:>24}  {:>12}",
            if row.by == "all" {
                row.value.clone()
            } else {
                format!("{} {}", row.by, row.value)
            },
            row.completed.count,
            percent(&row.completed),
            percent(&row.without_loss),
            error
        )?;
        if let Some(delivery) = &row.delivery {
            say!("  {}", delivery.words())?;
        }
    }
    if table.errors > 0 {
        say!(
            "{} of {} runs could not be run and count in no rate",
            table.errors,
            lines.len()
        )?;
    }
    for run in runs.iter().filter(|run| run.summary.is_none()).take(5) {
        tell!("could not be run: {}: {}", run.command, run.error);
    }
    say!("\n{} of {total} runs in {wall_s:.1} s", lines.len())?;
    whole(&runs, table.errors, interrupted)
}

/// What to say where runs differ in what was asked, but not in what was driven: a driver that sees nothing of a light is not tested
/// by it, and one without chance is not tested by a seed.
fn driven_alike(lines: &[Line]) -> Option<String> {
    let driven = lines
        .iter()
        .filter_map(|line| Some(line.summary.as_ref()?.digest.as_str()));
    let different: BTreeSet<&str> = driven.clone().collect();
    let alike = driven.count() - different.len();
    (alike > 0).then(|| {
        format!(
            "{alike} of {} runs were driven exactly as another one (equal digests): they count as runs of their own, so the intervals are narrower than what is known",
            lines.len()
        )
    })
}

/// An error where some runs could not be run: what was told of the others is not what was asked for. An interrupted sweep ends as
/// every interrupted command does.
fn whole(runs: &[SweepRun], errors: u64, interrupted: bool) -> Result<()> {
    match runs.iter().find(|run| run.summary.is_none()) {
        Some(first) if !interrupted => bail!(
            "{errors} of {} runs could not be run; the first: {}: {}",
            runs.len(),
            first.command,
            first.error
        ),
        _ => Ok(()),
    }
}

/// `98.4 % (96.9 to 99.2)`.
fn percent(rate: &Rate) -> String {
    let Interval { value, low, high } = rate.interval;
    format!(
        "{:.1} % ({:.1} to {:.1})",
        value * 100.0,
        low * 100.0,
        high * 100.0
    )
}

/// Random worlds are counted under their family's name.
fn sweep_run(line: &Line) -> SweepRun {
    let world = line
        .scenario
        .world
        .split(':')
        .next()
        .unwrap_or_default()
        .to_owned();
    let resolved = senda_run::scenario::find_world(&line.scenario.world).ok();
    // On a road in open land the lowest marking is earth, not a line.
    let line_colour = resolved
        .as_ref()
        .filter(|world| world.backdrop.hills.is_none())
        .and_then(|world| Some(world.markings.first()?.colour.nearest_name().to_owned()))
        .unwrap_or_default();
    SweepRun {
        world,
        line_colour,
        image_px: line.scenario.image_px,
        tightest_m: resolved.and_then(|world| world.path.tightest_radius_m()),
        summary: line.summary.clone(),
        error: line.error.clone().unwrap_or_default(),
        latency_s: line.scenario.latency_s,
        command: as_command(&line.scenario),
    }
}
