//! What can go wrong on the way from data to a driving network.

use std::path::PathBuf;
use thiserror::Error;

/// Why learning cannot begin or go on.
#[derive(Debug, Error)]
pub enum LearnError {
    /// An option is out of its range.
    #[error("{key}: expected {expected}, but found {found}")]
    Option {
        /// Its name.
        key: &'static str,
        /// What it may be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// A random split of frames.
    #[error(
        "a random split of frames leaks: neighbouring frames of a run are almost the same picture, so validation would \
         measure memory; split by `worlds`, `runs` or `time`, or insist with --allow-leak"
    )]
    Leak,
    /// A split by world or run with too few of them.
    #[error(
        "expected at least two {what}s to hold one out, but found {found}; record another one, or split by `time`"
    )]
    NothingToHoldOut {
        /// `world` or `run`.
        what: &'static str,
        /// How many there are.
        found: usize,
    },
    /// A split that leaves nothing to learn from.
    #[error(
        "the split leaves nothing to learn from: of each run's frames (the longest has {longest}) the last {percent:.0} % judge \
         (validation_share) and {gap} before them are left out (split_gap); lower one of the two, or record longer runs"
    )]
    NothingLeft {
        /// Frames of the longest run.
        longest: usize,
        /// Part that judges (%).
        percent: f64,
        /// Frames left out before it.
        gap: usize,
    },
    /// No frames.
    #[error("{what}: expected frames, but found none to use; {help}")]
    NoFrames {
        /// Which data.
        what: String,
        /// What to do.
        help: String,
    },
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// An experiment file is wrong.
    #[error("{}: {reason}", path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// What is wrong and where.
        reason: String,
    },
    /// A checkpoint of another experiment.
    #[error("{}: expected a checkpoint of this experiment, but {reason}; choose another folder or delete it", path.display())]
    Checkpoint {
        /// Which file.
        path: PathBuf,
        /// How it differs.
        reason: String,
    },
    /// A label that no network can learn.
    #[error(
        "{what}: run {run}, frame {frame}: expected a label between -{limit} and {limit}, but found {found}; correct or drop it"
    )]
    Label {
        /// Which data.
        what: &'static str,
        /// The run's name.
        run: String,
        /// The frame's number within the run, from 0.
        frame: usize,
        /// Largest label that is taken.
        limit: f32,
        /// What it is.
        found: f32,
    },
    /// The loss became infinite or not a number.
    #[error("the loss is no number after {steps} steps; lower the learning rate (now {learning_rate})")]
    Diverged {
        /// Steps so far.
        steps: u64,
        /// The learning rate.
        learning_rate: f64,
    },
    /// A network or model file.
    #[error(transparent)]
    Network(#[from] senda_nets::NetworkError),
    /// A network cannot be trained so.
    #[error(transparent)]
    Train(#[from] senda_nets::TrainError),
    /// A model file.
    #[error(transparent)]
    Model(#[from] senda_nets::ModelError),
    /// A model that cannot be taken to 8 bits.
    #[error(transparent)]
    Quantise(#[from] senda_nets::QuantiseError),
    /// Weights that others trained.
    #[error(transparent)]
    Adopt(#[from] senda_nets::AdoptError),
    /// Data.
    #[error(transparent)]
    Data(#[from] senda_data::DataError),
    /// A driver.
    #[error(transparent)]
    Driver(#[from] senda_drivers::DriverError),
    /// A run.
    #[error(transparent)]
    Run(#[from] senda_run::RunError),
    /// The simulator.
    #[error(transparent)]
    Simulator(#[from] senda_sim::SimError),
    /// A vehicle.
    #[error(transparent)]
    Vehicle(#[from] senda_core::VehicleError),
}

impl LearnError {
    pub(crate) fn io(path: &std::path::Path, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }
}
