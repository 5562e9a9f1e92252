//! What the floor is made of: one small picture per material, repeated with changing offsets, row by row.

use super::noise::{Lattice, fold, hash, smooth, unit};
use crate::colour::Colour;
use crate::floor::{Floor, FloorKind};

/// A texel of the painting: red, green, blue, gloss.
type Texel = [u8; 4];

/// Paints the rows of a floor. Texel (i, j) is `origin + (i, j)` of an endless floor, so a larger rectangle of the same
/// world shows the same floor.
#[derive(Debug)]
pub(super) struct Material {
    floor: Floor,
    metres_per_texel: f64,
    gloss: u8,
    seed: u32,
    pattern: Pattern,
}

#[derive(Debug)]
enum Pattern {
    /// A finished picture that repeats, every block of it shifted by chance: cut specks are not noticed.
    Picture(Vec<Texel>),
    /// Values 0..=255 that pieces (planks, tiles) turn into their own colours.
    Pieces(Vec<u8>),
}

/// Colours of the pieces of one row of pieces, made once for the texels' rows that run through them.
#[derive(Debug, Default)]
pub(super) struct PieceColours {
    /// Row of pieces, and number of its first piece with colours.
    first: Option<(i64, i64)>,
    /// How many pieces have colours.
    count: usize,
    colours: Vec<Vec<Texel>>,
}

/// Width across planks of the pattern of pieces (texels): a power of two, so that repeating is a mask.
const SIDE: usize = 256;
/// Length of the pattern of pieces along x (texels), a power of two: a plank must not repeat itself.
const ALONG: usize = 512;
/// Side of a finished picture (texels).
const PICTURE: usize = 384;

/// Planks and tiles that would be narrower (texels) are drawn this wide: they could not be told apart anyway, and there
/// would be millions of them.
const LEAST_PIECE: f64 = 6.0;

/// A plank or tile: its hash, and where it lies along x (texels).
struct Piece {
    key: u32,
    from: f64,
    to: f64,
}

impl Material {
    pub(super) fn new(floor: &Floor, metres_per_texel: f64) -> Self {
        let seed = fold(floor.seed, 1);
        let gloss = match floor.kind {
            FloorKind::Grass => 0,
            _ => (floor.gloss * 255.0).round() as u8,
        };
        let contrast = floor.contrast as f32;
        let pattern = match floor.kind {
            FloorKind::Plain => {
                let shades = shades(floor.colour, floor.second_colour, contrast * 0.5, gloss);
                let values = grain_tile(metres_per_texel, PICTURE, PICTURE, seed);
                Pattern::Picture(values.iter().map(|value| shades[usize::from(*value)]).collect())
            }
            FloorKind::Carpet => {
                let shades = shades(floor.second_colour, floor.colour, contrast.max(0.05) * 1.2, gloss);
                let values = carpet_tile(floor.scale_m / metres_per_texel, seed);
                Pattern::Picture(values.iter().map(|value| shades[usize::from(*value)]).collect())
            }
            FloorKind::Grass => {
                let shades = shades(floor.colour, floor.second_colour, contrast, 0);
                let values = grass_tile(metres_per_texel, seed);
                Pattern::Picture(values.iter().map(|value| shades[usize::from(*value)]).collect())
            }
            FloorKind::Speckled => {
                let [r, g, b] = floor.colour.rgb;
                let mut picture = vec![[r, g, b, gloss]; PICTURE * PICTURE];
                let size = floor.scale_m / metres_per_texel;
                scatter(&mut picture, size * 0.5, 0.34, floor, seed);
                scatter(&mut picture, size, 0.20, floor, seed ^ 0x77);
                Pattern::Picture(picture)
            }
            FloorKind::Wood => Pattern::Pieces(wood_tile(floor.scale_m / metres_per_texel, seed)),
            FloorKind::Tiles => Pattern::Pieces(grain_tile(metres_per_texel, ALONG, SIDE, seed)),
        };
        Self {
            floor: floor.clone(),
            metres_per_texel,
            gloss,
            seed,
            pattern,
        }
    }

    /// The gloss of the most glossy texel.
    pub(super) fn gloss(&self) -> u8 {
        self.gloss
    }

