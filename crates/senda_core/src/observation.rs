//! What a vehicle senses at one moment.

use crate::{Encoded, Image};

/// Time since the run began, in nanoseconds. Integers, so that sums of steps are exact.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, serde::Serialize, serde::Deserialize,
)]
#[serde(transparent)]
pub struct Stamp {
    /// Nanoseconds since the beginning of the run.
    pub ns: u64,
}

impl Stamp {
    /// From nanoseconds.
    pub fn from_ns(ns: u64) -> Self {
        Self { ns }
    }

    /// From seconds, rounded to the nearest nanosecond; negative becomes 0.
    pub fn from_s(seconds: f64) -> Self {
        Self {
            ns: (seconds.max(0.0) * 1e9).round() as u64,
        }
    }

    /// In seconds.
    pub fn as_s(self) -> f64 {
        self.ns as f64 * 1e-9
    }

    /// Seconds since an earlier stamp (negative if it is later).
    pub fn since_s(self, earlier: Stamp) -> f64 {
        (i128::from(self.ns) - i128::from(earlier.ns)) as f64 * 1e-9
    }
}

/// One camera's picture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frame {
    /// The camera's name in the vehicle's description: `center`, `left`, `right`.
    pub camera: String,
    /// When it was exposed.
    pub stamp: Stamp,
    /// The decoded picture.
    pub image: Image,
    /// The bytes as the sensor delivered them, if it delivered them compressed. Recordings keep these.
    pub encoded: Option<Encoded>,
}

/// What the wheels' sensors say.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Wheels {
    /// Encoder ticks of the left wheel since the run began. Counts as the sensor does: on a GoPiGo up only.
    pub left_ticks: i64,
    /// Encoder ticks of the right wheel since the run began.
    pub right_ticks: i64,
}

/// Everything a vehicle senses at one moment. The true state is not in it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Observation {
    /// When the observation was made.
    pub stamp: Stamp,
    /// Pictures, in the order of the vehicle's description. May be empty (a camera that missed a frame).
    pub frames: Vec<Frame>,
    /// Measured forward speed (m/s), where the vehicle measures it.
    pub speed_mps: Option<f64>,
    /// Wheel encoders, where there are any.
    pub wheels: Option<Wheels>,
    /// Battery voltage (V), where it is measured.
    pub battery_v: Option<f64>,
}

impl Observation {
    /// The frame of a camera by name.
    pub fn frame(&self, camera: &str) -> Option<&Frame> {
        self.frames.iter().find(|frame| frame.camera == camera)
    }

    /// The first frame: the centre camera on vehicles with several.
    pub fn first_frame(&self) -> Option<&Frame> {
        self.frames.first()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_and_nanoseconds_agree() {
        assert_eq!(Stamp::from_s(0.05), Stamp::from_ns(50_000_000));
        assert_eq!(Stamp::from_s(-1.0), Stamp::from_ns(0));
        assert_eq!(Stamp::from_s(f64::NAN), Stamp::from_ns(0));
        assert!((Stamp::from_ns(1_500_000_000).as_s() - 1.5).abs() < 1e-12);
    }

    /// Stamps from damaged recordings lie anywhere in u64; their difference overflowed i64.
    #[test]
    fn differences_are_signed_and_never_overflow() {
        let (early, late) = (Stamp::from_ns(10), Stamp::from_ns(u64::MAX / 2 + 10));
        assert!(early.since_s(late) < -9e9 && late.since_s(early) > 9e9);
        assert!(Stamp::from_ns(u64::MAX).since_s(Stamp::from_ns(0)) > 1.8e10);
    }

    #[test]
    fn frames_are_found_by_name() {
        let frame = |camera: &str| Frame {
            camera: camera.into(),
            ..Frame::default()
        };
        let observation = Observation {
            frames: vec![frame("center"), frame("left")],
            ..Observation::default()
        };
        assert_eq!(observation.frame("left"), Some(&observation.frames[1]));
        assert_eq!(observation.first_frame(), Some(&observation.frames[0]));
        assert_eq!(observation.frame("right"), None);
    }
}
