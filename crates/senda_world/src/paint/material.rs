//! What the floor is made of: one small picture per material, repeated with changing offsets, row by row.

use super::noise::{fold, hash, smooth, tiling_value, unit};
use crate::colour::Colour;
use crate::floor::{Floor, FloorKind};

/// A texel of the painting: red, green, blue, gloss.
type Texel = [u8; 4];

/// Paints the rows of a floor. Texel (i, j) is `origin + (i, j)` of an endless floor, so a larger rectangle of the same
/// world shows the same floor.
pub(super) struct Material<'a> {
    floor: &'a Floor,
    metres_per_texel: f64,
    gloss: u8,
    /// Values 0..=255 of the pattern, `side` x `side`, that repeat without a seam.
    tile: Vec<u8>,
    side: usize,
    /// Large chips of a speckled floor: colour and cover, repeating with another period.
    chips: Vec<Texel>,
    chips_side: usize,
    /// From a pattern value to a colour.
    shades: Vec<Texel>,
    seed: u32,
}

/// Side of a material's tile (texels): a power of two, so that repeating is a mask.
const SIDE: usize = 512;

impl<'a> Material<'a> {
    pub(super) fn new(floor: &'a Floor, metres_per_texel: f64) -> Self {
        let seed = fold(floor.seed, 1);
        let gloss = (floor.gloss * 255.0).round() as u8;
        let mut material = Self {
            floor,
            metres_per_texel,
            gloss,
            tile: Vec::new(),
            side: SIDE,
            chips: Vec::new(),
            chips_side: 0,
            shades: Vec::new(),
            seed,
        };
        let contrast = floor.contrast as f32;
        match floor.kind {
            FloorKind::Plain | FloorKind::Tiles => {
                material.tile = grain_tile(metres_per_texel, seed);
                material.shades = shades(floor.colour, floor.second_colour, contrast * 0.35, gloss);
            }
            FloorKind::Speckled => {
                let fine_m = floor.scale_m * 0.55;
                let base = [
                    floor.colour.rgb[0],
                    floor.colour.rgb[1],
                    floor.colour.rgb[2],
                    gloss,
                ];
                let mut fine = vec![base; SIDE * SIDE];
                scatter(
                    &mut fine,
                    SIDE,
                    fine_m / metres_per_texel,
                    0.30,
                    floor,
                    seed,
                    false,
                );
                let side = SIDE * 3 / 4 - 5;
                let mut chips = vec![[0; 4]; side * side];
                let large = floor.scale_m / metres_per_texel;
                scatter(&mut chips, side, large, 0.16, floor, seed ^ 0x77, true);
                // The fine specks are the ground; the value tile is not needed.
                material.shades = fine;
                material.chips = chips;
                material.chips_side = side;
            }
            FloorKind::Wood => material.tile = wood_tile(floor.scale_m / metres_per_texel, seed),
            FloorKind::Carpet => {
                material.tile = carpet_tile(floor.scale_m / metres_per_texel, seed);
                material.shades = shades(floor.second_colour, floor.colour, contrast.max(0.05) * 1.2, gloss);
            }
        }
        material
    }

    /// Fills a row of the painting. `first` and `row` count texels of the endless floor.
    pub(super) fn row(&self, out: &mut [Texel], first: i64, row: i64) {
        match self.floor.kind {
            FloorKind::Plain | FloorKind::Carpet => {
                let values = self.tile_row(row);
                for (i, texel) in out.iter_mut().enumerate() {
                    let at = (first + i as i64) as usize & (SIDE - 1);
                    *texel = self.shades[usize::from(values[at])];
                }
            }
            FloorKind::Speckled => self.speckled_row(out, first, row),
            FloorKind::Wood => self.wood_row(out, first, row),
            FloorKind::Tiles => self.tiles_row(out, first, row),
        }
    }

    fn tile_row(&self, row: i64) -> &[u8] {
        let start = (row as usize & (SIDE - 1)) * self.side;
        &self.tile[start..start + self.side]
    }

