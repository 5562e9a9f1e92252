//! Random numbers for made-up worlds.

use crate::colour::Colour;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Random numbers whose values do not depend on the version of a library.
pub(crate) struct Dice(ChaCha8Rng);

impl Dice {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Uniform in [0, 1).
    pub(crate) fn part(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.part()
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.part() < probability
    }

    /// Uniform in 0..count.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        ((self.part() * count as f64) as usize).min(count.saturating_sub(1))
    }

    pub(crate) fn seed(&mut self) -> u64 {
        self.0.next_u64() >> 32
    }

    pub(crate) fn vary(&mut self, colour: Colour, by: f64) -> Colour {
        let shift = self.between([-by, by]);
        let mut channel = |value: u8| {
            let value = f64::from(value) + shift + self.between([-by * 0.4, by * 0.4]);
            value.round().clamp(8.0, 247.0) as u8
        };
        let [r, g, b] = colour.rgb;
        Colour::new(channel(r), channel(g), channel(b))
    }
}
