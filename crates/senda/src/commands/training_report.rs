//! The page that `senda train` and `senda learn` write about a training.

use super::report::command_line;
use super::{INTERRUPTED, write_file};
use anyhow::Result;
use senda_eval::report::{Page, TrainingEpoch, TrainingReport, TrainingRound, training_html};
use senda_learn::{Samples, learn::Round, train::Epoch};
use senda_nets::Model;
use std::path::Path;

/// What there is to tell.
pub(crate) struct Told<'a> {
    pub(crate) model: &'a Model,
    pub(crate) history: &'a [Epoch],
    pub(crate) best_epoch: u32,
    pub(crate) rounds: &'a [Round],
    pub(crate) training: &'a Samples,
    pub(crate) validation: &'a Samples,
}

/// Writes the page.
pub(crate) fn write(path: &Path, title: &str, told: &Told) -> Result<()> {
    let first = told.model.outputs.first();
    let labels = |samples: &Samples| -> Vec<f64> {
        (0..samples.len())
            .map(|index| f64::from(samples.target(index)[0]))
            .collect()
    };
    let mut all = vec![("training".to_owned(), labels(told.training))];
    if !told.validation.is_empty() {
        all.push(("validation".to_owned(), labels(told.validation)));
    }
    let report = TrainingReport {
        network: told.model.network.name().to_owned(),
        epochs: told.history.iter().map(epoch).collect(),
        best_epoch: told.best_epoch,
        answer: first.map_or(String::new(), |output| {
            format!("{} ({})", output.name, output.unit)
        }),
        labels: all,
        rounds: told.rounds.iter().map(round).collect(),
    };
    let provenance = &told.model.provenance;
    let mut page = Page::new(title, &command_line());
    page.commit.clone_from(&provenance.commit);
    page.facts = [
        ("network", told.model.network.name().to_owned()),
        ("parameters", told.model.network.parameter_count().to_string()),
        ("worlds", provenance.worlds.join(", ")),
        ("data", provenance.data.join(", ")),
        ("seed", provenance.seed.to_string()),
    ]
    .into_iter()
    .filter(|(_, value)| !value.is_empty())
    .map(|(name, value)| (name.to_owned(), value))
    .collect();
    page.notes
        .extend(Some(provenance.notes.clone()).filter(|notes| !notes.is_empty()));
    if let Some(place) = provenance
        .metrics
        .get(INTERRUPTED)
        .and_then(|place| place.as_str())
    {
        page.notes.push(format!("Interrupted {place}."));
    }
    write_file(path, training_html(&page, &report).as_bytes())?;
    tell!("report: {}", path.display());
    Ok(())
}

fn epoch(epoch: &Epoch) -> TrainingEpoch {
    let judged = epoch.validation;
    TrainingEpoch {
        number: epoch.number,
        training_loss: epoch.training_loss,
        validation_loss: judged.map(|errors| errors.mean_squared),
        validation_error: judged.map(|errors| errors.mean_absolute),
        constant_error: judged.map(|errors| errors.of_constant_median),
        correlation: judged.map(|errors| errors.correlation),
    }
}

fn round(round: &Round) -> TrainingRound {
    TrainingRound {
        number: round.number,
        frames: round.frames,
        drives: round.drives,
        strayed: round.strayed,
        loss: round.loss,
        trial: round.trial,
        lane_error_m: round.lane_error_m,
    }
}
