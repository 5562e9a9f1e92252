//! Textures with levels of detail.

use super::kernel::{LEVELS, LevelLayout, STEPS_PER_TEXEL, STRIDE, STRIP, Texel, Texels};

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
        let total: usize = sizes.iter().map(|&(w, h)| strips(w) * strip(h)).sum();
        let mut all: Vec<Texel> = vec![0; total];
        let mut layouts = [LevelLayout::default(); LEVELS];
        let mut rest = &mut all[..];
        let mut base = 0;
        let mut here: Vec<u32> = texels.iter().map(|texel| pack(*texel)).collect();
        for (level, &(w, h)) in sizes.iter().enumerate() {
            if level > 0 {
                let (finer_width, finer_height) = sizes[level - 1];
                here = halved(&here, finer_width, finer_height, outside);
            }
            let limit = |side: usize| ((padded(side) - 2) as f64 * STEPS_PER_TEXEL + 127.0) as f32;
            layouts[level] = LevelLayout {
                base: base as u32,
                strip: strip(h) as u32,
                limit: [limit(w), limit(h)],
            };
            let (out, after) = rest.split_at_mut(strips(w) * strip(h));
            fill_strips(&here, w, h, outside, out);
            (rest, base) = (after, base + out.len());
        }
        for level in sizes.len()..LEVELS {
            layouts[level] = layouts[sizes.len() - 1];
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

    /// The colour at a place given in texels of level 0 from the outer corner of texel (0, 0): R, G, B times 127.
    pub(super) fn look(&self, x: f32, y: f32, level: u32) -> [i32; 3] {
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
        [0, 1, 2].map(|c| (row(0, c) * (128 - fy) + row(4, c) * fy) >> 7)
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

/// Writes a level as strips, with its border.
fn fill_strips(texels: &[u32], width: usize, height: usize, outside: u32, out: &mut [Texel]) {
    let wide = strips(width) * STRIP + 1;
    let (mut here, mut below) = (vec![outside; wide], vec![outside; wide]);
    let length = strip(height);
    for y in 0..padded(height) {
        // Row y of the level and its border; the one below it.
        match (y + 1).checked_sub(BORDER).filter(|y| *y < height) {
            Some(y) => below[BORDER..BORDER + width].copy_from_slice(&texels[y * width..(y + 1) * width]),
            None => below.fill(outside),
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

/// Half the size, rounded up; what is missing at odd edges is `outside`.
fn halved(texels: &[u32], width: usize, height: usize, outside: u32) -> Vec<u32> {
    let mut out = Vec::with_capacity(width.div_ceil(2) * height.div_ceil(2));
    let missing = vec![outside; width];
    for y in (0..height).step_by(2) {
        let upper = &texels[y * width..(y + 1) * width];
        let lower = if y + 1 < height {
            &texels[(y + 1) * width..(y + 2) * width]
        } else {
            &missing
        };
        let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        out.extend(pairs.map(|(u, l)| average(u[0], u[1], l[0], l[1])));
        if width % 2 == 1 {
            out.push(average(upper[width - 1], outside, lower[width - 1], outside));
        }
    }
    out
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
            assert_eq!(texture.look(6.0, 3.0, level), [1270, 2540, 3810]);
        }
    }

    #[test]
    fn the_outside_begins_half_a_texel_beyond_the_edge() {
        let texture = MipTexture::new(4, 4, &[[200; 4]; 16], [0; 4]);
        assert_eq!(texture.look(0.5, 2.0, 0), [200 * 127; 3]);
        assert_eq!(texture.look(-0.5, 2.0, 0), [0; 3]);
        assert_eq!(texture.look(4.5, 2.0, 0), [0; 3]);
        assert_eq!(texture.look(2.0, 400.0, 0), [0; 3]);
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
