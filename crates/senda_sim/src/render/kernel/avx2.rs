//! The pixel loops with 256-bit vectors. Every step mirrors `portable.rs`, bit for bit; tests compare them.

use super::{
    Colours, Detail, GROUP, GroupRun, LevelLayout, LightNode, Look, Looks, MOST_LOOKS_LOG2, Positions, STRIP,
    Shading, Surface, Texel, Texels, middle,
};
use std::arch::x86_64::*;
use std::mem::MaybeUninit;

/// Looks whose places are found before the first of them reads its texels: finding them first, the processor waits for
/// many texels at once instead of for one group's after the other's.
const AHEAD: usize = 32;

const _: () = assert!(
    AHEAD >= 1 << MOST_LOOKS_LOG2,
    "a group's looks are found together"
);

/// Where one look of eight pixels reads, and how it weighs what it reads.
#[derive(Clone, Copy)]
struct Place {
    /// Indices of the left upper texels.
    at: Indices,
    /// Weights of the left and the right texel (bytes), twice.
    weights_x: __m256i,
    /// Weights of the upper and the lower texel (16 bits).
    weights_y: __m256i,
}

/// Indices of the texels of eight pixels.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
struct Indices([u32; GROUP]);

/// Room for them.
type Places = [MaybeUninit<Place>; AHEAD];

/// # Safety
/// The processor has AVX2.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn sample(
    texels: Texels<'_>,
    looks: &Looks,
    looks_log2: u32,
    groups: GroupRun<'_>,
    out: &mut [Colours],
) {
    let mut places: Places = [const { MaybeUninit::uninit() }; AHEAD];
    let (mut groups, mut out) = (groups, &mut out[..groups.len()]);
    if looks_log2 == 0 && groups.look_once() {
        while groups.len() > 0 {
            let ahead = AHEAD.min(groups.len());
            let (now, later) = groups.split_at(ahead);
            let (out_now, out_later) = out.split_at_mut(ahead);
            sample_once(texels, &looks[0], &mut places, now, out_now);
            (groups, out) = (later, out_later);
        }
        return;
    }
    while groups.len() > 0 {
        let (mut ahead, mut looks_ahead) = (0, 0);
        for detail in groups.details() {
            let count = looks_of(detail, looks_log2);
            if looks_ahead + count > AHEAD {
                break;
            }
            (ahead, looks_ahead) = (ahead + 1, looks_ahead + count);
        }
        let (now, later) = groups.split_at(ahead);
        let (out_now, out_later) = out.split_at_mut(ahead);
        sample_often(texels, looks, looks_log2, &mut places, now, out_now);
        (groups, out) = (later, out_later);
    }
}

/// For groups with one look a pixel, at most [`AHEAD`].
#[target_feature(enable = "avx2")]
#[inline]
fn sample_once(
    texels: Texels<'_>,
    look: &Look,
    places: &mut Places,
    groups: GroupRun<'_>,
    out: &mut [Colours],
) {
    for ((at, detail), place) in groups.iter().zip(places.iter_mut()) {
        let level = usize::from(detail.level);
        let (x, y) = positions(at);
        place.write(find(&texels.layouts[level], look, &look.origin[level], x, y));
    }
    for (place, out) in found(places, groups.len()).iter().zip(out) {
        let [a, b, c, d] = look_up(texels.texels, place);
        let (a, b) = (_mm256_srai_epi32::<7>(a), _mm256_srai_epi32::<7>(b));
        let (c, d) = (_mm256_srai_epi32::<7>(c), _mm256_srai_epi32::<7>(d));
        store(_mm256_packs_epi32(a, b), _mm256_packs_epi32(c, d), out);
    }
}

