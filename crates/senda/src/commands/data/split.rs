//! `senda data split`: which runs `senda train` would learn from and which would judge (A7 in SPEC).

use crate::commands::train::Experiment;
use crate::commands::write_file;
use crate::terminal;
use anyhow::{Result, bail};
use clap::Args;
use senda_learn::{Samples, Split, gather, split};
use senda_nets::{InputSpec, Shape};
use senda_run::scenario::find_vehicle;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Recordings, tubs, Udacity folders, named frames, or folders of those
    data: Vec<PathBuf>,
    /// Experiment file (TOML) of `senda train`; flags override its keys
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// What is held out: worlds, runs, time (the end of every run) or random-frames
    #[arg(long, value_name = "HOW")]
    split: Option<String>,
    /// Part of the data that is held out
    #[arg(long, value_name = "PART")]
    validation_share: Option<f64>,
    /// Frames left out between the parts of a split in time
    #[arg(long, value_name = "N")]
    split_gap: Option<usize>,
    /// Seed of the draw
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Show a random split of frames although neighbouring frames leak into validation
    #[arg(long)]
    allow_leak: bool,
    /// Vehicle that foreign data were recorded on
    #[arg(long, value_name = "VEHICLE")]
    vehicle: Option<String>,
    /// Write an experiment file that splits so: `senda train --plan FILE`
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

/// A run, or its part, on one side.
#[derive(Serialize)]
struct Side<'a> {
    run: &'a str,
    world: &'a str,
    frames: usize,
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let mut experiment = match &arguments.plan {
        Some(path) => Experiment::load(path)?,
        None => Experiment::default(),
    };
    if !arguments.data.is_empty() {
        experiment.data.clone_from(&arguments.data);
    }
    if experiment.data.is_empty() {
        bail!("expected data to split, but found none; record some with `senda drive --record FOLDER`");
    }
    if let Some(how) = &arguments.split {
        experiment.split = super::super::train::word("split", how)?;
    }
    experiment.validation_share = arguments.validation_share.unwrap_or(experiment.validation_share);
    experiment.split_gap = arguments.split_gap.unwrap_or(experiment.split_gap);
    experiment.allow_leak |= arguments.allow_leak;
    experiment.training.seed = arguments.seed.unwrap_or(experiment.training.seed);
    if let Some(vehicle) = &arguments.vehicle {
        experiment.vehicle.clone_from(vehicle);
    }
    // Refused before hours of decoding, not after.
    if experiment.split == Split::RandomFrames && !experiment.allow_leak {
        return Err(senda_learn::LearnError::Leak.into());
    }
    let body = find_vehicle(&experiment.vehicle)?.body();
    // The pictures are decoded, since broken ones do not count, but one pixel of each is enough.
    let input = InputSpec::of(Shape::flat(1));
    let bar = terminal::bar("reading");
    let mut data = gather::recordings(
        &experiment.data,
        &body,
        &input,
        &experiment.answers,
        &experiment.selection,
        &mut |done, of| bar.set_position((1000 * done / of.max(1)) as u64),
    )?;
    bar.finish_and_clear();
    data.expect_frames(&experiment.data)?;
    let (training, validation) = split::split(
        &data.samples,
        experiment.split,
        experiment.validation_share,
        experiment.split_gap,
        experiment.training.seed,
        experiment.allow_leak,
    )?;
    data.warnings.extend(split::far_off(
        &training,
        &validation,
        experiment.split,
        experiment.validation_share,
    ));
    terminal::warn(&data.warnings);
    if let Some(path) = &arguments.out {
        let text = format!(
            "# Learned from: {}\n# Judged by: {}\n{}",
            names(&training),
            names(&validation),
            toml::to_string(&experiment)?
        );
        write_file(path, text.as_bytes())?;
        tell!("experiment: {}", path.display());
    }
    let leaks = experiment.split == Split::RandomFrames;
    if arguments.json {
        let value = serde_json::json!({
            "split": experiment.split,
            "leaks": leaks,
            "warnings": data.warnings,
            "training": sides(&training, leaks),
            "validation": sides(&validation, leaks),
            "training_frames": training.len(),
            "validation_frames": validation.len(),
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    if leaks {
        say!("this split LEAKS: neighbours of the judging frames are learned from")?;
    }
    let all = (training.len() + validation.len()).max(1) as f64;
    for (what, side) in [("learned from", &training), ("judges", &validation)] {
        say!(
            "{what}: {} frames ({:.0} %)",
            side.len(),
            100.0 * side.len() as f64 / all
        )?;
        for Side { run, world, frames } in sides(side, leaks) {
            let world = if world.is_empty() { "unknown world" } else { world };
            say!("  {frames:>7}  {world:20}  {run}")?;
        }
    }
    Ok(())
}

/// Random frames are runs of one frame each: nobody wants to read them.
fn sides(samples: &Samples, leaks: bool) -> Vec<Side<'_>> {
    if leaks {
        return Vec::new();
    }
    samples
        .runs
        .iter()
        .map(|run| Side {
            run: &run.name,
            world: &run.world,
            frames: run.frames.len(),
        })
        .collect()
}

fn names(samples: &Samples) -> String {
    let mut names: Vec<&str> = samples.runs.iter().map(|run| run.name.as_str()).collect();
    names.dedup();
    names.join(", ").replace(['\n', '\r'], " ")
}
