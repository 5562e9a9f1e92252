//! `senda detector train`.

use super::{list, print_scores, warn};
use crate::commands::{
    check_out, note_interruption, report::command_line, save_trained, train::inherited::inherit,
};
use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::Args;
use senda_core::bounded_file;
use senda_learn::detector::{DetectorTraining, Pictures, evaluate, train};
use senda_learn::train::News;
use senda_nets::{Darknet, DarknetWeights, Model, Provenance, Weights};
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    /// `.data` file of a darknet data set
    data: PathBuf,
    /// Ready detector (`detector-small`, `detector`, `yolov3-tiny`) or darknet's `.cfg` file
    #[arg(long, value_name = "DETECTOR", default_value = "detector-small")]
    network: String,
    /// Input size instead of the detector's own
    #[arg(long, value_name = "WxH", value_parser = crate::commands::drive::parse_size)]
    input: Option<[u32; 2]>,
    /// Begin with the values of a darknet `.weights` file, such as yolov3-tiny.conv.15
    #[arg(long, value_name = "FILE", conflicts_with = "from")]
    weights: Option<PathBuf>,
    /// Take only so many convolutions of it: those before the classes
    #[arg(long, value_name = "N", requires = "weights")]
    convolutions: Option<usize>,
    /// Go on from this model (fine-tuning), which keeps its layers; with `--input` they look at larger or smaller
    /// pictures than before
    #[arg(long, value_name = "FILE", conflicts_with = "network")]
    from: Option<PathBuf>,
    /// Passes over the pictures
    #[arg(long, value_name = "N")]
    epochs: Option<u32>,
    /// Pictures a step
    #[arg(long, value_name = "N")]
    batch: Option<usize>,
    /// Adam's step size
    #[arg(long, value_name = "RATE")]
    learning_rate: Option<f64>,
    /// Learn from the first so many pictures only
    #[arg(long, value_name = "N")]
    pictures: Option<usize>,
    /// Seed
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Threads; without it one for each core. The result does not depend on it
    #[arg(long, value_name = "N", value_parser = crate::commands::parse_jobs)]
    jobs: Option<usize>,
    /// Keep a checkpoint in this folder, and go on from it when it exists
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Where the model is written
    #[arg(short, long, value_name = "FILE", default_value = "detector.senda")]
    out: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: Arguments) -> Result<()> {
    let began_ns = terminal::clock_ns();
    check_out(&arguments.out)?;
    let (data, names) = list(&arguments.data, true)?;
    let classes = data.class_names(&arguments.data)?;
    let mut options = DetectorTraining::default();
    options.epochs = arguments.epochs.unwrap_or(options.epochs);
    options.batch = arguments.batch.unwrap_or(options.batch);
    options.learning_rate = arguments.learning_rate.unwrap_or(options.learning_rate);
    options.seed = arguments.seed.unwrap_or(options.seed);
    options.threads = arguments.jobs.unwrap_or(options.threads);
    let mut model = begin(&arguments, &classes, options.seed)?;
    let mut pictures = Pictures::load(&data, &arguments.data, &names, &model.input)?;
    warn(&pictures.warnings);
    if let Some(count) = arguments.pictures {
        pictures.truths.truncate(count);
        pictures
            .pixels
            .truncate(count.saturating_mul(pictures.picture_len));
    }
    let checkpoint = match &arguments.folder {
        Some(folder) => {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("cannot make folder {}", folder.display()))?;
            Some(folder.join("checkpoint"))
        }
        None => None,
    };
    let Some(detection) = model.detection.clone() else {
        bail!("expected a detector, but found a model that gives no boxes");
    };
    let bar = terminal::bar("training");
    let trained = train(
        &model.network,
        &detection,
        &model.input,
        &pictures,
        &options,
        model.weights.clone(),
        checkpoint.as_deref(),
        &mut terminal::ears(&bar),
        &mut |news| match news {
            News::Step { loss, .. } => bar.set_message(format!("training, loss {loss:.3}")),
            News::Epoch(epoch) => bar.suspend(|| {
                tell!(
                    "epoch {}: loss {:.4}  [{:.0} s]",
                    epoch.number,
                    epoch.training_loss,
                    terminal::seconds_since(began_ns)
                );
            }),
        },
    )?;
    bar.finish_and_clear();
    if trained.interrupted && trained.history.is_empty() {
        bail!(terminal::Interrupted(
            " before the first epoch was over: no model is written".to_owned()
        ));
    }
    model.weights = trained.weights;
    let judged = match &data.valid {
        Some(valid) => {
            let judges = Pictures::load(&data, &arguments.data, valid, &model.input)?;
            Some((evaluate(&model, &judges, 0.5, &mut |_, _| {})?, judges.len()))
        }
        None => None,
    };
    let mut provenance = Provenance {
        senda: env!("CARGO_PKG_VERSION").to_owned(),
        commit: senda_run::COMMIT.to_owned(),
        data: vec![format!(
            "{} ({} pictures)",
            arguments.data.display(),
            pictures.len()
        )],
        seed: options.seed,
        command: command_line(),
        ..Provenance::default()
    };
    if let Some(from) = &arguments.from {
        inherit(&mut provenance, from, &model.provenance);
    }
    if let Some((scores, _)) = &judged {
        provenance
            .metrics
            .insert("validation".into(), serde_json::to_value(scores)?);
    }
    if trained.interrupted {
        let (done, folder) = (trained.history.len(), arguments.folder.as_deref());
        note_interruption(&mut provenance, done, options.epochs, folder);
    }
    model.provenance = provenance;
    save_trained(&model, &arguments.out, arguments.folder.as_deref())?;
    let wall_s = terminal::seconds_since(began_ns);
    if arguments.json {
        let value = serde_json::json!({
            "model": arguments.out,
            "training_pictures": pictures.len(),
            "history": trained.history,
            "validation": judged.as_ref().map(|(scores, _)| scores),
            "interrupted": trained.interrupted,
            "wall_s": wall_s,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    say!(
        "model: {} ({} pictures to learn from) after {wall_s:.0} s",
        arguments.out.display(),
        pictures.len()
    )?;
    if let Some((scores, count)) = &judged {
        say!("on {count} pictures that it did not learn from:")?;
        let names = model
            .detection
            .as_ref()
            .map_or(&[][..], |detection| &detection.classes);
        print_scores(names, scores, 0.5)?;
    }
    Ok(())
}

/// The model that training begins with.
fn begin(arguments: &Arguments, classes: &[String], seed: u64) -> Result<Model> {
    if let Some(path) = &arguments.from {
        let model = Model::load(path)?;
        let own = model
            .detection
            .as_ref()
            .map(|detection| detection.classes.as_slice());
        if own != Some(classes) {
            bail!(
                "{}: expected a detector of {}, but found {}",
                path.display(),
                classes.join(", "),
                own.map_or("none".to_owned(), |own| own.join(", "))
            );
        }
        if model.is_quantised() {
            bail!(
                "{}: expected a model with full weights, but found one of 8 bits",
                path.display()
            );
        }
        let (Some([width, height]), Some(detection)) = (arguments.input, model.detection.clone()) else {
            return Ok(model);
        };
        let before = Darknet {
            network: model.network,
            detection,
            warnings: vec![],
        };
        let after = before.with_input(width as usize, height as usize)?;
        return Ok(after.into_model(model.weights));
    }
    let mut darknet = Darknet::find(&arguments.network)?.with_classes(classes)?;
    for warning in &darknet.warnings {
        tell!("warning: {warning}");
    }
    if let Some([width, height]) = arguments.input {
        darknet = darknet.with_input(width as usize, height as usize)?;
    }
    let mut weights = Weights::random(&darknet.network, seed);
    if let Some(path) = &arguments.weights {
        let name = path.display().to_string();
        let bytes = bounded_file::read(path, bounded_file::GIBIBYTE)
            .with_context(|| format!("cannot read {name}"))?;
        let most = arguments.convolutions.unwrap_or(usize::MAX);
        let read = DarknetWeights::from_bytes(&name, &bytes, &darknet.network, Some((&weights, most)))?;
        if let Some(wanted) = arguments
            .convolutions
            .filter(|wanted| *wanted > read.convolutions)
        {
            bail!(
                "--convolutions: expected at most {}, as many as the file and the network have in common, but found {wanted}",
                read.convolutions
            );
        }
        tell!("{name}: {} convolutions taken", read.convolutions);
        weights = read.weights;
    }
    Ok(darknet.into_model(weights))
}