    fn speckled_row(&self, out: &mut [Texel], first: i64, row: i64) {
        let start = (row as usize & (SIDE - 1)) * SIDE;
        let ground = &self.shades[start..start + SIDE];
        let side = self.chips_side as i64;
        let chips_start = row.rem_euclid(side) as usize * self.chips_side;
        let chips = &self.chips[chips_start..chips_start + self.chips_side];
        let mut at_chip = first.rem_euclid(side) as usize;
        for (i, texel) in out.iter_mut().enumerate() {
            let mut value = ground[(first + i as i64) as usize & (SIDE - 1)];
            let chip = chips[at_chip];
            if chip[3] > 0 {
                let cover = u32::from(chip[3]);
                for c in 0..3 {
                    let mixed = u32::from(value[c]) * (255 - cover) + u32::from(chip[c]) * cover;
                    value[c] = (mixed / 255) as u8;
                }
            }
            *texel = value;
            at_chip += 1;
            if at_chip == self.chips_side {
                at_chip = 0;
            }
        }
    }

    fn wood_row(&self, out: &mut [Texel], first: i64, row: i64) {
        let floor = self.floor;
        let plank = floor.scale_m / self.metres_per_texel; // texels
        let board_row = ((row as f64 + 0.5) / plank).floor();
        // How much of this row of texels is the joint between two rows of planks (1.2 mm).
        let joint = 0.0012 / self.metres_per_texel;
        let joint_cover = |from_edge: f64| ((joint * 0.5 - from_edge + 0.5).clamp(0.0, 1.0)) as f32;
        let within = row as f64 + 0.5 - board_row * plank;
        let long_joint = joint_cover(within.min(plank - within)).min(joint as f32);
        let long = plank * 12.0;
        // Planks of neighbouring rows are staggered.
        let shift = f64::from(unit(hash(board_row as i32, 77, self.seed))) * long;
        let end = first + out.len() as i64;
        let mut number = ((first as f64 - shift) / long).floor();
        loop {
            let (from, to) = (number * long + shift, (number + 1.0) * long + shift);
            if from >= end as f64 {
                break;
            }
            let key = hash(number as i32, board_row as i32, self.seed ^ 0x3D);
            let shades = self.plank_shades(key);
            let (shift_x, shift_y) = ((key >> 3) as usize, (key >> 17) as usize);
            let values = &self.tile[((row as usize).wrapping_add(shift_y) & (SIDE - 1)) * SIDE..][..SIDE];
            let low = (from.ceil() as i64).max(first);
            let high = (to.ceil() as i64).min(end);
            for i in low..high {
                let value = values[(i as usize).wrapping_add(shift_x) & (SIDE - 1)];
                let centre = i as f64 + 0.5;
                let from_end = (centre - from).min(to - centre);
                let texel = shades[usize::from(value)];
                let cover = if from_end < 2.0 {
                    long_joint.max(joint_cover(from_end).min(joint as f32))
                } else {
                    long_joint
                };
                out[(i - first) as usize] = if cover > 0.0 {
                    let [r, g, b] = floor.second_colour.rgb;
                    blend(texel, [r / 2, g / 2, b / 2, self.gloss / 4], cover.min(1.0))
                } else {
                    texel
                };
            }
            number += 1.0;
        }
    }

    /// Colours of one plank: every plank has its own lightness and grain strength.
    fn plank_shades(&self, key: u32) -> [Texel; 256] {
        let floor = self.floor;
        let contrast = floor.contrast as f32;
        let tone = 1.0 + (unit(key.rotate_left(7)) - 0.5) * 0.36 * contrast;
        let warmth = (unit(key.rotate_left(19)) - 0.5) * 0.08 * contrast;
        let depth = contrast * (0.45 + 0.4 * unit(key.rotate_left(27)));
        std::array::from_fn(|value| {
            let dark = depth * value as f32 / 255.0;
            let channel = |c: usize, tint: f32| {
                let light = f32::from(floor.colour.rgb[c]);
                let deep = f32::from(floor.second_colour.rgb[c]);
                ((light + (deep - light) * dark) * tone * (1.0 + tint)).clamp(0.0, 255.0) as u8
            };
            [
                channel(0, warmth),
                channel(1, 0.0),
                channel(2, -warmth),
                self.gloss,
            ]
        })
    }

