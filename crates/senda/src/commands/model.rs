//! `senda model`: what a trained network says about itself.

use anyhow::Result;
use clap::{Args, Subcommand};
use senda_nets::Model;
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Input, outputs, training and layers
    Info {
        /// Model file
        model: PathBuf,
        /// Print as JSON
        #[arg(long)]
        json: bool,
    },
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let Command::Info { model: path, json } = arguments.command;
    let model = Model::load(&path)?;
    if json {
        let value = serde_json::json!({
            "network": model.network.name(),
            "parameters": model.network.parameter_count(),
            "multiply_adds": model.network.multiply_adds(),
            "input": model.input,
            "outputs": model.outputs,
            "provenance": model.provenance,
        });
        println!("{}", serde_json::to_string_pretty(&value)?);
        return Ok(());
    }
    let input = &model.input;
    let colour = serde_json::to_value(input.colour)?;
    println!("{}", path.display());
    println!(
        "  input       {}x{} {}, values {} to {}",
        input.width,
        input.height,
        colour.as_str().unwrap_or_default(),
        input.offset,
        input.offset + 255.0 * input.scale
    );
    let crop = input.crop;
    println!(
        "  cut off     {:.0} % above, {:.0} % below, {:.0} % left, {:.0} % right",
        100.0 * crop.top,
        100.0 * crop.bottom,
        100.0 * crop.left,
        100.0 * crop.right
    );
    if let Some(camera) = &input.camera {
        let mounting = &camera.mounting;
        println!(
            "  camera      {}x{}, {:.3} m high, {:.3} m ahead, tilted {:.1}° down",
            camera.width_px,
            camera.height_px,
            mounting.z_m,
            mounting.x_m,
            mounting.tilt_rad.to_degrees()
        );
    }
    for output in &model.outputs {
        println!("  output      {}: {}", output.name, output.unit);
    }
    let made = &model.provenance;
    println!(
        "  made by     senda {} ({}), seed {}",
        made.senda, made.commit, made.seed
    );
    for line in &made.data {
        println!("  data        {line}");
    }
    for line in &made.worlds {
        println!("  worlds      {line}");
    }
    for (label, text) in [("command", &made.command), ("notes", &made.notes)] {
        if !text.is_empty() {
            println!("  {label:11} {text}");
        }
    }
    for (key, value) in &made.metrics {
        println!("  {key:11} {value}");
    }
    println!();
    super::net::show(&model.network, false)
}
