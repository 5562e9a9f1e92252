//! Checking options: what every driver refuses, and how it says so.

use thiserror::Error;

/// Why a driver cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DriverError {
    /// A camera driver for a vehicle without cameras.
    #[error("the vehicle `{body}` has no camera, but this driver sees by one; give the vehicle a [[camera]]")]
    NoCamera {
        /// The vehicle's name.
        body: String,
    },
    /// A camera that does not see the floor, so that nothing can be followed with it.
    #[error(
        "camera `{camera}` of `{body}` sees no floor within 3 m ahead; tilt it down (tilt_rad) or lower it (z_m)"
    )]
    NoFloor {
        /// The vehicle's name.
        body: String,
        /// The camera's name.
        camera: String,
    },
    /// A model that does not fit the vehicle or the driver.
    #[error("{reason}")]
    Model {
        /// How it does not fit, and what to do.
        reason: String,
    },
    /// A form that this driver does not have.
    #[error(
        "option `form`: the driver `{driver}` has no form `road`, which takes the two lines of a lane; use the driver `lane`, or the form `curve` or `document`"
    )]
    NoRoad {
        /// The driver.
        driver: &'static str,
    },
    /// A study of more steps than are kept.
    #[error(
        "the study has {runs} runs with {steps} steps together, but at most {most} are kept: shorten its duration, lengthen its \
         period or study fewer values at once"
    )]
    TooManySteps {
        /// Combinations of starts, look-aheads and gains.
        runs: usize,
        /// Steps of all of them.
        steps: usize,
        /// Steps that are possible.
        most: usize,
    },
    /// An option out of its range.
    #[error("option `{key}`: expected a number from {lowest} to {highest}, but found {found}")]
    Range {
        /// The option with its table.
        key: &'static str,
        /// Smallest value accepted.
        lowest: f64,
        /// Largest value accepted.
        highest: f64,
        /// What was given.
        found: f64,
    },
}

/// Options as a TOML table: for the head of a log (C15: all parameters once).
pub(crate) fn table<T: serde::Serialize>(options: &T) -> toml::Table {
    // Our own options are always tables of numbers and words.
    toml::Table::try_from(options).unwrap_or_default()
}

/// Refuses NaN and values outside `lowest..=highest`.
pub(crate) fn check(key: &'static str, found: f64, lowest: f64, highest: f64) -> Result<(), DriverError> {
    if found >= lowest && found <= highest {
        return Ok(());
    }
    Err(DriverError::Range {
        key,
        lowest,
        highest,
        found,
    })
}
