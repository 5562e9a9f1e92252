//! Static light on the floor, and the floor's own large-scale unevenness, as one coarse grid of factors.

use super::FloorPainting;
use super::noise::{clouds, fold, smooth, value};
use crate::floor::FloorKind;
use crate::light::Light;
use crate::thing::Thing;
use crate::world::World;
use senda_core::threads::both;
use senda_geom::{Vec2, trig};

/// Grid points stand this far apart (m) unless the floor is very large.
const GRID_M: f64 = 0.025;
/// … so that there are at most this many.
const GRID_POINTS: f64 = 200_000.0;
/// The painting is encoded with this exponent: multiplying encoded values multiplies light.
const GAMMA: f64 = 2.2;
/// Fixed-point one of a factor.
const ONE: f32 = 65_535.0;

/// The factors of a painting.
pub(super) struct Grid {
    columns: usize,
    /// Spacing in texels.
    step: f64,
    rows: usize,
    /// Encoded factors 0..=[`ONE`]: red, green, blue, and 1 for gloss.
    factors: Vec<[f32; 4]>,
}

/// Multiplies light and unevenness into a painting, and sets its outside colour.
pub(super) fn light_up(grid: &Grid, painting: &mut FloorPainting) {
    let (width, height) = (painting.width, painting.height);
    let middle = grid.rows / 2;
    let row = grid.first_row(middle, height);
    let (upper, lower) = painting.texels.split_at_mut(row * width);
    both(
        width * height,
        || grid.light_up(0..middle, width, height, upper),
        || grid.light_up(middle..grid.rows - 1, width, height, lower),
    );
    painting.outside = border_mean(painting);
}

impl Grid {
    /// For a painting of this size and place; its texels are not looked at.
    pub(super) fn new(world: &World, painting: &FloorPainting) -> Self {
        let texel_m = painting.metres_per_texel;
        let (width_m, height_m) = (painting.width as f64 * texel_m, painting.height as f64 * texel_m);
        let spacing_m = GRID_M.max((width_m * height_m / GRID_POINTS).sqrt()).max(texel_m);
        let step = spacing_m / texel_m;
        let columns = (painting.width as f64 / step).ceil() as usize + 2;
        let rows = (painting.height as f64 / step).ceil() as usize + 2;
        let sun = Sun::new(&world.light, painting, width_m, height_m);
        let mut light = Vec::with_capacity(columns * rows);
        let mut brightest = 1e-6f32;
        for row in 0..rows {
            for column in 0..columns {
                let at = painting.origin + Vec2::new(column as f64, row as f64) * spacing_m;
                let value = light_at(world, &sun, at);
                brightest = brightest.max(value[0]).max(value[1]).max(value[2]);
                light.push(value);
            }
        }
        let encode = encoding();
        let seed = fold(world.floor.seed, 9);
        let (cloud_strength, cloud_m) = unevenness(world);
        let mut factors = Vec::with_capacity(light.len());
        for row in 0..rows {
            for column in 0..columns {
                let at = (painting.origin + Vec2::new(column as f64, row as f64) * spacing_m) / cloud_m;
                let cloud = 1.0 - cloud_strength * clouds(at.x, at.y, seed);
                let value = light[row * columns + column];
                let factor = |c: usize| {
                    let index = (value[c] / brightest * (encode.len() - 1) as f32) as usize;
                    encode[index.min(encode.len() - 1)] * cloud * ONE
                };
                factors.push([factor(0), factor(1), factor(2), ONE]);
            }
        }
        Self {
            columns,
            rows,
            step,
            factors,
        }
    }

    /// The first row of texels of a row of cells, of a painting `height` rows high.
    fn first_row(&self, cell: usize, height: usize) -> usize {
        if cell == 0 {
            return 0;
        }
        ((cell as f64 * self.step - 0.5).ceil() as usize).min(height)
    }

