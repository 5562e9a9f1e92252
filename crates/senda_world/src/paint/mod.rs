//! From a world to pixels of floor: material, markings and static light.
//!
//! The same world gives the same bytes on every machine, and the same texel whichever window of the floor it is painted
//! in. What stands on the floor is not painted, only its shadow.

mod areas;
mod lines;
mod material;
mod noise;
mod shade;

use crate::world::World;
use areas::Grounds;
use lines::Lines;
use material::{Material, PieceColours};
use senda_core::memory::prefer_large_pages;
use senda_core::threads::both;
use senda_geom::Vec2;
use shade::{Grid, Rows};
use std::ops::Range;

/// Most texels of a painting (256 MiB). Worlds that need more are painted more coarsely.
pub const TEXEL_BUDGET: usize = 64 << 20;

/// Most texels to a side of a painting: positions along it are counted in 32-bit floats with seven bits to a texel.
pub const LONGEST_SIDE: usize = 60_000;

/// Rows that are painted together: few enough to stay in the processor's cache from the material to the light.
const BAND: usize = 32;

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
    let painter = Painter::new(world, metres_per_texel);
    let Place {
        width,
        height,
        origin,
        metres_per_texel,
        ..
    } = painter.place;
    let mut texels = vec![[0; 4]; width * height];
    prefer_large_pages(&mut texels);
    let middle = height / 2;
    let (upper, lower) = texels.split_at_mut(middle * width);
    let cover = |rows: Range<usize>, texels: &mut [[u8; 4]]| {
        let mut brush = Brush::default();
        for (row, texels) in rows.step_by(BAND).zip(texels.chunks_mut(BAND * width)) {
            let window = Window {
                columns: 0..width,
                rows: row..row + texels.len() / width,
            };
            painter.paint(&window, &mut brush, texels);
        }
    };
    both(
        width * height,
        || cover(0..middle, upper),
        || cover(middle..height, lower),
    );
    FloorPainting {
        width,
        height,
        origin,
        metres_per_texel,
        texels,
        outside: painter.outside(),
    }
}

/// Side of the finest texels (m) that [`TEXEL_BUDGET`] and [`LONGEST_SIDE`] allow a floor of a size (m).
pub fn finest_texel_m(size: Vec2) -> f64 {
    let by_area_m = (size.x * size.y / (TEXEL_BUDGET as f64 * 0.98)).sqrt();
    by_area_m.max(size.max_element() / (LONGEST_SIDE as f64 * 0.98))
}

/// A floor that is ready to be painted, window by window: whoever sees only part of it need not paint the rest.
#[derive(Debug)]
pub struct Painter {
    place: Place,
    material: Material,
    grounds: Grounds,
    lines: Lines,
    grid: Grid,
}

/// Texels of a painting: columns along x, rows along y.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Window {
    /// Along x.
    pub columns: Range<usize>,
    /// Along y.
    pub rows: Range<usize>,
}

/// Working memory of whoever paints, reused from window to window.
#[derive(Debug, Default)]
pub struct Brush {
    pieces: PieceColours,
    crossings: Vec<f64>,
    rows: Rows,
}

/// Where a painting's texels lie.
#[derive(Debug, Clone, Copy)]
struct Place {
    width: usize,
    height: usize,
    origin: Vec2,
    /// The origin, counted in texels.
    first: [i64; 2],
    metres_per_texel: f64,
}

/// The texels of a window while they are painted.
struct Canvas<'a> {
    place: &'a Place,
    window: &'a Window,
    texels: &'a mut [[u8; 4]],
}

impl Painter {
    /// For the painting that [`paint`] would make.
    pub fn new(world: &World, metres_per_texel: f64) -> Self {
        let place = Place::new(world, metres_per_texel);
        let (mut material, mut grid) = (None, None);
        both(
            place.width * place.height,
            || material = Some(Material::new(&world.floor, place.metres_per_texel)),
            || grid = Some(Grid::new(world, &place)),
        );
        Self {
            material: material.expect("made above"),
            grounds: Grounds::new(world, &place),
            lines: Lines::new(world, &place),
            grid: grid.expect("made above"),
            place,
        }
    }

    /// Texels along x and y.
    pub fn size(&self) -> (usize, usize) {
        (self.place.width, self.place.height)
    }

