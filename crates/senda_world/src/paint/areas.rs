//! Patches of ground and the shade under trees, painted before the path's markings.

use super::material::blend;
use super::noise::{clouds, fold, hash, smooth, unit, value};
use super::{Canvas, Place, within};
use crate::landscape::{Area, Tree};
use crate::world::World;
use senda_geom::{Vec2, trig};
use std::ops::Range;

/// All areas and the shade of all trees.
#[derive(Debug)]
pub(super) struct Grounds {
    areas: Vec<Patch>,
    shades: Vec<Shade>,
    /// How dark the shade is.
    strength: f32,
}

/// An area with its shore.
#[derive(Debug)]
struct Patch {
    area: Area,
    seed: u32,
    shore: Vec<Vec2>,
}

/// A soft blot where a tree keeps the sun off, and its foot.
#[derive(Debug)]
struct Shade {
    tree: Tree,
    /// Where the crown's shadow falls.
    crown: Vec2,
    /// The texels that it may touch.
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Grounds {
    pub(super) fn new(world: &World, place: &Place) -> Self {
        let patch = |(number, area): (usize, &Area)| {
            let seed = hash(number as i32, 1, world.floor.seed as u32);
            Patch {
                area: area.clone(),
                seed,
                shore: ragged_shore(area, seed),
            }
        };
        let (sin, cos) = trig::sincos(world.light.direction_rad);
        let slope = 1.0 / trig::tan(world.light.elevation_rad.clamp(0.3, 1.56));
        // The crown's middle stands at two thirds of the height.
        let shade = |tree: Tree| {
            let crown = tree.position - Vec2::new(cos, sin) * (slope * tree.height_m * 0.66);
            Shade::new(tree, crown, place)
        };
        let shades = if world.light.thing_shadows > 0.0 {
            let trees = world.landscape.trees(&world.path);
            trees.into_iter().map(shade).collect()
        } else {
            Vec::new()
        };
        Self {
            areas: world.landscape.areas.iter().enumerate().map(patch).collect(),
            shades,
            strength: world.light.thing_shadows as f32,
        }
    }

    /// Paints onto a floor that has no light on it yet.
    pub(super) fn paint(&self, canvas: &mut Canvas<'_>, crossings: &mut Vec<f64>) {
        for patch in &self.areas {
            patch.paint(canvas, crossings);
        }
        for shade in &self.shades {
            shade.paint(self.strength, canvas);
        }
    }
}

impl Patch {
    /// Row by row between the crossings of the shore with the row.
    fn paint(&self, canvas: &mut Canvas<'_>, crossings: &mut Vec<f64>) {
        let (place, window, shore) = (canvas.place, canvas.window, &self.shore);
        let texel_m = place.metres_per_texel;
        let (low, high) = shore
            .iter()
            .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), p| {
                (low.min(*p), high.max(*p))
            });
        if place.columns(low.x, high.x + 2.0 * texel_m, window).is_empty() {
            return;
        }
        let row = |y: f64| ((y - place.origin.y) / texel_m).floor().max(0.0) as usize;
        for j in within(row(low.y)..row(high.y + texel_m), &window.rows) {
            let y = place.origin.y + (j as f64 + 0.5) * texel_m;
            crossings.clear();
            for (i, a) in shore.iter().enumerate() {
                let b = shore[if i + 1 < shore.len() { i + 1 } else { 0 }];
                if (a.y > y) != (b.y > y) {
                    crossings.push((a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x) - place.origin.x) / texel_m);
                }
            }
            crossings.sort_unstable_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let (from, to) = (pair[0].max(0.0), pair[1].min(place.width as f64));
                if to <= from {
                    continue;
                }
                for i in within(from as usize..to.ceil() as usize, &window.columns) {
                    let at = i as f64;
                    let cover = (at + 1.0).min(to) - at.max(from);
                    let x = place.origin.x + (at + 0.5) * texel_m;
                    let texel = canvas.texel(i, j);
                    *texel = blend(
                        *texel,
                        ground(&self.area, self.seed, x, y),
                        cover.clamp(0.0, 1.0) as f32,
                    );
                }
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

impl Shade {
    fn new(tree: Tree, crown: Vec2, place: &Place) -> Self {
        // From the foot to the crown's shadow: a capsule that is thin where the trunk is.
        let reach = 0.55 * tree.width_m * 1.3;
        let low = (tree.position.min(crown) - Vec2::splat(reach) - place.origin) / place.metres_per_texel;
        let high = (tree.position.max(crown) + Vec2::splat(reach) - place.origin) / place.metres_per_texel;
        let range = |low: f64, high: f64, most: usize| {
            (low.max(0.0) as usize).min(most)..(high.ceil().max(0.0) as usize).min(most)
        };
        Self {
            columns: range(low.x, high.x, place.width),
            rows: range(low.y, high.y, place.height),
            tree,
            crown,
        }
    }

    fn paint(&self, strength: f32, canvas: &mut Canvas<'_>) {
        let (place, window) = (canvas.place, canvas.window);
        let (tree, crown) = (&self.tree, self.crown);
        let columns = within(self.columns.clone(), &window.columns);
        if columns.is_empty() {
            return;
        }
        let radius_m = 0.55 * tree.width_m;
        let seed = fold(u64::from(tree.seed), 3);
        let along = crown - tree.position;
        for j in within(self.rows.clone(), &window.rows) {
            for i in columns.clone() {
                let at = place.origin + Vec2::new(i as f64 + 0.5, j as f64 + 0.5) * place.metres_per_texel;
                let part =
                    ((at - tree.position).dot(along) / along.length_squared().max(1e-6)).clamp(0.0, 1.0);
                let away_m = (at - tree.position - along * part).length();
                let size_m = if part < 0.45 { 0.12 } else { radius_m };
                let trunk = smooth(((size_m.min(0.2) - away_m) / 0.2 + 0.5) as f32);
                let rough = clouds(at.x / 0.8, at.y / 0.8, seed) * 0.7 + 0.65;
                let leaves_m = (at - crown).length() as f32 / (radius_m as f32 * rough);
                let leaves = smooth((1.0 - leaves_m) * 2.5);
                let dark =
                    strength * trunk.max(leaves) * (0.85 + 0.15 * unit(hash(i as i32, j as i32, seed)));
                if dark > 0.01 {
                    let texel = canvas.texel(i, j);
                    let [r, g, b, gloss] = *texel;
                    *texel = blend([r, g, b, gloss], [r / 4, g / 4, b / 3, gloss], dark);
                }
            }
        }
    }
}
