//! C7's states of finding a line, and C12: when a vehicle without a line stops.

use crate::options::{DriverError, check};
use serde::{Deserialize, Serialize};

/// Event of a driver that ends because there never was a line.
pub const GAVE_UP: &str = "no line found, gave up";
/// Event of a driver that ends because its line is gone for good.
pub const STOPPED: &str = "stopped without a line";

/// What to do while no line is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WhileLost {
    /// The last command holds until the vehicle stops (the document).
    Hold,
    /// What was seen of the path before is followed to its end; then turn towards the side where it left, slowly.
    Search,
}

/// Limits of losing the line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossOptions {
    /// The vehicle stops after this distance at cruising speed without a line (m). C12: 0.35.
    pub stop_after_m: f64,
    /// A line seen for less than this does not count as found again (s). C12: 0.5.
    pub transition_s: f64,
    /// Without ever having seen a line the driver waits this long (s), then gives up. The document gives up at once.
    pub patience_s: f64,
    /// What to do while no line is seen. Left out: `hold` in the document's form, `search` in the others.
    pub while_lost: Option<WhileLost>,
    /// Speed while searching, as part of the cruising speed.
    pub search_speed_part: f64,
    /// Radius of the search turn (m).
    pub search_radius_m: f64,
}

impl Default for LossOptions {
    fn default() -> Self {
        Self {
            stop_after_m: 0.35,
            transition_s: 0.5,
            patience_s: 5.0,
            while_lost: None,
            search_speed_part: 0.6,
            search_radius_m: 0.12,
        }
    }
}

impl LossOptions {
    /// Refuses what makes no sense.
    pub fn validate(&self) -> Result<(), DriverError> {
        check("loss.stop_after_m", self.stop_after_m, 0.0, 100.0)?;
        check("loss.transition_s", self.transition_s, 0.0, 60.0)?;
        check("loss.patience_s", self.patience_s, 0.0, 3600.0)?;
        check("loss.search_speed_part", self.search_speed_part, 0.0, 1.0)?;
        check("loss.search_radius_m", self.search_radius_m, 0.01, 100.0)
    }
}

/// Whether there is a line. The numbers of the document's modes where it numbers them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// Mode -1: no line yet.
    #[default]
    NeverSeen,
    /// Mode 0: there was one, it is gone.
    Lost,
    /// Between: a line is there again, but not long enough to forget the loss.
    Transition,
    /// Mode 1: the line was there in the last frame.
    Tracking,
    /// Too long without a line: the vehicle stands and the driver has ended.
    Stopped,
}

impl Mode {
    /// For the log: -1 never seen, 0 lost, 0.5 transition, 1 tracking, -2 stopped.
    pub fn number(self) -> f64 {
        match self {
            Self::NeverSeen => -1.0,
            Self::Lost => 0.0,
            Self::Transition => 0.5,
            Self::Tracking => 1.0,
            Self::Stopped => -2.0,
        }
    }
}

/// Counts the time without a line.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Loss {
    mode: Mode,
    /// Time without a line since it was last found for good (s).
    lost_s: f64,
    /// How long the line has been back (s).
    found_s: f64,
    event: Option<&'static str>,
}

impl Loss {
    pub(crate) fn mode(&self) -> Mode {
        self.mode
    }

    /// Time without a line since it was last found for good (s).
    pub(crate) fn lost_s(&self) -> f64 {
        self.lost_s
    }

    /// What changed in the last step.
    pub(crate) fn event(&self) -> Option<&'static str> {
        self.event
    }

    /// After each step: whether a line was found, the time since the last step, and the cruising speed, which decides
    /// how long 35 cm take.
    pub(crate) fn step(&mut self, found: bool, dt_s: f64, cruise_mps: f64, options: &LossOptions) -> Mode {
        let before = self.mode;
        self.mode = match (self.mode, found) {
            (Mode::Stopped, _) => Mode::Stopped,
            (Mode::NeverSeen, false) => {
                self.lost_s += dt_s;
                if self.lost_s > options.patience_s {
                    Mode::Stopped
                } else {
                    Mode::NeverSeen
                }
            }
            (Mode::NeverSeen, true) => {
                (self.lost_s, self.found_s) = (0.0, 0.0);
                Mode::Transition
            }
            (Mode::Lost, true) => {
                self.found_s = 0.0;
                Mode::Transition
            }
            (Mode::Transition, true) => {
                self.found_s += dt_s;
                if self.found_s >= options.transition_s {
                    self.lost_s = 0.0;
                    Mode::Tracking
                } else {
                    Mode::Transition
                }
            }
            (Mode::Tracking, true) => Mode::Tracking,
            (Mode::Tracking | Mode::Transition | Mode::Lost, false) => {
                self.lost_s += dt_s;
                // At 0 m/s nothing is left behind; still, nobody waits forever.
                let limit_s = if cruise_mps > 1e-3 {
                    options.stop_after_m / cruise_mps
                } else {
                    options.patience_s
                };
                if self.lost_s >= limit_s {
                    Mode::Stopped
                } else {
                    Mode::Lost
                }
            }
        };
        self.event = match (before, self.mode) {
            (a, b) if a == b => None,
            (Mode::NeverSeen, Mode::Transition) => Some("line found"),
            (_, Mode::Transition) => Some("line seen again"),
            (_, Mode::Tracking) => Some("line tracked"),
            (_, Mode::Lost) => Some("line lost"),
            (Mode::NeverSeen, Mode::Stopped) => Some(GAVE_UP),
            (_, Mode::Stopped) => Some(STOPPED),
            (_, Mode::NeverSeen) => None,
        };
        self.mode
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(loss: &mut Loss, found: bool, seconds: f64) -> Mode {
        let options = LossOptions::default();
        for _ in 0..(seconds / 0.05).round() as usize {
            loss.step(found, 0.05, 0.07, &options);
        }
        loss.mode()
    }

    #[test]
    fn stops_after_35_cm_without_a_line() {
        let mut loss = Loss::default();
        assert_eq!(steps(&mut loss, true, 1.0), Mode::Tracking);
        assert_eq!(steps(&mut loss, false, 4.9), Mode::Lost); // 5 s at 7 cm/s
        assert_eq!(steps(&mut loss, false, 0.15), Mode::Stopped);
        assert_eq!(steps(&mut loss, true, 1.0), Mode::Stopped);
    }

    #[test]
    fn a_glimpse_does_not_reset_the_count_but_half_a_second_does() {
        let mut loss = Loss::default();
        steps(&mut loss, true, 1.0);
        steps(&mut loss, false, 3.0);
        assert_eq!(steps(&mut loss, true, 0.3), Mode::Transition);
        assert_eq!(steps(&mut loss, false, 2.1), Mode::Stopped);

        let mut loss = Loss::default();
        steps(&mut loss, true, 1.0);
        steps(&mut loss, false, 3.0);
        assert_eq!(steps(&mut loss, true, 0.65), Mode::Tracking);
        assert_eq!(steps(&mut loss, false, 2.1), Mode::Lost);
    }

    #[test]
    fn gives_up_when_there_never_was_a_line() {
        let mut loss = Loss::default();
        assert_eq!(steps(&mut loss, false, 4.0), Mode::NeverSeen);
        assert_eq!(steps(&mut loss, false, 1.2), Mode::Stopped);
    }
}
