//! Changes to training frames that make a network see more than was recorded, with the change of the answer that each
//! needs. All are options; the recordings stay as they are.

use crate::treatments::{blur, glare, noise, patches};
use rand::{Rng, RngExt};
use senda_drivers::Answer;
use serde::{Deserialize, Serialize};

/// What is changed, and how much. Zero switches a treatment off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Augmentation {
    /// Part of the frames that are mirrored; steering is negated with them (A9, B5 in SPEC: every frame both ways is 0.5).
    pub mirror: f64,
    /// Brightness: a factor between 1 - x and 1 + x for the whole frame.
    pub brightness: f64,
    /// Contrast around the frame's mean: a factor between 1 - x and 1 + x.
    pub contrast: f64,
    /// Colour: a factor between 1 - x and 1 + x for each channel.
    pub colour: f64,
    /// Part of the frames over which a shadow with a straight edge falls.
    pub shadow: f64,
    /// Part of the frames over which soft bright spots fall, as lamps are mirrored in a floor.
    pub glare: f64,
    /// Part of the frames that rectangles of any colour cover a little, as things stand about.
    pub patches: f64,
    /// Part of the frames that are blurred a little.
    pub blur: f64,
    /// Standard deviation of noise in every pixel (grey levels).
    pub noise: f64,
    /// Largest sideways shift (part of the width); the answer changes by [`Augmentation::steering_per_shift`].
    pub shift: f64,
    /// Change of the steering output for a shift by the whole width. A road seen further left needs steering to the left.
    pub steering_per_shift: f64,
}

impl Default for Augmentation {
    /// Mirrored and photometric: nothing that changes the answer except its sign.
    fn default() -> Self {
        Self {
            mirror: 0.5,
            brightness: 0.25,
            contrast: 0.25,
            colour: 0.12,
            shadow: 0.15,
            glare: 0.0,
            patches: 0.0,
            blur: 0.0,
            noise: 0.0,
            shift: 0.0,
            steering_per_shift: 0.0,
        }
    }
}

impl Augmentation {
    /// Mirroring only, as in A9.
    pub const MIRROR: Self = Self {
        mirror: 0.5,
        brightness: 0.0,
        contrast: 0.0,
        colour: 0.0,
        shadow: 0.0,
        glare: 0.0,
        patches: 0.0,
        blur: 0.0,
        noise: 0.0,
        shift: 0.0,
        steering_per_shift: 0.0,
    };

    /// Frames as they are.
    pub const NONE: Self = Self {
        mirror: 0.0,
        ..Self::MIRROR
    };

    /// The first key out of its range, with the range.
    pub fn fault(&self) -> Option<(&'static str, &'static str, f64)> {
        [
            ("mirror", self.mirror, 1.0, "0 to 1"),
            ("brightness", self.brightness, 0.9, "0 to 0.9"),
            ("contrast", self.contrast, 0.9, "0 to 0.9"),
            ("colour", self.colour, 0.9, "0 to 0.9"),
            ("shadow", self.shadow, 1.0, "0 to 1"),
            ("glare", self.glare, 1.0, "0 to 1"),
            ("patches", self.patches, 1.0, "0 to 1"),
            ("blur", self.blur, 1.0, "0 to 1"),
            ("noise", self.noise, 100.0, "0 to 100"),
            ("shift", self.shift, 0.3, "0 to 0.3"),
            (
                "steering_per_shift",
                self.steering_per_shift.abs(),
                100.0,
                "-100 to 100",
            ),
        ]
        .into_iter()
        .find(|(_, value, limit, _)| !(0.0..=*limit).contains(value))
        .map(|(key, value, _, range)| (key, range, value))
    }
}

/// Which outputs change with the picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answers {
    /// For each output: whether it is a turn, negated by mirroring.
    pub is_turn: Vec<bool>,
}

impl Answers {
    /// Of a network that gives these answers.
    pub fn of(answers: &[Answer]) -> Self {
        Self {
            is_turn: answers.iter().map(|answer| answer.is_turn()).collect(),
        }
    }
}

