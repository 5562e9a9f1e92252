//! A simulated vehicle.

pub mod render;
