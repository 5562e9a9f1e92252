//! A recording as a vehicle that only senses.

use crate::Recording;
use senda_core::{Body, Command, Observation, Stamp, Truth, Vehicle, VehicleError};

/// Where a replayed command first differed from the recorded one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// Number of the step, from 0.
    pub step: usize,
    /// When.
    pub stamp: Stamp,
    /// What was recorded.
    pub recorded: Command,
    /// What the driver asked now.
    pub replayed: Command,
}

/// Yields the recorded observations again; commands move nothing, they are compared with the recorded ones.
#[derive(Debug, Clone)]
pub struct Replay {
    recording: Recording,
    next: usize,
    damaged_frames: usize,
    first_damaged: Option<usize>,
    compared: usize,
    differences: usize,
    unexplained: usize,
    first_difference: Option<Difference>,
}

impl Replay {
    /// From a recording of senda or an imported one.
    pub fn new(recording: Recording) -> Self {
        Self {
            recording,
            next: 0,
            damaged_frames: 0,
            first_damaged: None,
            compared: 0,
            differences: 0,
            unexplained: 0,
            first_difference: None,
        }
    }

    /// The recording.
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// The command that was recorded for the last observation.
    pub fn recorded_command(&self) -> Option<&Command> {
        Some(&self.current()?.command)
    }

    /// Pictures left out of observations so far because they could not be decoded.
    pub fn damaged_frames(&self) -> usize {
        self.damaged_frames
    }

    /// Commands compared so far.
    pub fn compared(&self) -> usize {
        self.compared
    }

    /// Commands that were not exactly the recorded ones, so far.
    pub fn differences(&self) -> usize {
        self.differences
    }

    /// Those of them that came before anything was found missing: whoever remembers earlier frames answers otherwise once
    /// steps are lost or a picture is damaged.
    pub fn unexplained(&self) -> usize {
        self.unexplained
    }

    /// The first step before or in which something is missing.
    pub fn first_damaged(&self) -> Option<usize> {
        self.first_damaged
    }

    /// The first of them.
    pub fn first_difference(&self) -> Option<&Difference> {
        self.first_difference.as_ref()
    }

    fn current(&self) -> Option<&crate::Step> {
        self.recording.steps.get(self.next.checked_sub(1)?)
    }
}

impl Vehicle for Replay {
    fn body(&self) -> &Body {
        &self.recording.header.body
    }

    fn observe(&mut self, observation: &mut Observation) -> Result<bool, VehicleError> {
        let Some(step) = self.recording.steps.get(self.next) else {
            return Ok(false);
        };
        let damaged = step.observation_into(observation);
        if damaged > 0 || self.recording.lost.iter().any(|lost| lost.before == self.next) {
            self.first_damaged.get_or_insert(self.next);
        }
        self.next += 1;
        self.damaged_frames += damaged;
        Ok(true)
    }

    fn actuate(&mut self, command: &Command) -> Result<(), VehicleError> {
        let Some(step) = self.current() else {
            return Ok(());
        };
        let difference = Difference {
            step: self.next - 1,
            stamp: step.stamp,
            recorded: step.command,
            replayed: *command,
        };
        self.compared += 1;
        if difference.recorded != difference.replayed {
            self.differences += 1;
            self.unexplained += usize::from(self.first_damaged.is_none());
            self.first_difference.get_or_insert(difference);
        }
        Ok(())
    }

    fn truth(&self) -> Option<&Truth> {
        self.current()?.truth.as_ref()
    }
}