    /// As [`FloorPainting::origin`].
    pub fn origin(&self) -> Vec2 {
        self.place.origin
    }

    /// As [`FloorPainting::metres_per_texel`].
    pub fn metres_per_texel(&self) -> f64 {
        self.place.metres_per_texel
    }

    /// Whether any texel may be glossy.
    pub fn may_be_glossy(&self) -> bool {
        self.material.gloss() > 0 || self.lines.are_glossy()
    }

    /// Paints the texels of a window, row by row.
    ///
    /// # Panics
    /// When the window reaches beyond the painting or does not have as many texels.
    pub fn paint(&self, window: &Window, brush: &mut Brush, texels: &mut [[u8; 4]]) {
        assert!(
            window.columns.end <= self.place.width && window.rows.end <= self.place.height,
            "a window lies within its painting"
        );
        assert_eq!(texels.len(), window.columns.len() * window.rows.len());
        if texels.is_empty() {
            return;
        }
        let first = self.place.first[0] + window.columns.start as i64;
        for (row, texels) in (window.rows.clone()).zip(texels.chunks_exact_mut(window.columns.len())) {
            let row = self.place.first[1] + row as i64;
            self.material.row(&mut brush.pieces, texels, first, row);
        }
        let mut canvas = Canvas {
            place: &self.place,
            window,
            texels,
        };
        self.grounds.paint(&mut canvas, &mut brush.crossings);
        self.lines.paint(&mut canvas);
        self.grid.light_up(&mut canvas, &mut brush.rows);
    }

    /// As [`FloorPainting::outside`]: the mean of the painting's outermost texels.
    pub fn outside(&self) -> [u8; 4] {
        let Place { width, height, .. } = self.place;
        let (mut brush, mut texels) = (Brush::default(), Vec::new());
        let (mut sums, mut count) = ([0u64; 4], 0u64);
        for (columns, rows) in [
            (0..width, 0..1),
            (0..width, height - 1..height),
            (0..1, 0..height),
            (width - 1..width, 0..height),
        ] {
            let window = Window { columns, rows };
            texels.resize(window.columns.len() * window.rows.len(), [0; 4]);
            self.paint(&window, &mut brush, &mut texels);
            for texel in &texels {
                for (sum, value) in sums.iter_mut().zip(texel) {
                    *sum += u64::from(*value);
                }
            }
            count += texels.len() as u64;
        }
        sums.map(|sum| ((sum + count / 2) / count) as u8)
    }
}

impl Place {
    fn new(world: &World, metres_per_texel: f64) -> Self {
        let (low, high) = world.bounds();
        let metres_per_texel = metres_per_texel
            .max(world.texel_m)
            .max(finest_texel_m(high - low))
            .max(1e-5);
        // Texels lie on a lattice through the world's origin, so that the same place looks the same at any margin.
        let first_column = (low.x / metres_per_texel).floor();
        let first_row = (low.y / metres_per_texel).floor();
        let count = |far: f64, first: f64| ((far / metres_per_texel).ceil() - first).max(1.0) as usize;
        Self {
            width: count(high.x, first_column),
            height: count(high.y, first_row),
            origin: Vec2::new(first_column, first_row) * metres_per_texel,
            first: [first_column as i64, first_row as i64],
            metres_per_texel,
        }
    }

    /// The columns between two places along x, as far as they lie in a window.
    fn columns(&self, low: f64, high: f64, window: &Window) -> Range<usize> {
        let column = |x: f64| ((x - self.origin.x) / self.metres_per_texel).floor().max(0.0) as usize;
        within(column(low)..column(high), &window.columns)
    }
}

/// The part of a range that lies in another.
fn within(range: Range<usize>, all: &Range<usize>) -> Range<usize> {
    let start = range.start.clamp(all.start, all.end);
    start..range.end.clamp(start, all.end)
}

impl Canvas<'_> {
    /// The texel in a column and row of the painting, which must lie in the window.
    fn texel(&mut self, column: usize, row: usize) -> &mut [u8; 4] {
        let from = (row - self.window.rows.start) * self.window.columns.len();
        &mut self.texels[from + column - self.window.columns.start]
    }
}

#[cfg(test)]
mod tests;
