//! Random numbers: one independent stream for every source, so that adding a camera does not change wheel noise.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use senda_geom::trig;
use std::f64::consts::PI;

/// What random numbers are for. The numbers are part of the results: do not change them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// Lasting errors, drawn once a run.
    Build,
    /// Noise of the wheels.
    Wheels,
    /// Measurements of the battery.
    Battery,
    /// Pushes.
    Pushes,
    /// Frames and mounting of camera n.
    Camera(u64),
    /// Lost frames of camera n.
    Losses(u64),
}

/// A stream of one source.
#[derive(Debug, Clone)]
pub(crate) struct Random(ChaCha8Rng);

impl Random {
    pub(crate) fn new(seed: u64, source: Source) -> Self {
        let stream = match source {
            Source::Build => 1,
            Source::Wheels => 2,
            Source::Battery => 3,
            Source::Pushes => 4,
            Source::Camera(index) => 16 + index,
            Source::Losses(index) => 32 + index,
        };
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream);
        Self(generator)
    }

    /// Any 64 bits.
    pub(crate) fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform in 0..1.
    pub(crate) fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Normal with mean 0 and standard deviation 1 (Box & Muller 1958), cut off at ±4.
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * trig::log(1.0 - self.uniform())).sqrt();
        (radius * trig::cos(2.0 * PI * self.uniform())).clamp(-4.0, 4.0)
    }
}
