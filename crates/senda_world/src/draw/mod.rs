//! Pictures of a world: drawings (SVG), paintings (PNG) and prints at true scale (PDF, SVG).

mod above;
mod boards;
mod lines;
mod map;
mod pdf;
mod print;
mod shape;

pub use above::add_upright;
pub use boards::boards;
pub use map::svg;
pub use print::{CannotPrint, Ink, Paper, Print, PrintOptions, SHEET_LIMIT};

use crate::paint::FloorPainting;

/// A painting as PNG, north (large y) at the top, without the gloss channel.
pub fn png(painting: &FloorPainting) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, painting.width as u32, painting.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    let per_metre = (1.0 / painting.metres_per_texel).round() as u32;
    encoder.set_pixel_dims(Some(png::PixelDimensions {
        xppu: per_metre,
        yppu: per_metre,
        unit: png::Unit::Meter,
    }));
    let pixels: Vec<u8> = painting
        .texels
        .chunks_exact(painting.width)
        .rev()
        .flatten()
        .flat_map(|texel| [texel[0], texel[1], texel[2]])
        .collect();
    // Writing into memory fails only on sizes that do not match, and they do.
    let mut writer = encoder.write_header().expect("a painting has at least one texel");
    writer
        .write_image_data(&pixels)
        .expect("three bytes for every texel");
    writer.finish().expect("memory takes every byte");
    bytes
}
