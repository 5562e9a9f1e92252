//! Static light on the floor, and the floor's own large-scale unevenness, as one coarse grid of factors.

use super::noise::{clouds, fold, smooth, value};
use super::{Canvas, Place};
use crate::floor::FloorKind;
use crate::light::Light;
use crate::thing::Thing;
use crate::world::World;
use senda_geom::{Vec2, trig};
use std::ops::Range;

/// Grid points stand this far apart (m) unless the floor is very large.
const GRID_M: f64 = 0.025;
/// … so that there are at most this many.
const GRID_POINTS: f64 = 200_000.0;
/// The painting is encoded with this exponent: multiplying encoded values multiplies light.
const GAMMA: f64 = 2.2;
/// Fixed-point one of a factor.
const ONE: f32 = 65_535.0;

/// What light and unevenness do to a painting: factors at the points of a grid, linear in between.
#[derive(Debug)]
pub(super) struct Grid {
    origin: Vec2,
    /// Spacing in texels and in metres.
    step: f64,
    spacing_m: f64,
    /// Rows of the painting.
    height: usize,
    sun: Sun,
    /// Light of the brightest grid point's brightest channel: what is shown as 1.
    brightest: f32,
    encode: Vec<f32>,
    /// The floor's unevenness: strength, size (m) and seed.
    cloud_strength: f32,
    cloud_m: f64,
    cloud_seed: u32,
}

/// Working memory for the rows of a window.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// Factors at the grid's points.
    points: Vec<[f32; 4]>,
    /// Factors of all columns on the grid's row above and on that below: red, green, blue, and 1 for gloss.
    low: Vec<[f32; 4]>,
    high: Vec<[f32; 4]>,
    factors: Vec<u16>,
    slopes: Vec<i16>,
}

impl Grid {
    pub(super) fn new(world: &World, place: &Place) -> Self {
        let texel_m = place.metres_per_texel;
        let (width_m, height_m) = (place.width as f64 * texel_m, place.height as f64 * texel_m);
        let spacing_m = GRID_M.max((width_m * height_m / GRID_POINTS).sqrt()).max(texel_m);
        let step = spacing_m / texel_m;
        let (cloud_strength, cloud_m) = unevenness(world);
        let mut grid = Self {
            origin: place.origin,
            step,
            spacing_m,
            height: place.height,
            sun: Sun::new(world, place.origin, width_m, height_m),
            brightest: 1e-6,
            encode: encoding(),
            cloud_strength,
            cloud_m,
            cloud_seed: fold(world.floor.seed, 9),
        };
        grid.find_brightest(place);
        grid
    }

