//! `senda evaluate`: how a trained network really drives (A12 in SPEC).

use super::{
    drive::parse_size,
    sweep::{Output, drive_all},
};
use crate::terminal;
use anyhow::Result;
use clap::Args;
use senda_learn::offline;
use senda_run::Scenario;
use senda_run::sweep::{Plan, StartSpread};
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Model file
    model: PathBuf,
    /// Worlds that it never saw, separated by commas
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "LIST",
        default_value = "random-circuit:10000..10500"
    )]
    worlds: Vec<String>,
    /// Vehicle
    #[arg(long, value_name = "VEHICLE", default_value = "picar")]
    vehicle: String,
    /// Speeds in m/s
    #[arg(long, value_delimiter = ',', value_name = "LIST", default_value = "0.16")]
    speeds: Vec<f64>,
    /// Further delays from the camera to the network in s
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    latencies: Vec<f64>,
    /// Part of the frames that get lost on the way, 0 to 1
    #[arg(long, value_name = "PART", default_value_t = 0.0)]
    lost_frames: f64,
    /// Runs, drawn at random from worlds and both directions
    #[arg(long, value_name = "N", default_value_t = 100)]
    runs: usize,
    /// Lights instead of the worlds' own
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    lights: Vec<String>,
    /// Floors instead of the worlds' own
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    floors: Vec<String>,
    /// Image size instead of the vehicle's own
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    image: Option<[u32; 2]>,
    /// Seed
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Do not drive: compare frame by frame with what was done in these recordings or other data (B6), in each output's own unit
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    against: Vec<PathBuf>,
    /// Also drive the hand-coded lane follower over the same worlds
    #[arg(long)]
    beside_lane: bool,
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

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    // A model that cannot be used is told once, not once a run.
    let model = senda_nets::Model::load(&arguments.model)?;
    if !arguments.against.is_empty() {
        return compare(&model, &arguments);
    }
    let world = arguments.worlds.first().map_or("unseen-1", String::as_str);
    let mut base = Scenario::new(world, &arguments.vehicle, "neural");
    base.seed = arguments.seed;
    base.image_px = arguments.image;
    base.lost_frames = arguments.lost_frames;
    base.driver_options
        .insert("model".to_owned(), arguments.model.display().to_string().into());
    let plan = Plan {
        worlds: arguments.worlds,
        speeds_mps: arguments.speeds,
        latencies_s: arguments.latencies,
        lights: arguments.lights,
        floors: arguments.floors,
        both_directions: true,
        sample: Some(arguments.runs),
        start_spread: StartSpread {
            offset_m: 0.02,
            heading_rad: 0.1,
            station_m: 5.0,
        },
        ..Plan::once(base)
    };
    let output = |results: Option<PathBuf>, report: Option<PathBuf>| Output {
        title: "Evaluation",
        jobs: arguments.jobs,
        results,
        report,
        json: arguments.json,
    };
    drive_all(&plan, &output(arguments.results, arguments.report))?;
    if arguments.beside_lane && !terminal::interrupted() {
        println!("\nthe hand-coded lane follower over the same worlds, starts and speeds:");
        let mut plan = plan;
        plan.base.driver = "lane".to_owned();
        plan.base.driver_options.clear();
        drive_all(&plan, &output(None, None))?;
    }
    Ok(())
}

/// Frame by frame against what was done.
fn compare(model: &senda_nets::Model, arguments: &Arguments) -> Result<()> {
    let body = senda_run::scenario::find_vehicle(&arguments.vehicle)?.body();
    let bar = terminal::bar("reading");
    let (outputs, warnings) = offline::against_recordings(
        model,
        &arguments.against,
        &body,
        &offline::ALL_FRAMES,
        &mut |done, of| bar.set_position((1000 * done / of.max(1)) as u64),
    )?;
    bar.finish_and_clear();
    for warning in warnings.iter().take(10) {
        eprintln!("warning: {warning}");
    }
    if arguments.json {
        return terminal::print(&serde_json::to_string_pretty(&outputs)?);
    }
    for one in &outputs {
        let errors = &one.errors;
        terminal::print(&format!(
            "{}: RMSE {:.4}, mean error {:.4} (always the median: {:.4}), correlation {:.3}, {} frames",
            one.output,
            one.root_mean_square,
            errors.mean_absolute,
            errors.of_constant_median,
            errors.correlation,
            errors.count
        ))?;
    }
    Ok(())
}
