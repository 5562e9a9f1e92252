//! From colour pixels to the grey picture in which lines are sought.

use crate::Channel;
use crate::simd::{Kernel, Level};
use senda_core::Channels;

/// A [`Channel`] made ready for pixels: integer weights.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Grey {
    Luminance,
    Chroma,
    /// Weights with 7 fraction bits, and the offset.
    Projection([i16; 3], i32),
}

impl Grey {
    pub(crate) fn new(channel: Channel) -> Self {
        match channel {
            Channel::Luminance => Self::Luminance,
            Channel::Chroma => Self::Chroma,
            Channel::Projection {
                red,
                green,
                blue,
                offset,
            } => {
                let fixed = |weight: f64| (weight.clamp(-1.0, 1.0) * 128.0).round() as i16;
                // Rounds to the nearest: half a grey level is 64.
                let offset = (offset.clamp(-1000.0, 1000.0) * 128.0).round() as i32 + 64;
                Self::Projection([fixed(red), fixed(green), fixed(blue)], offset)
            }
        }
    }

    /// The grey value of one pixel of one or three bytes.
    pub(crate) fn of_pixel(self, pixel: &[u8]) -> u8 {
        match pixel {
            [r, g, b] => self.of_rgb(*r, *g, *b),
            _ => pixel[0],
        }
    }

    #[inline(always)]
    fn of_rgb(self, r: u8, g: u8, b: u8) -> u8 {
        match self {
            Self::Luminance => {
                ((77 * u16::from(r) + 150 * u16::from(g) + 29 * u16::from(b) + 128) >> 8) as u8
            }
            Self::Chroma => r.max(g).max(b) - r.min(g).min(b),
            Self::Projection([red, green, blue], offset) => {
                let sum = i32::from(red) * i32::from(r)
                    + i32::from(green) * i32::from(g)
                    + i32::from(blue) * i32::from(b);
                ((sum + offset) >> 7).clamp(0, 255) as u8
            }
        }
    }

    /// Fills `target` (one byte a pixel). Gray pixels are taken as they are, whatever the channel.
    pub(crate) fn convert(self, channels: Channels, pixels: &[u8], target: &mut [u8], level: Level) {
        match channels {
            Channels::Gray => target.copy_from_slice(pixels),
            Channels::Rgb => level.run(Convert {
                grey: self,
                pixels,
                target,
            }),
        }
    }
}

/// Luminance of RGB pixels: 0.299 R + 0.587 G + 0.114 B with weights of 8 fraction bits (77, 150, 29), so within one
/// grey level of the exact sum (C3 in SPEC).
///
/// # Panics
/// When `target` has not one byte for every three of `rgb`.
pub fn luminance(rgb: &[u8], target: &mut [u8]) {
    assert_eq!(rgb.len(), 3 * target.len());
    Level::detect().run(Convert {
        grey: Grey::Luminance,
        pixels: rgb,
        target,
    });
}

struct Convert<'a> {
    grey: Grey,
    pixels: &'a [u8],
    target: &'a mut [u8],
}

impl Kernel for Convert<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        // The kind is settled outside the loops, so that each becomes straight vector code.
        match self.grey {
            Grey::Luminance => convert(Grey::Luminance, self.pixels, self.target),
            Grey::Chroma => convert(Grey::Chroma, self.pixels, self.target),
            Grey::Projection(weights, offset) => {
                convert(Grey::Projection(weights, offset), self.pixels, self.target);
            }
        }
    }
}

#[inline(always)]
fn convert(grey: Grey, pixels: &[u8], target: &mut [u8]) {
    for (to, pixel) in target.iter_mut().zip(pixels.as_chunks::<3>().0) {
        // Byte by byte: three bytes copied at once would be put together from pieces.
        *to = grey.of_rgb(pixel[0], pixel[1], pixel[2]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grey_of(channel: Channel, rgb: [u8; 3]) -> u8 {
        // Wide enough for the vector code to take part.
        let pixels = rgb.repeat(67);
        let mut target = vec![0; 67];
        Grey::new(channel).convert(Channels::Rgb, &pixels, &mut target, Level::detect());
        assert!(target.iter().all(|value| *value == target[0]));
        assert_eq!(target[0], Grey::new(channel).of_pixel(&rgb));
        target[0]
    }

    proptest! {
        #[test]
        fn luminance_is_within_one_level(r: u8, g: u8, b: u8) {
            let exact = 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
            prop_assert!((f64::from(grey_of(Channel::Luminance, [r, g, b])) - exact).abs() < 1.0);
        }

        #[test]
        fn projections_are_within_three_levels(r: u8, g: u8, b: u8, red in -1.0..1.0f64, green in -1.0..1.0f64) {
            let channel = Channel::Projection { red, green, blue: -0.5, offset: 128.0 };
            let exact = 128.0 + red * f64::from(r) + green * f64::from(g) - 0.5 * f64::from(b);
            let exact = exact.clamp(0.0, 255.0);
            prop_assert!((f64::from(grey_of(channel, [r, g, b])) - exact).abs() < 2.6);
        }
    }

    #[test]
    fn grey_pixels_keep_their_value() {
        for grey in 0..=255 {
            assert_eq!(grey_of(Channel::Luminance, [grey; 3]), grey);
            assert_eq!(grey_of(Channel::Chroma, [grey; 3]), 0);
        }
        assert_eq!(grey_of(Channel::Chroma, [10, 200, 90]), 190);
    }
}