/// For groups with 2^`looks_log2` looks a pixel or more, at most [`AHEAD`] together.
#[target_feature(enable = "avx2")]
#[inline]
fn sample_often(
    texels: Texels<'_>,
    looks: &Looks,
    looks_log2: u32,
    places: &mut Places,
    groups: GroupRun<'_>,
    out: &mut [Colours],
) {
    let mut taken = 0;
    for (at, detail) in groups.iter() {
        let count = looks_of(detail, looks_log2);
        let level = usize::from(detail.level);
        let layout = &texels.layouts[level];
        let (x, y) = positions(at);
        let (spread_x, spread_y) = (_mm256_set1_ps(detail.spread[0]), _mm256_set1_ps(detail.spread[1]));
        for (place, look) in places[taken..taken + count].iter_mut().zip(&looks[count - 1..]) {
            let part = _mm256_set1_ps(look.part);
            let x = _mm256_add_ps(x, _mm256_mul_ps(spread_x, part));
            let y = _mm256_add_ps(y, _mm256_mul_ps(spread_y, part));
            place.write(find(layout, look, &look.origin[level], x, y));
        }
        taken += count;
    }
    let mut rest = found(places, taken);
    for (detail, out) in groups.details().iter().zip(out) {
        let log2 = looks_log2.max(u32::from(detail.looks_log2));
        let (mine, others) = rest.split_at(1 << log2);
        rest = others;
        let mut sums = look_up(texels.texels, &mine[0]);
        for place in &mine[1..] {
            let more = look_up(texels.texels, place);
            for k in 0..4 {
                sums[k] = _mm256_add_epi32(sums[k], more[k]);
            }
        }
        let shift = _mm_cvtsi32_si128(7 + log2 as i32);
        // Spelled out: closures handed to library functions would not be compiled for AVX2.
        let (a, b) = (_mm256_sra_epi32(sums[0], shift), _mm256_sra_epi32(sums[1], shift));
        let (c, d) = (_mm256_sra_epi32(sums[2], shift), _mm256_sra_epi32(sums[3], shift));
        store(_mm256_packs_epi32(a, b), _mm256_packs_epi32(c, d), out);
    }
}

/// Where the pixels of a group look, in the order of [`SLOTS`].
#[target_feature(enable = "avx2")]
#[inline]
fn positions(at: &Positions) -> (__m256, __m256) {
    // SAFETY: `Positions` are aligned to 64 bytes, their two fields are eight floats each.
    unsafe { (_mm256_load_ps(at.x.as_ptr()), _mm256_load_ps(at.y.as_ptr())) }
}

/// How many looks a group takes.
#[inline]
fn looks_of(detail: &Detail, looks_log2: u32) -> usize {
    1 << looks_log2.max(u32::from(detail.looks_log2))
}

/// The first places, which have been written.
#[inline]
fn found(places: &Places, count: usize) -> &[Place] {
    // Kept from being merged with the loop that wrote them, and read from memory: that is quicker than taking vectors
    // apart, which the compiler would do.
    let places = &std::hint::black_box(places)[..count];
    // SAFETY: the callers wrote the first `count`.
    unsafe { &*(std::ptr::from_ref(places) as *const [Place]) }
}

/// Writes a group's colours.
#[target_feature(enable = "avx2")]
#[inline]
fn store(first: __m256i, last: __m256i, out: &mut Colours) {
    // SAFETY: `Colours` is 32 integers of 16 bits.
    unsafe {
        _mm256_storeu_si256(out.as_mut_ptr().cast(), first);
        _mm256_storeu_si256(out.as_mut_ptr().add(16).cast(), last);
    }
}

/// Finds where a look of eight pixels reads.
#[target_feature(enable = "avx2")]
#[inline]
fn find(layout: &LevelLayout, look: &Look, origin: &[f32; 2], x: __m256, y: __m256) -> Place {
    let low7 = _mm256_set1_epi32(127);
    let (cos, sin) = (_mm256_set1_ps(look.cos), _mm256_set1_ps(look.sin));
    let x_turned = _mm256_sub_ps(_mm256_mul_ps(cos, x), _mm256_mul_ps(sin, y));
    let y_turned = _mm256_add_ps(_mm256_mul_ps(sin, x), _mm256_mul_ps(cos, y));
    let x = _mm256_add_ps(x_turned, _mm256_broadcast_ss(&origin[0]));
    let y = _mm256_add_ps(y_turned, _mm256_broadcast_ss(&origin[1]));
    let x = _mm256_min_ps(
        _mm256_max_ps(x, _mm256_setzero_ps()),
        _mm256_set1_ps(layout.limit[0]),
    );
    let y = _mm256_min_ps(
        _mm256_max_ps(y, _mm256_setzero_ps()),
        _mm256_set1_ps(layout.limit[1]),
    );
    let (x, y) = (_mm256_cvttps_epi32(x), _mm256_cvttps_epi32(y));
    let strips = _mm256_srli_epi32::<{ 7 + STRIP.ilog2() as i32 }>(x);
    let strips = _mm256_mullo_epi32(strips, _mm256_set1_epi32(layout.strip as i32));
    let column = _mm256_and_si256(_mm256_srli_epi32::<7>(x), _mm256_set1_epi32(STRIP as i32 - 1));
    let row = _mm256_srli_epi32::<7>(y);
    // STRIDE is 17.
    let down = _mm256_add_epi32(_mm256_slli_epi32::<4>(row), row);
    let at = _mm256_add_epi32(_mm256_add_epi32(strips, column), down);
    let at = _mm256_add_epi32(at, _mm256_set1_epi32(layout.base as i32));
    // Bytes 127 - fx, fx, twice: of seven bits, 127 - fx is the complement.
    let fx = _mm256_shuffle_epi8(x, both(&[0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12]));
    let weights_x = _mm256_xor_si256(
        _mm256_and_si256(fx, _mm256_set1_epi8(127)),
        _mm256_set1_epi16(127),
    );
    // 128 - fy in the low half, fy in the high half: 128 + 65535·fy.
    let fy = _mm256_and_si256(y, low7);
    let weights_y = _mm256_sub_epi32(_mm256_slli_epi32::<16>(fy), fy);
    let weights_y = _mm256_add_epi32(weights_y, _mm256_set1_epi32(128));
    let mut index = Indices([0; GROUP]);
    // SAFETY: eight 32-bit integers, aligned.
    unsafe { _mm256_store_si256(index.0.as_mut_ptr().cast(), at) };
    Place {
        at: index,
        weights_x,
        weights_y,
    }
}

