//! Hue, saturation and value, and masks of a range of them (A4 and D2 in SPEC).

use crate::simd::{Kernel, Level};

/// Hue, saturation and value of an sRGB pixel in OpenCV's ranges: hue 0..180 (2° a step, red at 0), saturation and
/// value 0..=255. Grey pixels have hue 0 and saturation 0.
pub fn hsv(rgb: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = rgb.map(i32::from);
    let value = r.max(g).max(b);
    let chroma = value - r.min(g).min(b);
    if chroma == 0 {
        return [0, 0, value as u8];
    }
    // Sixths of a turn: 0 red, 2 green, 4 blue, in steps of 30.
    let (part, base) = if value == r {
        (g - b, 0)
    } else if value == g {
        (b - r, 60)
    } else {
        (r - g, 120)
    };
    // Rounded to nearest: half of the divisor is added, on the side that the sign asks for.
    let hue = base + (60 * part + chroma * part.signum()) / (2 * chroma);
    let saturation = (510 * chroma + value) / (2 * value);
    [hue.rem_euclid(180) as u8, saturation as u8, value as u8]
}

/// A box in hue, saturation and value, limits included. A hue range that ends before it begins goes round through
/// red: 170..=10 is red.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HsvRange {
    /// Lowest hue, saturation and value.
    pub low: [u8; 3],
    /// Highest hue, saturation and value.
    pub high: [u8; 3],
}

impl HsvRange {
    /// Whether a pixel's colour is inside.
    #[inline(always)]
    pub fn contains(&self, [hue, saturation, value]: [u8; 3]) -> bool {
        let (from, to) = (self.low[0], self.high[0]);
        let hue_fits = if from <= to {
            (from..=to).contains(&hue)
        } else {
            hue >= from || hue <= to
        };
        hue_fits
            && (self.low[1]..=self.high[1]).contains(&saturation)
            && (self.low[2]..=self.high[2]).contains(&value)
    }

    /// Writes 255 where an RGB pixel is inside and 0 elsewhere.
    ///
    /// # Panics
    /// When `mask` has not one byte for every three of `rgb`.
    pub fn mask(&self, rgb: &[u8], mask: &mut [u8]) {
        assert_eq!(rgb.len(), 3 * mask.len());
        Level::detect().run(Mask {
            range: *self,
            rgb,
            mask,
        });
    }
}

struct Mask<'a> {
    range: HsvRange,
    rgb: &'a [u8],
    mask: &'a mut [u8],
}

impl Kernel for Mask<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (to, pixel) in self.mask.iter_mut().zip(self.rgb.as_chunks::<3>().0) {
            *to = if self.range.contains(hsv(*pixel)) { 255 } else { 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn named_colours_have_opencvs_numbers() {
        for (rgb, expected) in [
            ([255, 0, 0], [0, 255, 255]),
            ([255, 255, 0], [30, 255, 255]),
            ([0, 255, 0], [60, 255, 255]),
            ([0, 255, 255], [90, 255, 255]),
            ([0, 0, 255], [120, 255, 255]),
            ([255, 0, 255], [150, 255, 255]),
            ([0, 0, 0], [0, 0, 0]),
            ([77, 77, 77], [0, 0, 77]),
            ([128, 64, 64], [0, 128, 128]),
        ] {
            assert_eq!(hsv(rgb), expected, "{rgb:?}");
        }
    }

    proptest! {
        #[test]
        fn within_one_step_of_the_formula(r: u8, g: u8, b: u8) {
            let [hue, saturation, value] = hsv([r, g, b]).map(f64::from);
            let (r, g, b) = (f64::from(r), f64::from(g), f64::from(b));
            let max = r.max(g).max(b);
            let chroma = max - r.min(g).min(b);
            prop_assert_eq!(value, max);
            if chroma > 0.0 {
                let exact = if max == r {
                    30.0 * (g - b) / chroma
                } else if max == g {
                    60.0 + 30.0 * (b - r) / chroma
                } else {
                    120.0 + 30.0 * (r - g) / chroma
                };
                let off = (hue - exact).rem_euclid(180.0);
                prop_assert!(off.min(180.0 - off) <= 0.5 + 1e-9, "{hue} {exact}");
                prop_assert!((saturation - 255.0 * chroma / max).abs() <= 0.5 + 1e-9);
                prop_assert!(hue < 180.0);
            }
        }
    }

    #[test]
    fn masks_take_the_pink_of_the_tape_and_wrap_round_red() {
        // A4's limits: 150..180, 50..255, 120..255.
        let pink = HsvRange {
            low: [150, 50, 120],
            high: [180, 255, 255],
        };
        let red = HsvRange {
            low: [170, 50, 50],
            high: [10, 255, 255],
        };
        let pixels = [230, 60, 150, 140, 140, 140, 220, 20, 30, 40, 200, 60];
        let mut mask = [7; 4];
        pink.mask(&pixels, &mut mask);
        assert_eq!(mask, [255, 0, 255, 0]);
        red.mask(&pixels, &mut mask);
        assert_eq!(mask, [0, 0, 255, 0]);
    }
}