    /// Fills a row of the painting. `first` and `row` count texels of the endless floor.
    pub(super) fn row(&self, colours: &mut PieceColours, out: &mut [Texel], first: i64, row: i64) {
        match &self.pattern {
            Pattern::Picture(picture) => self.picture_row(picture, out, first, row),
            Pattern::Pieces(values) if self.floor.kind == FloorKind::Wood => {
                let lay = self.planks(row);
                self.pieces_row(values, colours, out, first, &lay, plank_shades);
            }
            Pattern::Pieces(values) => {
                let lay = self.tiles(row);
                self.pieces_row(values, colours, out, first, &lay, tile_shades);
            }
        }
    }

    fn picture_row(&self, picture: &[Texel], out: &mut [Texel], first: i64, row: i64) {
        let side = PICTURE as i64;
        // Loops of carpet stand in rows, and meadows are larger than what a cut would hide: their blocks stay in step.
        let shifted = !matches!(self.floor.kind, FloorKind::Carpet | FloorKind::Grass);
        let block_row = row.div_euclid(side);
        let mut at = first;
        let end = first + out.len() as i64;
        while at < end {
            let block = at.div_euclid(side);
            let stop = ((block + 1) * side).min(end);
            let key = if shifted {
                hash(block as i32, block_row as i32, self.seed ^ 0xB1)
            } else {
                0
            };
            let line = (row + i64::from(key >> 20)).rem_euclid(side) as usize;
            let line = &picture[line * PICTURE..(line + 1) * PICTURE];
            while at < stop {
                let column = (at + i64::from(key & 0xFFF)).rem_euclid(side) as usize;
                let count = ((stop - at) as usize).min(PICTURE - column);
                let to = (at - first) as usize;
                out[to..to + count].copy_from_slice(&line[column..column + count]);
                at += count as i64;
            }
        }
    }

    fn planks(&self, row: i64) -> Lay {
        let plank = (self.floor.scale_m / self.metres_per_texel).max(LEAST_PIECE); // texels
        let board_row = ((row as f64 + 0.5) / plank).floor();
        // How much of this row of texels is the joint between two rows of planks (1.2 mm).
        let joint = 0.0012 / self.metres_per_texel;
        let within = row as f64 + 0.5 - board_row * plank;
        let across = joint_cover(within.min(plank - within), joint);
        let long = plank * 12.0;
        // Planks of neighbouring rows are staggered.
        let shift = f64::from(unit(hash(board_row as i32, 77, self.seed))) * long;
        let [r, g, b] = self.floor.second_colour.rgb;
        let colour = [r / 2, g / 2, b / 2, self.gloss / 4];
        Lay {
            row,
            piece_row: board_row as i64,
            length: long,
            shift,
            joint,
            across,
            colour,
        }
    }

    fn tiles(&self, row: i64) -> Lay {
        let floor = &self.floor;
        let side = (floor.scale_m / self.metres_per_texel).max(LEAST_PIECE);
        let joint = 0.004f64.min(floor.scale_m * 0.1) / self.metres_per_texel;
        let tile_row = ((row as f64 + 0.5) / side).floor();
        let within = row as f64 + 0.5 - tile_row * side;
        let [r, g, b] = floor.second_colour.rgb;
        Lay {
            row,
            piece_row: tile_row as i64,
            length: side,
            shift: 0.0,
            joint,
            across: joint_cover(within.min(side - within), joint),
            colour: [r, g, b, self.gloss / 5],
        }
    }

    /// Fills a row that runs through pieces: each with its own colours and its own part of the pattern.
    fn pieces_row(
        &self,
        values: &[u8],
        known: &mut PieceColours,
        out: &mut [Texel],
        first: i64,
        lay: &Lay,
        colours: fn(&Floor, u32, u8, &mut Vec<Texel>),
    ) {
        let end = first + out.len() as i64;
        let mut number = ((first as f64 + 0.5 - lay.shift) / lay.length).floor() as i64;
        if known.first != Some((lay.piece_row, number)) {
            (known.first, known.count) = (Some((lay.piece_row, number)), 0);
        }
        let mut index = 0;
        while (number as f64 * lay.length + lay.shift) < end as f64 {
            let key = hash(number as i32, lay.piece_row as i32, self.seed ^ 0x3D);
            let piece = Piece {
                key,
                from: number as f64 * lay.length + lay.shift,
                to: (number + 1) as f64 * lay.length + lay.shift,
            };
            if index == known.count {
                if index == known.colours.len() {
                    known.colours.push(Vec::new());
                }
                colours(&self.floor, key, self.gloss, &mut known.colours[index]);
                known.count += 1;
            }
            fill_piece(out, first, lay, &piece, &known.colours[index], values);
            number += 1;
            index += 1;
        }
    }
}

