//! `senda bench`: how fast this machine runs senda, against the promised rates.

mod motors;

use crate::terminal;
use anyhow::{Context, Result, ensure};
use clap::Args;
use senda_run::bench::{Case, cases};
use senda_world::World;
use std::process::{Command, Stdio};

/// Promised time (s) from a process's start to its first step.
const START_S: f64 = 0.05;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Measure each case for about this long (s)
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
    /// Only cases whose name contains this
    #[arg(long)]
    only: Option<String>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

/// One measured case.
#[derive(serde::Serialize)]
struct Row {
    name: String,
    per_s: f64,
    best_per_s: f64,
    target_per_s: Option<f64>,
    ratio: Option<f64>,
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let mut rows = Vec::new();
    if !arguments.json {
        say!("one thread, median of rounds; ratio: measured over promised (on a 2-core AVX2 machine)\n")?;
        say!(
            "{:44} {:>12} {:>12} {:>10} {:>7}",
            "",
            "a second",
            "best",
            "promised",
            "ratio"
        )?;
    }
    for mut case in cases()? {
        if terminal::interrupted() {
            break;
        }
        if arguments
            .only
            .as_ref()
            .is_some_and(|only| !case.name.contains(only.as_str()))
        {
            continue;
        }
        let row = measure(&mut case, arguments.seconds);
        if !arguments.json {
            let promised = row
                .target_per_s
                .map_or("-".to_owned(), |target| format!("{target:.0}"));
            let ratio = row.ratio.map_or("-".to_owned(), |ratio| format!("{ratio:.2}"));
            say!(
                "{:44} {:>12.0} {:>12.0} {promised:>10} {ratio:>7}",
                row.name,
                row.per_s,
                row.best_per_s
            )?;
        }
        rows.push(row);
    }
    start_rows(&arguments, &mut rows)?;
    let mut all: Vec<serde_json::Value> = rows.iter().map(serde_json::to_value).collect::<Result<_, _>>()?;
    // As the others, by its name: `--only motors`.
    let wants_motors = arguments
        .only
        .as_ref()
        .is_none_or(|only| "motors".contains(only.as_str()));
    if wants_motors && !terminal::interrupted() {
        let measured = motors::measure(3.0 * arguments.seconds, arguments.json)?;
        for row in &measured {
            all.push(serde_json::to_value(row)?);
        }
    }
    if arguments.json {
        say!("{}", serde_json::to_string_pretty(&all)?)?;
    }
    Ok(())
}

/// How long `senda drive` takes from the start of its process to the end of a run of one step, in every ready world.
fn start_rows(arguments: &Arguments, rows: &mut Vec<Row>) -> Result<()> {
    let wanted = |name: &str| {
        arguments
            .only
            .as_ref()
            .is_none_or(|only| name.contains(only.as_str()))
    };
    let mut headed = arguments.json;
    for world in World::names() {
        let name = format!("start to first step, {world}");
        if terminal::interrupted() || !wanted(&name) {
            continue;
        }
        if !headed {
            say!(
                "\nwhole process of `senda drive` with the default vehicle, floor painted anew, one step driven\n\n{:44} {:>12} {:>12} {:>10} {:>7}",
                "",
                "ms",
                "best",
                "promised",
                "ratio"
            )?;
            headed = true;
        }
        let rounds = ((arguments.seconds / 0.1) as usize).clamp(3, 50);
        let mut seconds = Vec::with_capacity(rounds);
        for _ in 0..rounds {
            seconds.push(start_once(world)?);
        }
        seconds.sort_by(f64::total_cmp);
        let (median, best) = (seconds[rounds / 2], seconds[0]);
        let row = Row {
            name,
            per_s: 1.0 / median,
            best_per_s: 1.0 / best,
            target_per_s: Some(1.0 / START_S),
            ratio: Some(START_S / median),
        };
        if !arguments.json {
            say!(
                "{:44} {:>12.1} {:>12.1} {:>10.0} {:>7.2}",
                row.name,
                median * 1e3,
                best * 1e3,
                START_S * 1e3,
                START_S / median
            )?;
        }
        rows.push(row);
    }
    Ok(())
}

/// Drives one step in a process of its own, which nothing is warm for but the file of the program.
fn start_once(world: &str) -> Result<f64> {
    let program = std::env::current_exe().context("where this program lies")?;
    let begin = terminal::clock_ns();
    let status = Command::new(program)
        .args(["drive", "--world", world, "--time-limit", "0.001"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .context("start another senda")?;
    let took_s = terminal::seconds_since(begin);
    ensure!(status.success(), "drive --world {world}: {status}");
    Ok(took_s)
}

/// Rounds of about 50 ms, after one that is not counted.
fn measure(case: &mut Case, seconds: f64) -> Row {
    let begin = terminal::clock_ns();
    let mut calls = 0u64;
    while terminal::seconds_since(begin) < 0.1 {
        (case.call)();
        calls += 1;
    }
    let a_round = (calls / 2).max(1);
    let rounds = ((seconds / 0.05) as usize).max(3);
    let mut rates: Vec<f64> = (0..rounds)
        .map(|_| {
            let begin = terminal::clock_ns();
            for _ in 0..a_round {
                (case.call)();
            }
            a_round as f64 / terminal::seconds_since(begin).max(1e-9)
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    let per_s = rates[rates.len() / 2];
    let target_per_s = (case.target_per_s > 0.0).then_some(case.target_per_s);
    Row {
        name: case.name.to_owned(),
        per_s,
        best_per_s: rates[rates.len() - 1],
        target_per_s,
        ratio: target_per_s.map(|target| per_s / target),
    }
}
