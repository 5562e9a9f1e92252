//! When the driver did not see what it follows.

use senda_core::Explanation;
use serde::{Deserialize, Serialize};

/// What the driver's own account says about seeing the line or lane.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Losses {
    /// How often the line or lane was lost after it had been seen.
    pub lost: u32,
    /// Frames without it, those before it was first seen included.
    pub frames_without: u64,
    /// Part of the frames with it (0..=1); `None` if the driver does not say.
    pub found_rate: Option<f64>,
}

/// Counts losses in the steps' explanations, in order.
///
/// A loss is an event with the word `lost`; from a driver that gives no such event, a frame with the signal `found` at 0
/// after one above 0. An event repeated in consecutive steps counts once.
pub fn losses<'a>(steps: impl IntoIterator<Item = &'a Explanation>) -> Losses {
    let (mut by_event, mut by_signal) = (0, 0);
    let (mut was_event, mut was_found) = (false, false);
    let (mut said, mut found_frames) = (0u64, 0u64);
    for step in steps {
        let is_event = step
            .events
            .iter()
            .any(|event| event.split_whitespace().any(|word| word == "lost"));
        by_event += u32::from(is_event && !was_event);
        was_event = is_event;
        if let Some(found) = step.signals.iter().find(|signal| signal.name == "found") {
            let is_found = found.value > 0.0;
            by_signal += u32::from(was_found && !is_found);
            was_found = is_found;
            said += 1;
            found_frames += u64::from(is_found);
        }
    }
    Losses {
        lost: if by_event > 0 { by_event } else { by_signal },
        frames_without: said - found_frames,
        found_rate: (said > 0).then(|| found_frames as f64 / said as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(found: &[u8], event_at: &[usize]) -> Vec<Explanation> {
        let step = |(i, found): (usize, &u8)| {
            let mut step = Explanation::default();
            step.signal("found", f64::from(*found));
            if event_at.contains(&i) {
                step.event("line lost");
            }
            step
        };
        found.iter().enumerate().map(step).collect()
    }

    #[test]
    fn not_yet_seen_is_not_lost() {
        let found = losses(&steps(&[0, 0, 1, 1, 0, 0, 1, 0], &[]));
        assert_eq!(
            (found.lost, found.frames_without, found.found_rate),
            (2, 5, Some(0.375))
        );
    }

    #[test]
    fn events_outrank_the_signal_and_count_once() {
        assert_eq!(losses(&steps(&[1, 0, 1, 0, 0], &[3, 4])).lost, 1);
    }

    #[test]
    fn a_driver_that_says_nothing_has_no_rate() {
        assert_eq!(losses(&[Explanation::default()]), Losses::default());
    }
}
