//! Recordings for other people's programs.

use crate::edits::open_edited_runs;
use crate::import::{expect_steps, set_name};
use crate::open::Format;
use crate::{DataError, Recording, Step, named_frames, tub, udacity};
use senda_core::Body;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Steering beyond this part of full lock is cut off; less is rounding.
const BEYOND_LOCK: f64 = 1.000_001;

/// One run that an export wrote.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Exported {
    /// The folder it lies in.
    pub path: PathBuf,
    /// Frames written.
    pub frames: usize,
    /// Steps that have no picture which the format could hold.
    pub skipped: usize,
    /// What was damaged, missing or guessed while reading.
    pub warnings: Vec<String>,
}

/// Writes any data set in another program's format, the edits beside the data applied. `to` is a new or empty folder; several
/// runs become folders in it, except named frames, whose names tell runs apart. `body` is the vehicle that recorded foreign data.
pub fn export(from: &Path, body: &Body, format: Format, to: &Path) -> Result<Vec<Exported>, DataError> {
    if format == Format::Recording {
        return Err(DataError::NotThat {
            path: to.to_owned(),
            expected: "the format of another program (tub, udacity, named_frames)".into(),
            found: "senda's own".into(),
            advice: "copy the recording, or import foreign data".into(),
        });
    }
    let recordings = open_edited_runs(from, body)?;
    expect_steps(from, &recordings)?;
    let filled = std::fs::read_dir(to).is_ok_and(|mut entries| entries.next().is_some());
    if filled || to.is_file() {
        // Half an export over an old one would be a mixture.
        return Err(DataError::NotThat {
            path: to.to_owned(),
            expected: "a new or empty folder".into(),
            found: "something that is already there".into(),
            advice: "give another folder, or remove that one".into(),
        });
    }
    let name = set_name(from);
    let several = recordings.len() > 1 && format != Format::NamedFrames;
    recordings
        .into_iter()
        .enumerate()
        .map(|(index, recording)| {
            let path = if several {
                to.join(format!("{name}-{}", index + 1))
            } else {
                to.to_owned()
            };
            write(recording, index, format, path)
        })
        .collect()
}

fn write(recording: Recording, index: usize, format: Format, path: PathBuf) -> Result<Exported, DataError> {
    let frames = match format {
        Format::Tub => tub::write(&recording, &path, &tub::TubOptions::default())?.records,
        Format::Udacity => udacity::write(&recording, &path, &udacity::UdacityOptions::default())?,
        // A3's names begin with day, hour and minute, which a recording does not know: a number stands there.
        Format::NamedFrames | Format::Recording => {
            named_frames::write(&recording, &path, &format!("v{:06}", index + 1))?
        }
    };
    let mut warnings = recording.warnings;
    if format == Format::Udacity {
        let beyond = |step: &&Step| {
            udacity::convert::unlimited_steering(&recording.header.body, &step.command).abs() > BEYOND_LOCK
        };
        let count = recording.steps.iter().filter(beyond).count();
        if count > 0 {
            // First: it concerns every reader of the export.
            warnings.insert(
                0,
                format!(
                    "{count} of {} labels are steered further than the format's 25°, and were written as 25°",
                    recording.steps.len()
                ),
            );
        }
    }
    Ok(Exported {
        path,
        frames,
        skipped: recording.steps.len().saturating_sub(frames),
        warnings,
    })
}
