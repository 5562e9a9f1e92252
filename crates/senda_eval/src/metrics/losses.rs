//! When the driver did not see what it follows.

use senda_core::Explanation;
use serde::{Deserialize, Serialize};

/// A gap in seeing the line or lane counts as a loss from this length on (s). C12's own measure: a line seen for less
/// than half a second does not count as found, so one missing for less does not count as lost. Shorter gaps are
/// counted apart.
pub const LOSS_S: f64 = 0.5;

/// What the driver's own account says about seeing the line or lane.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Losses {
    /// How often the line or lane was lost: not seen for [`LOSS_S`] or longer after it had been seen.
    pub lost: u32,
    /// How often it was missing for at least one frame after it had been seen, losses included.
    pub gaps: u32,
    /// Frames without it, those before it was first seen included.
    pub frames_without: u64,
    /// Part of the frames with it (0..=1); `None` if the driver does not say.
    pub found_rate: Option<f64>,
}

/// Counts losses in the steps' times (s) and explanations, in order: gaps of the signal `found`, which is above 0 in
/// frames with the line or lane. A gap that lasts until the end counts by its length so far.
pub fn losses<'a>(steps: impl IntoIterator<Item = (f64, &'a Explanation)>) -> Losses {
    let mut losses = Losses::default();
    let (mut said, mut found_frames) = (0u64, 0u64);
    // When the line was last seen, and whether the gap since then was counted.
    let (mut last_seen_s, mut gap_counted, mut loss_counted) = (None, false, false);
    for (time_s, step) in steps {
        let Some(found) = step.signals.iter().find(|signal| signal.name == "found") else {
            continue;
        };
        said += 1;
        if found.value > 0.0 {
            found_frames += 1;
            (last_seen_s, gap_counted, loss_counted) = (Some(time_s), false, false);
        } else if let Some(seen_s) = last_seen_s {
            losses.gaps += u32::from(!gap_counted);
            gap_counted = true;
            if time_s - seen_s >= LOSS_S && !loss_counted {
                losses.lost += 1;
                loss_counted = true;
            }
        }
    }
    losses.frames_without = said - found_frames;
    losses.found_rate = (said > 0).then(|| found_frames as f64 / said as f64);
    losses
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One frame every 0.2 s.
    fn count(found: &[u8]) -> Losses {
        let steps: Vec<(f64, Explanation)> = found
            .iter()
            .enumerate()
            .map(|(i, found)| {
                let mut step = Explanation::default();
                step.signal("found", f64::from(*found));
                (i as f64 * 0.2, step)
            })
            .collect();
        losses(steps.iter().map(|(time_s, step)| (*time_s, step)))
    }

    #[test]
    fn not_yet_seen_is_not_lost() {
        let counted = count(&[0, 0, 0, 0, 1, 1, 1, 1]);
        assert_eq!((counted.lost, counted.gaps, counted.frames_without), (0, 0, 4));
        assert_eq!(counted.found_rate, Some(0.5));
    }

    #[test]
    fn a_short_gap_is_no_loss_and_a_long_one_counts_once() {
        assert_eq!(
            (count(&[1, 0, 0, 1, 0, 1]).lost, count(&[1, 0, 0, 1, 0, 1]).gaps),
            (0, 2)
        );
        assert_eq!(
            (
                count(&[1, 0, 0, 0, 0, 0, 0, 1]).lost,
                count(&[1, 0, 0, 0, 0, 0, 0, 1]).gaps
            ),
            (1, 1)
        );
        assert_eq!(count(&[1, 0, 0, 0, 1, 0, 0, 0]).lost, 2);
    }

    #[test]
    fn a_driver_that_says_nothing_has_no_rate() {
        assert_eq!(losses([(0.0, &Explanation::default())]), Losses::default());
    }
}
