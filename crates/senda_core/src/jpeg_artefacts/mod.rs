//! What JPEG does to a picture, without the bytes: the same pixels as encoding and decoding, several times as fast.
//!
//! A simulated camera's frames are compressed and decompressed because that is what real drivers see. Where nobody keeps
//! the bytes, packing and unpacking them is most of the work and changes nothing: Huffman coding is exact. What does
//! change pixels is integer arithmetic, the same here as in the encoder and the decoder that [`crate::codec`] uses (colours,
//! one colour difference for four pixels, cosine transform, quantisation, and all of it backwards); tests compare the two
//! over many sizes and qualities, bit for bit.

mod lanes;
mod transform;

use crate::{Channels, CodecError, Image};
use lanes::Lanes;
use transform::Quantiser;

/// Applies the artefacts; keeps its memory from frame to frame.
#[derive(Debug, Clone)]
pub struct JpegArtefacts {
    quality: u8,
    brightness: Quantiser,
    colour: Quantiser,
    kind: Kind,
    /// Brightness and the two colour differences.
    planes: [Plane; 3],
    rows: Rows,
}

/// Which vectors are used; the bits are the same.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Portable,
    /// Only where the processor has AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

/// Rows of the picture taken apart.
#[derive(Debug, Clone, Default)]
struct Rows {
    /// Red, green and blue.
    colours: [Vec<u8>; 3],
    /// A row of a colour difference at half the width, then the two of them at the full width.
    half: Vec<i16>,
    whole: [Vec<i16>; 2],
}

impl JpegArtefacts {
    /// For a quality of 1..=100, as [`crate::codec::encode_jpeg_into`] takes it.
    pub fn new(quality: u8) -> Self {
        let quality = quality.clamp(1, 100);
        #[cfg(target_arch = "x86_64")]
        let kind = if std::arch::is_x86_feature_detected!("avx2") {
            Kind::Avx2
        } else {
            Kind::Portable
        };
        #[cfg(not(target_arch = "x86_64"))]
        let kind = Kind::Portable;
        Self {
            quality,
            brightness: Quantiser::new(&transform::BRIGHTNESS, quality),
            colour: Quantiser::new(&transform::COLOUR, quality),
            kind,
            planes: Default::default(),
            rows: Rows::default(),
        }
    }

    /// The quality, 1..=100.
    pub fn quality(&self) -> u8 {
        self.quality
    }

    /// Writes into `result` what would be decoded if `image` were encoded.
    pub fn apply(&mut self, image: &Image, result: &mut Image) -> Result<(), CodecError> {
        let (width, height) = (image.width(), image.height());
        if image.is_empty() || width > usize::from(u16::MAX) || height > usize::from(u16::MAX) {
            return Err(CodecError::Size { width, height });
        }
        result.reshape(width, height, image.channels());
        match image.channels() {
            Channels::Gray => self.planes[0].reshape(width.next_multiple_of(8), height.next_multiple_of(8)),
            Channels::Rgb => {
                let (wide, high) = (width.next_multiple_of(16), height.next_multiple_of(16));
                let [brightness, differences @ ..] = &mut self.planes;
                brightness.reshape(wide, high);
                for plane in differences {
                    plane.reshape(wide / 2, high / 2);
                }
                self.rows.reshape(wide);
            }
        }
        match self.kind {
            Kind::Portable => self.run::<[i32; 8]>(image, result),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `new` saw AVX2 on this processor.
            #[allow(unsafe_code)]
            Kind::Avx2 => unsafe { self.run_avx2(image, result) },
        }
        Ok(())
    }

    /// # Safety
    /// The processor has AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    #[allow(unsafe_code)]
    unsafe fn run_avx2(&mut self, image: &Image, result: &mut Image) {
        self.run::<lanes::Avx2>(image, result);
    }

    #[inline(always)]
    fn run<L: Lanes>(&mut self, image: &Image, result: &mut Image) {
        match image.channels() {
            Channels::Gray => self.grey::<L>(image, result),
            Channels::Rgb => self.colours::<L>(image, result),
        }
    }