/// One bilinear look of eight pixels: R, G, B, gloss times 127 · 128 of pixels 0 and 2, 1 and 3, 4 and 6, 5 and 7
/// (slots 0 and 4, 1 and 5 ...).
#[target_feature(enable = "avx2")]
#[inline]
fn look_up(texels: &[Texel], place: &Place) -> [__m256i; 4] {
    let (index, weights_x, weights_y) = (&place.at.0, place.weights_x, place.weights_y);
    // Left texel, the one below it, right texel, the one below it, to a.r b.r c.r d.r, a.g b.g c.g d.g ...
    let interleave = both(&[0, 8, 4, 12, 1, 9, 5, 13, 2, 10, 6, 14, 3, 11, 7, 15]);
    let mut sums = [_mm256_setzero_si256(); 4];
    macro_rules! pair {
        ($k:literal, $broadcast:literal) => {
            // SAFETY: coordinates were clamped to the level's limits, for which `Texels::new` checked that the texel
            // and its right neighbour are inside the slice.
            let four = unsafe {
                let low = _mm_loadu_si128(texels.as_ptr().add(index[$k] as usize).cast());
                let high = _mm_loadu_si128(texels.as_ptr().add(index[$k + 4] as usize).cast());
                _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(low), high)
            };
            let across = _mm256_maddubs_epi16(
                _mm256_shuffle_epi8(four, interleave),
                _mm256_shuffle_epi32::<$broadcast>(weights_x),
            );
            sums[$k] = _mm256_madd_epi16(across, _mm256_shuffle_epi32::<$broadcast>(weights_y));
        };
    }
    pair!(0, 0b00_00_00_00);
    pair!(1, 0b01_01_01_01);
    pair!(2, 0b10_10_10_10);
    pair!(3, 0b11_11_11_11);
    sums
}

/// The same byte pattern in both halves.
#[target_feature(enable = "avx2")]
fn both(p: &[i8; 16]) -> __m256i {
    _mm256_setr_epi8(
        p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14], p[15],
        p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14], p[15],
    )
}

/// # Safety
/// The processor has AVX2.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn expose(
    surfaces: &[Surface],
    mirrored: &[[f32; 4]],
    gain: [f32; 4],
    glow: [f32; 4],
    out: &mut [LightNode],
) {
    let [r, g, b, a] = gain;
    let gain = _mm_setr_ps(r, g, b, a);
    let [r, g, b, a] = glow;
    let glow = _mm_setr_ps(r, g, b, a);
    let (black, most) = (_mm_setzero_ps(), _mm_set1_ps(32_767.0));
    for ((out, surface), mirrored) in out.iter_mut().zip(surfaces).zip(mirrored) {
        // SAFETY: four floats.
        let mirrored = unsafe { _mm_loadu_ps(mirrored.as_ptr()) };
        let vignette = _mm_set1_ps(surface.vignette);
        let reflected = _mm_sqrt_ps(_mm_mul_ps(_mm_set1_ps(surface.fresnel), mirrored));
        let gain = _mm_mul_ps(gain, vignette);
        let glow = _mm_mul_ps(_mm_mul_ps(glow, reflected), vignette);
        let gain = _mm_cvttps_epi32(_mm_min_ps(_mm_max_ps(gain, black), most));
        let glow = _mm_cvttps_epi32(_mm_min_ps(_mm_max_ps(glow, black), most));
        // SAFETY: eight integers of 16 bits.
        unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), _mm_packs_epi32(gain, glow)) };
    }
}

