//! `senda train`: a network on recordings.

mod experiment;
mod fine_tuning;
pub(crate) mod inherited;
mod judged;

use super::{check_out, note_interruption, report::command_line, save_trained, training_report};
use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::Args;
pub(crate) use experiment::Experiment;
use judged::Judged;
use senda_learn::{
    Answers, Samples,
    beginning::begin,
    gather::{self, Data},
    learn::network_for,
    split,
    train::{self, Lesson, News},
};
use senda_nets::{InputSpec, Model, Provenance, View};
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Recordings, tubs, Udacity folders, named frames, or folders of those
    data: Vec<PathBuf>,
    /// Experiment file (TOML); flags override its keys
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Ready network (`senda net list`) or network file
    #[arg(long, value_name = "NETWORK")]
    network: Option<String>,
    /// Data that judge and are not learned from
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    validation: Vec<PathBuf>,
    /// How to hold data out without --validation: worlds, runs, time or random-frames
    #[arg(long, value_name = "HOW")]
    split: Option<String>,
    /// Part of the data that is held out
    #[arg(long, value_name = "PART")]
    validation_share: Option<f64>,
    /// Frames left out between the parts of a split in time: neighbours of the held-out frames
    #[arg(long, value_name = "N")]
    split_gap: Option<usize>,
    /// Let a random split of frames leak neighbouring frames into validation
    #[arg(long)]
    allow_leak: bool,
    /// Vehicle that foreign data were recorded on
    #[arg(long, value_name = "VEHICLE")]
    vehicle: Option<String>,
    /// rgb, grey or saturation
    #[arg(long, value_name = "COLOUR")]
    colour: Option<String>,
    /// Part of the frame's height that is cut off above
    #[arg(long, value_name = "PART")]
    crop_top: Option<f64>,
    /// Part of the frame's height that is cut off below
    #[arg(long, value_name = "PART")]
    crop_bottom: Option<f64>,
    /// Add the edges of the frame's saturation to what the network sees (document B)
    #[arg(long)]
    edges: bool,
    /// Frames that the network is shown at once; its channels are shared out among them
    #[arg(long, value_name = "N")]
    stack: Option<usize>,
    /// Passes over the data
    #[arg(long, value_name = "N")]
    epochs: Option<u32>,
    /// Samples a step
    #[arg(long, value_name = "N")]
    batch: Option<usize>,
    /// Consecutive frames of a run that a network with a memory learns from at once; 1: single frames, without the memory
    #[arg(long, value_name = "N")]
    sequence: Option<usize>,
    /// Adam's step size
    #[arg(long, value_name = "RATE")]
    learning_rate: Option<f64>,
    /// How far rare curves are raised against frequent straights: 0 not at all, 1 until every range counts the same
    #[arg(long, value_name = "PART")]
    balance: Option<f64>,
    /// Show every frame as it is and mirrored in every epoch
    #[arg(long)]
    both_ways: bool,
    /// Stop when validation has not improved for this many epochs
    #[arg(long, value_name = "N")]
    patience: Option<u32>,
    /// What full lock is called in degrees, to tell errors in degrees too (document A's servo: 50)
    #[arg(long, value_name = "DEG")]
    full_lock_deg: Option<f64>,
    /// Seed
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Threads; without it one for each core. The result does not depend on it
    #[arg(long, value_name = "N", value_parser = super::parse_jobs)]
    jobs: Option<usize>,
    /// Go on from these weights: a model (fine-tuning), or others' weights for the network (safetensors, ONNX)
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Keep a checkpoint in this folder, and go on from it when it exists
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Where the model is written
    #[arg(long, value_name = "FILE", default_value = "model.senda")]
    out: PathBuf,
    /// Write a report (one HTML file); with --folder there is always one in it
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn word<T: serde::de::DeserializeOwned>(flag: &str, text: &str) -> Result<T> {
    serde_json::from_value(serde_json::Value::String(text.to_owned()))
        .map_err(|error| anyhow::anyhow!("--{flag} {text}: {error}"))
}

