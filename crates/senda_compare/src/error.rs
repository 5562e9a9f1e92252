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
    /// Folders to be joined hold different comparisons.
    #[error(
        "{}: expected the plan of the first folder, but found another one; name only parts of one comparison",
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
    /// A lap to learn from was not driven whole.
    #[error(
        "expected a whole lap of {world:?} to learn from, but {driver:?} did not drive it to its end ({ended}); take another world, \
         driver or speed_mps"
    )]
    Lap {
        /// The world.
        world: String,
        /// Who drove.
        driver: String,
        /// How it ended.
        ended: &'static str,
    },
    /// No such vehicle drives so fast.
    #[error("{key}: expected at most {most_mps} m/s, as fast as {vehicle:?} is, but found {found_mps}")]
    Speed {
        /// Which key of the plan.
        key: String,
        /// Its value (m/s).
        found_mps: f64,
        /// The vehicle.
        vehicle: String,
        /// Its top speed (m/s).
        most_mps: f64,
    },
    /// A world that judges was learned from.
    #[error(
        "{key}: expected worlds that nothing was learned from or tuned on, but {world:?} is the same world as {learned:?}; take \
         another one, or another seed of a random one"
    )]
    Seen {
        /// Which list of the plan.
        key: &'static str,
        /// The world that judges.
        world: String,
        /// The one that was learned from.
        learned: String,
    },
    /// A folder is another one's place of work at this moment.
    #[error(
        "{}: another `senda compare` works in this folder; wait for it, or give each part a folder of its own with --folder",
        folder.display()
    )]
    Busy {
        /// The folder.
        folder: PathBuf,
    },
    /// What is to be joined is no comparison's folder.
    #[error(
        "{}: expected the folder of a comparison, with its plan ({source}); name folders that `senda compare --shard` made",
        path.display()
    )]
    NoFolder {
        /// What was named.
        path: PathBuf,
        /// What the system said of its plan.
        source: std::io::Error,
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
