//! `senda deliver`: a package in a warehouse, brought to its depot and back.

use super::{
    drive::{ScenarioFlags, drive_and_keep},
    write_file,
};
use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::Args;
use senda_eval::delivery::{Event, Stop};
use senda_run::Scenario;
use senda_world::PlaceKind;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    flags: ScenarioFlags,
    /// Keep the run as a recording (MCAP) in this folder
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// Write a report (one HTML file)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print the outcome as JSON
    #[arg(long)]
    json: bool,
    /// Write the resolved scenario (for `senda drive --scenario`)
    #[arg(long, value_name = "FILE")]
    scenario_out: Option<PathBuf>,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Outcome<'a> {
    world: &'a str,
    /// As asked for, or the one that the world shows.
    package: Option<String>,
    seed: u64,
    /// Whether the delivery was whole.
    completed: bool,
    /// Of one that was not: where the mission gave up or turned back.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<&'a Event>,
    goal: Option<u8>,
    delivered_to: Option<u8>,
    correct: bool,
    returned: bool,
    red_light_violations: u32,
    departures: u32,
    stops: &'a [Stop],
    time_s: f64,
    ended: &'a str,
    frames: u64,
    frame_time_mean_s: Option<f64>,
    digest: &'a str,
    events: &'a [Event],
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let base = match &arguments.flags.scenario {
        Some(path) => Scenario::load(path)?,
        None => Scenario::new("warehouse", "warehouse-cart", "mission"),
    };
    let scenario = arguments.flags.over(base)?;
    if scenario.driver != "mission" {
        bail!(
            "--driver: expected mission, which delivers, but found {}; `senda drive` drives with any",
            scenario.driver
        );
    }
    scenario.check_driver_options(arguments.flags.scenario.as_deref())?;
    super::warn_of(&scenario)?;
    check(&scenario)?;
    if let Some(path) = &arguments.scenario_out {
        write_file(path, scenario.to_toml().as_bytes())?;
    }
    let summary = drive_and_keep(
        &scenario,
        None,
        arguments.record.as_deref(),
        arguments.report.as_deref(),
        None,
    )?;
    let delivery = summary.delivery.as_ref().with_context(|| {
        format!(
            "{} is no warehouse; `senda world list` shows which are",
            scenario.world
        )
    })?;
    if arguments.json {
        let outcome = Outcome {
            world: &scenario.world,
            package: scenario
                .package
                .clone()
                .or(delivery.goal.map(|goal| format!("I{goal}"))),
            seed: scenario.seed,
            completed: delivery.is_whole(),
            reason: delivery.reason(),
            goal: delivery.goal,
            delivered_to: delivery.delivered_to,
            correct: delivery.correct,
            returned: delivery.returned,
            red_light_violations: delivery.red_light_violations,
            departures: delivery.departures,
            stops: &delivery.stops,
            time_s: delivery.time_s,
            ended: &summary.ended,
            frames: summary.frames,
            frame_time_mean_s: summary.frame_time_mean_s,
            digest: &summary.digest,
            events: &delivery.events,
        };
        terminal::print(&serde_json::to_string_pretty(&outcome)?)?;
    } else {
        terminal::print(delivery.text().trim_end())?;
    }
    Ok(())
}

/// Refuses what cannot be delivered before anything is driven. (`senda drive` shows a vehicle any package.)
fn check(scenario: &Scenario) -> Result<()> {
    let world = scenario.resolve_world()?;
    let Some(warehouse) = &world.warehouse else {
        bail!(
            "{} is no warehouse; expected one, such as warehouse or random-warehouse:1: `senda world list` shows them",
            scenario.world
        );
    };
    let mut packages: Vec<String> = warehouse
        .places
        .iter()
        .filter_map(|place| match place.kind {
            PlaceKind::Depot { number } => Some(format!("I{number}")),
            _ => None,
        })
        .collect();
    packages.sort();
    match &scenario.package {
        Some(package) if !packages.contains(package) => bail!(
            "--package: expected one of {}, the depots of {}, but found {package:?}",
            packages.join(", "),
            scenario.world
        ),
        _ => Ok(()),
    }
}
