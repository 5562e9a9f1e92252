//! Devices: gamepads and steering wheels that a person drives with, and the thread that turns motors.
//!
//! ```
//! use senda_hw::gamepad::{Axis, Layout, Motion, Raw};
//! // A stick from 0 to 255, a trigger that rests at 0.
//! let layout = Layout::new(Axis { low: 0, high: 255, rest: 128 }, Some((5, Axis { low: 0, high: 255, rest: 0 })));
//! // Full left: the kernel counts to the right, we to the left.
//! assert_eq!(layout.motion(Raw { kind: Raw::AXIS, code: 0, value: 0 }), Some(Motion::Steering(1.0)));
//! assert_eq!(layout.motion(Raw { kind: Raw::AXIS, code: 5, value: 255 }), Some(Motion::Pedal(1.0)));
//! ```
//!
//! This crate does not know drivers, the loop, recordings, or what a movement means for a vehicle.

pub mod gamepad;
pub mod motors;

pub use gamepad::{Gamepad, GamepadError, Motion};