/// Changes a frame (`channels` planes of `height` rows of `width` bytes) and its targets in place. `scratch` is reused.
pub fn augment<R: Rng>(
    options: &Augmentation,
    [channels, height, width]: [usize; 3],
    pixels: &mut [u8],
    targets: &mut [f32],
    answers: &Answers,
    rng: &mut R,
) {
    if rng.random_bool(options.mirror) {
        mirror(width, pixels);
        for (target, is_turn) in targets.iter_mut().zip(&answers.is_turn) {
            if *is_turn {
                *target = -*target;
            }
        }
    }
    if options.shift > 0.0 {
        let part = rng.random_range(-options.shift..=options.shift);
        let by_px = (part * width as f64).round() as isize;
        shift(width, pixels, by_px);
        for (target, is_turn) in targets.iter_mut().zip(&answers.is_turn) {
            if *is_turn {
                // Seen further right (u grows), the road is further right: steer right, which is negative.
                *target -= (options.steering_per_shift * by_px as f64 / width as f64) as f32;
            }
        }
    }
    let mut factor = |by: f64| {
        if by > 0.0 {
            rng.random_range(1.0 - by..=1.0 + by)
        } else {
            1.0
        }
    };
    let brightness = factor(options.brightness);
    let contrast = factor(options.contrast);
    let plane = height * width;
    for channel in pixels.chunks_exact_mut(plane).take(channels) {
        let gain = brightness * factor(options.colour);
        let mean = channel.iter().map(|byte| f64::from(*byte)).sum::<f64>() / plane as f64;
        let mut table = [0u8; 256];
        for (value, entry) in table.iter_mut().enumerate() {
            *entry = (gain * (mean + contrast * (value as f64 - mean)))
                .round()
                .clamp(0.0, 255.0) as u8;
        }
        for byte in channel {
            *byte = table[usize::from(*byte)];
        }
    }
    let shape = [channels, height, width];
    if rng.random_bool(options.shadow) {
        shadow(shape, pixels, rng);
    }
    // Nothing is drawn for what is switched off: older experiments keep their frames.
    let mut falls = |part: f64, treatment: fn([usize; 3], &mut [u8], &mut R)| {
        if part > 0.0 && rng.random_bool(part) {
            treatment(shape, pixels, rng);
        }
    };
    falls(options.glare, glare);
    falls(options.patches, patches);
    falls(options.blur, blur);
    if options.noise > 0.0 {
        noise(options.noise, pixels, rng);
    }
}

fn mirror(width: usize, pixels: &mut [u8]) {
    for row in pixels.chunks_exact_mut(width) {
        row.reverse();
    }
}

/// Moves every row by `by_px` to the right; what comes in repeats the border.
fn shift(width: usize, pixels: &mut [u8], by_px: isize) {
    let by = by_px.unsigned_abs().min(width);
    for row in pixels.chunks_exact_mut(width) {
        if by_px > 0 {
            row.copy_within(..width - by, by);
            let border = row[by.min(width - 1)];
            row[..by].fill(border);
        } else {
            row.copy_within(by.., 0);
            let border = row[width - by.min(width - 1) - 1];
            row[width - by..].fill(border);
        }
    }
}