/// # Safety
/// The processor has AVX2; the lengths are those that `Kernel::shade` checks.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn shade(colours: &[Colours], shading: &Shading<'_>, row: &mut [u8]) {
    // Without noise or reflections their steps change nothing: leaving them out keeps the bytes and saves a third.
    let noisy = shading.noise_dark != 0 || shading.noise_fall != 0;
    // SAFETY: promised by the caller.
    unsafe {
        match (shading.glows, noisy) {
            (true, true) => shade_with::<true, true>(colours, shading, row),
            (true, false) => shade_with::<true, false>(colours, shading, row),
            (false, true) => shade_with::<false, true>(colours, shading, row),
            (false, false) => shade_with::<false, false>(colours, shading, row),
        }
    }
}

/// # Safety
/// As [`shade`].
#[target_feature(enable = "avx2")]
unsafe fn shade_with<const GLOWS: bool, const NOISY: bool>(
    colours: &[Colours],
    shading: &Shading<'_>,
    row: &mut [u8],
) {
    // Half 0 of the work is pixels 0 and 1 | 4 and 5, half 1 is 2 and 3 | 6 and 7: packed, they are in order.
    let parts = [middles([0, 1, 4, 5]), middles([2, 3, 6, 7])];
    let alpha = both(&[6, 7, 6, 7, 6, 7, 6, 7, 14, 15, 14, 15, 14, 15, 14, 15]);
    let drop_alpha = both(&[0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1]);
    let (dark, fall) = (
        _mm256_set1_epi16(shading.noise_dark),
        _mm256_set1_epi16(shading.noise_fall),
    );
    let part = _mm256_set1_epi16(shading.part);
    let mut nodes = shading.above.iter().zip(shading.below);
    let (white, half) = (_mm256_set1_epi16(4095), _mm256_set1_epi16(8));
    let noises = shading.noise.chunks_exact(4 * GROUP);
    let Some(mut left) = nodes.next().map(|(above, below)| node(above, below, part)) else {
        return;
    };
    for (g, ((colours, noise), (above, below))) in colours.iter().zip(noises).zip(nodes).enumerate() {
        let right = node(above, below, part);
        let step = _mm256_sub_epi16(right, left);
        let (gain, glow) = (
            _mm256_unpacklo_epi64(left, left),
            _mm256_unpackhi_epi64(left, left),
        );
        let (gain_step, glow_step) = (
            _mm256_unpacklo_epi64(step, step),
            _mm256_unpackhi_epi64(step, step),
        );
        left = right;
        // SAFETY: 32 bytes.
        let noise = unsafe { _mm256_loadu_si256(noise.as_ptr().cast()) };
        // Bytes in the upper halves of 16-bit lanes.
        let noise = [
            _mm256_unpacklo_epi8(_mm256_setzero_si256(), noise),
            _mm256_unpackhi_epi8(_mm256_setzero_si256(), noise),
        ];
        let mut values = [_mm256_setzero_si256(); 2];
        for i in 0..2 {
            // SAFETY: `Colours` is four times 8 integers of 16 bits.
            let colour = unsafe {
                let low = _mm_loadu_si128(colours.as_ptr().add(8 * i).cast());
                let high = _mm_loadu_si128(colours.as_ptr().add(8 * i + 16).cast());
                _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(low), high)
            };
            let gain = _mm256_add_epi16(gain, _mm256_mulhrs_epi16(gain_step, parts[i]));
            let mut value = _mm256_mulhi_epu16(colour, gain);
            if GLOWS {
                let glow = _mm256_add_epi16(glow, _mm256_mulhrs_epi16(glow_step, parts[i]));
                let mirrored = _mm256_mulhi_epu16(_mm256_shuffle_epi8(colour, alpha), glow);
                let (high, low) = (
                    _mm256_max_epi16(value, mirrored),
                    _mm256_min_epi16(value, mirrored),
                );
                let sum = _mm256_sub_epi16(high, _mm256_srai_epi16::<3>(high));
                value = _mm256_max_epi16(high, _mm256_add_epi16(sum, _mm256_srai_epi16::<1>(low)));
            }
            if NOISY {
                let level = _mm256_sub_epi16(dark, _mm256_mulhrs_epi16(_mm256_min_epi16(value, white), fall));
                value = _mm256_add_epi16(value, _mm256_mulhrs_epi16(noise[i], level));
            }
            values[i] = _mm256_srai_epi16::<4>(_mm256_add_epi16(value, half));
        }
        let bytes = _mm256_shuffle_epi8(_mm256_packus_epi16(values[0], values[1]), drop_alpha);
        // Twelve bytes in each half, and four that the next store writes over.
        let from = 3 * GROUP * g;
        let write = |to: &mut [u8]| {
            debug_assert!(to.len() >= 28);
            // SAFETY: 16 bytes at 0 and at 12 into 28 or more, which the callers checked.
            unsafe {
                _mm_storeu_si128(to.as_mut_ptr().cast(), _mm256_castsi256_si128(bytes));
                _mm_storeu_si128(
                    to.as_mut_ptr().add(12).cast(),
                    _mm256_extracti128_si256::<1>(bytes),
                );
            }
        };
        match row.get_mut(from..from + 28) {
            Some(to) => write(to),
            None => {
                let mut whole = [0u8; 28];
                write(&mut whole);
                let rest = &mut row[from..];
                let count = rest.len().min(3 * GROUP);
                rest[..count].copy_from_slice(&whole[..count]);
            }
        }
    }
}

