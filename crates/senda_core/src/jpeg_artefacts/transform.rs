//! Blocks of eight by eight values: cosine transform, quantisation, and back.

use super::lanes::Lanes;

/// Quantisation of brightness at quality 50, row by row: ITU-T T.81 annex K, table K.1.
pub(super) const BRIGHTNESS: [u8; 64] = [
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17,
    22, 29, 51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78,
    87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
];

/// Quantisation of colour at quality 50: table K.2.
pub(super) const COLOUR: [u8; 64] = [
    17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99, 99, 99, 47, 66,
    99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
];

/// Steps of one table at one quality.
#[derive(Debug, Clone)]
pub(super) struct Quantiser {
    steps: [[i32; 8]; 8],
    /// Division by eight times the step, as (value + correction) · reciprocal / 2¹⁵.
    reciprocals: [[i32; 8]; 8],
    corrections: [[i32; 8]; 8],
}

impl Quantiser {
    pub(super) fn new(table: &[u8; 64], quality: u8) -> Self {
        let quality = u32::from(quality);
        let scale = if quality < 50 {
            5000 / quality
        } else {
            200 - 2 * quality
        };
        let mut quantiser = Self {
            steps: [[0; 8]; 8],
            reciprocals: [[0; 8]; 8],
            corrections: [[0; 8]; 8],
        };
        for (i, &value) in table.iter().enumerate() {
            let step = ((u32::from(value) * scale + 50) / 100).clamp(1, 255);
            // The transform's results are eight times too large.
            let divisor = 8 * step;
            let (mut reciprocal, rest) = ((1 << 15) / divisor, (1 << 15) % divisor);
            let mut correction = divisor / 2;
            if rest > 0 && rest <= correction {
                correction += 1;
            } else if rest > 0 {
                reciprocal += 1;
            }
            quantiser.steps[i / 8][i % 8] = step as i32;
            quantiser.reciprocals[i / 8][i % 8] = reciprocal as i32;
            quantiser.corrections[i / 8][i % 8] = correction as i32;
        }
        quantiser
    }

    /// A block less 128 becomes the block as it is decoded, 0..=255.
    #[inline(always)]
    pub(super) fn apply<L: Lanes>(&self, block: &mut [L; 8]) {
        L::transpose(block);
        forward::<L, 11>(block, |sum| sum.left::<2>());
        L::transpose(block);
        forward::<L, 15>(block, |sum| sum.add(L::splat(2)).right::<2>());
        let mut rough = L::splat(0);
        for y in 0..8 {
            let value = block[y];
            let steps = value.abs().add(L::load(&self.corrections[y]));
            let steps = steps.times(L::load(&self.reciprocals[y])).right::<15>();
            block[y] = steps.signed_as(value).times(L::load(&self.steps[y]));
            rough = rough.or(if y == 0 {
                block[y].without_first()
            } else {
                block[y]
            });
        }
        if rough.is_zero() {
            let grey = (((block[0].first() + 4) >> 3) + 128).clamp(0, 255);
            *block = [L::splat(grey); 8];
            return;
        }
        backward::<L, 10>(block, 512);
        L::transpose(block);
        backward::<L, 17>(block, 512 + (1 << 16) + (128 << 17));
        L::transpose(block);
        for row in block {
            *row = row.clamped();
        }
    }
}

/// The cosine transform along the first index, in thirteen bits of fraction: Loeffler, Ligtenberg and Moschytz, "Practical
/// fast 1-D DCT algorithms with 11 multiplications", ICASSP 1989, in the form with twelve multiplications that the Independent
/// JPEG Group's software made usual. `SHIFT` bits are taken off again; `whole` scales what has no factor.
#[inline(always)]
fn forward<L: Lanes, const SHIFT: i32>(rows: &mut [L; 8], whole: impl Fn(L) -> L) {
    let rounded = |value: L| value.add(L::splat(1 << (SHIFT - 1))).right::<SHIFT>();
    let times = |value: L, factor: i32| value.times(L::splat(factor));
    let [r0, r1, r2, r3, r4, r5, r6, r7] = *rows;
    let (s07, d07) = (r0.add(r7), r0.subtract(r7));
    let (s16, d16) = (r1.add(r6), r1.subtract(r6));
    let (s25, d25) = (r2.add(r5), r2.subtract(r5));
    let (s34, d34) = (r3.add(r4), r3.subtract(r4));

    let (outer, outer_d) = (s07.add(s34), s07.subtract(s34));
    let (inner, inner_d) = (s16.add(s25), s16.subtract(s25));
    rows[0] = whole(outer.add(inner));
    rows[4] = whole(outer.subtract(inner));
    let z1 = times(inner_d.add(outer_d), 4433);
    rows[2] = rounded(z1.add(times(outer_d, 6270)));
    rows[6] = rounded(z1.add(times(inner_d, -15137)));

    let z3 = d34.add(d16);
    let z4 = d25.add(d07);
    let z5 = times(z3.add(z4), 9633);
    let z1 = times(d34.add(d07), -7373);
    let z2 = times(d25.add(d16), -20995);
    let z3 = times(z3, -16069).add(z5);
    let z4 = times(z4, -3196).add(z5);
    rows[7] = rounded(times(d34, 2446).add(z1).add(z3));
    rows[5] = rounded(times(d25, 16819).add(z2).add(z4));
    rows[3] = rounded(times(d16, 25172).add(z2).add(z3));
    rows[1] = rounded(times(d07, 12299).add(z1).add(z4));
}

/// The way back, in twelve bits of fraction; `offset` is added before `SHIFT` bits are taken off.
#[inline(always)]
fn backward<L: Lanes, const SHIFT: i32>(rows: &mut [L; 8], offset: i32) {
    let times = |value: L, factor: i32| value.times(L::splat(factor));
    let [r0, r1, r2, r3, r4, r5, r6, r7] = *rows;
    let p1 = times(r2.add(r6), 2217);
    let t2 = p1.add(times(r6, -7567));
    let t3 = p1.add(times(r2, 3135));
    let t0 = r0.add(r4).left::<12>().add(L::splat(offset));
    let t1 = r0.subtract(r4).left::<12>().add(L::splat(offset));
    let (x0, x3) = (t0.add(t3), t0.subtract(t3));
    let (x1, x2) = (t1.add(t2), t1.subtract(t2));

    let p3 = r7.add(r3);
    let p4 = r5.add(r1);
    let p5 = times(p3.add(p4), 4816);
    let p1 = p5.add(times(r7.add(r1), -3685));
    let p2 = p5.add(times(r5.add(r3), -10497));
    let p3 = times(p3, -8034);
    let p4 = times(p4, -1597);
    let t3 = times(r1, 6149).add(p1.add(p4));
    let t2 = times(r3, 12586).add(p2.add(p3));
    let t1 = times(r5, 8410).add(p2.add(p4));
    let t0 = times(r7, 1223).add(p1.add(p3));

    for (i, (even, odd)) in [(x0, t3), (x1, t2), (x2, t1), (x3, t0)].into_iter().enumerate() {
        rows[i] = even.add(odd).right::<SHIFT>();
        rows[7 - i] = even.subtract(odd).right::<SHIFT>();
    }
}
