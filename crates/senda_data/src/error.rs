//! What can go wrong with files of recorded data.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a recording or a foreign data set cannot be read or written. Damage inside a file is not an error: readers
/// return the good part with warnings.
#[derive(Debug, Error)]
pub enum DataError {
    /// The file or folder cannot be opened or read at all.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// Writing failed: disk full, no permission, medium gone.
    #[error("{}: cannot be written: {source}; {saved}", path.display())]
    Write {
        /// Which file.
        path: PathBuf,
        /// What is safe on the disk, such as `the first 120 steps are saved and readable`.
        saved: String,
        /// The system's words.
        source: std::io::Error,
    },
    /// The file is something else than asked for.
    #[error("{}: expected {expected}, but found {found}; {advice}", path.display())]
    NotThat {
        /// Which file.
        path: PathBuf,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
        /// What to do.
        advice: String,
    },
    /// One value in the file's head makes the rest meaningless.
    #[error("{}: {key}: expected {expected}, but found {found}", path.display())]
    Value {
        /// Which file.
        path: PathBuf,
        /// Which key or line.
        key: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A file of edits is wrong.
    #[error("{}: {reason}", path.display())]
    Edits {
        /// Which file.
        path: PathBuf,
        /// What is wrong, and where.
        reason: String,
    },
    /// Written by a newer senda.
    #[error(
        "{}: senda_format: expected at most {supported}, but found {found}; it was recorded by senda {by}: use that version or a newer one",
        path.display()
    )]
    Newer {
        /// Which file.
        path: PathBuf,
        /// The newest format that this program reads.
        supported: u32,
        /// The file's format.
        found: String,
        /// The version that wrote it.
        by: String,
    },
    /// A caller's value that cannot be recorded, such as a command that is not a number.
    #[error("step {step}: {what}: expected {expected}, but found {found}")]
    Unrecordable {
        /// Number of the step, from 0.
        step: u64,
        /// Which value.
        what: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
}

impl DataError {
    pub(crate) fn read(path: &Path, source: std::io::Error) -> Self {
        Self::Read {
            path: path.to_owned(),
            source,
        }
    }

    pub(crate) fn write(path: &Path, saved: impl Into<String>, source: std::io::Error) -> Self {
        Self::Write {
            path: path.to_owned(),
            saved: saved.into(),
            source,
        }
    }
}