    #[inline(always)]
    fn grey<L: Lanes>(&mut self, image: &Image, result: &mut Image) {
        let (width, height) = (image.width(), image.height());
        let plane = &mut self.planes[0];
        for y in 0..height {
            let row = plane.row_mut(y);
            for (value, &pixel) in row.iter_mut().zip(image.row(y)) {
                *value = i16::from(pixel) - 128;
            }
            let last = row[width - 1];
            row[width..].fill(last);
        }
        plane.fill_down(height);
        plane.quantise::<L>(&self.brightness);
        for y in 0..height {
            for (pixel, &value) in result.row_mut(y).iter_mut().zip(plane.row(y)) {
                *pixel = value as u8;
            }
        }
    }

    #[inline(always)]
    fn colours<L: Lanes>(&mut self, image: &Image, result: &mut Image) {
        let height = image.height();
        let [luma, blue, red] = &mut self.planes;
        for y in 0..height {
            self.rows.take_apart(image.row(y));
            self.rows.brightness(luma.row_mut(y));
            if y.is_multiple_of(2) {
                self.rows.differences(blue.row_mut(y / 2), red.row_mut(y / 2));
            }
        }
        luma.fill_down(height);
        // Below the picture its last row is repeated, also where that one was left out; it is still taken apart.
        let rows = height.div_ceil(2);
        if rows < blue.height() {
            self.rows.differences(blue.row_mut(rows), red.row_mut(rows));
            blue.fill_down(rows + 1);
            red.fill_down(rows + 1);
        }
        luma.quantise::<L>(&self.brightness);
        blue.quantise::<L>(&self.colour);
        red.quantise::<L>(&self.colour);
        for y in 0..height {
            blue.widened_row(y, &mut self.rows.half, &mut self.rows.whole[0]);
            red.widened_row(y, &mut self.rows.half, &mut self.rows.whole[1]);
            self.rows.put_together(luma.row(y), result.row_mut(y));
        }
    }
}

impl Rows {
    fn reshape(&mut self, width: usize) {
        for row in &mut self.colours {
            row.resize(width, 0);
        }
        for row in &mut self.whole {
            row.resize(width, 0);
        }
        self.half.resize(width / 2, 0);
    }

    /// Right of the picture its last pixel is repeated.
    #[inline(always)]
    fn take_apart(&mut self, pixels: &[u8]) {
        let (pixels, _) = pixels.as_chunks::<3>();
        let [red, green, blue] = &mut self.colours;
        for (((pixel, red), green), blue) in pixels.iter().zip(&mut *red).zip(&mut *green).zip(&mut *blue) {
            [*red, *green, *blue] = *pixel;
        }
        for row in &mut self.colours {
            let last = row[pixels.len() - 1];
            row[pixels.len()..].fill(last);
        }
    }

    /// JFIF's Y, less 128.
    #[inline(always)]
    fn brightness(&self, row: &mut [i16]) {
        let [red, green, blue] = &self.colours;
        for (((value, &red), &green), &blue) in row.iter_mut().zip(red).zip(green).zip(blue) {
            let [red, green, blue] = [i32::from(red), i32::from(green), i32::from(blue)];
            *value = ((19595 * red + 38470 * green + 7471 * blue + 0x7fff) >> 16) as i16 - 128;
        }
    }

    /// JFIF's Cb and Cr, less 128, of every second pixel.
    #[inline(always)]
    fn differences(&self, cb_row: &mut [i16], cr_row: &mut [i16]) {
        let [red, green, blue] = [0, 1, 2].map(|i| self.colours[i].as_chunks::<2>().0);
        for ((((cb, cr), red), green), blue) in cb_row.iter_mut().zip(cr_row).zip(red).zip(green).zip(blue) {
            let [red, green, blue] = [i32::from(red[0]), i32::from(green[0]), i32::from(blue[0])];
            let middle = (128 << 16) + 0x7fff;
            // The encoder keeps eight bits of each.
            *cb = ((-11059 * red - 21709 * green + 32768 * blue + middle) >> 16 & 0xff) as i16 - 128;
            *cr = ((32768 * red - 27439 * green - 5329 * blue + middle) >> 16 & 0xff) as i16 - 128;
        }
    }

