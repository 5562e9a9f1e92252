//! `senda train --from MODEL`: what the model decides.

use super::Experiment;
use anyhow::Result;
use senda_learn::learn::network_for;
use senda_nets::{Edges, Model};
use std::path::Path;

/// A model that is fine-tuned brings its own network, pictures and outputs: nothing else that was asked for goes unnoticed.
pub(super) fn refuse_other(model: &Model, path: &Path, experiment: &Experiment) -> Result<()> {
    let differs = |what: &str, own: &str, asked: &str| {
        anyhow::anyhow!(
            "{what}: expected {own}, as the model {} has it, but found {asked}; leave it out, or begin with the model's \
             weights alone: `senda model export {0} weights.onnx`, then --from weights.onnx",
            path.display()
        )
    };
    if let Some(name) = &experiment.network {
        let asked = network_for(name, &experiment.answers)?;
        if asked.to_toml() != model.network.to_toml() {
            return Err(differs(
                "network",
                model.network.name(),
                &format!("another one, {name}"),
            ));
        }
    }
    let input = &model.input;
    if let Some(colour) = experiment.colour.filter(|colour| *colour != input.colour) {
        return Err(differs("colour", input.colour.name(), colour.name()));
    }
    if let Some(crop) = experiment.crop.filter(|crop| *crop != input.crop) {
        return Err(differs(
            "crop",
            &format!("{:?}", input.crop),
            &format!("{crop:?}"),
        ));
    }
    if experiment.edges.is_some() && experiment.edges != input.edges {
        let words = |edges: Option<Edges>| edges.map_or("none".to_owned(), |edges| format!("{edges:?}"));
        return Err(differs("edges", &words(input.edges), &words(experiment.edges)));
    }
    if let Some(stack) = experiment.stack.filter(|stack| *stack != input.stack) {
        return Err(differs("stack", &input.stack.to_string(), &stack.to_string()));
    }
    let names = |outputs: &[senda_nets::OutputSpec]| -> String {
        let names: Vec<&str> = outputs.iter().map(|output| output.name.as_str()).collect();
        names.join(", ")
    };
    let asked: Vec<_> = experiment.answers.iter().map(|answer| answer.output()).collect();
    if names(&asked) != names(&model.outputs) {
        return Err(differs("answers", &names(&model.outputs), &names(&asked)));
    }
    Ok(())
}