/// Where four pixels lie in their group, in all four channels.
#[target_feature(enable = "avx2")]
fn middles(pixels: [usize; 4]) -> __m256i {
    let [a, b, c, d] = pixels.map(middle);
    _mm256_setr_epi16(a, a, a, a, b, b, b, b, c, c, c, c, d, d, d, d)
}

/// The light between a node above and one below the row, in both halves.
#[target_feature(enable = "avx2")]
#[inline]
fn node(above: &LightNode, below: &LightNode, part: __m256i) -> __m256i {
    // SAFETY: eight integers of 16 bits each.
    let (above, below) = unsafe {
        (
            _mm_loadu_si128(above.as_ptr().cast()),
            _mm_loadu_si128(below.as_ptr().cast()),
        )
    };
    let (above, below) = (
        _mm256_broadcastsi128_si256(above),
        _mm256_broadcastsi128_si256(below),
    );
    _mm256_add_epi16(above, _mm256_mulhrs_epi16(_mm256_sub_epi16(below, above), part))
}

/// # Safety
/// The processor has AVX2; both rows are equally long.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn blur_across(row: &[Colours], weight: i16, out: &mut [Colours]) {
    let (row, out) = (row.as_flattened(), out.as_flattened_mut());
    let weight = _mm256_set1_epi16(weight);
    let last = row.len() - 16;
    for i in (0..row.len()).step_by(16) {
        // SAFETY: i + 16 is at most the length of both; the neighbours 4 away are read where they exist.
        unsafe {
            let here = _mm256_loadu_si256(row.as_ptr().add(i).cast());
            let left = if i > 0 {
                _mm256_loadu_si256(row.as_ptr().add(i - 4).cast())
            } else {
                // The first pixel again, then the first three.
                _mm256_permute4x64_epi64::<0b10_01_00_00>(here)
            };
            let right = if i < last {
                _mm256_loadu_si256(row.as_ptr().add(i + 4).cast())
            } else {
                _mm256_permute4x64_epi64::<0b11_11_10_01>(here)
            };
            let value = blurred(left, here, right, weight);
            _mm256_storeu_si256(out.as_mut_ptr().add(i).cast(), value);
        }
    }
}

/// # Safety
/// The processor has AVX2; all rows are equally long.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn blur_down(rows: [&[Colours]; 3], weight: i16, out: &mut [Colours]) {
    let (above, here, below) = (
        rows[0].as_flattened(),
        rows[1].as_flattened(),
        rows[2].as_flattened(),
    );
    let out = out.as_flattened_mut();
    let weight = _mm256_set1_epi16(weight);
    for i in (0..out.len()).step_by(16) {
        // SAFETY: i + 16 is at most the length of all.
        unsafe {
            let above = _mm256_loadu_si256(above.as_ptr().add(i).cast());
            let here = _mm256_loadu_si256(here.as_ptr().add(i).cast());
            let below = _mm256_loadu_si256(below.as_ptr().add(i).cast());
            let value = blurred(above, here, below, weight);
            _mm256_storeu_si256(out.as_mut_ptr().add(i).cast(), value);
        }
    }
}

#[target_feature(enable = "avx2")]
fn blurred(a: __m256i, here: __m256i, b: __m256i, weight: __m256i) -> __m256i {
    let mean = _mm256_avg_epu16(a, b);
    _mm256_add_epi16(here, _mm256_mulhrs_epi16(_mm256_sub_epi16(mean, here), weight))
}
