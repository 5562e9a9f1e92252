//! Who drives.

use crate::{Command, Explanation, Observation, Truth};

/// Turns observations into commands: a person, a line follower, a network, a mission.
///
/// `drive` is called once per observation, in order. The same observations from a new driver give the same commands.
pub trait Driver: Send {
    /// The command for this observation.
    fn drive(&mut self, observation: &Observation) -> Command;

    /// Adds to `explanation` how the last command came about: numbers for the log, shapes for the picture, events.
    /// Only called when somebody looks, so `drive` itself should not build anything for it.
    fn explain(&self, _explanation: &mut Explanation) {}

    /// Whether the driver has ended its work (delivered, given up): the loop stops the vehicle and ends the run.
    fn is_done(&self) -> bool {
        false
    }
}

/// A driver that is told the true state. Only for measuring and labelling: nothing on a real vehicle can be one.
pub trait PrivilegedDriver: Send {
    /// The command for this observation, knowing the true state.
    fn drive_knowing(&mut self, observation: &Observation, truth: &Truth) -> Command;

    /// As [`Driver::explain`].
    fn explain(&self, _explanation: &mut Explanation) {}
}
