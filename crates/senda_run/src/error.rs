//! Why a run cannot start or go on.

use std::path::PathBuf;
use thiserror::Error;

/// Why a run, replay or sweep failed. Each names what was found, what was expected and what to do.
#[derive(Debug, Error)]
pub enum RunError {
    /// The world file or name.
    #[error(transparent)]
    World(#[from] senda_world::WorldError),
    /// A recording or foreign data.
    #[error(transparent)]
    Data(#[from] senda_data::DataError),
    /// The simulator refused the scenario.
    #[error(transparent)]
    Sim(#[from] senda_sim::SimError),
    /// The vehicle failed while driving.
    #[error(transparent)]
    Vehicle(#[from] senda_core::VehicleError),
    /// The driver refuses the vehicle or its options.
    #[error(transparent)]
    Driver(#[from] senda_drivers::DriverError),
    /// A model file cannot be used.
    #[error(transparent)]
    Model(#[from] senda_nets::ModelError),
    /// No such driver.
    #[error("unknown driver `{found}`: {}expected one of {known}", did_you_mean(.nearest))]
    UnknownDriver {
        /// What was asked for.
        found: String,
        /// The most similar name.
        nearest: Option<String>,
        /// The known names.
        known: String,
    },
    /// The driver's options do not fit.
    #[error("options of driver `{driver}`: {reason}")]
    DriverOptions {
        /// Which driver.
        driver: String,
        /// What is wrong with them.
        reason: String,
    },
    /// The driver must know the true state, and this vehicle has none.
    #[error("driver `{driver}` needs the true state, which only simulated runs have: choose another driver")]
    NoTruth {
        /// Which driver.
        driver: String,
    },
    /// A value of the scenario is out of range.
    #[error("scenario: `{key}` is {found}, but must be {expected}")]
    Scenario {
        /// Which key.
        key: &'static str,
        /// Its value.
        found: String,
        /// What is allowed.
        expected: String,
    },
    /// A file of ours (scenario, sweep, results) does not parse.
    #[error("{path}: {reason}")]
    File {
        /// Which file.
        path: PathBuf,
        /// Line, key, what was expected and found.
        reason: String,
    },
    /// Reading or writing failed.
    #[error("{path}: {source}")]
    Io {
        /// Which file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
}

impl RunError {
    pub(crate) fn io(path: &std::path::Path, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }
}

fn did_you_mean(nearest: &Option<String>) -> String {
    match nearest {
        Some(name) => format!("did you mean `{name}`? "),
        None => String::new(),
    }
}

/// Refuses a value of a scenario or a sweep.
pub(crate) fn wrong<T>(
    key: &'static str,
    found: impl ToString,
    expected: impl Into<String>,
) -> Result<T, RunError> {
    Err(RunError::Scenario {
        key,
        found: found.to_string(),
        expected: expected.into(),
    })
}
