//! One module a command.

pub(crate) mod bench;
pub(crate) mod calibrate;
pub(crate) mod compare;
pub(crate) mod data;
pub(crate) mod deliver;
pub(crate) mod detector;
pub(crate) mod drive;
pub(crate) mod evaluate;
pub(crate) mod hands;
pub(crate) mod learn;
pub(crate) mod look;
pub(crate) mod model;
pub(crate) mod net;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod study;
pub(crate) mod sweep;
pub(crate) mod tour;
pub(crate) mod train;
pub(crate) mod training_report;
pub(crate) mod watched_lane;
pub(crate) mod world;

use anyhow::{Context, Result, anyhow};
use senda_core::whole_file;
use senda_learn::train::MOST_THREADS;
use senda_nets::{Model, Provenance};
use senda_run::Scenario;
use std::path::Path;

/// Writes a file whole or not at all: a full disk must not leave half a report over a good one.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    make_folder_of(path)?;
    whole_file::replace(path, |file| file.write_all(bytes))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Warns of what the vehicle does not have and of what a mission does not do; on standard error, so that results stay alone on
/// standard output.
pub(crate) fn warn_of(scenario: &Scenario) -> Result<()> {
    for note in scenario.notes()? {
        tell!("warning: {note}");
    }
    Ok(())
}

/// Makes the folder of a file to come and finds out whether it can be written, before the hours that it is to hold.
pub(crate) fn check_out(path: &Path) -> Result<()> {
    make_folder_of(path)?;
    whole_file::check_place(path)
        .with_context(|| format!("cannot write {}; choose another place with --out", path.display()))
}

/// Writes a model. One that lies there already is kept as `NAME.earlier`: it may have cost hours.
pub(crate) fn save_model(model: &Model, path: &Path) -> Result<()> {
    make_folder_of(path)?;
    if let Some(earlier) = model.save_keeping_earlier(path)? {
        tell!(
            "{}: the model that was there is now {}",
            path.display(),
            earlier.display()
        );
    }
    Ok(())
}

/// The figure of a model whose training was interrupted.
pub(crate) const INTERRUPTED: &str = "interrupted";

/// Says how far a training came and what to do; a figure says so in the model.
pub(crate) fn note_interruption(provenance: &mut Provenance, done: usize, of: u32, folder: Option<&Path>) {
    let place = format!("after epoch {done} of {of}");
    match folder {
        Some(folder) => tell!(
            "interrupted {place}: the same command goes on from {}",
            folder.display()
        ),
        None => tell!("interrupted {place}: give --folder FOLDER to be able to go on"),
    }
    provenance.metrics.insert(INTERRUPTED.to_owned(), place.into());
}

/// Writes the model at the end of a training. Where that fails, what can still be had is said: the weights took hours.
pub(crate) fn save_trained(model: &Model, out: &Path, folder: Option<&Path>) -> Result<()> {
    save_model(model, out).map_err(|error| match folder {
        Some(folder) => anyhow!(
            "{error:#}; nothing is lost: the same command with another --out goes on from the checkpoint in {}",
            folder.display()
        ),
        None => anyhow!(
            "{error:#}; the weights are lost: with --folder FOLDER a checkpoint is kept, and the same command goes on with another --out"
        ),
    })
}

/// Threads; 0: one for each core.
pub(crate) fn parse_jobs(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(jobs) if jobs <= MOST_THREADS => Ok(jobs),
        _ => Err(format!(
            "expected 1 to {MOST_THREADS} threads, or 0 for one for each core, but found `{text}`"
        )),
    }
}

fn make_folder_of(path: &Path) -> Result<()> {
    match path.parent() {
        Some(folder) => std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make folder {}", folder.display())),
        None => Ok(()),
    }
}
