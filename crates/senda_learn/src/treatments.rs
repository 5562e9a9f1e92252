//! Treatments of frames that change no answer: what other cameras, floors and halls put into a picture.

use rand::{Rng, RngExt};

/// Most soft spots that fall over one frame.
const MOST_SPOTS: u32 = 5;
/// Most rectangles that cover parts of one frame.
const MOST_PATCHES: u32 = 4;

/// Soft bright spots, higher than wide: lamps mirrored in a polished floor. All channels get almost the same.
pub(crate) fn glare([channels, height, width]: [usize; 3], pixels: &mut [u8], rng: &mut impl Rng) {
    let plane = height * width;
    for _ in 0..rng.random_range(1..=MOST_SPOTS) {
        let centre = [
            rng.random_range(0.0..width as f64),
            rng.random_range(-0.2..1.0) * height as f64,
        ];
        let radius = [
            rng.random_range(0.02..0.12) * width as f64,
            rng.random_range(0.08..0.5) * height as f64,
        ];
        let strength = rng.random_range(20.0..150.0);
        for channel in pixels.chunks_exact_mut(plane).take(channels) {
            let strength = strength * rng.random_range(0.85..=1.0);
            for (v, row) in channel.chunks_exact_mut(width).enumerate() {
                let away_v = (v as f64 - centre[1]) / radius[1];
                if away_v.abs() >= 1.0 {
                    continue;
                }
                for (u, byte) in row.iter_mut().enumerate() {
                    let away_u = (u as f64 - centre[0]) / radius[0];
                    let near = 1.0 - away_u * away_u - away_v * away_v;
                    if near > 0.0 {
                        *byte = (f64::from(*byte) + strength * near * near).min(255.0) as u8;
                    }
                }
            }
        }
    }
}

/// Rectangles of any colour: things that stand about and that no world had.
pub(crate) fn patches([channels, height, width]: [usize; 3], pixels: &mut [u8], rng: &mut impl Rng) {
    let plane = height * width;
    for _ in 0..rng.random_range(1..=MOST_PATCHES) {
        let mut span = |whole: usize, longest: f64| {
            let half = 0.5 * rng.random_range(0.02..longest) * whole as f64;
            let middle = rng.random_range(0.0..whole as f64);
            ((middle - half).max(0.0) as usize)..((middle + half).ceil() as usize).min(whole)
        };
        let (columns, rows) = (span(width, 0.2), span(height, 0.4));
        for channel in pixels.chunks_exact_mut(plane).take(channels) {
            let colour: u8 = rng.random_range(0..=255);
            for row in channel.chunks_exact_mut(width).take(rows.end).skip(rows.start) {
                row[columns.clone()].fill(colour);
            }
        }
    }
}

/// A mean over three neighbours along rows, columns or both: movement, and lenses that are not sharp.
pub(crate) fn blur([channels, height, width]: [usize; 3], pixels: &mut [u8], rng: &mut impl Rng) {
    let (along_rows, along_columns) = match rng.random_range(0..3) {
        0 => (true, false),
        1 => (false, true),
        _ => (true, true),
    };
    let mean = |before: u8, here: u8, after: u8| {
        ((u16::from(before) + 2 * u16::from(here) + u16::from(after) + 2) / 4) as u8
    };
    for channel in pixels.chunks_exact_mut(height * width).take(channels) {
        if along_rows {
            for row in channel.chunks_exact_mut(width) {
                let mut before = row[0];
                for u in 0..width {
                    let here = row[u];
                    row[u] = mean(before, here, row[(u + 1).min(width - 1)]);
                    before = here;
                }
            }
        }
        if along_columns {
            for u in 0..width {
                let mut before = channel[u];
                for v in 0..height {
                    let here = channel[v * width + u];
                    channel[v * width + u] = mean(before, here, channel[(v + 1).min(height - 1) * width + u]);
                    before = here;
                }
            }
        }
    }
}

/// Adds to every byte a number whose standard deviation is this many grey levels: the sum of four even ones.
pub(crate) fn noise(deviation: f64, pixels: &mut [u8], rng: &mut impl Rng) {
    // Four bytes' sum has a standard deviation of 2 · 73.9.
    let scale = deviation / 147.8;
    for byte in pixels {
        let sum: u32 = rng.random::<[u8; 4]>().iter().map(|part| u32::from(*part)).sum();
        let changed = f64::from(*byte) + scale * (f64::from(sum) - 510.0);
        *byte = changed.round().clamp(0.0, 255.0) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const SHAPE: [usize; 3] = [3, 20, 30];

    fn grey() -> Vec<u8> {
        vec![100; SHAPE.iter().product()]
    }

    #[test]
    fn glare_only_adds_light_and_leaves_most_of_the_frame() {
        for seed in 0..30 {
            let mut pixels = grey();
            glare(SHAPE, &mut pixels, &mut ChaCha8Rng::seed_from_u64(seed));
            assert!(pixels.iter().all(|byte| *byte >= 100), "seed {seed}");
            let lit = pixels.iter().filter(|byte| **byte > 101).count();
            assert!(lit * 10 < 8 * pixels.len(), "seed {seed}: {lit}");
        }
    }

    #[test]
    fn patches_cover_the_same_place_in_all_channels_and_little_of_it() {
        for seed in 0..30 {
            let mut pixels = grey();
            patches(SHAPE, &mut pixels, &mut ChaCha8Rng::seed_from_u64(seed));
            let covered = |channel: usize| -> Vec<bool> {
                pixels[channel * 600..(channel + 1) * 600]
                    .iter()
                    .map(|byte| *byte != 100)
                    .collect()
            };
            // A patch may have the floor's own value in one channel; two never have it in this many seeds.
            let places: Vec<usize> = (0..3)
                .map(|c| covered(c).iter().filter(|is| **is).count())
                .collect();
            assert!(places.iter().all(|count| *count < 300), "seed {seed}: {places:?}");
            assert!(places[0].max(places[1]) > 0, "seed {seed}: {places:?}");
        }
    }

    #[test]
    fn blur_keeps_an_even_frame_and_spreads_a_point() {
        let mut pixels = grey();
        blur(SHAPE, &mut pixels, &mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(pixels, grey());
        for seed in 0..6 {
            let mut point = vec![0; SHAPE.iter().product()];
            point[10 * 30 + 15] = 200;
            blur(SHAPE, &mut point, &mut ChaCha8Rng::seed_from_u64(seed));
            let touched = point.iter().filter(|byte| **byte > 0).count();
            assert!([3, 9].contains(&touched), "seed {seed}: {touched}");
            assert!((50..=100).contains(&point[10 * 30 + 15]), "seed {seed}");
        }
    }

    #[test]
    fn noise_has_the_deviation_that_was_asked_for() {
        let mut pixels = grey();
        noise(8.0, &mut pixels, &mut ChaCha8Rng::seed_from_u64(1));
        let n = pixels.len() as f64;
        let mean = pixels.iter().map(|byte| f64::from(*byte)).sum::<f64>() / n;
        let variance = pixels
            .iter()
            .map(|byte| f64::from(*byte) - mean)
            .map(|off| off * off)
            .sum::<f64>()
            / n;
        assert!((mean - 100.0).abs() < 0.8, "{mean}");
        assert!((variance.sqrt() - 8.0).abs() < 0.6, "{}", variance.sqrt());
    }
}
