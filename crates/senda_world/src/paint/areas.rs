//! Patches of ground and the shade under trees, painted before the path's markings.

use super::FloorPainting;
use super::material::blend;
use super::noise::{clouds, fold, hash, smooth, unit, value};
use crate::landscape::{Area, Tree};
use crate::world::World;
use senda_geom::{Vec2, trig};

/// Paints all areas and the shade of all trees onto a floor that has no light on it yet.
pub(super) fn paint_areas(world: &World, painting: &mut FloorPainting) {
    for (number, area) in world.landscape.areas.iter().enumerate() {
        paint_area(area, hash(number as i32, 1, world.floor.seed as u32), painting);
    }
    if world.light.thing_shadows > 0.0 {
        let (sin, cos) = trig::sincos(world.light.direction_rad);
        let slope = 1.0 / trig::tan(world.light.elevation_rad.clamp(0.3, 1.56));
        for tree in world.landscape.trees(&world.path) {
            // The crown's middle stands at two thirds of the height.
            let crown = tree.position - Vec2::new(cos, sin) * (slope * tree.height_m * 0.66);
            paint_shade(&tree, crown, world.light.thing_shadows as f32, painting);
        }
    }
}

/// Row by row between the crossings of the shore with the row.
fn paint_area(area: &Area, seed: u32, painting: &mut FloorPainting) {
    let shore = ragged_shore(area, seed);
    let texel_m = painting.metres_per_texel;
    let (low, high) = shore
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
            (low.min(p.y), high.max(p.y))
        });
    let row = |y: f64| (((y - painting.origin.y) / texel_m).floor().max(0.0) as usize).min(painting.height);
    let mut crossings = Vec::new();
    for j in row(low)..row(high + texel_m) {
        let y = painting.origin.y + (j as f64 + 0.5) * texel_m;
        crossings.clear();
        for (i, a) in shore.iter().enumerate() {
            let b = shore[(i + 1) % shore.len()];
            if (a.y > y) != (b.y > y) {
                crossings.push((a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x) - painting.origin.x) / texel_m);
            }
        }
        crossings.sort_unstable_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let (from, to) = (pair[0].max(0.0), pair[1].min(painting.width as f64));
            if to <= from {
                continue;
            }
            for i in from as usize..(to.ceil() as usize).min(painting.width) {
                let at = i as f64;
                let cover = (at + 1.0).min(to) - at.max(from);
                let x = painting.origin.x + (at + 0.5) * texel_m;
                let texel = &mut painting.texels[j * painting.width + i];
                *texel = blend(*texel, ground(area, seed, x, y), cover.clamp(0.0, 1.0) as f32);
            }
        }
    }
}

/// The shore with its unevenness: slow bays and short bites.
fn ragged_shore(area: &Area, seed: u32) -> Vec<Vec2> {
    let shore = area.shore();
    let count = shore.len();
    (0..count)
        .map(|i| {
            let (before, after) = (shore[(i + count - 1) % count], shore[(i + 1) % count]);
            let normal = (after - before).normalize_or_zero().perp();
            let at = shore[i] / (area.ragged_m.max(0.1) * 6.0);
            let slow = f64::from(value(at.x, at.y, seed ^ 0x51)) - 0.5;
            let short = f64::from(value(at.x * 5.0, at.y * 5.0, seed ^ 0x52)) - 0.5;
            shore[i] + normal * (area.ragged_m * (1.4 * slow + 0.6 * short))
        })
        .collect()
}

/// The ground's colour at a place.
fn ground(area: &Area, seed: u32, x: f64, y: f64) -> [u8; 4] {
    let scale = 1.0 / area.scale_m;
    let slow = value(x * scale, y * scale, seed);
    let fast = value(x * scale * 6.0, y * scale * 9.0, seed ^ 7);
    let part = (0.7 * slow + 0.3 * fast).clamp(0.0, 1.0);
    let [r, g, b] = std::array::from_fn(|c| {
        let (main, other) = (
            f32::from(area.colour.rgb[c]),
            f32::from(area.second_colour.rgb[c]),
        );
        (main + (other - main) * part).round() as u8
    });
    [r, g, b, 0]
}

/// A soft blot where a tree keeps the sun off, and its foot.
fn paint_shade(tree: &Tree, crown: Vec2, strength: f32, painting: &mut FloorPainting) {
    let texel_m = painting.metres_per_texel;
    let radius_m = 0.55 * tree.width_m;
    let seed = fold(u64::from(tree.seed), 3);
    // From the foot to the crown's shadow: a capsule that is thin where the trunk is.
    let along = crown - tree.position;
    let reach = radius_m * 1.3;
    let low = (tree.position.min(crown) - Vec2::splat(reach) - painting.origin) / texel_m;
    let high = (tree.position.max(crown) + Vec2::splat(reach) - painting.origin) / texel_m;
    let range = |low: f64, high: f64, most: usize| {
        (low.max(0.0) as usize).min(most)..(high.ceil().max(0.0) as usize).min(most)
    };
    for j in range(low.y, high.y, painting.height) {
        for i in range(low.x, high.x, painting.width) {
            let at = painting.origin + Vec2::new(i as f64 + 0.5, j as f64 + 0.5) * texel_m;
            let part = ((at - tree.position).dot(along) / along.length_squared().max(1e-6)).clamp(0.0, 1.0);
            let away_m = (at - tree.position - along * part).length();
            let size_m = if part < 0.45 { 0.12 } else { radius_m };
            let trunk = smooth(((size_m.min(0.2) - away_m) / 0.2 + 0.5) as f32);
            let rough = clouds(at.x / 0.8, at.y / 0.8, seed) * 0.7 + 0.65;
            let leaves_m = (at - crown).length() as f32 / (radius_m as f32 * rough);
            let leaves = smooth((1.0 - leaves_m) * 2.5);
            let dark = strength * trunk.max(leaves) * (0.85 + 0.15 * unit(hash(i as i32, j as i32, seed)));
            if dark > 0.01 {
                let texel = &mut painting.texels[j * painting.width + i];
                let [r, g, b, gloss] = *texel;
                *texel = blend([r, g, b, gloss], [r / 4, g / 4, b / 3, gloss], dark);
            }
        }
    }
}
