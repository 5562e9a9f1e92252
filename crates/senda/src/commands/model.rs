//! `senda model`: what a trained network says about itself, and its way to and from other programs.

mod import;
mod quantise;

use anyhow::Result;
use clap::{Args, Subcommand};
use senda_nets::Model;
use std::path::{Path, PathBuf};

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
    /// Write a model as an ONNX file for other programs
    Export {
        /// Model file
        model: PathBuf,
        /// ONNX file to write
        out: PathBuf,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Take in a network that PyTorch, Keras or another program exported as ONNX
    Import(import::Arguments),
    /// Take a model to weights and values of 8 bits
    Quantise(quantise::Arguments),
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    match arguments.command {
        Command::Info { model, json } => info(&model, json),
        Command::Export { model, out, json } => export(&model, &out, json),
        Command::Import(arguments) => import::run(arguments),
        Command::Quantise(arguments) => quantise::run(arguments),
    }
}

fn export(path: &Path, out: &Path, json: bool) -> Result<()> {
    let model = Model::load(path)?;
    let bytes = model.to_onnx();
    super::write_file(out, &bytes)?;
    let shape = model.network.input();
    let shape = [shape.channels, shape.height, shape.width];
    if json {
        let value = serde_json::json!({
            "onnx": out,
            "bytes": bytes.len(),
            "input": shape,
            "outputs": model.outputs,
            "quantised": model.is_quantised(),
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    let names: Vec<&str> = model.outputs.iter().map(|output| output.name.as_str()).collect();
    say!(
        "{}: input [batch, {}, {}, {}], output [batch, {}] ({}); how frames are prepared stands in its metadata",
        out.display(),
        shape[0],
        shape[1],
        shape[2],
        names.len(),
        names.join(", ")
    )?;
    Ok(())
}

fn info(path: &Path, json: bool) -> Result<()> {
    let model = Model::load(path)?;
    if json {
        let value = serde_json::json!({
            "network": model.network.name(),
            "parameters": model.network.parameter_count(),
            "multiply_adds": model.network.multiply_adds(),
            "input": model.input,
            "outputs": model.outputs,
            "provenance": model.provenance,
            "quantised": model.is_quantised(),
            "recurrent": model.network.is_recurrent(),
            "forgets": model.forgets,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    let input = &model.input;
    say!("{}", path.display())?;
    say!(
        "  input       {}x{} {}{}, values {} to {}",
        input.width,
        input.height,
        input.colour.name(),
        match input.stack {
            1 => String::new(),
            frames => format!(", {frames} frames"),
        },
        input.offset,
        input.offset + 255.0 * input.scale
    )?;
    let crop = input.crop;
    say!(
        "  cut off     {:.0} % above, {:.0} % below, {:.0} % left, {:.0} % right",
        100.0 * crop.top,
        100.0 * crop.bottom,
        100.0 * crop.left,
        100.0 * crop.right
    )?;
    if let Some(edges) = input.edges {
        say!(
            "  edges       added, Canny's thresholds {} and {}",
            edges.low,
            edges.high
        )?;
    }
    if let Some(camera) = &input.camera {
        let mounting = &camera.mounting;
        say!(
            "  camera      {}x{}, {:.3} m high, {:.3} m ahead, tilted {:.1}° down",
            camera.width_px,
            camera.height_px,
            mounting.z_m,
            mounting.x_m,
            mounting.tilt_rad.to_degrees()
        )?;
    }
    for output in &model.outputs {
        say!("  output      {}: {}", output.name, output.unit)?;
    }
    if model.is_quantised() {
        say!("  precision   8 bits")?;
    }
    if model.network.is_recurrent() {
        let memory = match model.forgets {
            true => "none: emptied before every picture",
            false => "from picture to picture",
        };
        say!("  memory      {memory}")?;
    }
    let made = &model.provenance;
    say!(
        "  made by     senda {} ({}), seed {}",
        made.senda,
        made.commit,
        made.seed
    )?;
    for line in &made.data {
        say!("  data        {line}")?;
    }
    for line in &made.worlds {
        say!("  worlds      {line}")?;
    }
    for (label, text) in [("command", &made.command), ("notes", &made.notes)] {
        if !text.is_empty() {
            say!("  {label:11} {text}")?;
        }
    }
    for (key, value) in &made.metrics {
        say!("  {key:11} {value}")?;
    }
    say!("")?;
    super::net::show(&model.network, false)
}
