//! The picture as luminance, with a smaller copy to search in.

use super::CalibrationError;
use senda_core::{Channels, Image};
use senda_geom::Vec2;

/// Smallest picture in which the squares of a sheet still have edges to fit (px): a little below the document's 123x92.
const SMALLEST: (usize, usize) = (96, 72);
/// Widest picture to search in (px); larger photographs are searched in a copy shrunk by a whole factor.
const WIDEST_SEARCH: usize = 640;
/// Narrowest picture to smooth before searching (px).
const LEAST_SMOOTHED: usize = 200;
/// Brightness that white paper must reach at least: sensor noise and JPEG leave nothing to fit below. Guess.
const DARKEST_PAPER: u8 = 40;
/// Least difference between paper and ink, as a part of the paper's brightness. Guess.
const LEAST_CONTRAST: f64 = 0.25;

/// Luminance values in rows.
#[derive(Debug, Clone)]
pub(super) struct Gray {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f32>,
}

impl Gray {
    /// Bilinear value at a place (px, pixel centres at +0.5); the border repeats.
    pub(super) fn sample(&self, place: Vec2) -> f64 {
        let x = (place.x - 0.5).clamp(0.0, (self.width - 1) as f64);
        let y = (place.y - 0.5).clamp(0.0, (self.height - 1) as f64);
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (fx, fy) = (x - x0 as f64, y - y0 as f64);
        let at = |x: usize, y: usize| f64::from(self.values[y * self.width + x]);
        let upper = at(x0, y0) + (at(x1, y0) - at(x0, y0)) * fx;
        let lower = at(x0, y1) + (at(x1, y1) - at(x0, y1)) * fx;
        upper + (lower - upper) * fy
    }

    /// The brightness below which a part of the pixels lies.
    fn quantile(&self, part: f64) -> u8 {
        let mut counts = [0usize; 256];
        for value in &self.values {
            counts[value.clamp(0.0, 255.0) as usize] += 1;
        }
        let wanted = part * self.values.len() as f64;
        let mut below = 0;
        for (level, count) in counts.iter().enumerate() {
            below += count;
            if below as f64 >= wanted {
                return level as u8;
            }
        }
        255
    }
}

/// The picture in full size and the copy to search in.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    /// Full size, for exact edges.
    pub(super) full: Gray,
    /// Shrunk and smoothed, for finding shapes.
    pub(super) search: Gray,
    /// Full size over search size.
    pub(super) shrink: usize,
}

impl Picture {
    pub(super) fn new(image: &Image) -> Result<Self, CalibrationError> {
        let (width, height) = (image.width(), image.height());
        if width < SMALLEST.0 || height < SMALLEST.1 {
            return Err(CalibrationError::TooSmall {
                width_px: width,
                height_px: height,
                smallest_width_px: SMALLEST.0,
                smallest_height_px: SMALLEST.1,
            });
        }
        let full = luminance(image);
        let brightest = full.quantile(0.98);
        let darkest = full.quantile(0.02);
        if brightest < DARKEST_PAPER {
            return Err(CalibrationError::TooDark {
                brightest,
                needed: DARKEST_PAPER,
            });
        }
        if f64::from(brightest - darkest) < LEAST_CONTRAST * f64::from(brightest) {
            return Err(CalibrationError::NoContrast { darkest, brightest });
        }
        let shrink = width.div_ceil(WIDEST_SEARCH);
        let search = shrunk(&full, shrink);
        // In small pictures the white between square and floor is two or three pixels: smoothing would close it.
        let search = if width < LEAST_SMOOTHED {
            search
        } else {
            smoothed(&search)
        };
        Ok(Self { full, search, shrink })
    }
}

/// 0.299 R + 0.587 G + 0.114 B (C3).
fn luminance(image: &Image) -> Gray {
    let values = match image.channels() {
        Channels::Gray => image.pixels().iter().map(|v| f32::from(*v)).collect(),
        Channels::Rgb => image
            .pixels()
            .chunks_exact(3)
            .map(|p| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]))
            .collect(),
    };
    Gray {
        width: image.width(),
        height: image.height(),
        values,
    }
}

/// Means of blocks of `factor` x `factor`; what is left over at the right and below is dropped.
fn shrunk(gray: &Gray, factor: usize) -> Gray {
    if factor <= 1 {
        return gray.clone();
    }
    let (width, height) = (gray.width / factor, gray.height / factor);
    let mut values = vec![0.0; width * height];
    for y in 0..height * factor {
        let row = &gray.values[y * gray.width..][..width * factor];
        let target = &mut values[y / factor * width..][..width];
        for (sum, block) in target.iter_mut().zip(row.chunks_exact(factor)) {
            *sum += block.iter().sum::<f32>();
        }
    }
    let count = (factor * factor) as f32;
    for value in &mut values {
        *value /= count;
    }
    Gray {
        width,
        height,
        values,
    }
}

/// Binomial 3x3: takes the edge off single-pixel noise and speckles, keeps corners within a pixel.
fn smoothed(gray: &Gray) -> Gray {
    let (width, height) = (gray.width, gray.height);
    let mut across = vec![0.0; width * height];
    for (target, row) in across
        .chunks_exact_mut(width)
        .zip(gray.values.chunks_exact(width))
    {
        for x in 0..width {
            target[x] = 0.25 * row[x.saturating_sub(1)] + 0.5 * row[x] + 0.25 * row[(x + 1).min(width - 1)];
        }
    }
    let mut values = vec![0.0; width * height];
    for y in 0..height {
        let (above, below) = (y.saturating_sub(1) * width, (y + 1).min(height - 1) * width);
        for x in 0..width {
            values[y * width + x] =
                0.25 * across[above + x] + 0.5 * across[y * width + x] + 0.25 * across[below + x];
        }
    }
    Gray {
        width,
        height,
        values,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_between_pixels_is_interpolated() {
        let image = Image::from_pixels(
            96,
            72,
            Channels::Gray,
            (0..96 * 72).map(|i| (i % 96) as u8 * 2).collect(),
        );
        let picture = Picture::new(&image.unwrap()).unwrap();
        assert!((picture.full.sample(Vec2::new(10.5, 3.5)) - 20.0).abs() < 1e-9);
        assert!((picture.full.sample(Vec2::new(11.0, 3.9)) - 21.0).abs() < 1e-9);
        assert!((picture.full.sample(Vec2::new(-4.0, 3.5)) - 0.0).abs() < 1e-9);
        assert_eq!(picture.shrink, 1);
    }

    #[test]
    fn large_photographs_are_searched_in_a_smaller_copy() {
        let mut image = Image::new(2000, 1500, Channels::Rgb);
        for (i, byte) in image.pixels_mut().iter_mut().enumerate() {
            *byte = if i / 3 % 2000 < 1000 { 20 } else { 200 };
        }
        let picture = Picture::new(&image).unwrap();
        assert_eq!(
            (picture.shrink, picture.search.width, picture.search.height),
            (4, 500, 375)
        );
        assert!((picture.search.values[100] - 20.0).abs() < 1e-3);
    }

    #[test]
    fn useless_pictures_are_named() {
        let error = |width, level| {
            let mut image = Image::new(width, 240, Channels::Gray);
            image.pixels_mut().fill(level);
            Picture::new(&image).unwrap_err().to_string()
        };
        assert!(error(320, 12).contains("too dark"));
        assert!(error(320, 250).contains("too little contrast"));
        assert!(error(50, 250).contains("at least 96x72 px, but found 50x240"));
        assert!(Picture::new(&Image::default()).is_err());
    }
}
