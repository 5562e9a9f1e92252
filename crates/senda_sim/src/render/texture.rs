//! Textures with levels of detail.

use super::kernel::{LEVELS, LevelLayout, STEPS_PER_TEXEL, STRIDE, STRIP, Texel, Texels};
use senda_core::memory::prefer_large_pages;
use senda_core::threads::both;

/// A picture of a plane in halving sizes, each with a border of one colour: looks beyond the edge see that colour.
#[derive(Debug, Clone)]
pub struct MipTexture {
    texels: Vec<Texel>,
    layouts: [LevelLayout; LEVELS],
    levels: usize,
}

/// Texels of border on the low sides.
const BORDER: usize = 1;

impl MipTexture {
    /// From `width` x `height` texels R, G, B, A in rows; `outside` is what lies beyond them.
    ///
    /// A (gloss) is kept as its square root, as the colours are: reflections are mixed in that form.
    ///
    /// # Panics
    /// When the number of texels is not `width · height`, or a side is 0 or above 60,000.
    pub fn new(width: usize, height: usize, texels: &[[u8; 4]], outside: [u8; 4]) -> Self {
        assert_eq!(texels.len(), width * height);
        assert!((1..=60_000).contains(&width) && (1..=60_000).contains(&height));
        let gloss: [u8; 256] = std::array::from_fn(|a| (255.0 * (a as f64 / 255.0).sqrt()).round() as u8);
        let pack = |[r, g, b, a]: [u8; 4]| u32::from_le_bytes([r, g, b, gloss[usize::from(a)]]);
        let outside = pack(outside);
        let sizes = sizes(width, height);
        let mut layouts = [LevelLayout::default(); LEVELS];
        let mut base = 0;
        for (layout, &(w, h)) in layouts.iter_mut().zip(&sizes) {
            let limit = |side: usize| ((padded(side) - 2) as f64 * STEPS_PER_TEXEL + 127.0) as f32;
            *layout = LevelLayout {
                base: base as u32,
                strip: strip(h) as u32,
                limit: [limit(w), limit(h)],
            };
            base += strips(w) * strip(h);
        }
        for level in sizes.len()..LEVELS {
            layouts[level] = layouts[sizes.len() - 1];
        }
        let mut all: Vec<Texel> = vec![0; base];
        prefer_large_pages(&mut all);
        let finest = Level {
            width,
            height,
            outside,
            texel: |index: usize| pack(texels[index]),
        };
        let (level, coarser) = all.split_at_mut(strips(width) * strip(height));
        // Half of the finest level's strips, and half of the next level's rows, each.
        let middle = strips(width) / 2;
        let (left, right) = level.split_at_mut(middle * strip(height));
        let (next_width, next_height) = (width.div_ceil(2), height.div_ceil(2));
        let mut next = vec![0; next_width * next_height];
        prefer_large_pages(&mut next);
        let (upper, lower) = next.split_at_mut(next_height / 2 * next_width);
        both(
            texels.len(),
            || {
                finest.fill_strips(0, left);
                finest.halve(0, upper);
            },
            || {
                finest.fill_strips(middle, right);
                finest.halve(next_height / 2, lower);
            },
        );
        let mut rest = coarser;
        for &(width, height) in &sizes[1..] {
            let level = Level {
                width,
                height,
                outside,
                texel: |index: usize| next[index],
            };
            let (out, after) = rest.split_at_mut(strips(width) * strip(height));
            level.fill_strips(0, out);
            let mut halved = vec![0; width.div_ceil(2) * height.div_ceil(2)];
            level.halve(0, &mut halved);
            (next, rest) = (halved, after);
        }
        Self {
            texels: all,
            layouts,
            levels: sizes.len(),
        }
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels
    }

    /// Where the outer corner of texel (0, 0) lies in a level, in that level's texels times [`STEPS_PER_TEXEL`],
    /// counted so that whole numbers are texels' middles.
    pub(super) const ORIGIN: f64 = (BORDER as f64 - 0.5) * STEPS_PER_TEXEL;

    pub(super) fn texels(&self) -> Texels<'_> {
        Texels::new(&self.texels, &self.layouts)
    }

    /// The texel at a place given in texels of level 0 from the outer corner of texel (0, 0): R, G, B, A times 127.
    pub(super) fn look(&self, x: f32, y: f32, level: u32) -> [i32; 4] {
        let level = (level as usize).min(self.levels - 1);
        let layout = &self.layouts[level];
        let shrink = 128.0 / (1u32 << level) as f32;
        let at = |value: f32, limit: f32| (value * shrink + Self::ORIGIN as f32).max(0.0).min(limit) as u32;
        let (x, y) = (at(x, layout.limit[0]), at(y, layout.limit[1]));
        let (fx, fy) = ((x & 127) as i32, (y & 127) as i32);
        let index = layout.index(x >> 7, y >> 7);
        let (left, right) = (
            self.texels[index].to_le_bytes(),
            self.texels[index + 1].to_le_bytes(),
        );
        let row = |at: usize, c: usize| i32::from(left[at + c]) * (127 - fx) + i32::from(right[at + c]) * fx;
        [0, 1, 2, 3].map(|c| (row(0, c) * (128 - fy) + row(4, c) * fy) >> 7)
    }
}