    fn tiles_row(&self, out: &mut [Texel], first: i64, row: i64) {
        let floor = self.floor;
        let side = floor.scale_m / self.metres_per_texel;
        let grout = 0.004f64.min(floor.scale_m * 0.1) / self.metres_per_texel;
        let cover = |within: f64| {
            let from_edge = within.min(side - within);
            ((grout * 0.5 - from_edge + 0.5).clamp(0.0, 1.0) as f32).min(grout as f32)
        };
        let tile_row = ((row as f64 + 0.5) / side).floor();
        let row_cover = cover(row as f64 + 0.5 - tile_row * side);
        let [r, g, b] = floor.second_colour.rgb;
        let joint = [r, g, b, self.gloss / 5];
        let end = first + out.len() as i64;
        let mut number = ((first as f64 + 0.5) / side).floor();
        loop {
            let (from, to) = (number * side, (number + 1.0) * side);
            if from >= end as f64 {
                break;
            }
            // Every tile is fired a little differently and laid turned.
            let key = hash(number as i32, tile_row as i32, self.seed ^ 0x9C);
            let tone = 1.0 + (unit(key) - 0.5) * 0.10 * floor.contrast as f32;
            let scaled = (tone * 256.0) as u32;
            let values =
                &self.tile[((row as usize).wrapping_add((key >> 5) as usize) & (SIDE - 1)) * SIDE..][..SIDE];
            let low = ((from - 0.5).ceil() as i64).max(first);
            let high = ((to - 0.5).ceil() as i64).min(end);
            for i in low..high {
                let value = values[(i as usize).wrapping_add((key >> 15) as usize) & (SIDE - 1)];
                let mut texel = self.shades[usize::from(value)];
                for channel in texel.iter_mut().take(3) {
                    *channel = (u32::from(*channel) * scaled / 256).min(255) as u8;
                }
                let joint_cover = row_cover.max(cover(i as f64 + 0.5 - from));
                out[(i - first) as usize] = if joint_cover > 0.0 {
                    blend(texel, joint, joint_cover)
                } else {
                    texel
                };
            }
            number += 1.0;
        }
    }
}

/// A mix of two texels.
pub(super) fn blend(below: Texel, above: Texel, cover: f32) -> Texel {
    let part = (cover.clamp(0.0, 1.0) * 256.0) as u32;
    std::array::from_fn(|c| ((u32::from(below[c]) * (256 - part) + u32::from(above[c]) * part) >> 8) as u8)
}

/// Colours for values 0..=255 around the main colour (at 128), reaching `strength` of the way to the second colour.
fn shades(colour: Colour, second: Colour, strength: f32, gloss: u8) -> Vec<Texel> {
    (0..256)
        .map(|value| {
            let part = (value as f32 - 128.0) / 128.0 * strength;
            let channel = |c: usize| {
                let (main, other) = (f32::from(colour.rgb[c]), f32::from(second.rgb[c]));
                (main + (other - main) * part).round().clamp(0.0, 255.0) as u8
            };
            [channel(0), channel(1), channel(2), gloss]
        })
        .collect()
}

/// Fine grain: dust, pores, brush marks of half a millimetre to a centimetre.
fn grain_tile(metres_per_texel: f64, seed: u32) -> Vec<u8> {
    let octaves: Vec<(f64, f32, i32, u32)> = [0.0012, 0.004, 0.012]
        .iter()
        .zip([0.5f32, 0.3, 0.35])
        .enumerate()
        .map(|(k, (size_m, weight))| {
            // A whole number of cells a tile; grain finer than a texel averages out.
            let cells = ((SIDE as f64 * metres_per_texel / size_m).round() as i32).clamp(1, SIDE as i32);
            let fade = (size_m / metres_per_texel).min(1.0) as f32;
            (
                f64::from(cells) / SIDE as f64,
                weight * fade,
                cells,
                seed ^ k as u32,
            )
        })
        .collect();
    let mut tile = Vec::with_capacity(SIDE * SIDE);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let mut sum = 0.0;
            for (scale, weight, cells, octave_seed) in &octaves {
                let noise = tiling_value(x as f64 * scale, y as f64 * scale, *cells, *cells, *octave_seed);
                sum += (noise - 0.5) * weight;
            }
            tile.push((128.0 + sum * 255.0).clamp(0.0, 255.0) as u8);
        }
    }
    tile
}

