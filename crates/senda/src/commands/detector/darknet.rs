//! `senda detector import` and `export`: darknet's files.

use crate::commands::{check_out, report::command_line, save_model, write_file};
use crate::terminal;
use anyhow::{Context, Result, bail};
use senda_core::bounded_file;
use senda_data::darknet::parse_names;
use senda_nets::{Darknet, DarknetWeights, Model, Provenance};
use std::path::Path;

/// Makes a model of a `.cfg`, its `.weights` and the names of its classes.
pub(super) fn import(cfg: &Path, weights: &Path, names: &Path, out: &Path, json: bool) -> Result<()> {
    check_out(out)?;
    let darknet = Darknet::find(&cfg.display().to_string())?;
    for warning in &darknet.warnings {
        tell!("warning: {warning}");
    }
    let text = std::fs::read_to_string(names).with_context(|| format!("cannot read {}", names.display()))?;
    let classes = parse_names(&text);
    let own = darknet.detection.classes.len();
    if classes.len() != own {
        bail!(
            "{}: expected {own} names, as many as classes in {}, but found {}",
            names.display(),
            cfg.display(),
            classes.len()
        );
    }
    let darknet = darknet.with_classes(&classes)?;
    let name = weights.display().to_string();
    let bytes =
        bounded_file::read(weights, bounded_file::GIBIBYTE).with_context(|| format!("cannot read {name}"))?;
    let read = DarknetWeights::from_bytes(&name, &bytes, &darknet.network, None)?;
    let mut model = darknet.into_model(read.weights);
    model.provenance = Provenance {
        senda: env!("CARGO_PKG_VERSION").to_owned(),
        commit: senda_run::COMMIT.to_owned(),
        command: command_line(),
        data: vec![format!(
            "weights of {name}, which darknet had shown {} pictures",
            read.seen
        )],
        ..Provenance::default()
    };
    save_model(&model, out)?;
    let value = serde_json::json!({
        "model": out,
        "network": model.network.name(),
        "parameters": model.network.parameter_count(),
        "classes": classes,
        "seen": read.seen,
    });
    let words = format!(
        "{}: {} with {} parameters, finds {}",
        out.display(),
        model.network.name(),
        model.network.parameter_count(),
        classes.join(", ")
    );
    terminal::answer(json, &value, &words)
}

/// Writes darknet's files.
pub(super) fn export(path: &Path, folder: &Path, json: bool) -> Result<()> {
    let model = Model::load(path)?;
    let Some(detection) = model.detection.clone() else {
        bail!(
            "{}: expected a detector, but found a model that gives no boxes",
            path.display()
        );
    };
    let names = format!("{}\n", detection.classes.join("\n"));
    let darknet = Darknet {
        network: model.network.clone(),
        detection,
        warnings: vec![],
    };
    let weights = DarknetWeights {
        weights: model.weights,
        seen: 0,
        convolutions: 0,
    };
    let mut files = Vec::new();
    for (name, bytes) in [
        ("detector.cfg", darknet.to_cfg()?.into_bytes()),
        ("detector.weights", weights.to_bytes(&model.network)?),
        ("detector.names", names.into_bytes()),
    ] {
        write_file(&folder.join(name), &bytes)?;
        files.push(folder.join(name).display().to_string());
    }
    terminal::answer(json, &serde_json::json!({ "files": files }), &files.join("\n"))
}
