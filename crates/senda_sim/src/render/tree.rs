//! Pictures of trees: a trunk and an uneven crown, with holes to see through.

use senda_geom::trig;
use senda_world::Tree;

/// Texels across and up: a tree is a hundred pixels high at most before the road is left.
pub(super) const COLUMNS: usize = 40;
pub(super) const ROWS: usize = 64;

/// Round parts that a crown consists of.
const BLOBS: usize = 14;

/// Part of the height below the crown.
const TRUNK: f64 = 0.22;

/// The picture, row by row from the top: red, green, blue, and 255 where there is wood or leaves, else 0. Leaves are lit
/// from one side, by `brightness` of white at their brightest.
pub(super) fn picture(tree: &Tree, brightness: [f64; 3]) -> Vec<[u8; 4]> {
    let random = |use_number: u32| unit(tree.seed ^ use_number.wrapping_mul(0x9E37_79B1));
    // Round crowns and tall ones.
    let pointed = random(1);
    let blobs: [[f64; 3]; BLOBS] = std::array::from_fn(|i| {
        let i = i as u32;
        let (up, across) = (random(10 + 3 * i), 2.0 * random(11 + 3 * i) - 1.0);
        let half = half_width(up, pointed);
        let size = 0.10 + 0.16 * random(12 + 3 * i);
        [
            across * (half - 0.5 * size).max(0.0),
            TRUNK + (1.0 - TRUNK) * (0.1 + 0.8 * up),
            size,
        ]
    });
    let leaf = [0, 1, 2].map(|c| f64::from(tree.colour.rgb[c]) * brightness[c]);
    let wood = [0, 1, 2].map(|c| [74.0, 60.0, 46.0][c] * brightness[c]);
    let mut texels = Vec::with_capacity(COLUMNS * ROWS);
    for row in 0..ROWS {
        let up = 1.0 - (row as f64 + 0.5) / ROWS as f64;
        for column in 0..COLUMNS {
            let across = ((column as f64 + 0.5) / COLUMNS as f64 - 0.5) * 2.0;
            let grain = unit(tree.seed ^ ((row * COLUMNS + column) as u32 + 977).wrapping_mul(0x85EB_CA77));
            // Deepest inside any of the blobs; heights count more, as the picture is higher than wide. The exact
            // distance, which is slow, decides only between those that are the deepest to within rounding.
            let away = |[x, y, _]: &[f64; 3]| ((across - x) * 0.55, up - y);
            let mut rough = [0.0; BLOBS];
            for (depth, blob) in rough.iter_mut().zip(&blobs) {
                let (x, y) = away(blob);
                *depth = 1.0 - (x * x + y * y).sqrt() / blob[2];
            }
            let deepest = rough.iter().fold(-1.0f64, |deepest, depth| deepest.max(*depth));
            let depth = blobs
                .iter()
                .zip(rough)
                .filter(|(_, rough)| *rough > deepest - 1e-9)
                .map(|(blob, _)| {
                    let (x, y) = away(blob);
                    1.0 - trig::hypot(x, y) / blob[2]
                })
                .fold(-1.0f64, f64::max);
            let light = 0.62 + 0.30 * up - 0.14 * across + 0.25 * (grain - 0.5);
            let byte = |value: f64| value.round().clamp(0.0, 255.0) as u8;
            let (colour, solid) = if depth > 0.28 * grain {
                (leaf.map(|c| byte(c * light)), 255)
            } else if up < TRUNK + 0.1 && across.abs() < 0.07 {
                (wood.map(|c| byte(c * (0.8 - 0.5 * across))), 255)
            } else {
                (leaf.map(|c| byte(c * 0.7)), 0)
            };
            texels.push([colour[0], colour[1], colour[2], solid]);
        }
    }
    texels
}

/// Half the crown's width at a height 0..=1 within it, 1 the picture's.
fn half_width(up: f64, pointed: f64) -> f64 {
    let round = (1.0 - (2.0 * up - 0.9) * (2.0 * up - 0.9)).max(0.0).sqrt();
    let tall = 0.75 * (1.0 - up);
    round + (tall - round) * pointed
}

/// A number in [0, 1) from a seed (finaliser of MurmurHash3).
fn unit(seed: u32) -> f64 {
    let mut h = seed;
    h ^= h >> 16;
    h = h.wrapping_mul(0x85EB_CA6B);
    h ^= h >> 13;
    h = h.wrapping_mul(0xC2B2_AE35);
    h ^= h >> 16;
    f64::from(h >> 8) / f64::from(1u32 << 24)
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_geom::Vec2;
    use senda_world::Colour;

    #[test]
    fn a_tree_has_a_crown_a_trunk_and_sky_around_it() {
        for seed in 0..20 {
            let tree = Tree {
                position: Vec2::ZERO,
                height_m: 8.0,
                width_m: 4.0,
                colour: Colour::new(60, 90, 50),
                seed,
            };
            let texels = picture(&tree, [1.0; 3]);
            let solid = |row: usize, column: usize| texels[row * COLUMNS + column][3] == 255;
            let share = texels.iter().filter(|t| t[3] == 255).count() as f64 / texels.len() as f64;
            assert!((0.12..0.75).contains(&share), "{seed}: {share}");
            assert!(solid(ROWS - 1, COLUMNS / 2), "it stands on its trunk");
            assert!(!solid(ROWS - 1, 0) && !solid(0, 0) && !solid(0, COLUMNS - 1));
        }
    }
}
