//! `senda tour`: a first look. Line and lane, several circuits, floors and lights, one report.

use super::{
    report::{PageRun, command_line, page},
    write_file,
};
use crate::terminal;
use anyhow::Result;
use clap::Args;
use rayon::prelude::*;
use senda_eval::{Summary, summary::INTERRUPTED};
use senda_run::{Ears, Scenario, drive};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Where to write the report (one HTML file)
    #[arg(long, value_name = "FILE", default_value = "tour.html")]
    report: PathBuf,
    /// Only the first of the runs, for a quick look
    #[arg(long)]
    quick: bool,
    /// Print all summaries as JSON
    #[arg(long)]
    json: bool,
}

/// World, driver, floor, light, speed (m/s). The speeds are C16's: 13 cm/s on a line, 16 cm/s in a lane.
const STOPS: [(&str, &str, &str, &str, f64); 6] = [
    ("oval", "line", "plain", "daylight", 0.13),
    ("s-curves", "line", "speckled", "lamp", 0.13),
    ("hard-curves", "line", "glossy", "lamp", 0.13),
    ("oval-lane", "lane", "plain", "daylight", 0.16),
    ("s-curves-lane", "lane", "glossy-speckled", "lamp", 0.16),
    ("hard-curves-lane", "lane", "speckled", "daylight", 0.16),
];

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let began_ns = terminal::clock_ns();
    let stops = if arguments.quick { &STOPS[..1] } else { &STOPS[..] };
    let bar = terminal::bar("driving");
    let done: Vec<AtomicU64> = stops.iter().map(|_| AtomicU64::new(0)).collect();
    let move_bar = || {
        let sum: u64 = done.iter().map(|part| part.load(Ordering::Relaxed)).sum();
        bar.set_position(sum / stops.len() as u64);
    };
    let runs: Result<Vec<PageRun>> = stops
        .par_iter()
        .zip(&done)
        .map(|((world, driver, floor, light, speed), part_done)| {
            let scenario = Scenario {
                floor: Some((*floor).to_owned()),
                light: Some((*light).to_owned()),
                speed_mps: Some(*speed),
                ..Scenario::new(world, "gopigo", driver)
            };
            let mut ears = Ears {
                progress: Box::new(|part| {
                    part_done.store((part * 1000.0) as u64, Ordering::Relaxed);
                    move_bar();
                }),
                interrupted: Box::new(terminal::interrupted),
                clock_ns: Box::new(terminal::clock_ns),
            };
            let (outcome, recording) = drive::recorded(&scenario, &mut ears)?;
            Ok(PageRun {
                recording,
                summary: outcome.summary,
                frame_times_ns: outcome.frame_times_ns,
                look: None,
            })
        })
        .collect();
    let runs = runs?;
    bar.finish_and_clear();
    write_file(
        &arguments.report,
        page("A tour with senda", &command_line(), &runs)?.as_bytes(),
    )?;
    if arguments.json {
        let summaries: Vec<&Summary> = runs.iter().map(|run| &run.summary).collect();
        say!("{}", serde_json::to_string_pretty(&summaries)?)?;
        return Ok(());
    }
    let cut_short = runs.iter().filter(|run| run.summary.ended == INTERRUPTED).count();
    if cut_short > 0 {
        say!("interrupted: {cut_short} of {} runs are cut short\n", runs.len())?;
    }
    say!("driver  world              floor            light      laps  lost  lane error mean   max")?;
    for PageRun { summary, .. } in &runs {
        say!(
            "{:7} {:18} {:16} {:10} {:4} {:5} {:>13} {:>8}",
            summary.driver,
            summary.world,
            summary.floor,
            summary.light,
            summary.laps,
            summary.lost,
            centimetres(summary.lane_error_mean_m),
            centimetres(summary.lane_error_max_m),
        )?;
    }
    say!(
        "\n{} runs in {:.1} s. Open {}",
        runs.len(),
        terminal::seconds_since(began_ns),
        arguments.report.display()
    )?;
    Ok(())
}

fn centimetres(length_m: Option<f64>) -> String {
    length_m.map_or("-".to_owned(), |length| format!("{:.1} cm", length * 100.0))
}