/// Room for the border: 1 before, 2 after.
fn padded(side: usize) -> usize {
    side + BORDER + 2
}

/// Strips of a level.
fn strips(width: usize) -> usize {
    padded(width).div_ceil(STRIP)
}

/// Texels of a strip.
fn strip(height: usize) -> usize {
    padded(height) * STRIDE
}

/// A level while it is written.
struct Level<F> {
    width: usize,
    height: usize,
    outside: u32,
    /// The texel of an index, row by row.
    texel: F,
}

impl<F: Fn(usize) -> u32> Level<F> {
    /// Writes strips, the first of them number `first`, with their border.
    fn fill_strips(&self, first: usize, out: &mut [Texel]) {
        let (width, height) = (self.width, self.height);
        let length = strip(height);
        // Columns of the border and the level, from the first strip's first.
        let from = first * STRIP;
        let wide = out.len() / length * STRIP + 1;
        let inside = BORDER.max(from)..(BORDER + width).min(from + wide);
        let (mut here, mut below) = (vec![self.outside; wide], vec![self.outside; wide]);
        for y in 0..padded(height) {
            // Row y of the level and its border; the one below it.
            match (y + 1).checked_sub(BORDER).filter(|y| *y < height) {
                Some(y) if !inside.is_empty() => {
                    let texels = y * width + inside.start - BORDER..;
                    let columns = &mut below[inside.start - from..inside.end - from];
                    for (out, index) in columns.iter_mut().zip(texels) {
                        *out = (self.texel)(index);
                    }
                }
                _ => below.fill(self.outside),
            }
            for (number, strip) in out.chunks_exact_mut(length).enumerate() {
                let columns = number * STRIP..number * STRIP + STRIDE;
                let pairs = here[columns.clone()].iter().zip(&below[columns]);
                let row = &mut strip[y * STRIDE..(y + 1) * STRIDE];
                for (out, (upper, lower)) in row.iter_mut().zip(pairs) {
                    *out = Texel::from(*upper) | Texel::from(*lower) << 32;
                }
            }
            std::mem::swap(&mut here, &mut below);
        }
    }

    /// Rows of half the size, rounded up, the first of them number `first`; what is missing at odd edges is outside.
    fn halve(&self, first: usize, out: &mut [u32]) {
        let (width, height, outside) = (self.width, self.height, self.outside);
        let texel = &self.texel;
        for (row, out) in (first..).zip(out.chunks_exact_mut(width.div_ceil(2))) {
            let upper = 2 * row * width;
            let lower = |x: usize| {
                if 2 * row + 1 < height {
                    texel(upper + width + x)
                } else {
                    outside
                }
            };
            let (pairs, odd) = out.split_at_mut(width / 2);
            for (x, out) in (0..).step_by(2).zip(pairs) {
                *out = average(texel(upper + x), texel(upper + x + 1), lower(x), lower(x + 1));
            }
            for out in odd {
                *out = average(texel(upper + width - 1), outside, lower(width - 1), outside);
            }
        }
    }
}

/// Halving until one texel is left, rounding up.
fn sizes(width: usize, height: usize) -> Vec<(usize, usize)> {
    let mut sizes = vec![(width, height)];
    while let Some(&(w, h)) = sizes.last()
        && (w > 1 || h > 1)
        && sizes.len() < LEVELS
    {
        sizes.push((w.div_ceil(2), h.div_ceil(2)));
    }
    sizes
}

/// The mean of four texels, channel by channel, rounded.
fn average(a: u32, b: u32, c: u32, d: u32) -> u32 {
    const EVEN: u32 = 0x00ff_00ff;
    let half = |shift: u32| {
        let sum =
            ((a >> shift) & EVEN) + ((b >> shift) & EVEN) + ((c >> shift) & EVEN) + ((d >> shift) & EVEN);
        ((sum + 0x0002_0002) >> 2) & EVEN
    };
    half(0) | half(8) << 8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plain_texture_stays_plain_on_every_level() {
        let texture = MipTexture::new(13, 7, &[[10, 20, 30, 255]; 91], [10, 20, 30, 255]);
        assert_eq!(texture.levels(), 5);
        for level in 0..5 {
            assert_eq!(texture.look(6.0, 3.0, level)[..3], [1270, 2540, 3810]);
        }
    }

    #[test]
    fn the_outside_begins_half_a_texel_beyond_the_edge() {
        let texture = MipTexture::new(4, 4, &[[200; 4]; 16], [0; 4]);
        assert_eq!(texture.look(0.5, 2.0, 0)[..3], [200 * 127; 3]);
        assert_eq!(texture.look(-0.5, 2.0, 0), [0; 4]);
        assert_eq!(texture.look(4.5, 2.0, 0), [0; 4]);
        assert_eq!(texture.look(2.0, 400.0, 0), [0; 4]);
    }

    #[test]
    fn levels_average() {
        let mut texels = [[0u8; 4]; 16];
        texels[5] = [255; 4];
        let texture = MipTexture::new(4, 4, &texels, [0; 4]);
        assert_eq!(texture.look(1.0, 1.0, 1)[0], 64 * 127);
        assert_eq!(texture.look(2.0, 2.0, 2)[0], 16 * 127);
    }
}
