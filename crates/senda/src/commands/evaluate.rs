//! `senda evaluate`: how a trained network really drives (A12 in SPEC).

use super::{
    drive::parse_size,
    sweep::{Output, drive_all},
};
use anyhow::Result;
use clap::Args;
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
    senda_nets::Model::load(&arguments.model)?;
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
    if arguments.beside_lane {
        println!("\nthe hand-coded lane follower over the same worlds, starts and speeds:");
        let mut plan = plan;
        plan.base.driver = "lane".to_owned();
        plan.base.driver_options.clear();
        drive_all(&plan, &output(None, None))?;
    }
    Ok(())
}
