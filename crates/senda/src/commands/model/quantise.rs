//! `senda model quantise`: 8 bits, and what they change.

use crate::commands::{check_out, report::command_line, save_model};
use crate::terminal;
use anyhow::{Result, bail};
use clap::Args;
use senda_learn::quantise::{frames, quantise};
use senda_nets::Model;
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Model file
    model: PathBuf,
    /// Frames like those that it will see: recordings and other data, or random worlds from a seed on (FAMILY:SEED), which
    /// the model drives
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "LIST",
        default_value = "random-circuit:9000"
    )]
    calibrate: Vec<String>,
    /// Vehicle that drives, or that foreign data were recorded on
    #[arg(long, value_name = "VEHICLE", default_value = "picar")]
    vehicle: String,
    /// Frames: half of them calibrate, half compare
    #[arg(long, value_name = "N", default_value_t = 400)]
    frames: usize,
    /// Where the model is written
    #[arg(short, long, value_name = "FILE", default_value = "model-8.senda")]
    out: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: Arguments) -> Result<()> {
    let model = Model::load(&arguments.model)?;
    check_out(&arguments.out)?;
    let bar = terminal::bar("gathering frames");
    let samples = frames(
        &model,
        &arguments.calibrate,
        &arguments.vehicle,
        arguments.frames,
        &|done, of| bar.set_position((1000 * done / of.max(1)) as u64),
        &terminal::interrupted,
    )?;
    if terminal::interrupted() {
        bail!(terminal::Interrupted(": no model is written".to_owned()));
    }
    bar.finish_and_clear();
    let mut quantised = quantise(&model, &samples)?;
    let made = &mut quantised.model.provenance;
    let note = format!(
        "8 bits, calibrated on {} frames of {}: {}",
        quantised.calibrated,
        arguments.calibrate.join(", "),
        command_line()
    );
    if !made.notes.is_empty() {
        made.notes.push_str("; ");
    }
    made.notes.push_str(&note);
    save_model(&quantised.model, &arguments.out)?;
    let size = |path: &PathBuf| std::fs::metadata(path).map_or(0, |data| data.len());
    let sizes = [size(&arguments.model), size(&arguments.out)];
    if arguments.json {
        let value = serde_json::json!({
            "model": arguments.out,
            "bytes": sizes[1],
            "bytes_before": sizes[0],
            "calibrated_frames": quantised.calibrated,
            "compared_frames": quantised.compared,
            "differences": quantised.differences,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    say!(
        "{}: {} bytes, {} before; calibrated on {} frames",
        arguments.out.display(),
        sizes[1],
        sizes[0],
        quantised.calibrated
    )?;
    for difference in &quantised.differences {
        say!(
            "  {}: {:.5} apart in the mean over {} other frames, {:.5} at most",
            difference.output,
            difference.mean,
            quantised.compared,
            difference.largest
        )?;
    }
    Ok(())
}
