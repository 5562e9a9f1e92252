//! JPEG and PNG: one decoder for driving, training and replay, so that all see the same pixels.

use crate::{Channels, Image};
use thiserror::Error;

/// A compressed image format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImageFormat {
    /// Lossy; what USB cameras deliver.
    Jpeg,
    /// Lossless.
    Png,
}

/// A compressed image as a sensor delivered it or as a file holds it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Encoded {
    /// How the bytes are to be read.
    pub format: ImageFormat,
    /// The compressed bytes.
    pub bytes: Vec<u8>,
}

/// Why bytes are not an image, or an image cannot become bytes.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum CodecError {
    /// The bytes are damaged, cut short or something else.
    #[error("expected a {format:?} image, but it cannot be decoded: {reason}")]
    Damaged {
        /// What was expected.
        format: ImageFormat,
        /// The decoder's words.
        reason: String,
    },
    /// Neither a JPEG nor a PNG.
    #[error("expected a JPEG or PNG image, but the first bytes are {found}")]
    Unknown {
        /// The first bytes in hexadecimal.
        found: String,
    },
    /// JPEG cannot hold images wider or higher than 65,535 px, or without pixels.
    #[error("cannot encode an image of {width}x{height} px")]
    Size {
        /// Width (px).
        width: usize,
        /// Height (px).
        height: usize,
    },
}

impl Encoded {
    /// Recognises JPEG and PNG by their first bytes.
    pub fn recognise(bytes: Vec<u8>) -> Result<Self, CodecError> {
        let format = if bytes.starts_with(&[0xff, 0xd8]) {
            ImageFormat::Jpeg
        } else if bytes.starts_with(&[0x89, b'P', b'N', b'G']) {
            ImageFormat::Png
        } else {
            let found: Vec<String> = bytes.iter().take(8).map(|b| format!("{b:02x}")).collect();
            return Err(CodecError::Unknown {
                found: if found.is_empty() {
                    "missing".into()
                } else {
                    found.join(" ")
                },
            });
        };
        Ok(Self { format, bytes })
    }

    /// Decodes into an image (gray stays gray), reusing its memory.
    pub fn decode_into(&self, image: &mut Image) -> Result<(), CodecError> {
        match self.format {
            ImageFormat::Jpeg => decode_jpeg(&self.bytes, image),
            ImageFormat::Png => decode_png(&self.bytes, image),
        }
    }

    /// Decodes into a new image.
    pub fn decode(&self) -> Result<Image, CodecError> {
        let mut image = Image::default();
        self.decode_into(&mut image)?;
        Ok(image)
    }
}

/// JPEG with 4:2:0 chroma (as USB cameras send it) at `quality` 1..=100, appended to `bytes`, which is cleared first.
pub fn encode_jpeg_into(image: &Image, quality: u8, bytes: &mut Vec<u8>) -> Result<(), CodecError> {
    let size = CodecError::Size {
        width: image.width(),
        height: image.height(),
    };
    let (Ok(width), Ok(height)) = (u16::try_from(image.width()), u16::try_from(image.height())) else {
        return Err(size);
    };
    bytes.clear();
    let mut encoder = jpeg_encoder::Encoder::new(&mut *bytes, quality.clamp(1, 100));
    let colour = match image.channels() {
        Channels::Gray => jpeg_encoder::ColorType::Luma,
        Channels::Rgb => {
            encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_2_2);
            jpeg_encoder::ColorType::Rgb
        }
    };
    encoder
        .encode(image.pixels(), width, height, colour)
        .map_err(|_| size)
}

/// JPEG at `quality` 1..=100.
pub fn encode_jpeg(image: &Image, quality: u8) -> Result<Encoded, CodecError> {
    let mut bytes = Vec::new();
    encode_jpeg_into(image, quality, &mut bytes)?;
    Ok(Encoded {
        format: ImageFormat::Jpeg,
        bytes,
    })
}

/// Lossless PNG, fast compression.
pub fn encode_png(image: &Image) -> Result<Encoded, CodecError> {
    let size = CodecError::Size {
        width: image.width(),
        height: image.height(),
    };
    let (Ok(width), Ok(height)) = (u32::try_from(image.width()), u32::try_from(image.height())) else {
        return Err(size);
    };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_color(match image.channels() {
        Channels::Gray => png::ColorType::Grayscale,
        Channels::Rgb => png::ColorType::Rgb,
    });
    let mut writer = encoder.write_header().map_err(|_| size.clone())?;
    writer
        .write_image_data(image.pixels())
        .map_err(|_| size.clone())?;
    writer.finish().map_err(|_| size)?;
    Ok(Encoded {
        format: ImageFormat::Png,
        bytes,
    })
}