    /// Looks at all points, but works the shadows out only where the place would be the brightest without them.
    fn find_brightest(&mut self, place: &Place) {
        let columns = (place.width as f64 / self.step).ceil() as usize + 2;
        let rows = (place.height as f64 / self.step).ceil() as usize + 2;
        let most = |light: [f32; 3]| light[0].max(light[1]).max(light[2]);
        let points = || (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let open = |(column, row)| most(self.sun.without_shadows(self.point(column, row)));
        let lit = |(column, row)| most(self.sun.light_at(self.point(column, row)));
        // The best without shadows first: where no shadow falls on it, no other point is worth a second look.
        let mut best = ((0, 0), f32::NEG_INFINITY);
        for point in points() {
            let light = open(point);
            if light > best.1 {
                best = (point, light);
            }
        }
        let mut brightest = self.brightest.max(lit(best.0));
        if brightest < best.1 {
            for point in points() {
                if open(point) > brightest {
                    brightest = brightest.max(lit(point));
                }
            }
        }
        self.brightest = brightest;
    }

    fn point(&self, column: usize, row: usize) -> Vec2 {
        self.origin + Vec2::new(column as f64, row as f64) * self.spacing_m
    }

    /// Encoded factors 0..=[`ONE`] at a point.
    fn factor(&self, column: usize, row: usize) -> [f32; 4] {
        let point = self.point(column, row);
        let at = point / self.cloud_m;
        let cloud = 1.0 - self.cloud_strength * clouds(at.x, at.y, self.cloud_seed);
        let light = self.sun.light_at(point);
        let last = self.encode.len() - 1;
        let factor = |c: usize| {
            let index = (light[c] / self.brightest * last as f32) as usize;
            self.encode[index.min(last)] * cloud * ONE
        };
        [factor(0), factor(1), factor(2), ONE]
    }

    /// The first row of texels of a row of cells.
    fn first_row(&self, cell: usize) -> usize {
        if cell == 0 {
            return 0;
        }
        ((cell as f64 * self.step - 0.5).ceil() as usize).min(self.height)
    }

    /// The row of cells that a row of texels lies in.
    fn cell_of(&self, row: usize) -> usize {
        let mut cell = ((row as f64 + 0.5) / self.step) as usize;
        while self.first_row(cell) > row {
            cell -= 1;
        }
        while self.first_row(cell + 1) <= row {
            cell += 1;
        }
        cell
    }

    /// Multiplies light and unevenness into a window.
    pub(super) fn light_up(&self, canvas: &mut Canvas<'_>, memory: &mut Rows) {
        let window = canvas.window;
        let width = window.columns.len();
        let Rows {
            points,
            low,
            high,
            factors,
            slopes,
        } = memory;
        low.resize(width, [0.0; 4]);
        high.resize(width, [0.0; 4]);
        factors.resize(width * 4, 0);
        slopes.resize(width * 4, 0);
        let mut rows = canvas.texels.chunks_exact_mut(width);
        let mut expanded = usize::MAX;
        let mut row = window.rows.start;
        while row < window.rows.end {
            let cell = self.cell_of(row);
            let (first, end) = (
                self.first_row(cell),
                self.first_row(cell + 1).min(window.rows.end),
            );
            // The row above the last cell is the row below this one, unless cells were skipped.
            if expanded == cell {
                std::mem::swap(low, high);
            } else {
                self.expand(cell, &window.columns, points, low);
            }
            self.expand(cell + 1, &window.columns, points, high);
            expanded = cell + 1;
            let part = ((first as f64 + 0.5) / self.step - cell as f64) as f32;
            let (lows, highs) = (low.as_flattened(), high.as_flattened());
            let passed = (row - first) as i32;
            for k in 0..width * 4 {
                let rise = highs[k] - lows[k];
                let at_first = (lows[k] + rise * part).clamp(0.0, ONE) as u16;
                slopes[k] = (rise / self.step as f32) as i16;
                // As many saturating additions as rows have passed.
                let factor = i32::from(at_first) + passed * i32::from(slopes[k]);
                factors[k] = factor.clamp(0, i32::from(u16::MAX)) as u16;
            }
            for texels in rows.by_ref().take(end - row) {
                // 16-bit lanes on purpose: this loop becomes one multiplication for eight channels.
                for ((byte, factor), slope) in texels
                    .as_flattened_mut()
                    .iter_mut()
                    .zip(factors.iter_mut())
                    .zip(slopes.iter())
                {
                    let product = (u32::from(u16::from(*byte) << 8) * u32::from(*factor)) >> 16;
                    *byte = ((product as u16).saturating_add(128) >> 8) as u8;
                    *factor = factor.saturating_add_signed(*slope);
                }
            }
            row = end;
        }
    }

    /// One row of the grid, linear between its points, one value a column of texels.
    fn expand(&self, row: usize, columns: &Range<usize>, points: &mut Vec<[f32; 4]>, out: &mut [[f32; 4]]) {
        let at = |column: usize| ((column as f64 + 0.5) / self.step) as f32;
        let first = at(columns.start) as usize;
        points.clear();
        points.extend((first..=at(columns.end - 1) as usize + 1).map(|column| self.factor(column, row)));
        for (i, value) in columns.clone().zip(out) {
            let at = at(i);
            let column = at as usize;
            let part = at - column as f32;
            let (a, b) = (&points[column - first], &points[column - first + 1]);
            *value = std::array::from_fn(|c| a[c] + (b[c] - a[c]) * part);
        }
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

/// The light on a floor.
#[derive(Debug)]
struct Sun {
    light: Light,
    ambient: [f32; 3],
    /// Brightness falls along this direction: (position - middle)·slope.
    slope: Vec2,
    middle: Vec2,
    /// Lamp colours, linear.
    lamps: Vec<[f32; 3]>,
    /// Shadows of upright things.
    cast: Vec<Cast>,
}

/// The shadow of a thing: its footprint swept along the shadow's direction.
#[derive(Debug)]
struct Cast {
    corners: Vec<Vec2>,
    from: Vec2,
    reach: Vec2,
    /// It lies within this circle: middle, and squared radius (m²).
    middle: Vec2,
    around_square: f64,
}

impl Sun {
    fn new(world: &World, origin: Vec2, width_m: f64, height_m: f64) -> Self {
        let light = &world.light;
        let (sin, cos) = trig::sincos(light.direction_rad);
        let towards = Vec2::new(cos, sin);
        let reach_m = 0.5 * (width_m * cos.abs() + height_m * sin.abs());
        let colour = |rgb: [u8; 3], strength: f64| rgb.map(|c| linear(c) * strength as f32);
        // Where a shadow falls, per metre of height.
        let shadow = -towards / trig::tan(light.elevation_rad.clamp(0.05, 1.56));
        let cast = if light.thing_shadows > 0.0 {
            world
                .things
                .iter()
                .map(|thing| Cast::new(thing, shadow))
                .collect()
        } else {
            Vec::new()
        };
        Self {
            ambient: colour(light.colour.rgb, light.ambient),
            slope: towards * (0.5 * light.gradient / reach_m.max(1e-6)),
            middle: origin + Vec2::new(width_m, height_m) * 0.5,
            lamps: light
                .lamps
                .iter()
                .map(|lamp| colour(lamp.colour.rgb, lamp.strength))
                .collect(),
            cast,
            light: light.clone(),
        }
    }

    /// Linear light at a place, before scaling to the brightest place.
    fn light_at(&self, at: Vec2) -> [f32; 3] {
        let light = &self.light;
        let mut shade = self.gradient(at);
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
        for cast in &self.cast {
            shade *= 1.0 - light.thing_shadows as f32 * cast.dark(at);
        }
        self.with_lamps(shade, at)
    }

    /// The same without any shadow: never less.
    fn without_shadows(&self, at: Vec2) -> [f32; 3] {
        self.with_lamps(self.gradient(at), at)
    }

    /// 1 at the bright side to 1 - gradient at the dark one.
    fn gradient(&self, at: Vec2) -> f32 {
        (1.0 - 0.5 * self.light.gradient + (at - self.middle).dot(self.slope)) as f32
    }

    fn with_lamps(&self, shade: f32, at: Vec2) -> [f32; 3] {
        let mut sum = self.ambient.map(|c| c * shade);
        for (lamp, colour) in self.light.lamps.iter().zip(&self.lamps) {
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
}

impl Cast {
    fn new(thing: &Thing, shadow: Vec2) -> Self {
        let reach = shadow * (thing.bottom_m + thing.height_m);
        let from = shadow * thing.bottom_m;
        let corners = thing.footprint();
        let size_m = corners.iter().fold(0.0f64, |size, corner| {
            size.max((*corner - thing.pose.position()).length())
        });
        let around_m = size_m + (reach - from).length() * 0.5 + 0.05;
        Self {
            middle: thing.pose.position() + (from + reach) * 0.5,
            around_square: around_m * around_m,
            corners,
            from,
            reach,
        }
    }

    /// How deep a place lies in the shadow, 0 ..= 1.
    fn dark(&self, at: Vec2) -> f32 {
        if (at - self.middle).length_squared() > self.around_square {
            return 0.0;
        }
        let (from, reach) = (self.from, self.reach);
        let mut nearest_m = f64::INFINITY;
        // The distance to the swept footprint, sampled along the sweep: edges are soft anyway.
        let steps = ((reach - from).length() / 0.02).ceil().clamp(1.0, 40.0) as usize;
        for k in 0..=steps {
            let shift = from + (reach - from) * (k as f64 / steps as f64);
            nearest_m = nearest_m.min(outside_distance(&self.corners, at - shift));
        }
        1.0 - smooth((nearest_m / 0.035) as f32)
    }
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