/// How a row of texels runs through a row of pieces.
struct Lay {
    row: i64,
    piece_row: i64,
    /// Length of a piece along the row (texels).
    length: f64,
    /// Where piece 0 begins (texels).
    shift: f64,
    /// Width of the joints (texels).
    joint: f64,
    /// Part of this row of texels that the joint along it covers.
    across: f32,
    colour: Texel,
}

/// Part of a texel that a joint `joint` texels wide covers, when its middle is `away` texels from the joint's.
fn joint_cover(away: f64, joint: f64) -> f32 {
    (joint * 0.5 - away + 0.5).clamp(0.0, 1.0).min(joint) as f32
}

fn fill_piece(out: &mut [Texel], first: i64, lay: &Lay, piece: &Piece, shades: &[Texel], values: &[u8]) {
    let end = first + out.len() as i64;
    let low = ((piece.from - 0.5).ceil() as i64).max(first);
    let high = ((piece.to - 0.5).ceil() as i64).min(end);
    if low >= high {
        return;
    }
    let (shift_x, shift_y) = ((piece.key >> 3) as usize, (piece.key >> 17) as usize);
    let line = &values[((lay.row as usize).wrapping_add(shift_y) & (SIDE - 1)) * ALONG..][..ALONG];
    let texels = &mut out[(low - first) as usize..(high - first) as usize];
    for (i, texel) in (low..).zip(texels.iter_mut()) {
        *texel = shades[usize::from(line[(i as usize).wrapping_add(shift_x) & (ALONG - 1)])];
    }
    if lay.across > 0.0 {
        for texel in texels.iter_mut() {
            *texel = blend(*texel, lay.colour, lay.across);
        }
    }
    // The ends of the piece.
    let reach = (lay.joint * 0.5 + 1.0).ceil() as usize;
    let count = texels.len();
    let edges = (0..reach.min(count)).chain(count.saturating_sub(reach).max(reach.min(count))..count);
    for k in edges {
        let centre = (low + k as i64) as f64 + 0.5;
        let cover = joint_cover((centre - piece.from).min(piece.to - centre), lay.joint);
        if cover > 0.0 {
            texels[k] = blend(texels[k], lay.colour, cover);
        }
    }
}

/// Colours of one plank: every plank has its own lightness and grain strength.
fn plank_shades(floor: &Floor, key: u32, gloss: u8, out: &mut Vec<Texel>) {
    let contrast = floor.contrast as f32;
    let tone = 1.0 + (unit(key.rotate_left(7)) - 0.5) * 0.36 * contrast;
    let warmth = (unit(key.rotate_left(19)) - 0.5) * 0.08 * contrast;
    let depth = contrast * (0.45 + 0.4 * unit(key.rotate_left(27)));
    let colour = |value: usize| {
        let dark = depth * value as f32 / 255.0;
        let channel = |c: usize, tint: f32| {
            let light = f32::from(floor.colour.rgb[c]);
            let deep = f32::from(floor.second_colour.rgb[c]);
            ((light + (deep - light) * dark) * tone * (1.0 + tint)).clamp(0.0, 255.0) as u8
        };
        [channel(0, warmth), channel(1, 0.0), channel(2, -warmth), gloss]
    };
    out.clear();
    out.extend((0..256).map(colour));
}

