//! From a world to pixels of floor.

use crate::world::World;
use senda_geom::Vec2;

/// The floor as a picture from above: what it reflects times the static light on it.
#[derive(Debug, Clone, PartialEq)]
pub struct FloorPainting {
    /// Texels along x.
    pub width: usize,
    /// Texels along y.
    pub height: usize,
    /// World position of the outer corner of texel (0, 0): smallest x and y (m).
    pub origin: Vec2,
    /// Side of a texel (m). Larger than asked for where the world is too large for the texel budget.
    pub metres_per_texel: f64,
    /// Row-major in y. Texel (i, j) covers x in `origin.x + [i, i+1)·m` and y in `origin.y + [j, j+1)·m`. Red, green and
    /// blue are sRGB-encoded reflectance times static light (brightest place 1); the fourth byte is gloss 0..=255.
    pub texels: Vec<[u8; 4]>,
    /// What lies beyond the painted rectangle.
    pub outside: [u8; 4],
}

/// Paints a world's floor. Deterministic; the same bytes on every machine.
pub fn paint(world: &World, metres_per_texel: f64) -> FloorPainting {
    let (low, high) = world.bounds();
    let width = (((high.x - low.x) / metres_per_texel).ceil() as usize).max(1);
    let height = (((high.y - low.y) / metres_per_texel).ceil() as usize).max(1);
    let [r, g, b] = world.floor.colour.rgb;
    let ground = [r, g, b, (world.floor.gloss * 255.0).round() as u8];
    let mut painting = FloorPainting {
        width,
        height,
        origin: low,
        metres_per_texel,
        texels: vec![ground; width * height],
        outside: ground,
    };
    for marking in &world.markings {
        let [r, g, b] = marking.colour.rgb;
        let texel = [r, g, b, (marking.gloss * 255.0).round() as u8];
        let steps = (world.path.length_m() / (0.5 * metres_per_texel)).ceil() as usize;
        for i in 0..=steps {
            let station_m = world.path.length_m() * i as f64 / steps as f64;
            if !marking.covers(station_m) {
                continue;
            }
            let pose = world.path.pose_at(station_m);
            let across = (marking.width_m / (0.5 * metres_per_texel)).ceil() as usize;
            for k in 0..=across {
                let offset_m = marking.offset_m + marking.width_m * (k as f64 / across as f64 - 0.5);
                let at = (pose.position() + pose.left() * offset_m - low) / metres_per_texel;
                if at.x >= 0.0 && at.y >= 0.0 && (at.x as usize) < width && (at.y as usize) < height {
                    painting.texels[at.y as usize * width + at.x as usize] = texel;
                }
            }
        }
    }
    painting
}