    /// Lights the texels of some rows of cells.
    fn light_up(&self, cells: std::ops::Range<usize>, width: usize, height: usize, texels: &mut [[u8; 4]]) {
        let mut rows = texels.chunks_exact_mut(width);
        let (mut low, mut high) = (vec![[0.0f32; 4]; width], vec![[0.0f32; 4]; width]);
        let (mut factors, mut slopes) = (vec![0u16; width * 4], vec![0i16; width * 4]);
        let mut expanded = usize::MAX;
        for cell in cells {
            let (row, end) = (self.first_row(cell, height), self.first_row(cell + 1, height));
            if row >= end {
                continue;
            }
            // The row above the last cell is the row below this one, unless cells were skipped.
            if expanded == cell {
                std::mem::swap(&mut low, &mut high);
            } else {
                expand(self, cell, &mut low);
            }
            expand(self, cell + 1, &mut high);
            expanded = cell + 1;
            let part = ((row as f64 + 0.5) / self.step - cell as f64) as f32;
            let (lows, highs) = (low.as_flattened(), high.as_flattened());
            for k in 0..width * 4 {
                let rise = highs[k] - lows[k];
                factors[k] = (lows[k] + rise * part).clamp(0.0, ONE) as u16;
                slopes[k] = (rise / self.step as f32) as i16;
            }
            for texels in rows.by_ref().take(end - row) {
                // 16-bit lanes on purpose: this loop becomes one multiplication for eight channels.
                for ((byte, factor), slope) in texels
                    .as_flattened_mut()
                    .iter_mut()
                    .zip(&mut factors)
                    .zip(&slopes)
                {
                    let product = (u32::from(u16::from(*byte) << 8) * u32::from(*factor)) >> 16;
                    *byte = ((product as u16).saturating_add(128) >> 8) as u8;
                    *factor = factor.saturating_add_signed(*slope);
                }
            }
        }
    }
}

/// Mean of the painting's outermost texels: what goes on beyond them.
fn border_mean(painting: &FloorPainting) -> [u8; 4] {
    let (width, height) = (painting.width, painting.height);
    let rows = painting.texels[..width]
        .iter()
        .chain(&painting.texels[width * (height - 1)..]);
    let columns = (0..height).flat_map(|j| {
        [
            &painting.texels[j * width],
            &painting.texels[j * width + width - 1],
        ]
    });
    let (mut sums, mut count) = ([0u64; 4], 0u64);
    for texel in rows.chain(columns) {
        for (sum, value) in sums.iter_mut().zip(texel) {
            *sum += u64::from(*value);
        }
        count += 1;
    }
    sums.map(|sum| ((sum + count / 2) / count) as u8)
}

/// One row of the grid, linear between its points, one value a texel.
fn expand(grid: &Grid, row: usize, out: &mut [[f32; 4]]) {
    let points = &grid.factors[row * grid.columns..][..grid.columns];
    for (i, value) in out.iter_mut().enumerate() {
        let at = ((i as f64 + 0.5) / grid.step) as f32;
        let column = at as usize;
        let part = at - column as f32;
        let (a, b) = (&points[column], &points[column + 1]);
        *value = std::array::from_fn(|c| a[c] + (b[c] - a[c]) * part);
    }
}

/// Strength and size (m) of the slow unevenness of a floor's colour.
fn unevenness(world: &World) -> (f32, f64) {
    let floor = &world.floor;
    let contrast = floor.contrast as f32;
    match floor.kind {
        FloorKind::Plain => (0.28 * contrast, floor.scale_m.max(0.02)),
        FloorKind::Speckled => (0.06 * contrast, 0.3),
        FloorKind::Wood => (0.05 * contrast, 0.4),
        FloorKind::Tiles => (0.10 * contrast, 0.25),
        FloorKind::Carpet => (0.16 * contrast, 0.18),
        FloorKind::Grass => (0.3 * contrast, floor.scale_m),
    }
}

/// Encoded value of linear light, as a table: 4,096 steps are finer than 8 bits can show.
fn encoding() -> Vec<f32> {
    (0..4096)
        .map(|i| trig::pow(f64::from(i) / 4095.0, 1.0 / GAMMA) as f32)
        .collect()
}

/// Linear value of an encoded channel 0..=255, as a part of white.
fn linear(channel: u8) -> f32 {
    trig::pow(f64::from(channel) / 255.0, GAMMA) as f32
}

/// What of the light is the same everywhere.
struct Sun {
    ambient: [f32; 3],
    /// Brightness falls along this direction: (position - middle)·slope.
    slope: Vec2,
    middle: Vec2,
    /// Lamp colours, linear.
    lamps: Vec<[f32; 3]>,
    /// Where a shadow falls, per metre of height.
    shadow: Vec2,
}

