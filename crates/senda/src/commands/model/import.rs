//! `senda model import`: a network of another program becomes a model file.

use crate::commands::{report::command_line, save_model, train::word};
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use senda_drivers::Answer;
use senda_nets::{Colour, Crop, Edges, Imported, InputSpec, Model, OutputSpec, Provenance};
use serde::Deserialize;
use std::path::PathBuf;

/// What an ONNX file does not say, as a file; every key has a flag.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Description {
    outputs: Option<Vec<Answer>>,
    values: Option<[f32; 2]>,
    colour: Option<Colour>,
    crop: Option<Crop>,
    edges: Option<Edges>,
    stack: Option<usize>,
    vehicle: Option<String>,
    notes: String,
}

#[derive(Args)]
pub(crate) struct Arguments {
    /// ONNX file
    onnx: PathBuf,
    /// What the file does not say (TOML): the keys outputs, values, colour, crop, edges, stack, vehicle, notes; flags override them
    #[arg(long, value_name = "FILE")]
    spec: Option<PathBuf>,
    /// What the outputs mean, in order: steering, curvature, speed, throttle
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    outputs: Vec<String>,
    /// What black and full light are at the input: 0,1 or -1,1 or 0,255
    #[arg(
        long,
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        value_name = "LOW,HIGH"
    )]
    values: Vec<f32>,
    /// rgb, grey or saturation
    #[arg(long, value_name = "COLOUR")]
    colour: Option<String>,
    /// Part of the frame's height that is cut off above
    #[arg(long, value_name = "PART")]
    crop_top: Option<f64>,
    /// Part of the frame's height that is cut off below
    #[arg(long, value_name = "PART")]
    crop_bottom: Option<f64>,
    /// The vehicle whose camera it was trained with; without it every camera is accepted
    #[arg(long, value_name = "VEHICLE")]
    vehicle: Option<String>,
    /// Where the model is written
    #[arg(short, long, value_name = "FILE", default_value = "model.senda")]
    out: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn description(&self) -> Result<Description> {
        let mut description = match &self.spec {
            Some(path) => {
                let text = std::fs::read_to_string(path)
                    .with_context(|| format!("cannot read {}", path.display()))?;
                toml::from_str(&text).with_context(|| path.display().to_string())?
            }
            None => Description::default(),
        };
        if !self.outputs.is_empty() {
            let outputs = self.outputs.iter().map(|output| word("outputs", output));
            description.outputs = Some(outputs.collect::<Result<_>>()?);
        }
        match self.values.as_slice() {
            [] => {}
            [low, high] => description.values = Some([*low, *high]),
            other => bail!(
                "--values: expected two numbers such as -1,1, but found {}",
                other.len()
            ),
        }
        if let Some(colour) = &self.colour {
            description.colour = Some(word("colour", colour)?);
        }
        if self.crop_top.is_some() || self.crop_bottom.is_some() {
            let crop = description.crop.get_or_insert_default();
            crop.top = self.crop_top.unwrap_or(crop.top);
            crop.bottom = self.crop_bottom.unwrap_or(crop.bottom);
        }
        if self.vehicle.is_some() {
            description.vehicle.clone_from(&self.vehicle);
        }
        Ok(description)
    }
}

/// The input, from what the file's own notes and the description say.
fn input(imported: &Imported, description: &Description) -> Result<InputSpec> {
    let shape = imported.network.input();
    let own: Option<InputSpec> = match imported.metadata.get("senda.input") {
        Some(text) => Some(serde_json::from_str(text).context("the ONNX file's senda.input is damaged")?),
        None => None,
    };
    let [low, high] = match (description.values, &own) {
        (Some(values), _) => values,
        (None, Some(own)) => [own.offset, own.offset + 255.0 * own.scale],
        (None, None) => bail!(
            "expected to be told what black and full light are at the network's input, which an ONNX file does not say: \
             give --values -1,1 or 0,1 or 0,255, as it was trained"
        ),
    };
    if !(low.is_finite() && high.is_finite() && low != high) {
        bail!("--values: expected two different numbers, but found {low} and {high}");
    }
    let mut input = own.unwrap_or_else(|| InputSpec::of(shape));
    if description.values.is_some() {
        input.offset = low;
        input.scale = (high - low) / 255.0;
    }
    input.colour = description.colour.unwrap_or(input.colour);
    input.crop = description.crop.unwrap_or(input.crop);
    input.edges = description.edges.or(input.edges);
    input.stack = description.stack.unwrap_or(input.stack);
    if let Some(vehicle) = &description.vehicle {
        let body = senda_run::scenario::find_vehicle(vehicle)?.body();
        let camera = body.cameras.first().cloned();
        input.camera =
            Some(camera.ok_or_else(|| anyhow!("vehicle {vehicle}: expected a camera, but found none"))?);
    }
    match input.fault(shape) {
        Some(fault) => Err(anyhow!("{fault}")),
        None => Ok(input),
    }
}

fn outputs(imported: &Imported, description: &Description) -> Result<Vec<OutputSpec>> {
    let count = imported.network.output_len();
    let outputs: Vec<OutputSpec> = match (&description.outputs, imported.metadata.get("senda.outputs")) {
        (Some(answers), _) => answers.iter().map(|answer| answer.output()).collect(),
        (None, Some(text)) => {
            serde_json::from_str(text).context("the ONNX file's senda.outputs is damaged")?
        }
        (None, None) => bail!(
            "expected to be told what the network's {count} output(s) mean, which an ONNX file does not say: give \
             --outputs with steering, curvature, speed or throttle for each, in order"
        ),
    };
    if outputs.len() != count {
        bail!(
            "expected a meaning for each of the network's {count} output(s), but found {}: --outputs",
            outputs.len()
        );
    }
    Ok(outputs)
}

pub(super) fn run(arguments: Arguments) -> Result<()> {
    let description = arguments.description()?;
    let imported = Imported::load(&arguments.onnx)?;
    let imported_by = command_line();
    let provenance = match imported.metadata.get("senda.provenance") {
        Some(text) => {
            let mut own: Provenance =
                serde_json::from_str(text).context("the ONNX file's senda.provenance is damaged")?;
            let notes = [
                own.notes.as_str(),
                &description.notes,
                &format!("through ONNX: {imported_by}"),
            ];
            own.notes = notes
                .into_iter()
                .filter(|note| !note.is_empty())
                .collect::<Vec<_>>()
                .join("; ");
            own
        }
        None => Provenance {
            senda: env!("CARGO_PKG_VERSION").to_owned(),
            commit: senda_run::COMMIT.to_owned(),
            data: vec![format!("unknown: imported from {}", arguments.onnx.display())],
            command: imported_by,
            notes: description.notes.clone(),
            ..Provenance::default()
        },
    };
    let model = Model {
        input: input(&imported, &description)?,
        outputs: outputs(&imported, &description)?,
        provenance,
        network: imported.network,
        weights: imported.weights,
        grids: vec![],
        detection: None,
        forgets: false,
    };
    save_model(&model, &arguments.out)?;
    if arguments.json {
        let value = serde_json::json!({
            "model": arguments.out,
            "network": model.network.name(),
            "parameters": model.network.parameter_count(),
            "input": model.input,
            "outputs": model.outputs,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    say!(
        "{}: {} layers, {} parameters; drive with `senda drive --driver neural --model {}`",
        arguments.out.display(),
        model.network.layers().len(),
        model.network.parameter_count(),
        arguments.out.display()
    )?;
    Ok(())
}
