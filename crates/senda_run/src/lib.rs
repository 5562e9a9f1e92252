//! Joins a vehicle and a driver in one loop, and everything around it: scenarios, recording, replay, sweeps.
//!
//! ```
//! use senda_run::{Ears, Scenario, drive};
//! let scenario = Scenario { time_limit_s: Some(2.0), ..Scenario::new("straight", "gopigo", "line") };
//! let run = drive::in_memory(&scenario, &mut Ears::deaf()).unwrap();
//! assert!(run.summary.frames > 10);
//! ```
//!
//! This crate does not print, parse arguments or read a clock: the edges pass those in through [`Ears`].

pub mod bench;
pub mod calibration;
pub mod drive;
pub mod error;
pub mod guard;
mod log;
mod notes;
mod own_file;
pub mod photograph;
pub mod pilot;
pub mod random;
pub mod referee;
pub mod replay;
pub mod scenario;
mod scenario_file;
mod start;
pub mod sweep;
pub mod trajectory;

pub use error::RunError;
pub use guard::Guard;
pub use pilot::Pilot;
pub use scenario::Scenario;

/// The commit that this program was built from; `unknown` outside a repository.
pub const COMMIT: &str = match option_env!("SENDA_COMMIT") {
    Some(commit) => commit,
    None => "unknown",
};

/// What the loop tells its surroundings and asks of them while it runs.
pub struct Ears<'a> {
    /// Called after every step with the part of the run that is done, 0..=1.
    pub progress: Box<dyn FnMut(f64) + 'a>,
    /// Asked before every step: `true` ends the run in good order (Ctrl-C).
    pub interrupted: Box<dyn Fn() -> bool + 'a>,
    /// A monotonic clock in nanoseconds, to time drivers. Only figures about speed depend on it.
    pub clock_ns: Box<dyn Fn() -> u64 + 'a>,
}

impl Ears<'_> {
    /// Nobody listens, nobody interrupts, and no time passes.
    pub fn deaf() -> Self {
        Self {
            progress: Box::new(|_| {}),
            interrupted: Box::new(|| false),
            clock_ns: Box::new(|| 0),
        }
    }
}