    /// Back to red, green and blue from values of 0..=255, in fourteen bits of fraction.
    #[inline(always)]
    fn put_together(&mut self, luma: &[i16], pixels: &mut [u8]) {
        let [red, green, blue] = &mut self.colours;
        let [cb_row, cr_row] = &self.whole;
        for (((((&luma, &cb), &cr), red), green), blue) in luma
            .iter()
            .zip(cb_row)
            .zip(cr_row)
            .zip(&mut *red)
            .zip(&mut *green)
            .zip(&mut *blue)
        {
            let [cb, cr] = [i32::from(cb) - 128, i32::from(cr) - 128];
            let luma = (i32::from(luma) << 14) + 0x1fff;
            *red = ((luma + 22970 * cr) >> 14).clamp(0, 255) as u8;
            *green = ((luma - 11700 * cr - 5638 * cb) >> 14).clamp(0, 255) as u8;
            *blue = ((luma + 29032 * cb) >> 14).clamp(0, 255) as u8;
        }
        let (pixels, _) = pixels.as_chunks_mut::<3>();
        for (((pixel, &red), &green), &blue) in pixels.iter_mut().zip(&*red).zip(&*green).zip(&*blue) {
            *pixel = [red, green, blue];
        }
    }
}

/// One component of the picture, filled up to whole blocks. Values are less 128 until they are quantised, then 0..=255.
#[derive(Debug, Clone, Default)]
struct Plane {
    width: usize,
    values: Vec<i16>,
}

impl Plane {
    fn reshape(&mut self, width: usize, height: usize) {
        self.width = width;
        self.values.resize(width * height, 0);
    }

    fn height(&self) -> usize {
        self.values.len() / self.width
    }

    #[inline(always)]
    fn row(&self, y: usize) -> &[i16] {
        &self.values[y * self.width..(y + 1) * self.width]
    }

    #[inline(always)]
    fn row_mut(&mut self, y: usize) -> &mut [i16] {
        &mut self.values[y * self.width..(y + 1) * self.width]
    }

    /// Repeats row `y - 1` from row `y` on.
    fn fill_down(&mut self, y: usize) {
        let (above, below) = self.values.split_at_mut(y * self.width);
        let last = &above[(y - 1) * self.width..];
        for row in below.chunks_exact_mut(self.width) {
            row.copy_from_slice(last);
        }
    }

    /// Transforms, quantises and transforms back, block by block.
    #[inline(always)]
    fn quantise<L: Lanes>(&mut self, quantiser: &Quantiser) {
        let width = self.width;
        for rows in self.values.chunks_exact_mut(8 * width) {
            for x in (0..width).step_by(8) {
                let eight = |y: usize| y * width + x..y * width + x + 8;
                let mut block: [L; 8] =
                    std::array::from_fn(|y| L::load_short(rows[eight(y)].try_into().expect("eight")));
                quantiser.apply(&mut block);
                for (y, row) in block.iter().enumerate() {
                    row.store_short((&mut rows[eight(y)]).try_into().expect("eight"));
                }
            }
        }
    }

