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
    brightness: Quantiser,
    colour: Quantiser,
    kind: Kind,
    /// Brightness and the two colour differences.
    planes: [Plane; 3],
    /// A row of a colour difference at half the width, then of both at the full width.
    half: Vec<i16>,
    whole: [Vec<i16>; 2],
}

/// Which vectors are used; the bits are the same.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Portable,
    /// Only where the processor has AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2,
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
            brightness: Quantiser::new(&transform::BRIGHTNESS, quality),
            colour: Quantiser::new(&transform::COLOUR, quality),
            kind,
            planes: Default::default(),
            half: Vec::new(),
            whole: Default::default(),
        }
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
                self.half.resize(wide / 2, 0);
                for row in &mut self.whole {
                    row.resize(wide, 0);
                }
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
            let differences = y
                .is_multiple_of(2)
                .then(|| [blue.row_mut(y / 2), red.row_mut(y / 2)]);
            take_apart::<L>(image.row(y), luma.row_mut(y), differences);
        }
        luma.fill_down(height);
        // Below the picture its last row is repeated, also where that one's colours were left out.
        let rows = height.div_ceil(2);
        if rows < blue.height() {
            let last = [blue.row_mut(rows), red.row_mut(rows)];
            take_apart::<L>(image.row(height - 1), luma.row_mut(height - 1), Some(last));
            blue.fill_down(rows + 1);
            red.fill_down(rows + 1);
        }
        luma.quantise::<L>(&self.brightness);
        blue.quantise::<L>(&self.colour);
        red.quantise::<L>(&self.colour);
        for y in 0..height {
            blue.widened_row(y, &mut self.half, &mut self.whole[0]);
            red.widened_row(y, &mut self.half, &mut self.whole[1]);
            let [blue, red] = &self.whole;
            put_together::<L>(luma.row(y), blue, red, result.row_mut(y));
        }
    }
}

/// A row's brightness (JFIF's Y) and, if wanted, the colour differences (Cb, Cr) of every second pixel, all less 128. Right of
/// the picture its last pixel is repeated.
#[inline(always)]
fn take_apart<L: Lanes>(pixels: &[u8], luma: &mut [i16], mut differences: Option<[&mut [i16]; 2]>) {
    let last = pixels.last_chunk::<3>().copied().unwrap_or_default();
    for (i, luma) in luma.as_chunks_mut::<16>().0.iter_mut().enumerate() {
        let start = (48 * i).min(pixels.len());
        let [red, green, blue] = match pixels[start..].first_chunk::<48>() {
            Some(sixteen) => L::take_apart(sixteen),
            None => {
                let mut sixteen = [0; 48];
                let (pixels, _) = pixels[start..].as_chunks::<3>();
                for (i, pixel) in sixteen.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                    *pixel = pixels.get(i).copied().unwrap_or(last);
                }
                L::take_apart(&sixteen)
            }
        }
        .map(|channel| channel.map(i32::from));
        for k in 0..16 {
            luma[k] = ((19595 * red[k] + 38470 * green[k] + 7471 * blue[k] + 0x7fff) >> 16) as i16 - 128;
        }
        let Some(rows) = &mut differences else { continue };
        let [cb, cr] = rows.each_mut().map(|row| &mut row[8 * i..8 * i + 8]);
        let middle = (128 << 16) + 0x7fff;
        for k in 0..8 {
            let [red, green, blue] = [red[2 * k], green[2 * k], blue[2 * k]];
            // The encoder keeps eight bits of each.
            cb[k] = ((-11059 * red - 21709 * green + 32768 * blue + middle) >> 16 & 0xff) as i16 - 128;
            cr[k] = ((32768 * red - 27439 * green - 5329 * blue + middle) >> 16 & 0xff) as i16 - 128;
        }
    }
}

/// Back to red, green and blue from values of 0..=255, in fourteen bits of fraction.
#[inline(always)]
fn put_together<L: Lanes>(luma: &[i16], cb: &[i16], cr: &[i16], pixels: &mut [u8]) {
    let sixteens = [luma, cb, cr].map(|row| row.as_chunks::<16>().0);
    for (i, pixels) in pixels.chunks_mut(48).enumerate() {
        // In arrays of its own, so that the compiler sees that nothing overlaps.
        let [luma, cb, cr] = sixteens.map(|sixteens| sixteens[i].map(i32::from));
        let mut channels = [[0; 16]; 3];
        for k in 0..16 {
            let [luma, cb, cr] = [(luma[k] << 14) + 0x1fff, cb[k] - 128, cr[k] - 128];
            channels[0][k] = ((luma + 22970 * cr) >> 14).clamp(0, 255) as u8;
            channels[1][k] = ((luma - 11700 * cr - 5638 * cb) >> 14).clamp(0, 255) as u8;
            channels[2][k] = ((luma + 29032 * cb) >> 14).clamp(0, 255) as u8;
        }
        let sixteen = L::put_together(&channels);
        pixels.copy_from_slice(&sixteen[..pixels.len()]);
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
        for (pair, three) in pairs[1..].iter_mut().zip(half.windows(3)) {
            let near = 3 * three[1] + 2;
            *pair = [(near + three[0]) >> 2, (near + three[2]) >> 2];
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
