//! The pixel loops in plain Rust. What the AVX2 version must equal.

use super::{
    Colours, Detail, GROUP, GroupRun, LevelLayout, LightNode, Look, Looks, Positions, SLOTS, Shading,
    Surface, Texels, middle, rounded_product,
};

pub(super) fn sample(
    texels: Texels<'_>,
    looks: &Looks,
    looks_log2: u32,
    groups: GroupRun<'_>,
    out: &mut [Colours],
) {
    for ((at, detail), out) in groups.iter().zip(out) {
        let log2 = looks_log2.max(u32::from(detail.looks_log2));
        let count = 1usize << log2;
        let layout = &texels.layouts[usize::from(detail.level)];
        let mut sums = [0i32; 4 * GROUP];
        for look in &looks[count - 1..2 * count - 1] {
            let (x, y) = positions(at, detail, look, layout);
            for (k, pixel) in SLOTS.into_iter().enumerate() {
                let (fx, fy) = (x[k] & 127, y[k] & 127);
                let at = layout.index(x[k] >> 7, y[k] >> 7);
                let [left, right] = [texels.texels[at], texels.texels[at + 1]];
                let upper = mix(left as u32, right as u32, fx);
                let lower = mix((left >> 32) as u32, (right >> 32) as u32, fx);
                for half in 0..2 {
                    // Two channels of 16 bits become two of 32: the vertical weights add 7 bits.
                    let wide = widen(upper[half]) * u64::from(128 - fy) + widen(lower[half]) * u64::from(fy);
                    sums[4 * pixel + half] += wide as u32 as i32;
                    sums[4 * pixel + half + 2] += (wide >> 32) as i32;
                }
            }
        }
        for (out, sum) in out.iter_mut().zip(&sums) {
            *out = (sum >> (7 + log2)) as i16;
        }
    }
}

/// Texture coordinates of a group, 7 bits below the point, kept inside the level.
#[inline(always)]
fn positions(
    at: &Positions,
    detail: &Detail,
    look: &Look,
    layout: &LevelLayout,
) -> ([u32; GROUP], [u32; GROUP]) {
    let [x0, y0] = look.origin[usize::from(detail.level)];
    let (along_x, along_y) = (detail.spread[0] * look.part, detail.spread[1] * look.part);
    let (mut xs, mut ys) = ([0; GROUP], [0; GROUP]);
    for k in 0..GROUP {
        let (x, y) = (at.x[k] + along_x, at.y[k] + along_y);
        xs[k] = inside(look.cos * x - look.sin * y + x0, layout.limit[0]);
        ys[k] = inside(look.sin * x + look.cos * y + y0, layout.limit[1]);
    }
    (xs, ys)
}

#[inline(always)]
fn inside(value: f32, limit: f32) -> u32 {
    let value = if value > 0.0 { value } else { 0.0 };
    (if value < limit { value } else { limit }) as u32
}

/// Weighs two texels by 127 - part and part: [R and B, G and A] in 16 bits each.
#[inline(always)]
fn mix(a: u32, b: u32, part: u32) -> [u32; 2] {
    const EVEN: u32 = 0x00ff_00ff;
    [
        (a & EVEN) * (127 - part) + (b & EVEN) * part,
        ((a >> 8) & EVEN) * (127 - part) + ((b >> 8) & EVEN) * part,
    ]
}

#[inline(always)]
fn widen(pair: u32) -> u64 {
    u64::from(pair & 0xffff) | u64::from(pair >> 16) << 32
}

pub(super) fn expose(
    surfaces: &[Surface],
    mirrored: &[[f32; 4]],
    gain: [f32; 4],
    glow: [f32; 4],
    out: &mut [LightNode],
) {
    let limited = |value: f32| value.clamp(0.0, 32_767.0) as i16;
    for ((out, surface), mirrored) in out.iter_mut().zip(surfaces).zip(mirrored) {
        for c in 0..4 {
            let glow = glow[c] * (surface.fresnel * mirrored[c]).sqrt();
            out[c] = limited(gain[c] * surface.vignette);
            out[c + 4] = limited(glow * surface.vignette);
        }
    }
}

pub(super) fn shade(colours: &[Colours], shading: &Shading<'_>, row: &mut [u8]) {
    let node = |g: usize| between(&shading.above[g], &shading.below[g], shading.part);
    let mut left = node(0);
    for (g, (colours, row)) in colours.iter().zip(row.chunks_mut(3 * GROUP)).enumerate() {
        let right = node(g + 1);
        let noise = &shading.noise[4 * GROUP * g..][..4 * GROUP];
        let mut bytes = [0u8; 4 * GROUP];
        for k in 0..GROUP {
            let light = between(&left, &right, middle(k));
            let gloss = if shading.glows {
                i32::from(colours[4 * k + 3])
            } else {
                0
            };
            for c in 0..3 {
                let i = 4 * k + c;
                let lit = ((i32::from(colours[i]) * i32::from(light[c])) >> 16) as i16;
                let mirrored = ((gloss * i32::from(light[c + 4])) >> 16) as i16;
                let (high, low) = (lit.max(mirrored), lit.min(mirrored));
                // √(a² + b²) within 3 %: bytes are close to the square root of light, and light adds.
                let both = high.max(high - (high >> 3) + (low >> 1));
                let level = shading.noise_dark - rounded_product(both.min(4095), shading.noise_fall);
                let value = both + rounded_product(i16::from(noise[i]) << 8, level) + 8;
                bytes[i] = (value >> 4).clamp(0, 255) as u8;
            }
        }
        for (out, pixel) in row.chunks_exact_mut(3).zip(bytes.chunks_exact(4)) {
            out.copy_from_slice(&pixel[..3]);
        }
        left = right;
    }
}

/// `a + (b - a)·part`, part in Q15.
#[inline(always)]
fn between(a: &LightNode, b: &LightNode, part: i16) -> LightNode {
    let mut node = [0; 8];
    for i in 0..8 {
        node[i] = a[i] + rounded_product(b[i] - a[i], part);
    }
    node
}

pub(super) fn blur_across(row: &[Colours], weight: i16, out: &mut [Colours]) {
    let (row, out) = (row.as_flattened(), out.as_flattened_mut());
    let last = row.len() - 4;
    for i in 0..row.len() {
        let left = if i < 4 { row[i] } else { row[i - 4] };
        let right = if i < last { row[i + 4] } else { row[i] };
        out[i] = blurred(left, row[i], right, weight);
    }
}

pub(super) fn blur_down(rows: [&[Colours]; 3], weight: i16, out: &mut [Colours]) {
    let [above, here, below] = rows.map(|row| row.as_flattened());
    let beside = above.iter().zip(below);
    for ((out, here), (above, below)) in out.as_flattened_mut().iter_mut().zip(here).zip(beside) {
        *out = blurred(*above, *here, *below, weight);
    }
}

/// Colours are not negative: the rounded mean of both neighbours is that of `pavgw`.
#[inline(always)]
fn blurred(a: i16, here: i16, b: i16, weight: i16) -> i16 {
    let mean = ((i32::from(a) + i32::from(b) + 1) >> 1) as i16;
    here + rounded_product(mean - here, weight)
}