/// Colours of one floor tile: every tile is fired a little differently.
fn tile_shades(floor: &Floor, key: u32, gloss: u8, out: &mut Vec<Texel>) {
    let contrast = floor.contrast as f32;
    let tone = 1.0 + (unit(key.rotate_left(11)) - 0.5) * 0.10 * contrast;
    let scaled = |colour: Colour| {
        let channel = |value: u8| (f32::from(value) * tone).round().clamp(0.0, 255.0) as u8;
        Colour {
            rgb: colour.rgb.map(channel),
        }
    };
    let (colour, second) = (scaled(floor.colour), scaled(floor.second_colour));
    out.clear();
    out.extend(shades(colour, second, contrast * 0.5, gloss));
}

/// A mix of two texels.
pub(super) fn blend(below: Texel, above: Texel, cover: f32) -> Texel {
    let part = (cover.clamp(0.0, 1.0) * 256.0) as u32;
    std::array::from_fn(|c| ((u32::from(below[c]) * (256 - part) + u32::from(above[c]) * part) >> 8) as u8)
}

/// Colours for values 0..=255 around the main colour (at 128), reaching `strength` of the way to the second colour.
fn shades(colour: Colour, second: Colour, strength: f32, gloss: u8) -> [Texel; 256] {
    std::array::from_fn(|value| {
        let part = (value as f32 - 128.0) / 128.0 * strength;
        let channel = |c: usize| {
            let (main, other) = (f32::from(colour.rgb[c]), f32::from(second.rgb[c]));
            (main + (other - main) * part).round().clamp(0.0, 255.0) as u8
        };
        [channel(0), channel(1), channel(2), gloss]
    })
}

/// A sum of noise of several sizes (m) and strengths that repeats after a picture of so many texels, around 0.5.
fn layered_noise(
    metres_per_texel: f64,
    [columns, rows]: [usize; 2],
    octaves: &[(f64, f32)],
    seed: impl Fn(usize, i32) -> u32,
) -> Vec<u8> {
    // A whole number of cells a picture.
    let cells = |texels: usize, size_m: f64| {
        ((texels as f64 * metres_per_texel / size_m).round() as i32).clamp(1, texels as i32)
    };
    let mut sums = vec![0.5f32; columns * rows];
    for (number, (size_m, weight)) in octaves.iter().enumerate() {
        let (across, down) = (cells(columns, *size_m), cells(rows, *size_m));
        // What is finer than a texel averages out.
        let weight = weight * (size_m / metres_per_texel).min(1.0) as f32;
        let lattice = Lattice::new(across, down, seed(number, across));
        let (step_x, step_y) = (across as f32 / columns as f32, down as f32 / rows as f32);
        lattice.add_picture(&mut sums, columns, step_x, step_y, weight);
    }
    sums.iter()
        .map(|sum| (sum * 255.0).clamp(0.0, 255.0) as u8)
        .collect()
}

/// Fine grain: dust, pores, brush marks of a millimetre to a centimetre.
fn grain_tile(metres_per_texel: f64, columns: usize, rows: usize, seed: u32) -> Vec<u8> {
    let octaves = [(0.0012, 0.7), (0.004, 0.4), (0.012, 0.4)];
    layered_noise(metres_per_texel, [columns, rows], &octaves, |number, _| {
        seed ^ number as u32
    })
}

/// Tufts, clumps and bald places, from a hand's breadth to some metres.
fn grass_tile(metres_per_texel: f64, seed: u32) -> Vec<u8> {
    let octaves = [(0.15, 0.8), (0.5, 0.6), (2.2, 0.6), (7.0, 0.5)];
    layered_noise(metres_per_texel, [PICTURE, PICTURE], &octaves, |_, cells| {
        seed ^ (cells as u32).wrapping_mul(0x9E37)
    })
}