/// The largest side accepted (px): no camera of ours comes near.
const LARGEST_SIDE_PX: usize = 16_384;

/// The largest picture accepted (px). A damaged header must not ask for gigabytes; 64 million pixels are 192 MB.
const LARGEST_AREA_PX: usize = 1 << 26;

fn is_too_large(width: usize, height: usize) -> bool {
    width > LARGEST_SIDE_PX || height > LARGEST_SIDE_PX || width * height > LARGEST_AREA_PX
}

fn decode_jpeg(bytes: &[u8], image: &mut Image) -> Result<(), CodecError> {
    use zune_jpeg::zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions};
    let damaged = |reason: String| CodecError::Damaged {
        format: ImageFormat::Jpeg,
        reason,
    };
    let options = |space| {
        DecoderOptions::default()
            .jpeg_set_out_colorspace(space)
            .set_max_width(LARGEST_SIDE_PX)
            .set_max_height(LARGEST_SIDE_PX)
            // A frame cut short is an error, not half a gray picture.
            .set_strict_mode(true)
    };
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(bytes), options(ColorSpace::RGB));
    decoder.decode_headers().map_err(|e| damaged(format!("{e:?}")))?;
    let channels = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => Channels::Gray,
        _ => Channels::Rgb,
    };
    if channels == Channels::Gray {
        decoder.set_options(options(ColorSpace::Luma));
    }
    let (width, height) = decoder.dimensions().ok_or_else(|| damaged("no size".into()))?;
    if is_too_large(width, height) {
        return Err(damaged(format!("{width}x{height} px is too large")));
    }
    image.reshape(width, height, channels);
    decoder
        .decode_into(image.pixels_mut())
        .map_err(|e| damaged(format!("{e:?}")))
}