/// One side of a straight line through the picture gets darker, all channels alike.
fn shadow([channels, height, width]: [usize; 3], pixels: &mut [u8], rng: &mut impl Rng) {
    let light = rng.random_range(0.5..0.85);
    let through = [
        rng.random_range(0.0..width as f64),
        rng.random_range(0.0..height as f64),
    ];
    // Any direction without trigonometry: a point of the square around the origin.
    let normal = [rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)];
    for plane in pixels.chunks_exact_mut(height * width).take(channels) {
        for (v, row) in plane.chunks_exact_mut(width).enumerate() {
            for (u, byte) in row.iter_mut().enumerate() {
                if normal[0] * (u as f64 - through[0]) + normal[1] * (v as f64 - through[1]) > 0.0 {
                    *byte = (f64::from(*byte) * light) as u8;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn turns(outputs: &[bool]) -> Answers {
        Answers {
            is_turn: outputs.to_vec(),
        }
    }

    #[test]
    fn mirroring_negates_turns_and_keeps_the_rest() {
        let mut pixels = [1, 2, 3, 4, 5, 6];
        let mut targets = [0.5, 0.7];
        let always = Augmentation {
            mirror: 1.0,
            ..Augmentation::NONE
        };
        augment(
            &always,
            [1, 2, 3],
            &mut pixels,
            &mut targets,
            &turns(&[true, false]),
            &mut ChaCha8Rng::seed_from_u64(1),
        );
        assert_eq!((pixels, targets), ([3, 2, 1, 6, 5, 4], [-0.5, 0.7]));
    }

    #[test]
    fn shifting_to_the_right_steers_to_the_right() {
        let mut pixels = [1, 2, 3, 4];
        shift(4, &mut pixels, 1);
        assert_eq!(pixels, [1, 1, 2, 3]);
        shift(4, &mut pixels, -2);
        assert_eq!(pixels, [2, 3, 3, 3]);
        shift(4, &mut pixels, 40);
        shift(4, &mut pixels, -40);
        let options = Augmentation {
            shift: 0.25,
            steering_per_shift: 2.0,
            ..Augmentation::NONE
        };
        for seed in 0..20 {
            let mut pixels = [0, 0, 0, 0, 255, 0, 0, 0];
            let mut targets = [0.0];
            augment(
                &options,
                [1, 1, 8],
                &mut pixels,
                &mut targets,
                &turns(&[true]),
                &mut ChaCha8Rng::seed_from_u64(seed),
            );
            let at = pixels.iter().position(|byte| *byte == 255).unwrap() as f32;
            assert_eq!(targets[0], -2.0 * (at - 4.0) / 8.0);
        }
    }

    #[test]
    fn nothing_is_nothing_and_the_same_seed_does_the_same() {
        let original: Vec<u8> = (0..60).collect();
        let run = |options: &Augmentation, seed: u64| {
            let mut pixels = original.clone();
            let mut targets = [0.25];
            augment(
                options,
                [3, 4, 5],
                &mut pixels,
                &mut targets,
                &turns(&[true]),
                &mut ChaCha8Rng::seed_from_u64(seed),
            );
            (pixels, targets)
        };
        assert_eq!(run(&Augmentation::NONE, 3), (original.clone(), [0.25]));
        let all = Augmentation {
            shift: 0.2,
            shadow: 1.0,
            ..Augmentation::default()
        };
        assert_eq!(run(&all, 3), run(&all, 3));
        assert_ne!(run(&all, 3), run(&all, 4));
    }

    /// Frames of one sequence are changed alike by giving them the same random numbers: no picture may ask for more of them.
    #[test]
    fn how_many_numbers_are_drawn_depends_on_no_picture() {
        let all = Augmentation {
            shift: 0.2,
            shadow: 0.5,
            glare: 0.5,
            patches: 0.5,
            blur: 0.5,
            noise: 4.0,
            ..Augmentation::default()
        };
        for seed in 0..40 {
            let next = |fill: u8, target: f32| {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                let mut pixels = [fill; 60];
                pixels[7] = 90;
                augment(
                    &all,
                    [3, 4, 5],
                    &mut pixels,
                    &mut [target],
                    &turns(&[true]),
                    &mut rng,
                );
                rng.random::<u64>()
            };
            assert_eq!(next(0, 0.5), next(255, 0.0));
        }
    }

    #[test]
    fn ranges_are_checked() {
        assert_eq!(Augmentation::default().fault(), None);
        let wrong = Augmentation {
            mirror: f64::NAN,
            ..Augmentation::default()
        };
        assert_eq!(wrong.fault().unwrap().0, "mirror");
    }
}