/// Grain of wood along x: long fibres, and broad bands of early and late wood.
fn wood_tile(plank: f64, seed: u32) -> Vec<u8> {
    let mut tile = Vec::with_capacity(SIDE * SIDE);
    let side = SIDE as f64;
    let fibre_rows = ((side * 26.0 / plank).round() as i32).clamp(1, SIDE as i32);
    let band_rows = ((side * 5.0 / plank).round() as i32).clamp(1, SIDE as i32);
    let fibre_columns = ((side * 0.8 / plank).round() as i32).clamp(1, SIDE as i32);
    let wave_columns = ((side * 0.22 / plank).round() as i32).clamp(1, SIDE as i32);
    for y in 0..SIDE {
        let v = y as f64 / side;
        for x in 0..SIDE {
            let u = x as f64 / side;
            // Bands meander: their row is shifted by slow noise along the plank.
            let wave = f64::from(tiling_value(
                u * f64::from(wave_columns) * 2.0,
                v * 3.0,
                wave_columns * 2,
                3,
                seed ^ 5,
            ));
            let bands = tiling_value(
                u * f64::from(wave_columns),
                v * f64::from(band_rows) + wave * 2.2,
                wave_columns,
                band_rows,
                seed ^ 1,
            );
            let fibres = tiling_value(
                u * f64::from(fibre_columns),
                v * f64::from(fibre_rows) + wave * 2.0,
                fibre_columns,
                fibre_rows,
                seed ^ 2,
            );
            let pores = unit(hash(x as i32 / 6, y as i32, seed ^ 3));
            let line = smooth((bands - 0.35) * 2.6);
            let pore = if pores > 0.93 { 0.25 } else { 0.0 };
            let value = 0.50 * line + 0.38 * fibres + pore;
            tile.push((value * 230.0).clamp(0.0, 255.0) as u8);
        }
    }
    tile
}

/// Loops of yarn in staggered rows; each loop is a bright knob in a dark ground and has its own lightness.
fn carpet_tile(loop_texels: f64, seed: u32) -> Vec<u8> {
    let count = ((SIDE as f64 / loop_texels).round() as i32 & !1).clamp(2, SIDE as i32);
    let cell = SIDE as f64 / f64::from(count);
    // Knobs finer than two texels average out.
    let relief = ((cell - 1.0) / 2.0).clamp(0.0, 1.0) as f32;
    let mut tile = Vec::with_capacity(SIDE * SIDE);
    for y in 0..SIDE {
        let row_at = (y as f64 + 0.5) / cell;
        let row = row_at.floor();
        for x in 0..SIDE {
            let column_at = (x as f64 + 0.5) / cell + if row as i32 % 2 == 0 { 0.0 } else { 0.5 };
            let column = column_at.floor();
            let (cx, cy) = ((column as i32).rem_euclid(count), (row as i32).rem_euclid(count));
            let key = hash(cx, cy, seed ^ 0x11);
            let (dx, dy) = (
                (column_at - column) as f32 - 0.5 - (unit(key) - 0.5) * 0.25,
                (row_at - row) as f32 - 0.5 - (unit(key.rotate_left(9)) - 0.5) * 0.25,
            );
            let knob = 1.0 - smooth((dx * dx + dy * dy) * 3.2);
            // Lit from one side.
            let lit = (dx + dy) * -0.35;
            let own = (unit(key.rotate_left(18)) - 0.5) * 0.55;
            let speck = if key & 31 == 0 { -0.35 } else { 0.0 };
            let value = 0.5 + own + speck + relief * ((knob - 0.45) * 0.75 + lit * 0.6);
            tile.push((value * 255.0).clamp(0.0, 255.0) as u8);
        }
    }
    tile
}

