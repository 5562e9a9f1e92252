//! From a world to pixels of floor: material, markings and static light.
//!
//! The same world gives the same bytes on every machine. What stands on the floor is not painted, only its shadow.

mod areas;
mod lines;
mod material;
mod noise;
mod shade;

use crate::world::World;
use material::Material;
use senda_core::memory::prefer_large_pages;
use senda_core::threads::both;
use senda_geom::Vec2;

/// Most texels of a painting (256 MiB). Worlds that need more are painted more coarsely.
pub const TEXEL_BUDGET: usize = 64 << 20;

/// The floor as a picture from above: what it reflects times the static light on it.
#[derive(Debug, Clone, PartialEq)]
pub struct FloorPainting {
    /// Texels along x.
    pub width: usize,
    /// Texels along y.
    pub height: usize,
    /// World position of the outer corner of texel (0, 0): smallest x and y (m).
    pub origin: Vec2,
    /// Side of a texel (m). Larger than asked for where the world is too large for [`TEXEL_BUDGET`].
    pub metres_per_texel: f64,
    /// Row-major in y. Texel (i, j) covers x in `origin.x + [i, i+1)·m` and y in `origin.y + [j, j+1)·m`. Red, green and
    /// blue are sRGB-encoded reflectance times static light (brightest place 1); the fourth byte is gloss 0..=255.
    pub texels: Vec<[u8; 4]>,
    /// What lies beyond the painted rectangle.
    pub outside: [u8; 4],
}

/// Paints a world's floor at `metres_per_texel` (2 mm suits small circuits), or more coarsely where the world says so
/// ([`World::texel_m`]) or that would need more than [`TEXEL_BUDGET`] texels: [`FloorPainting::metres_per_texel`] tells.
pub fn paint(world: &World, metres_per_texel: f64) -> FloorPainting {
    let (low, high) = world.bounds();
    let size = high - low;
    let metres_per_texel = metres_per_texel
        .max(world.texel_m)
        .max(finest_texel_m(size))
        .max(1e-5);
    // Texels lie on a lattice through the world's origin, so that the same place looks the same at any margin.
    let first_column = (low.x / metres_per_texel).floor();
    let first_row = (low.y / metres_per_texel).floor();
    let origin = Vec2::new(first_column, first_row) * metres_per_texel;
    let count = |far: f64, first: f64| ((far / metres_per_texel).ceil() - first).max(1.0) as usize;
    let (width, height) = (count(high.x, first_column), count(high.y, first_row));
    let mut painting = FloorPainting {
        width,
        height,
        origin,
        metres_per_texel,
        texels: vec![[0; 4]; width * height],
        outside: [0; 4],
    };
    prefer_large_pages(&mut painting.texels);
    let (mut material, mut grid) = (None, None);
    both(
        width * height,
        || material = Some(Material::new(&world.floor, metres_per_texel)),
        || grid = Some(shade::Grid::new(world, &painting)),
    );
    let (material, grid) = (material.expect("made above"), grid.expect("made above"));
    let cover = |mut material: Material, first: usize, texels: &mut [[u8; 4]]| {
        for (j, row) in (first..).zip(texels.chunks_exact_mut(width)) {
            material.row(row, first_column as i64, first_row as i64 + j as i64);
        }
    };
    let middle = height / 2;
    let (upper, lower) = painting.texels.split_at_mut(middle * width);
    let copy = material.clone();
    both(
        width * height,
        || cover(material, 0, upper),
        || cover(copy, middle, lower),
    );
    areas::paint_areas(world, &mut painting);
    lines::paint_markings(world, &mut painting);
    shade::light_up(&grid, &mut painting);
    painting
}

/// Side of the finest texels (m) that [`TEXEL_BUDGET`] allows a floor of a size (m).
pub fn finest_texel_m(size: Vec2) -> f64 {
    (size.x * size.y / (TEXEL_BUDGET as f64 * 0.98)).sqrt()
}

#[cfg(test)]
mod tests;
