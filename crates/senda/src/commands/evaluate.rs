//! `senda evaluate`: how a trained network really drives (A12 in SPEC).

use super::{
    drive::parse_size,
    sweep::{Output, drive_all},
};
use crate::terminal;
use anyhow::{Result, bail};
use clap::Args;
use senda_learn::offline;
use senda_nets::Provenance;
use senda_run::Scenario;
use senda_run::scenario::find_world;
use senda_run::sweep::{Plan, StartSpread};
use std::collections::BTreeSet;
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
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "LIST",
        conflicts_with_all = ["worlds", "speeds", "latencies", "lost_frames", "runs", "lights", "floors", "image", "seed",
            "beside_lane", "jobs", "results", "report"]
    )]
    against: Vec<PathBuf>,
    /// Also drive the hand-coded lane follower over the same worlds
    #[arg(long)]
    beside_lane: bool,
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
    let warnings = check(&plan, &model.provenance)?;
    terminal::warn(&warnings);
    let output = Output {
        title: "Evaluation",
        warnings,
        jobs: arguments.jobs,
        results: arguments.results,
        report: arguments.report,
        json: arguments.json,
    };
    let lane = arguments.beside_lane.then(|| {
        let mut lane = plan.clone();
        lane.base.driver = "lane".to_owned();
        lane.base.driver_options.clear();
        lane
    });
    let name = "the hand-coded lane follower over the same worlds, starts and speeds";
    drive_all(&plan, lane.as_ref().map(|lane| (name, lane)), &output)
}

/// Refuses a plan that could not be driven, before anything is; then what its results will not say.
fn check(plan: &Plan, provenance: &Provenance) -> Result<Vec<String>> {
    if plan.sample == Some(0) {
        bail!("--runs: expected at least 1, but found 0");
    }
    if let Some(speed) = plan
        .speeds_mps
        .iter()
        .find(|speed| !(speed.is_finite() && **speed > 0.0))
    {
        bail!("--speeds: expected more than 0 m/s, but found {speed}");
    }
    let driven: BTreeSet<String> = plan.runs()?.into_iter().map(|run| run.world).collect();
    let mut known = Vec::new();
    for world in &driven {
        let name = find_world(world)?.name;
        if provenance
            .worlds
            .iter()
            .any(|learned| is_among(world, &name, learned, provenance))
        {
            known.push(world.as_str());
        }
    }
    let Some(first) = known.first() else {
        return Ok(vec![]);
    };
    Ok(vec![format!(
        "the model learned from {} of the {} worlds driven here, such as {first}: the rates say less about worlds that it never saw",
        known.len(),
        driven.len()
    )])
}

/// Whether a world is one that a model file says it learned from: by its name or its file's, or in a range of random ones.
fn is_among(world: &str, name: &str, learned: &str, provenance: &Provenance) -> bool {
    if learned == world || learned == name {
        return true;
    }
    let Some((family, seed)) = world.split_once(':') else {
        return false;
    };
    let range = match learned.split_once(", seeds from ") {
        // As older model files have it; every drive took the next seed.
        Some((family, first)) => first
            .parse()
            .ok()
            .map(|first: u64| (family, first, first + drives(provenance))),
        None => learned.split_once(':').and_then(|(family, range)| {
            let (first, end) = range.split_once("..")?;
            Some((family, first.parse().ok()?, end.parse().ok()?))
        }),
    };
    match (range, seed.parse::<u64>()) {
        (Some((learned, first, end)), Ok(seed)) => learned == family && (first..end).contains(&seed),
        _ => false,
    }
}

/// Drives of all rounds of `senda learn`.
pub(crate) fn drives(provenance: &Provenance) -> u64 {
    let rounds = provenance
        .metrics
        .get("rounds")
        .and_then(|rounds| rounds.as_array());
    rounds
        .into_iter()
        .flatten()
        .filter_map(|round| round["drives"].as_u64())
        .sum()
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
    terminal::warn(&warnings);
    if arguments.json {
        return terminal::print(&serde_json::to_string_pretty(&outputs)?);
    }
    for one in &outputs {
        let errors = &one.errors;
        terminal::print(format!(
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worlds_that_were_learned_are_known_by_name_and_by_range() {
        let learned = |worlds: &[&str]| Provenance {
            worlds: worlds.iter().map(|world| (*world).to_owned()).collect(),
            metrics: serde_json::from_str(r#"{"rounds": [{"drives": 8}, {"drives": 16}]}"#).unwrap(),
            ..Provenance::default()
        };
        let warned = |worlds: &[&str], provenance: &Provenance| {
            let plan = Plan {
                worlds: worlds.iter().map(|world| (*world).to_owned()).collect(),
                ..Plan::once(Scenario::new(worlds[0], "picar", "neural"))
            };
            check(&plan, provenance).unwrap().join("")
        };
        let ranged = learned(&["random-circuit:1000000..1000024"]);
        let older = learned(&["random-circuit, seeds from 1000000"]);
        for provenance in [&ranged, &older] {
            let warning = warned(&["random-circuit:1000022..1000026"], provenance);
            assert!(
                warning.contains("2 of the 4 worlds") && warning.contains(":1000022"),
                "{warning}"
            );
            assert_eq!(
                warned(&["random-circuit:1000024", "random-lane:1000003"], provenance),
                ""
            );
        }
        let recorded = learned(&["circuit-1"]);
        assert!(warned(&["circuit-1", "circuit-2"], &recorded).contains("1 of the 2"));
        assert_eq!(warned(&["circuit-2"], &recorded), "");
    }
}
