//! Images as plain bytes.

/// How many bytes make a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Channels {
    /// One byte: luminance.
    Gray,
    /// Three bytes: red, green, blue (sRGB).
    #[default]
    Rgb,
}

impl Channels {
    /// Bytes a pixel.
    pub fn count(self) -> usize {
        match self {
            Self::Gray => 1,
            Self::Rgb => 3,
        }
    }
}

/// An image: rows from top to bottom, pixels from left to right, no padding.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Image {
    width: usize,
    height: usize,
    channels: Channels,
    pixels: Vec<u8>,
}

impl Image {
    /// A black image.
    pub fn new(width: usize, height: usize, channels: Channels) -> Self {
        Self {
            width,
            height,
            channels,
            pixels: vec![0; width * height * channels.count()],
        }
    }

    /// From bytes in row order; `None` when their number is not width · height · channels.
    pub fn from_pixels(width: usize, height: usize, channels: Channels, pixels: Vec<u8>) -> Option<Self> {
        // Sizes of foreign files may not even fit when multiplied.
        let expected = width.checked_mul(height)?.checked_mul(channels.count())?;
        (pixels.len() == expected).then_some(Self {
            width,
            height,
            channels,
            pixels,
        })
    }

    /// Changes size and kind, keeping the allocation; the contents are unspecified afterwards.
    pub fn reshape(&mut self, width: usize, height: usize, channels: Channels) {
        (self.width, self.height, self.channels) = (width, height, channels);
        self.pixels.resize(width * height * channels.count(), 0);
    }

    /// Becomes a copy of another image, keeping the allocation.
    pub fn copy_from(&mut self, other: &Image) {
        self.reshape(other.width, other.height, other.channels);
        self.pixels.copy_from_slice(&other.pixels);
    }

    /// Width (px).
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height (px).
    pub fn height(&self) -> usize {
        self.height
    }

    /// Gray or RGB.
    pub fn channels(&self) -> Channels {
        self.channels
    }

    /// All bytes.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// All bytes, to write.
    pub fn pixels_mut(&mut self) -> &mut [u8] {
        &mut self.pixels
    }

    /// The bytes of one row.
    pub fn row(&self, y: usize) -> &[u8] {
        let stride = self.width * self.channels.count();
        &self.pixels[y * stride..(y + 1) * stride]
    }

    /// The bytes of one row, to write.
    pub fn row_mut(&mut self, y: usize) -> &mut [u8] {
        let stride = self.width * self.channels.count();
        &mut self.pixels[y * stride..(y + 1) * stride]
    }

    /// The bytes of one pixel.
    pub fn pixel(&self, x: usize, y: usize) -> &[u8] {
        let count = self.channels.count();
        &self.row(y)[x * count..(x + 1) * count]
    }

    /// Whether it has no pixels.
    pub fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_pixels_lie_from_top_left() {
        let pixels = (0..2 * 3 * 3).collect();
        let mut image = Image::from_pixels(3, 2, Channels::Rgb, pixels).unwrap();
        assert_eq!(image.row(1), [9, 10, 11, 12, 13, 14, 15, 16, 17]);
        assert_eq!(image.pixel(2, 0), [6, 7, 8]);
        image.row_mut(0)[0] = 99;
        assert_eq!(image.pixel(0, 0), [99, 1, 2]);
        assert!(!image.is_empty() && Image::default().is_empty());
    }

    #[test]
    fn sizes_that_do_not_fit_the_bytes_are_refused() {
        assert!(Image::from_pixels(3, 2, Channels::Gray, vec![0; 5]).is_none());
        assert!(Image::from_pixels(usize::MAX, 2, Channels::Rgb, vec![0; 5]).is_none());
    }

    #[test]
    fn reshaping_and_copying_keep_the_memory() {
        let mut image = Image::new(8, 8, Channels::Rgb);
        let memory = image.pixels().as_ptr();
        image.reshape(4, 4, Channels::Gray);
        assert_eq!((image.pixels().len(), image.pixels().as_ptr()), (16, memory));
        let other = Image::from_pixels(2, 2, Channels::Rgb, vec![7; 12]).unwrap();
        image.copy_from(&other);
        assert_eq!((&image, image.pixels().as_ptr()), (&other, memory));
    }
}
