//! Foreign data becomes recordings of senda.

use crate::open::{Format, open_runs};
use crate::{DataError, Recording};
use senda_core::Body;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// One recording that an import wrote.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Imported {
    /// The file.
    pub path: PathBuf,
    /// Steps in it.
    pub steps: usize,
    /// Its duration (s).
    pub duration_s: f64,
    /// What was damaged, missing or guessed. The recording's summary keeps these.
    pub warnings: Vec<String>,
}

/// Turns a foreign data set into recordings, one per run: sequences never cross runs.
///
/// `to` is a file when it ends in `.mcap`: then the set must be one run. Otherwise it is a folder, made if missing, for
/// `<name of the set>-1.mcap` and so on. Nothing is written over. `body` is the vehicle that recorded the data.
pub fn import(from: &Path, body: &Body, to: &Path) -> Result<Vec<Imported>, DataError> {
    let format = Format::detect(from)?;
    if format == Format::Recording {
        return Err(DataError::NotThat {
            path: from.to_owned(),
            expected: "data of another program".into(),
            found: "a recording of senda".into(),
            advice: "use it as it is".into(),
        });
    }
    let recordings = open_runs(from, body)?;
    expect_steps(from, &recordings)?;
    let single = to.extension().is_some_and(|end| end.eq_ignore_ascii_case("mcap"));
    if single && recordings.len() != 1 {
        return Err(DataError::NotThat {
            path: from.to_owned(),
            expected: "one run".into(),
            found: format!("{} runs", recordings.len()),
            advice: format!("give a folder instead of {}", to.display()),
        });
    }
    let paths: Vec<PathBuf> = if single {
        vec![to.to_owned()]
    } else {
        std::fs::create_dir_all(to).map_err(|e| DataError::write(to, "nothing was saved", e))?;
        let name = set_name(from);
        (1..=recordings.len())
            .map(|number| to.join(format!("{name}-{number}.mcap")))
            .collect()
    };
    // All before any: half an import over an old one would be a mixture.
    if let Some(there) = paths.iter().find(|path| path.exists()) {
        return Err(DataError::NotThat {
            path: there.clone(),
            expected: "a new file".into(),
            found: "a file that is already there".into(),
            advice: "remove it, or give another place".into(),
        });
    }
    recordings
        .into_iter()
        .zip(paths)
        .map(|(recording, path)| save(recording, path, format))
        .collect()
}

/// Refuses data without a single record that can be used, with the first reasons; nothing is written then.
pub(crate) fn expect_steps(from: &Path, recordings: &[Recording]) -> Result<(), DataError> {
    if recordings.iter().any(|recording| !recording.steps.is_empty()) {
        return Ok(());
    }
    let warnings: Vec<&str> = recordings
        .iter()
        .flat_map(|recording| &recording.warnings)
        .map(String::as_str)
        .take(5)
        .collect();
    Err(DataError::NotThat {
        path: from.to_owned(),
        expected: "records that can be used".into(),
        found: match &warnings[..] {
            [] => "none (the edits beside the data leave all of them out)".to_owned(),
            some => format!("none ({})", some.join("; ")),
        },
        advice: "nothing was written".into(),
    })
}

fn save(mut recording: Recording, path: PathBuf, format: Format) -> Result<Imported, DataError> {
    recording.summary = Some(serde_json::json!({
        "imported": format.name(),
        "steps": recording.steps.len(),
        "duration_s": recording.duration_s(),
        "warnings": recording.warnings,
    }));
    recording.save(&path)?;
    Ok(Imported {
        path,
        steps: recording.steps.len(),
        duration_s: recording.duration_s(),
        warnings: recording.warnings,
    })
}

/// `warehouse` of `…/warehouse.tar.gz`.
pub(crate) fn set_name(from: &Path) -> String {
    let name = from
        .file_name()
        .map_or_else(|| "data".into(), |name| name.to_string_lossy().into_owned());
    for end in [".tar.gz", ".tgz", ".tar", ".csv"] {
        if let Some(stem) = name.strip_suffix(end) {
            return stem.to_owned();
        }
    }
    name
}
