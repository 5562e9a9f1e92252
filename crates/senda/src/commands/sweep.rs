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
    report::{Page, SweepRun, SweepTable, sweep_html, sweep_table},
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
    #[arg(long, value_name = "N", value_parser = super::parse_jobs)]
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
    drive_all(&plan, None, &output)
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

/// Runs a plan and tells the rates; then perhaps another plan beside it, with what to call that one.
pub(crate) fn drive_all(plan: &Plan, beside: Option<(&str, &Plan)>, output: &Output) -> Result<()> {
    let driven = drive(plan, output)?;
    let beside = match beside {
        Some((name, plan)) if !driven.interrupted() => Some((name, drive(plan, output)?)),
        _ => None,
    };
    let mut warnings = output.warnings.clone();
    warnings.extend(driven.warnings.iter().cloned());
    if let Some(path) = &output.report {
        let mut head = Page::new(output.title, &command_line());
        head.notes.clone_from(&warnings);
        head.notes.extend(driven.interruption(output));
        if let Some((name, beside)) = &beside {
            head.notes.push(format!("{name}: {}", beside.overall()));
        }
        write_file(path, sweep_html(&head, &driven.runs).as_bytes())?;
        tell!("report: {}", path.display());
    }
    if output.json {
        let mut value = driven.json(&warnings);
        if let Some((_, beside)) = &beside {
            value["beside"] = beside.json(&beside.warnings);
        }
        say!("{}", serde_json::to_string_pretty(&value)?)?;
    } else {
        driven.print()?;
        if let Some((name, beside)) = &beside {
            say!("\n{name}:")?;
            beside.print()?;
        }
    }
    driven.whole()?;
    beside.map_or(Ok(()), |(_, beside)| beside.whole())
}

/// Runs a plan.
fn drive(plan: &Plan, output: &Output) -> Result<Driven> {
    plan.check()?;
    let mut warnings = Vec::new();
    let repeated = plan.repeated()?;
    if repeated > 0 {
        warnings.push(format!(
            "{repeated} runs equal others in everything and are left out: each is run and counted once"
        ));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(output.jobs.unwrap_or(0))
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
    warnings.extend(driven_alike(&lines));
    terminal::warn(&warnings);
    let runs: Vec<SweepRun> = lines.iter().map(sweep_run).collect();
    let driven = Driven {
        table: sweep_table(&runs),
        runs,
        wanted: plan.runs()?.len(),
        wall_s: terminal::seconds_since(began_ns),
        warnings,
    };
    if let Some(words) = driven.interruption(output) {
        tell!("{words}");
    }
    Ok(driven)
}

/// What became of a plan.
struct Driven {
    runs: Vec<SweepRun>,
    table: SweepTable,
    /// Runs of the plan.
    wanted: usize,
    wall_s: f64,
    warnings: Vec<String>,
}

impl Driven {
    fn interrupted(&self) -> bool {
        self.runs.len() < self.wanted
    }

    fn interruption(&self, output: &Output) -> Option<String> {
        let again = match &output.results {
            Some(path) => format!("run the same command again to go on from {}", path.display()),
            None => "give --results FILE to be able to go on".to_owned(),
        };
        let (done, wanted) = (self.runs.len(), self.wanted);
        self.interrupted()
            .then(|| format!("interrupted after {done} of {wanted} runs: {again}"))
    }

    /// The rate over all runs, in words.
    fn overall(&self) -> String {
        let all = self.table.rows.iter().find(|row| row.by == "all");
        all.map_or("nothing was driven".to_owned(), |row| {
            let Rate { hits, count, .. } = row.completed;
            format!("{hits} of {count} runs completed, {}", percent(&row.completed))
        })
    }

    fn json(&self, warnings: &[String]) -> serde_json::Value {
        serde_json::json!({
            "runs": self.runs.len(),
            "wanted": self.wanted,
            "interrupted": self.interrupted(),
            "warnings": warnings,
            "errors": self.table.errors,
            "wall_s": self.wall_s,
            "rows": self.table.rows,
        })
    }

    fn print(&self) -> Result<()> {
        say!(
            "{:30} {:>6}  {:>24}  {:>24}  {:>12}",
            "",
            "runs",
            "completed",
            "without a loss",
            "lane error"
        )?;
        for row in &self.table.rows {
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
        let (done, errors) = (self.runs.len(), self.table.errors);
        if errors > 0 {
            say!("{errors} of {done} runs could not be run and count in no rate")?;
        }
        for run in self.runs.iter().filter(|run| run.summary.is_none()).take(5) {
            tell!("could not be run: {}: {}", run.command, run.error);
        }
        say!("\n{done} of {} runs in {:.1} s", self.wanted, self.wall_s)
    }

    /// An error where some runs could not be run: what was told of the others is not what was asked for. An interrupted sweep ends
    /// as every interrupted command does.
    fn whole(&self) -> Result<()> {
        match self.runs.iter().find(|run| run.summary.is_none()) {
            Some(first) if !self.interrupted() => bail!(
                "{} of {} runs could not be run; the first: {}: {}",
                self.table.errors,
                self.runs.len(),
                first.command,
                first.error
            ),
            _ => Ok(()),
        }
    }
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
