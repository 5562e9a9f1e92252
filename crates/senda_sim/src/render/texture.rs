//! Textures with levels of detail.

use super::kernel::{LEVELS, LevelLayout, STEPS_PER_TEXEL, STRIDE, STRIP, Texel, Texels};
use senda_core::memory::prefer_large_pages;
use senda_world::paint::LONGEST_SIDE;

/// A picture of a plane in halving sizes, each with a border of one colour: looks beyond the edge see that colour.
#[derive(Debug, Clone)]
pub struct MipTexture {
    texels: Vec<Texel>,
    layouts: [LevelLayout; LEVELS],
    /// Columns and rows of each level.
    sizes: Vec<(usize, usize)>,
}

/// Texels of border on the low sides.
pub(super) const BORDER: usize = 1;

/// Texels of border on the high sides.
pub(super) const FAR_BORDER: usize = 2;

impl MipTexture {
    /// From `width` x `height` texels R, G, B, A in rows; `outside` is what lies beyond them.
    ///
    /// A (gloss) is kept as its square root, as the colours are: reflections are mixed in that form.
    ///
    /// # Panics
    /// When the number of texels is not `width · height`, or a side is 0 or above [`LONGEST_SIDE`].
    pub fn new(width: usize, height: usize, texels: &[[u8; 4]], outside: [u8; 4]) -> Self {
        assert_eq!(texels.len(), width * height);
        let pack = Packing::new();
        let outside = pack.texel(outside);
        let mut texture = Self::blank(width, height);
        let mut picture = Vec::new();
        pack.texels(texels, &mut picture);
        for level in 0..texture.levels() {
            let (width, height) = texture.size(level);
            texture.surround(level, outside);
            texture.store(level, [BORDER, BORDER], width, &picture);
            let mut halved = Vec::new();
            halve(&picture, (width, height), outside, &mut halved);
            picture = halved;
        }
        texture
    }

    /// A texture of this size that nobody may look at before its texels and its border are stored. Memory that nothing
    /// is stored in costs nothing.
    ///
    /// # Panics
    /// When a side is 0 or above [`LONGEST_SIDE`].
    pub(super) fn blank(width: usize, height: usize) -> Self {
        assert!((1..=LONGEST_SIDE).contains(&width) && (1..=LONGEST_SIDE).contains(&height));
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
        let mut texels: Vec<Texel> = vec![0; base];
        prefer_large_pages(&mut texels);
        Self {
            texels,
            layouts,
            sizes,
        }
    }

    /// Columns and rows of a level.
    pub(super) fn size(&self, level: usize) -> (usize, usize) {
        self.sizes[level]
    }

    /// Stores rows of `width` packed texels in a level; `at` is the place of the first, counted from the corner of the
    /// border.
    pub(super) fn store(&mut self, level: usize, at: [usize; 2], width: usize, rows: &[u32]) {
        const UPPER: u64 = 0xffff_ffff;
        let layout = self.layouts[level];
        let [column, row] = at;
        let height = rows.len() / width;
        // A strip begins with the texels that the strip before it ends with.
        for strip in column.saturating_sub(1) / STRIP..=(column + width - 1) / STRIP {
            let from = column.max(strip * STRIP);
            let to = (column + width).min(strip * STRIP + STRIDE);
            if from >= to {
                continue;
            }
            let within = layout.base as usize + strip * layout.strip as usize + from - strip * STRIP;
            let of_row = |y: usize| &rows[y * width + from - column..][..to - from];
            if row > 0 {
                let above = &mut self.texels[within + (row - 1) * STRIDE..][..to - from];
                for (out, below) in above.iter_mut().zip(of_row(0)) {
                    *out = *out & UPPER | Texel::from(*below) << 32;
                }
            }
            for y in 0..height {
                let out = &mut self.texels[within + (row + y) * STRIDE..][..to - from];
                if y + 1 < height {
                    let pairs = of_row(y).iter().zip(of_row(y + 1));
                    for (out, (upper, lower)) in out.iter_mut().zip(pairs) {
                        *out = Texel::from(*upper) | Texel::from(*lower) << 32;
                    }
                } else {
                    for (out, upper) in out.iter_mut().zip(of_row(y)) {
                        *out = Texel::from(*upper) | *out & !UPPER;
                    }
                }
            }
        }
    }

