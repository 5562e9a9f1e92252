//! Green and red by limits that follow the light (D2, D3 and D4 in SPEC).

use crate::HsvRange;
use senda_core::{Channels, Image};

/// Limits of green and red for one light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// The line.
    pub green: HsvRange,
    /// The crossings.
    pub red: HsvRange,
}

impl Default for Limits {
    fn default() -> Self {
        ColourLimits::default().for_light(0.5)
    }
}

/// How limits follow the light: D3's linear map from the mean lightness of bright pixels to the lowest saturation.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ColourLimits {
    /// Hues of green, in OpenCV's half degrees.
    pub green_hue: [u8; 2],
    /// Hues of red: from the first round through 0 to the second.
    pub red_hue: [u8; 2],
    /// Lowest saturation (0 ..= 255) in the darkest light (lightness 0).
    pub saturation_dark: f64,
    /// … and in the brightest (lightness 1).
    pub saturation_bright: f64,
    /// Lowest value (0 ..= 255): darker pixels have no hue worth the name.
    pub value_low: u8,
}

impl Default for ColourLimits {
    /// Measured on the worlds for tuning: bright light washes colours out, noise of dark light gives grey a colour.
    fn default() -> Self {
        Self {
            green_hue: [40, 96],
            red_hue: [168, 9],
            saturation_dark: 105.0,
            saturation_bright: 70.0,
            value_low: 32,
        }
    }
}

impl ColourLimits {
    /// The limits for a lightness 0 ..= 1 (D3).
    pub fn for_light(&self, lightness: f64) -> Limits {
        let part = lightness.clamp(0.0, 1.0);
        let saturation = self.saturation_dark + (self.saturation_bright - self.saturation_dark) * part;
        let least = saturation.round().clamp(0.0, 255.0) as u8;
        let range = |[from, to]: [u8; 2], extra: u8| HsvRange {
            low: [from, least.saturating_add(extra), self.value_low],
            high: [to, 255, 255],
        };
        Limits {
            green: range(self.green_hue, 0),
            // Paper and skin are reddish too; the crossing's red is deep.
            red: range(self.red_hue, 25),
        }
    }
}

/// Shrinks by a whole factor, each pixel the mean of `factor` x `factor`: the low-pass filter before the mask.
pub fn shrink(image: &Image, factor: usize, small: &mut Image) {
    if factor <= 1 {
        small.copy_from(image);
        return;
    }
    let (width, height) = (image.width() / factor, image.height() / factor);
    small.reshape(width, height, Channels::Rgb);
    let share = (factor * factor) as u32;
    for v in 0..height {
        let out = small.row_mut(v);
        for (u, out) in out.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let mut sum = [share / 2; 3];
            for dv in 0..factor {
                let row = &image.row(v * factor + dv)[3 * u * factor..3 * (u + 1) * factor];
                for pixel in row.as_chunks::<3>().0 {
                    for (sum, value) in sum.iter_mut().zip(pixel) {
                        *sum += u32::from(*value);
                    }
                }
            }
            *out = sum.map(|sum| (sum / share) as u8);
        }
    }
}

/// Mean lightness (HLS, 0 ..= 1) of the brighter pixels of the image's lower two thirds (D3): pixels above a fixed
/// brightness, as the document masks the background away; of all when hardly any is that bright.
pub fn lightness(image: &Image) -> f64 {
    /// Guess: document D gives no number.
    const BRIGHT: u8 = 60;
    let (mut bright, mut all) = ((0u64, 0u64), (0u64, 0u64));
    for v in (image.height() / 3..image.height()).step_by(2) {
        for pixel in image.row(v).as_chunks::<3>().0.iter().step_by(2) {
            let (high, low) = pixel
                .iter()
                .fold((0u8, 255u8), |(high, low), c| (high.max(*c), low.min(*c)));
            let lightness = u64::from(high) + u64::from(low);
            all = (all.0 + lightness, all.1 + 1);
            if high > BRIGHT {
                bright = (bright.0 + lightness, bright.1 + 1);
            }
        }
    }
    let (sum, count) = if bright.1 * 20 > all.1 { bright } else { all };
    sum as f64 / (count.max(1) * 510) as f64
}