impl Arguments {
    fn experiment(&self) -> Result<Experiment> {
        let mut experiment = match &self.plan {
            Some(path) => Experiment::load(path)?,
            None => Experiment::default(),
        };
        if !self.data.is_empty() {
            experiment.data.clone_from(&self.data);
        }
        if !self.validation.is_empty() {
            experiment.validation.clone_from(&self.validation);
        }
        if self.network.is_some() {
            experiment.network.clone_from(&self.network);
        }
        if self.from.is_some() {
            experiment.from.clone_from(&self.from);
        }
        experiment.allow_leak |= self.allow_leak;
        if let Some(vehicle) = &self.vehicle {
            experiment.vehicle.clone_from(vehicle);
        }
        if let Some(how) = &self.split {
            experiment.split = word("split", how)?;
        }
        if let Some(colour) = &self.colour {
            experiment.colour = Some(word("colour", colour)?);
        }
        experiment.validation_share = self.validation_share.unwrap_or(experiment.validation_share);
        experiment.split_gap = self.split_gap.unwrap_or(experiment.split_gap);
        if self.crop_top.is_some() || self.crop_bottom.is_some() {
            let crop = experiment.crop.get_or_insert_default();
            crop.top = self.crop_top.unwrap_or(crop.top);
            crop.bottom = self.crop_bottom.unwrap_or(crop.bottom);
        }
        experiment.full_lock_deg = self.full_lock_deg.or(experiment.full_lock_deg);
        if let Some(degrees) = experiment.full_lock_deg
            && !(degrees > 0.0 && degrees <= 360.0)
        {
            bail!("full_lock_deg: expected more than 0 and at most 360 degrees, but found {degrees}");
        }
        if self.edges {
            experiment.edges.get_or_insert_default();
        }
        experiment.stack = self.stack.or(experiment.stack);
        let training = &mut experiment.training;
        training.epochs = self.epochs.unwrap_or(training.epochs);
        training.batch = self.batch.unwrap_or(training.batch);
        training.sequence = self.sequence.unwrap_or(training.sequence);
        training.learning_rate = self.learning_rate.unwrap_or(training.learning_rate);
        training.balance = self.balance.unwrap_or(training.balance);
        training.both_ways |= self.both_ways;
        training.patience = self.patience.unwrap_or(training.patience);
        training.seed = self.seed.unwrap_or(training.seed);
        training.threads = self.jobs.unwrap_or(training.threads);
        if experiment.data.is_empty() {
            bail!(
                "expected data to learn from, but found none; record some with `senda drive --record FOLDER`, then `senda train FOLDER`"
            );
        }
        Ok(experiment)
    }
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let mut experiment = arguments.experiment()?;
    check_out(&arguments.out)?;
    let began_ns = terminal::clock_ns();
    let from = experiment.from.clone();
    let is_model = |path: &&PathBuf| {
        let extension = path.extension().and_then(|extension| extension.to_str());
        !matches!(extension, Some("safetensors" | "onnx"))
    };
    let (network, weights, mut input) = if let Some(path) = from.as_ref().filter(is_model) {
        let model = Model::load(path)?;
        fine_tuning::refuse_other(&model, path, &experiment)?;
        (model.network, model.weights, model.input)
    } else {
        let name = experiment.network.get_or_insert_with(|| "pilotnet".to_owned());
        let network = network_for(name, &experiment.answers)?;
        let seed = experiment.training.seed;
        let (weights, note) = begin(&network, &experiment.training, seed, from.as_deref())?;
        if let Some(note) = note {
            tell!("{note}");
        }
        let view = View {
            colour: experiment.colour,
            crop: experiment.crop.unwrap_or_default(),
            edges: experiment.edges,
            stack: experiment.stack,
        };
        let input = InputSpec::for_network(&network, &view).map_err(|fault| anyhow::anyhow!("{fault}"))?;
        (network, weights, input)
    };
    let base = from.as_deref().and_then(inherited::learned_by);
    let body = senda_run::scenario::find_vehicle(&experiment.vehicle)?.body();
    let bar = terminal::bar("reading");
    let read = |paths: &[PathBuf]| -> Result<Data> {
        let data = gather::recordings(
            paths,
            &body,
            &input,
            &experiment.answers,
            &experiment.selection,
            &mut |done, of| bar.set_position((1000 * done / of.max(1)) as u64),
        )?;
        bar.suspend(|| terminal::warn(&data.warnings));
        data.expect_frames(paths)?;
        Ok(data)
    };
    let Data {
        samples: all,
        camera,
        used,
        mut warnings,
        sources,
        ..
    } = read(&experiment.data)?;
    let (training, validation) = if experiment.validation.is_empty() {
        let share = experiment.validation_share;
        let (training, validation) = split::split(
            &all,
            experiment.split,
            share,
            experiment.split_gap,
            experiment.training.seed,
            experiment.allow_leak,
        )?;
        if let Some(note) = split::far_off(&training, &validation, experiment.split, share) {
            bar.suspend(|| terminal::tell(format!("warning: {note}")));
            warnings.push(note);
        }
        (training, validation)
    } else {
        let judging = read(&experiment.validation)?;
        let learned_too = judging.sources.intersection(&sources).count();
        if learned_too > 0 {
            let leak = format!(
                "{learned_too} of the {} files or data sets that judge are learned from too: validation measures memory, not driving",
                judging.sources.len()
            );
            bar.suspend(|| terminal::tell(format!("warning: {leak}")));
            warnings.push(leak);
        }
        warnings.extend(judging.warnings);
        (all, judging.samples)
    };
    // What the data do not know, a model that is fine-tuned may.
    input.camera = camera.or(input.camera);
    let answers = Answers::of(&experiment.answers);
    let checkpoint = arguments.folder.as_ref().map(|folder| folder.join("checkpoint"));
    bar.set_message("training");
    let lesson = Lesson {
        network: &network,
        input: &input,
        answers: &answers,
        training: &training,
        validation: &validation,
        options: &experiment.training,
        checkpoint: checkpoint.as_deref(),
    };
    // An experiment that is refused leaves the folder's own as it was.
    train::check(&lesson, &weights)?;
    if let Some(folder) = &arguments.folder {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make folder {}", folder.display()))?;
        experiment.write(folder, &network, &input)?;
    }
    let trained = train::train(
        &lesson,
        weights,
        &mut terminal::ears(&bar),
        &mut |news| match news {
            News::Step { loss, .. } => bar.set_message(format!("training, loss {loss:.5}")),
            News::Epoch(epoch) => bar.suspend(|| {
                let judged = epoch.validation.map_or(String::new(), |errors| {
                    format!(
                        ", validation: MSE {:.5}, mean error {:.4} (constant: {:.4}), correlation {:.3}",
                        errors.mean_squared,
                        errors.mean_absolute,
                        errors.of_constant_median,
                        errors.correlation
                    )
                });
                tell!(
                    "epoch {}: loss {:.5}{judged}  [{:.0} s]",
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
    let judge = |samples: &Samples| -> Result<Option<Judged>> {
        if samples.is_empty() {
            return Ok(None);
        }
        let errors = train::judge(&lesson, &trained.weights, samples)?;
        let degrees = experiment
            .full_lock_deg
            .map(|full_lock_deg| errors.in_degrees(full_lock_deg));
        Ok(Some(Judged { errors, degrees }))
    };
    let (on_training, on_validation) = (judge(&training)?, judge(&validation)?);
    let worse = match (&on_validation, &on_training) {
        (Some(judged), _) => judged.worse_than_constant("judging"),
        (None, Some(judged)) => judged.worse_than_constant("learned"),
        (None, None) => None,
    };
    if let Some(note) = &worse {
        tell!("warning: {note}");
        warnings.push(note.clone());
    }
    let best = trained
        .history
        .iter()
        .find(|epoch| epoch.number == trained.best_epoch);
    let mut provenance = Provenance {
        senda: env!("CARGO_PKG_VERSION").to_owned(),
        commit: senda_run::COMMIT.to_owned(),
        data: used.iter().map(|path| path.display().to_string()).collect(),
        worlds: {
            let mut worlds: Vec<String> = training
                .runs
                .iter()
                .map(|run| run.world.clone())
                .filter(|w| !w.is_empty())
                .collect();
            worlds.sort();
            worlds.dedup();
            worlds
        },
        seed: experiment.training.seed,
        command: command_line(),
        notes: worse.unwrap_or_default(),
        ..Provenance::default()
    };
    if let Some((from, base)) = from.as_deref().zip(base.as_ref()) {
        inherited::inherit(&mut provenance, from, base);
    }
    if let Some(best) = best {
        provenance
            .metrics
            .insert("best_epoch".into(), serde_json::to_value(best)?);
    }
    if trained.interrupted {
        let done = trained.history.len();
        let folder = arguments.folder.as_deref();
        note_interruption(&mut provenance, done, experiment.training.epochs, folder);
    }
    let forgets = experiment.training.forgets(&network);
    let model = Model {
        outputs: experiment.answers.iter().map(|answer| answer.output()).collect(),
        network,
        weights: trained.weights,
        input,
        provenance,
        grids: vec![],
        detection: None,
        forgets,
    };
    save_trained(&model, &arguments.out, arguments.folder.as_deref())?;
    let in_folder = arguments.folder.as_ref().map(|folder| folder.join("report.html"));
    for path in arguments.report.iter().chain(&in_folder) {
        let told = training_report::Told {
            model: &model,
            history: &trained.history,
            best_epoch: trained.best_epoch,
            rounds: &[],
            training: &training,
            validation: &validation,
        };
        let title = format!("Training of {}", model.network.name());
        training_report::write(path, &title, &told)?;
    }
    let wall_s = terminal::seconds_since(began_ns);
    if arguments.json {
        let value = serde_json::json!({
            "model": arguments.out,
            "network": model.network.name(),
            "training_frames": training.len(),
            "validation_frames": validation.len(),
            "best_epoch": trained.best_epoch,
            "on_training": on_training.map(|judged| judged.json()),
            "on_validation": on_validation.map(|judged| judged.json()),
            "history": trained.history,
            "interrupted": trained.interrupted,
            "warnings": warnings,
            "wall_s": wall_s,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    say!(
        "model: {} (epoch {}; {} frames to learn from, {} to judge) after {wall_s:.0} s",
        arguments.out.display(),
        trained.best_epoch,
        training.len(),
        validation.len()
    )?;
    for (name, judged) in [("training", on_training), ("validation", on_validation)] {
        if let Some(judged) = judged {
            say!("{name} frames, untreated: {judged}")?;
        }
    }
    Ok(())
}