    /// Stores the border of a level.
    pub(super) fn surround(&mut self, level: usize, outside: u32) {
        let (width, height) = self.size(level);
        let border = vec![outside; FAR_BORDER * padded(width.max(height))];
        for (at, [wide, high]) in [
            ([0, 0], [BORDER, padded(height)]),
            ([BORDER + width, 0], [FAR_BORDER, padded(height)]),
            ([0, 0], [padded(width), BORDER]),
            ([0, BORDER + height], [padded(width), FAR_BORDER]),
        ] {
            self.store(level, at, wide, &border[..wide * high]);
        }
    }

    /// A packed texel of a level.
    pub(super) fn texel(&self, level: usize, column: usize, row: usize) -> u32 {
        self.texels[self.layouts[level].index((column + BORDER) as u32, (row + BORDER) as u32)] as u32
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.sizes.len()
    }

    /// Where the outer corner of texel (0, 0) lies in a level, in that level's texels times [`STEPS_PER_TEXEL`],
    /// counted so that whole numbers are texels' middles.
    pub(super) const ORIGIN: f64 = (BORDER as f64 - 0.5) * STEPS_PER_TEXEL;

    pub(super) fn texels(&self) -> Texels<'_> {
        Texels::new(&self.texels, &self.layouts)
    }

    /// The texel at a place given in texels of level 0 from the outer corner of texel (0, 0): R, G, B, A times 127.
    pub(super) fn look(&self, x: f32, y: f32, level: u32) -> [i32; 4] {
        let level = (level as usize).min(self.levels() - 1);
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

/// A side with its border.
fn padded(side: usize) -> usize {
    side + BORDER + FAR_BORDER
}

/// Strips of a level.
fn strips(width: usize) -> usize {
    padded(width).div_ceil(STRIP)
}

/// Texels of a strip.
fn strip(height: usize) -> usize {
    padded(height) * STRIDE
}

/// Makes texels as they are kept.
#[derive(Debug)]
pub(super) struct Packing {
    gloss: [u8; 256],
}

impl Packing {
    pub(super) fn new() -> Self {
        Self {
            gloss: std::array::from_fn(|a| (255.0 * (a as f64 / 255.0).sqrt()).round() as u8),
        }
    }

    #[inline]
    pub(super) fn texel(&self, [r, g, b, a]: [u8; 4]) -> u32 {
        u32::from_le_bytes([r, g, b, self.gloss[usize::from(a)]])
    }

    /// Packs texels into `out`, whose memory is reused.
    pub(super) fn texels(&self, texels: &[[u8; 4]], out: &mut Vec<u32>) {
        out.clear();
        out.extend(texels.iter().map(|texel| self.texel(*texel)));
    }
}

/// Rows of half the size, rounded up, into `out`, whose memory is reused; what is missing at odd edges is `outside`.
pub(super) fn halve(picture: &[u32], (width, height): (usize, usize), outside: u32, out: &mut Vec<u32>) {
    out.clear();
    for pair in picture.chunks(2 * width) {
        let (upper, lower) = pair.split_at(width);
        let [even, odd] = [upper, lower].map(|row| row.as_chunks::<2>());
        if lower.is_empty() {
            out.extend(even.0.iter().map(|[a, b]| average(*a, *b, outside, outside)));
            out.extend(even.1.iter().map(|a| average(*a, outside, outside, outside)));
        } else {
            let pairs = even.0.iter().zip(odd.0);
            out.extend(pairs.map(|([a, b], [c, d])| average(*a, *b, *c, *d)));
            let singles = even.1.iter().zip(odd.1);
            out.extend(singles.map(|(a, c)| average(*a, outside, *c, outside)));
        }
    }
    debug_assert_eq!(out.len(), width.div_ceil(2) * height.div_ceil(2));
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
pub(super) fn average(a: u32, b: u32, c: u32, d: u32) -> u32 {
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
