//! `senda learn`: from nothing to a driving network.

use super::train::inherited::{inherit, learned_by};
use super::{check_out, report::command_line, save_model, training_report};
use crate::terminal;
use anyhow::Result;
use clap::Args;
use senda_learn::Samples;
use senda_learn::learn::{self, Learning, Stage};
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Experiment file (TOML); flags override its keys
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Ready network (`senda net list`) or network file
    #[arg(long, value_name = "NETWORK")]
    network: Option<String>,
    /// Begin with these weights, for the layers that fit: a model, safetensors or ONNX
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Vehicle
    #[arg(long, value_name = "VEHICLE")]
    vehicle: Option<String>,
    /// Families of random worlds to learn from, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    worlds: Vec<String>,
    /// Frames that the expert drives first, at least: the last eight drives are kept whole
    #[arg(long, value_name = "N")]
    expert_frames: Option<usize>,
    /// Rounds in which the network drives and is corrected
    #[arg(long, value_name = "N")]
    rounds: Option<u32>,
    /// Frames of each round, at least, as for the expert's
    #[arg(long, value_name = "N")]
    round_frames: Option<usize>,
    /// Passes over all frames at the end
    #[arg(long, value_name = "N")]
    epochs: Option<u32>,
    /// Seed of everything
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Runs of the trial after each round; 0 for none
    #[arg(long, value_name = "N")]
    trial_runs: Option<usize>,
    /// Where everything is kept; an experiment that lies there goes on
    #[arg(long, value_name = "FOLDER", default_value = "experiment")]
    folder: PathBuf,
    /// Where the model is written
    #[arg(long, value_name = "FILE", default_value = "model.senda")]
    out: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn learning(&self) -> Result<Learning> {
        let mut learning = match &self.plan {
            Some(path) => Learning::load(path)?,
            None => Learning::default(),
        };
        if let Some(network) = &self.network {
            learning.network.clone_from(network);
        }
        if let Some(from) = &self.from {
            learning.from = Some(from.clone());
        }
        if let Some(vehicle) = &self.vehicle {
            learning.gathering.vehicle.clone_from(vehicle);
        }
        if !self.worlds.is_empty() {
            learning.gathering.families.clone_from(&self.worlds);
        }
        learning.expert_frames = self.expert_frames.unwrap_or(learning.expert_frames);
        learning.rounds = self.rounds.unwrap_or(learning.rounds);
        learning.round_frames = self.round_frames.unwrap_or(learning.round_frames);
        learning.training.epochs = self.epochs.unwrap_or(learning.training.epochs);
        if let Some(seed) = self.seed {
            learning.seed = seed;
            learning.training.seed = seed;
        }
        learning.trial.runs = self.trial_runs.unwrap_or(learning.trial.runs);
        Ok(learning)
    }
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let learning = arguments.learning()?;
    check_out(&arguments.out)?;
    let began_ns = terminal::clock_ns();
    let bar = terminal::bar("learn");
    let place = |part: f64| bar.set_position((1000.0 * part) as u64);
    let tell = |stage: Stage| match stage {
        Stage::Weights(note) => bar.suspend(|| tell!("{note}")),
        Stage::Gathering(round, done, of) => {
            bar.set_message(format!("round {round}: driving {done}/{of}"));
            place(done as f64 / of.max(1) as f64);
        }
        Stage::Training(round, part, loss) => {
            bar.set_message(format!("round {round}: training, loss {loss:.5}"));
            place(part);
        }
        Stage::Trial(round, done, of) => {
            bar.set_message(format!("round {round}: trial {done}/{of}"));
            place(done as f64 / of.max(1) as f64);
        }
        Stage::Round(round) => {
            let trial = round.trial.map_or(String::new(), |[done, of]| {
                let error = round
                    .lane_error_m
                    .map_or(String::new(), |m| format!(", mean error {:.1} cm", 100.0 * m));
                format!(", {done} of {of} trial runs completed{error}")
            });
            bar.suspend(|| {
                tell!(
                    "round {}: {} frames, {} of {} drives left the road, loss {:.5}{trial}  [{:.0} s]",
                    round.number,
                    round.frames,
                    round.strayed,
                    round.drives,
                    round.loss,
                    terminal::seconds_since(began_ns)
                );
            });
        }
    };
    let learned = learn::learn(&learning, &arguments.folder, &terminal::interrupted, &tell)?;
    bar.finish_and_clear();
    if learned.interrupted {
        tell!(
            "interrupted: the same command goes on from {}",
            arguments.folder.display()
        );
        if arguments.json {
            let value = serde_json::json!({
                "interrupted": true,
                "rounds": learned.rounds,
                "wall_s": terminal::seconds_since(began_ns),
            });
            say!("{}", serde_json::to_string_pretty(&value)?)?;
        }
        return Ok(());
    }
    let mut model = learned.model;
    model.provenance.command = command_line();
    if let Some((from, base)) = learning
        .from
        .as_deref()
        .and_then(|from| Some((from, learned_by(from)?)))
    {
        inherit(&mut model.provenance, from, &base);
    }
    save_model(&model, &arguments.out)?;
    let told = training_report::Told {
        model: &model,
        history: &learned.history,
        // Nothing judges but the trials: the last epoch is kept.
        best_epoch: learned.history.last().map_or(0, |epoch| epoch.number),
        rounds: &learned.rounds,
        training: &learned.samples,
        validation: &Samples::new(learned.samples.frame_len, learned.samples.outputs),
    };
    let title = format!("{} learns to drive", model.network.name());
    training_report::write(&arguments.folder.join("report.html"), &title, &told)?;
    let wall_s = terminal::seconds_since(began_ns);
    if arguments.json {
        let value = serde_json::json!({
            "interrupted": false,
            "model": arguments.out,
            "network": model.network.name(),
            "rounds": learned.rounds,
            "history": learned.history,
            "wall_s": wall_s,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    say!("model: {} after {wall_s:.0} s", arguments.out.display())?;
    say!(
        "try it: senda drive --world unseen-1 --vehicle {} --driver neural --model {}",
        learning.gathering.vehicle,
        arguments.out.display()
    )?;
    Ok(())
}