/// Scatters chips of several colours and sizes over a tile that wraps around. `size` is their typical diameter
/// (texels), `share` the part of the floor that they cover at contrast 1. With `masked`, only they are written, with their
/// cover as the fourth byte.
fn scatter(tile: &mut [Texel], side: usize, size: f64, share: f64, floor: &Floor, seed: u32, masked: bool) {
    let colours = chip_colours(floor);
    // Chips much smaller than a texel would be too many to place and average out: larger, paler ones stand for them.
    let drawn = size.max(0.9);
    let pale = (size / drawn) as f32;
    let area = drawn * drawn * 0.6;
    let count = (side as f64 * side as f64 * share * (0.35 + 0.65 * floor.contrast) / area) as i32;
    let strength = (0.35 + 0.65 * floor.contrast as f32) * pale;
    for number in 0..count {
        let random = |use_number: i32| unit(hash(number, use_number, seed));
        let (cx, cy) = (random(0) * side as f32, random(1) * side as f32);
        let shade = colours[(random(2) * colours.len() as f32) as usize];
        let cover = strength * (0.55 + 0.45 * random(3));
        // Many small chips, few large ones; longish and turned.
        let draw = random(4);
        let radius = 0.5 * drawn as f32 * (0.55 + 0.9 * draw * draw);
        let stretch = 0.6 + 0.4 * random(5);
        let (ax, ay) = axis(random(6));
        let reach = (radius + 1.0).ceil() as i32;
        for y in -reach..=reach {
            for x in -reach..=reach {
                let (px, py) = (cx.floor() + x as f32 + 0.5 - cx, cy.floor() + y as f32 + 0.5 - cy);
                let (along, across) = (px * ax + py * ay, (py * ax - px * ay) / stretch);
                // Between round and square, as broken stone is.
                let round = (along * along + across * across).sqrt();
                let square = along.abs().max(across.abs());
                let distance = 0.5 * round + 0.5 * square * 1.12;
                let inside = (radius - distance + 0.5).clamp(0.0, 1.0) * cover;
                if inside <= 0.004 {
                    continue;
                }
                let column = (cx as i32 + x).rem_euclid(side as i32) as usize;
                let row = (cy as i32 + y).rem_euclid(side as i32) as usize;
                let texel = &mut tile[row * side + column];
                if masked {
                    let cover = (inside * 255.0) as u8;
                    if cover > texel[3] {
                        *texel = [shade[0], shade[1], shade[2], cover];
                    }
                } else {
                    *texel = blend(*texel, [shade[0], shade[1], shade[2], texel[3]], inside);
                }
            }
        }
    }
}

/// A unit vector from a number in [0, 1): the square's border, projected; even enough for stones.
fn axis(part: f32) -> (f32, f32) {
    let (x, y) = (1.0 - 2.0 * part, 1.0 - 2.0 * (part - 0.5).abs());
    let length = (x * x + y * y).sqrt().max(1e-3);
    (x / length, y / length)
}

/// Stone is never of one colour: the second colour, darker, lighter, redder, and some nearly like the ground.
fn chip_colours(floor: &Floor) -> [[u8; 3]; 7] {
    let mix = |part: f32, gain: [f32; 3]| -> [u8; 3] {
        std::array::from_fn(|c| {
            let (a, b) = (
                f32::from(floor.colour.rgb[c]),
                f32::from(floor.second_colour.rgb[c]),
            );
            ((a + (b - a) * part) * gain[c]).round().clamp(0.0, 255.0) as u8
        })
    };
    [
        mix(1.0, [1.0; 3]),
        mix(1.0, [0.7; 3]),
        mix(0.6, [1.0; 3]),
        mix(0.9, [1.25, 1.0, 0.85]),
        mix(-0.4, [1.0; 3]),
        mix(-0.25, [1.03, 1.03, 1.05]),
        mix(0.7, [0.92, 0.98, 1.1]),
    ]
}