    /// Row `y` of the picture at twice the plane's width and height: three quarters the nearer value, one quarter the next one,
    /// in both directions; at the edges the same value counts twice.
    #[inline(always)]
    fn widened_row(&self, y: usize, half: &mut [i16], row: &mut [i16]) {
        let near = y / 2;
        let far = if y.is_multiple_of(2) {
            near.saturating_sub(1)
        } else {
            (near + 1).min(self.height() - 1)
        };
        for ((value, near), far) in half.iter_mut().zip(self.row(near)).zip(self.row(far)) {
            *value = (3 * near + 2 + far) >> 2;
        }
        let last = half.len() - 1;
        let (pairs, _) = row.as_chunks_mut::<2>();
        pairs[0] = [half[0], (3 * half[0] + half[1] + 2) >> 2];
        pairs[last] = [(3 * half[last] + half[last - 1] + 2) >> 2, half[last]];
        for (((pair, &before), &value), &after) in
            pairs[1..].iter_mut().zip(&*half).zip(&half[1..]).zip(&half[2..])
        {
            let near = 3 * value + 2;
            *pair = [(near + before) >> 2, (near + after) >> 2];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec;
    use proptest::prelude::*;

    fn encoded_and_decoded(image: &Image, quality: u8) -> Image {
        codec::encode_jpeg(image, quality).unwrap().decode().unwrap()
    }

    fn check(image: &Image, quality: u8) {
        let mut artefacts = JpegArtefacts::new(quality);
        let mut portable = artefacts.clone();
        portable.kind = Kind::Portable;
        let expected = encoded_and_decoded(image, quality);
        let mut result = Image::default();
        for artefacts in [&mut artefacts, &mut portable] {
            artefacts.apply(image, &mut result).unwrap();
            assert!(
                result == expected,
                "{}x{} px, {:?}, quality {quality}: not what the codec gives",
                image.width(),
                image.height(),
                image.channels()
            );
        }
    }

    /// Smooth, with edges and noise, like a camera's picture.
    fn picture(width: usize, height: usize, channels: Channels, seed: u32) -> Image {
        let mut state = seed.wrapping_mul(0x9e37_79b9) | 1;
        let mut pixels = Vec::new();
        for y in 0..height {
            for x in 0..width {
                for channel in 0..channels.count() {
                    state ^= state << 13;
                    state ^= state >> 17;
                    state ^= state << 5;
                    let noise = state >> (25 + seed % 7);
                    let edge = if (x * 3 + y * 2 + channel * 11) / 29 % 3 == 0 {
                        140
                    } else {
                        30
                    };
                    pixels.push((edge as u32 + noise + (x as u32 + y as u32) / 5).min(255) as u8);
                }
            }
        }
        Image::from_pixels(width, height, channels, pixels).unwrap()
    }

    #[test]
    fn pixels_are_those_of_encoding_and_decoding_in_every_size() {
        for (width, height) in [
            (1, 1),
            (2, 3),
            (7, 9),
            (15, 16),
            (16, 15),
            (17, 33),
            (31, 18),
            (123, 92),
            (160, 120),
            (48, 34),
        ] {
            for channels in [Channels::Gray, Channels::Rgb] {
                for quality in [1, 20, 50, 85, 95, 100] {
                    check(&picture(width, height, channels, quality.into()), quality);
                }
            }
        }
    }

    #[test]
    fn extreme_pixels_come_out_as_from_the_codec() {
        for value in [0, 1, 127, 128, 254, 255] {
            for quality in [1, 75, 100] {
                check(
                    &Image::from_pixels(24, 24, Channels::Rgb, vec![value; 24 * 24 * 3]).unwrap(),
                    quality,
                );
            }
        }
        let saturated: Vec<u8> = (0..32 * 32)
            .flat_map(|i| [[255, 0, 0], [0, 0, 255], [0, 255, 0], [255; 3]][(i / 3) % 4])
            .collect();
        for quality in [1, 30, 90, 100] {
            check(
                &Image::from_pixels(32, 32, Channels::Rgb, saturated.clone()).unwrap(),
                quality,
            );
        }
    }

    #[test]
    fn a_picture_without_pixels_is_refused() {
        let refused = JpegArtefacts::new(85).apply(&Image::default(), &mut Image::default());
        assert_eq!(refused, Err(CodecError::Size { width: 0, height: 0 }));
    }

    proptest! {
        #[test]
        fn noise_comes_out_as_from_the_codec(width in 1usize..70, height in 1usize..50, quality in 1u8..=100, seed: u32) {
            check(&picture(width, height, Channels::Rgb, seed), quality);
        }
    }
}
