//! Why a comparison cannot begin or go on.

use std::path::PathBuf;
use thiserror::Error;

use senda_toml::Problem;

/// Each names what was found, what was expected and what to do.
#[derive(Debug, Error)]
pub enum CompareError {
    /// Something in a plan is wrong, with its line.
    #[error(transparent)]
    Plan(#[from] Box<Problem>),
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// No ready plan has this name.
    #[error("expected the name of a ready comparison, but found {found:?}; known: {known}")]
    UnknownPreset {
        /// What was asked for.
        found: String,
        /// The known names.
        known: String,
    },
    /// A folder holds another comparison.
    #[error(
        "{}: expected the plan of this comparison, but found another one; choose another folder with --folder",
        path.display()
    )]
    OtherPlan {
        /// Its plan file.
        path: PathBuf,
    },
    /// Neither a part `i/N` nor anything like it.
    #[error("expected a part such as 1/4 (the first of four), but found {found:?}")]
    Part {
        /// What was found.
        found: String,
    },
    /// Results are missing.
    #[error("{missing} of {total} results are missing; {help}")]
    Missing {
        /// How many are missing.
        missing: usize,
        /// Of how many.
        total: usize,
        /// Commands that make them.
        help: String,
    },
    /// A result cannot be used.
    #[error("{}: expected a result of this comparison, but {reason}; delete the file and run the comparison again", path.display())]
    Result {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A row's network and treatment do not fit each other.
    #[error("row {row}: {reason}")]
    Row {
        /// The row's identity.
        row: String,
        /// What does not fit.
        reason: String,
    },
    /// Learning failed.
    #[error(transparent)]
    Learn(#[from] senda_learn::LearnError),
    /// A lap failed.
    #[error(transparent)]
    Run(#[from] senda_run::RunError),
    /// A model file cannot be used.
    #[error(transparent)]
    Model(#[from] senda_nets::ModelError),
    /// One job of many failed.
    #[error("{job}: {source}")]
    Job {
        /// What was to be done.
        job: String,
        /// Why it could not.
        source: Box<CompareError>,
    },
}

impl CompareError {
    pub(crate) fn io(path: &std::path::Path, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }
}