fn decode_png(bytes: &[u8], image: &mut Image) -> Result<(), CodecError> {
    let damaged = |reason: String| CodecError::Damaged {
        format: ImageFormat::Png,
        reason,
    };
    let limits = png::Limits {
        bytes: LARGEST_AREA_PX * 8,
    };
    let mut decoder = png::Decoder::new_with_limits(std::io::Cursor::new(bytes), limits);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| damaged(e.to_string()))?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    if is_too_large(width, height) {
        return Err(damaged(format!("{width}x{height} px is too large")));
    }
    // Bytes a pixel as stored, and how many of them we keep: transparency is dropped.
    let (stored, channels) = match reader.output_color_type().0 {
        png::ColorType::Grayscale => (1, Channels::Gray),
        png::ColorType::GrayscaleAlpha => (2, Channels::Gray),
        png::ColorType::Rgb => (3, Channels::Rgb),
        png::ColorType::Rgba => (4, Channels::Rgb),
        png::ColorType::Indexed => return Err(damaged("palette was not expanded".into())),
    };
    image.reshape(width, height, channels);
    if reader.output_buffer_size() != Some(width * height * stored) {
        return Err(damaged("wrong number of bytes".into()));
    }
    if stored == channels.count() {
        reader
            .next_frame(image.pixels_mut())
            .map_err(|e| damaged(e.to_string()))?;
        return Ok(());
    }
    let mut raw = vec![0; width * height * stored];
    reader.next_frame(&mut raw).map_err(|e| damaged(e.to_string()))?;
    let pixels = image.pixels_mut().chunks_exact_mut(channels.count());
    for (pixel, raw) in pixels.zip(raw.chunks_exact(stored)) {
        pixel.copy_from_slice(&raw[..channels.count()]);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient(width: usize, height: usize, channels: Channels) -> Image {
        let count = channels.count();
        let pixels = (0..width * height * count)
            .map(|i| ((i / count) % width * 255 / width) as u8)
            .collect();
        Image::from_pixels(width, height, channels, pixels).unwrap()
    }

    #[test]
    fn png_is_lossless_and_jpeg_is_close() {
        for channels in [Channels::Gray, Channels::Rgb] {
            let image = gradient(33, 21, channels);
            assert_eq!(encode_png(&image).unwrap().decode().unwrap(), image);
            let jpeg = encode_jpeg(&image, 90).unwrap().decode().unwrap();
            assert_eq!((jpeg.width(), jpeg.height(), jpeg.channels()), (33, 21, channels));
            let worst = jpeg
                .pixels()
                .iter()
                .zip(image.pixels())
                .map(|(a, b)| a.abs_diff(*b))
                .max()
                .unwrap();
            assert!(worst < 24, "{worst}");
        }
    }

    #[test]
    fn damaged_images_are_errors_and_never_panic() {
        for whole in [
            encode_jpeg(&gradient(64, 48, Channels::Rgb), 80),
            encode_png(&gradient(64, 48, Channels::Rgb)),
        ] {
            let whole = whole.unwrap();
            for cut in [0, 1, 2, 10, whole.bytes.len() / 2] {
                let part = Encoded {
                    format: whole.format,
                    bytes: whole.bytes[..cut].to_vec(),
                };
                assert!(part.decode().is_err(), "{:?} cut to {cut} bytes", whole.format);
            }
            for place in 0..whole.bytes.len() {
                let mut broken = whole.clone();
                broken.bytes[place] ^= 0x55;
                let _ = broken.decode();
            }
        }
        assert!(Encoded::recognise(b"GIF89a".to_vec()).is_err());
    }

    /// FNV-1a.
    fn digest(bytes: &[u8]) -> u64 {
        bytes.iter().fold(0xcbf2_9ce4_8422_2325, |digest, byte| {
            (digest ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
        })
    }

    /// A picture with edges, slopes and grain, so that every frequency and the colour conversion take part.
    fn busy() -> Image {
        let mut seed = 1_u32;
        let pixels = (0..160 * 120 * 3)
            .map(|i| {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let (x, y) = (i / 3 % 160, i / 480);
                (x + y * (i % 3) + (seed >> 28) as usize + if x > y { 90 } else { 0 }) as u8
            })
            .collect();
        Image::from_pixels(160, 120, Channels::Rgb, pixels).unwrap()
    }

    /// Recordings hold these bytes and drivers see these pixels, on every machine.
    #[test]
    fn jpeg_bytes_and_pixels_are_golden() {
        let jpeg = encode_jpeg(&busy(), 85).unwrap();
        let bytes = digest(&jpeg.bytes);
        let pixels = digest(jpeg.decode().unwrap().pixels());
        assert_eq!(
            (bytes, pixels),
            (0x04e5_52c2_b19f_d9f4, 0xd9f1_b611_4556_0a2a),
            "new digests 0x{bytes:016x}, 0x{pixels:016x}"
        );
    }

    #[test]
    fn decoding_again_reuses_the_memory() {
        for encoded in [encode_jpeg(&busy(), 85).unwrap(), encode_png(&busy()).unwrap()] {
            let mut image = Image::default();
            encoded.decode_into(&mut image).unwrap();
            let memory = image.pixels().as_ptr();
            encoded.decode_into(&mut image).unwrap();
            assert_eq!(image.pixels().as_ptr(), memory, "{:?}", encoded.format);
        }
    }

    #[test]
    fn transparency_and_depth_of_foreign_pngs_are_dropped() {
        for (colour, depth, data, expected) in [
            (
                png::ColorType::Rgba,
                png::BitDepth::Eight,
                vec![10, 20, 30, 0, 40, 50, 60, 255],
                vec![10, 20, 30, 40, 50, 60],
            ),
            (
                png::ColorType::GrayscaleAlpha,
                png::BitDepth::Eight,
                vec![7, 0, 9, 9],
                vec![7, 9],
            ),
            (
                png::ColorType::Grayscale,
                png::BitDepth::Sixteen,
                vec![200, 1, 100, 2],
                vec![200, 100],
            ),
            (
                png::ColorType::Grayscale,
                png::BitDepth::One,
                vec![0b0100_0000],
                vec![0, 255],
            ),
        ] {
            let mut bytes = Vec::new();
            let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
            encoder.set_color(colour);
            encoder.set_depth(depth);
            encoder.write_header().unwrap().write_image_data(&data).unwrap();
            let image = Encoded::recognise(bytes).unwrap().decode().unwrap();
            assert_eq!(image.pixels(), expected, "{colour:?} {depth:?}");
        }
    }

    /// A header of a few bytes asked for 800 MB before a single pixel was read.
    #[test]
    fn a_header_that_asks_for_too_much_is_refused() {
        let mut jpeg = encode_jpeg(&Image::new(16, 16, Channels::Rgb), 80).unwrap();
        let frame = jpeg
            .bytes
            .windows(2)
            .position(|pair| pair == [0xff, 0xc0])
            .unwrap();
        jpeg.bytes[frame + 5..frame + 9].copy_from_slice(&[0x3f, 0xff, 0x3f, 0xff]);
        assert!(jpeg.decode().unwrap_err().to_string().contains("too large"));
        let mut png = Vec::new();
        let mut encoder = png::Encoder::new(&mut png, 16_000, 16_000);
        encoder.set_color(png::ColorType::Rgb);
        encoder
            .write_header()
            .unwrap()
            .write_chunk(png::chunk::IDAT, &[])
            .unwrap();
        assert!(
            Encoded::recognise(png)
                .unwrap()
                .decode()
                .unwrap_err()
                .to_string()
                .contains("too large")
        );
    }
}