impl Sun {
    fn new(light: &Light, painting: &FloorPainting, width_m: f64, height_m: f64) -> Self {
        let (sin, cos) = trig::sincos(light.direction_rad);
        let towards = Vec2::new(cos, sin);
        let reach_m = 0.5 * (width_m * cos.abs() + height_m * sin.abs());
        let colour = |rgb: [u8; 3], strength: f64| rgb.map(|c| linear(c) * strength as f32);
        Self {
            ambient: colour(light.colour.rgb, light.ambient),
            slope: towards * (0.5 * light.gradient / reach_m.max(1e-6)),
            middle: painting.origin + Vec2::new(width_m, height_m) * 0.5,
            lamps: light
                .lamps
                .iter()
                .map(|lamp| colour(lamp.colour.rgb, lamp.strength))
                .collect(),
            shadow: -towards / trig::tan(light.elevation_rad.clamp(0.05, 1.56)),
        }
    }
}

/// Linear light at a place, before scaling to the brightest place.
fn light_at(world: &World, sun: &Sun, at: Vec2) -> [f32; 3] {
    let light = &world.light;
    // From 1 at the bright side to 1 - gradient at the dark one.
    let gradient = (1.0 - 0.5 * light.gradient + (at - sun.middle).dot(sun.slope)) as f32;
    let mut shade = gradient;
    if let Some(shadows) = light.shadows {
        let seed = fold(shadows.seed, 31);
        // Blobs (people, furniture) and bars (window frames) in one field.
        let scale = 1.0 / shadows.scale_m;
        let blob = clouds(at.x * scale * 0.8, at.y * scale * 0.8, seed);
        let bar = value(
            (at.x * 0.8 + at.y * 0.6) * scale * 1.3,
            (at.y * 0.8 - at.x * 0.6) * scale * 0.25,
            seed ^ 4,
        );
        let softness = 0.02 + 0.30 * shadows.softness as f32;
        let dark = smooth((0.6 * blob + 0.4 * bar - 0.5) / softness + 0.5);
        shade *= 1.0 - shadows.strength as f32 * dark;
    }
    if light.thing_shadows > 0.0 {
        for thing in &world.things {
            let dark = thing_shadow(thing, sun.shadow, at);
            shade *= 1.0 - light.thing_shadows as f32 * dark;
        }
    }
    let mut sum = sun.ambient.map(|c| c * shade);
    for (lamp, colour) in light.lamps.iter().zip(&sun.lamps) {
        let away = (at - lamp.position()).length_squared();
        let square = lamp.height_m * lamp.height_m;
        // Lambert: cos θ / r², relative to the place right below.
        let part = square / (square + away);
        let pool = (part * part) as f32;
        for c in 0..3 {
            sum[c] += colour[c] * pool;
        }
    }
    sum
}

/// How deep a place lies in a thing's shadow, 0 ..= 1: its footprint swept along the shadow's direction.
fn thing_shadow(thing: &Thing, shadow: Vec2, at: Vec2) -> f32 {
    let reach = shadow * (thing.bottom_m + thing.height_m);
    let from = shadow * thing.bottom_m;
    let size_m = thing.footprint().iter().fold(0.0f64, |size, corner| {
        size.max((*corner - thing.pose.position()).length())
    });
    let middle = thing.pose.position() + (from + reach) * 0.5;
    let around_m = size_m + (reach - from).length() * 0.5 + 0.05;
    if (at - middle).length_squared() > around_m * around_m {
        return 0.0;
    }
    let corners = thing.footprint();
    let mut nearest_m = f64::INFINITY;
    // The distance to the swept footprint, sampled along the sweep: edges are soft anyway.
    let steps = ((reach - from).length() / 0.02).ceil().clamp(1.0, 40.0) as usize;
    for k in 0..=steps {
        let shift = from + (reach - from) * (k as f64 / steps as f64);
        nearest_m = nearest_m.min(outside_distance(&corners, at - shift));
    }
    1.0 - smooth((nearest_m / 0.035) as f32)
}

/// Distance from a convex, counter-clockwise polygon (0 inside); two corners are a segment.
fn outside_distance(corners: &[Vec2], at: Vec2) -> f64 {
    let mut inside = corners.len() > 2;
    let mut nearest = f64::INFINITY;
    for (i, a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let (edge, away) = (b - *a, at - *a);
        if edge.perp_dot(away) < 0.0 {
            inside = false;
        }
        let part = (away.dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        nearest = nearest.min((away - edge * part).length());
    }
    if inside { 0.0 } else { nearest }
}