/// Grain of wood along x: long fibres, and broad bands of early and late wood.
fn wood_tile(plank: f64, seed: u32) -> Vec<u8> {
    let cells = |texels: usize, per_plank: f64| {
        ((texels as f64 * per_plank / plank).round() as i32).clamp(1, texels as i32)
    };
    let (band_rows, band_columns) = (cells(SIDE, 5.0), cells(ALONG, 0.22));
    let (fibre_rows, fibre_columns) = (cells(SIDE, 26.0), cells(ALONG, 0.8));
    let waves = Lattice::new(band_columns * 2, 3, seed ^ 5);
    let bands = Lattice::new(band_columns, band_rows, seed ^ 1);
    let fibres = Lattice::new(fibre_columns, fibre_rows, seed ^ 2);
    let mut tile = Vec::with_capacity(ALONG * SIDE);
    for y in 0..SIDE {
        let v = y as f32 / SIDE as f32;
        for x in 0..ALONG {
            let u = x as f32 / ALONG as f32;
            // Bands meander: their row is shifted by slow noise along the plank.
            let wave = waves.at(u * (band_columns * 2) as f32, v * 3.0);
            let band = bands.at(u * band_columns as f32, v * band_rows as f32 + wave * 2.2);
            let fibre = fibres.at(u * fibre_columns as f32, v * fibre_rows as f32 + wave * 2.0);
            let pore = if hash(x as i32 / 6, y as i32, seed ^ 3) > 0xEE00_0000 {
                0.25
            } else {
                0.0
            };
            let value = 0.50 * smooth((band - 0.35) * 2.6) + 0.38 * fibre + pore;
            tile.push((value * 230.0).clamp(0.0, 255.0) as u8);
        }
    }
    tile
}

/// Loops of yarn in staggered rows; each loop is a bright knob in a dark ground and has its own lightness.
fn carpet_tile(loop_texels: f64, seed: u32) -> Vec<u8> {
    let count = ((PICTURE as f64 / loop_texels).round() as i32 & !1).clamp(2, PICTURE as i32);
    let cell = PICTURE as f64 / f64::from(count);
    // Knobs finer than two texels average out.
    let relief = ((cell - 1.0) / 2.0).clamp(0.0, 1.0) as f32;
    let mut tile = Vec::with_capacity(PICTURE * PICTURE);
    for y in 0..PICTURE {
        let row_at = (y as f64 + 0.5) / cell;
        let row = row_at.floor();
        for x in 0..PICTURE {
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

/// Scatters chips of several colours and sizes over a picture that wraps around. `size` is their typical diameter
/// (texels), `share` the part of the floor that they cover at contrast 1.
fn scatter(picture: &mut [Texel], size: f64, share: f64, floor: &Floor, seed: u32) {
    let colours = chip_colours(floor);
    let side = PICTURE as f32;
    // Chips much smaller than a texel would be too many to place and average out: larger, paler ones stand for them.
    let drawn = size.max(0.9);
    let pale = (size / drawn).max(0.25) as f32;
    let area = drawn * drawn * 0.6;
    let count =
        (f64::from(side * side) * share * (0.35 + 0.65 * floor.contrast) / (area * f64::from(pale))) as i32;
    let strength = (0.35 + 0.65 * floor.contrast as f32) * pale;
    for number in 0..count {
        let random = |use_number: i32| unit(hash(number, use_number, seed));
        let (cx, cy) = (random(0) * side, random(1) * side);
        let shade = colours[(random(2) * colours.len() as f32) as usize];
        let cover = strength * (0.55 + 0.45 * random(3));
        // Many small chips, few large ones; longish and turned.
        let draw = random(4);
        let radius = 0.5 * drawn as f32 * (0.55 + 0.9 * draw * draw);
        let stretch = 0.6 + 0.4 * random(5);
        let (ax, ay) = axis(random(6));
        let (low_x, high_x) = ((cx - radius - 0.5).floor() as i32, (cx + radius + 0.5) as i32);
        let (low_y, high_y) = ((cy - radius - 0.5).floor() as i32, (cy + radius + 0.5) as i32);
        for y in low_y..=high_y {
            let row = y.rem_euclid(PICTURE as i32) as usize * PICTURE;
            for x in low_x..=high_x {
                let (px, py) = (x as f32 + 0.5 - cx, y as f32 + 0.5 - cy);
                let (along, across) = (px * ax + py * ay, (py * ax - px * ay) / stretch);
                // Between round and square, as broken stone is.
                let round = (along * along + across * across).sqrt();
                let square = along.abs().max(across.abs());
                let distance = 0.5 * round + 0.5 * square * 1.12;
                let inside = (radius - distance + 0.5).clamp(0.0, 1.0) * cover;
                if inside > 0.004 {
                    let texel = &mut picture[row + x.rem_euclid(PICTURE as i32) as usize];
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
