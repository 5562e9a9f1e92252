//! The pixel loops with 256-bit vectors. Every step mirrors `portable.rs`, bit for bit; tests compare them.

use super::{Colours, GROUP, Group, Looks, Shading, Texels, middle};
use std::arch::x86_64::{
    __m128i, __m256i, _mm_cvtsi32_si128, _mm_loadl_epi64, _mm_storel_epi64, _mm_storeu_si128,
    _mm_unpacklo_epi64, _mm256_add_epi16, _mm256_add_epi32, _mm256_add_ps, _mm256_and_si256,
    _mm256_castsi128_si256, _mm256_castsi256_si128, _mm256_cvttps_epi32, _mm256_extracti128_si256,
    _mm256_inserti128_si256, _mm256_load_ps, _mm256_loadu_si256, _mm256_madd_epi16, _mm256_maddubs_epi16,
    _mm256_max_epi16, _mm256_max_ps, _mm256_min_epi16, _mm256_min_ps, _mm256_mul_ps, _mm256_mulhi_epu16,
    _mm256_mulhrs_epi16, _mm256_mullo_epi32, _mm256_packs_epi32, _mm256_packus_epi16,
    _mm256_permute2x128_si256, _mm256_permute4x64_epi64, _mm256_permutevar8x32_epi32, _mm256_set1_epi16,
    _mm256_set1_epi32, _mm256_set1_epi64x, _mm256_set1_ps, _mm256_setr_epi8, _mm256_setr_epi16,
    _mm256_setr_epi32, _mm256_setzero_ps, _mm256_setzero_si256, _mm256_shuffle_epi8, _mm256_shuffle_epi32,
    _mm256_slli_epi32, _mm256_sra_epi32, _mm256_srai_epi16, _mm256_srli_epi32, _mm256_storeu_si256,
    _mm256_sub_epi16, _mm256_sub_epi32, _mm256_sub_ps, _mm256_unpackhi_epi8, _mm256_unpacklo_epi8,
};

/// # Safety
/// The processor has AVX2.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn sample(
    texels: Texels<'_>,
    looks: &Looks,
    looks_log2: u32,
    groups: &[Group],
    out: &mut [Colours],
) {
    let low7 = _mm256_set1_epi32(127);
    // Bytes of two texels above and two below, interleaved by channel: a.r b.r c.r d.r, a.g b.g ...
    let interleave = both(&[0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15]);
    for (group, out) in groups.iter().zip(out) {
        let log2 = looks_log2.max(group.looks_log2);
        let count = 1usize << log2;
        let layout = &texels.layouts[group.level as usize];
        let stride = layout.stride as usize;
        // SAFETY: `Group` is aligned to 32 bytes, its first two fields are eight floats each.
        let (xs, ys) = unsafe { (_mm256_load_ps(group.x.as_ptr()), _mm256_load_ps(group.y.as_ptr())) };
        let mut sums = [_mm256_setzero_si256(); 4];
        for look in &looks[count - 1..2 * count - 1] {
            let [x0, y0] = look.origin[group.level as usize];
            let x = _mm256_add_ps(xs, _mm256_set1_ps(group.spread[0] * look.part));
            let y = _mm256_add_ps(ys, _mm256_set1_ps(group.spread[1] * look.part));
            let (cos, sin) = (_mm256_set1_ps(look.cos), _mm256_set1_ps(look.sin));
            let x_turned = _mm256_sub_ps(_mm256_mul_ps(cos, x), _mm256_mul_ps(sin, y));
            let y_turned = _mm256_add_ps(_mm256_mul_ps(sin, x), _mm256_mul_ps(cos, y));
            let x = _mm256_add_ps(x_turned, _mm256_set1_ps(x0));
            let y = _mm256_add_ps(y_turned, _mm256_set1_ps(y0));
            let x = _mm256_min_ps(
                _mm256_max_ps(x, _mm256_setzero_ps()),
                _mm256_set1_ps(layout.limit[0]),
            );
            let y = _mm256_min_ps(
                _mm256_max_ps(y, _mm256_setzero_ps()),
                _mm256_set1_ps(layout.limit[1]),
            );
            let (x, y) = (_mm256_cvttps_epi32(x), _mm256_cvttps_epi32(y));
            let (fx, fy) = (_mm256_and_si256(x, low7), _mm256_and_si256(y, low7));
            let rows = _mm256_mullo_epi32(_mm256_srli_epi32::<7>(y), _mm256_set1_epi32(layout.stride as i32));
            let at = _mm256_add_epi32(rows, _mm256_srli_epi32::<7>(x));
            let at = _mm256_add_epi32(at, _mm256_set1_epi32(layout.base as i32));
            // 127 - fx in the low byte, fx in the next: 127 + 255·fx.
            let weights_x = _mm256_add_epi32(_mm256_sub_epi32(_mm256_slli_epi32::<8>(fx), fx), low7);
            // 128 - fy in the low half, fy in the high half: 128 + 65535·fy.
            let weights_y = _mm256_sub_epi32(_mm256_slli_epi32::<16>(fy), fy);
            let weights_y = _mm256_add_epi32(weights_y, _mm256_set1_epi32(128));
            let mut index = [0u32; GROUP];
            // SAFETY: eight 32-bit integers.
            unsafe { _mm256_storeu_si256(index.as_mut_ptr().cast(), at) };
            macro_rules! pair {
                ($k:literal, $wx:expr, $wy:literal) => {{
                    // SAFETY: coordinates were clamped to the level's limits, for which `Texels::new` checked that
                    // the texel, its right neighbour and both below are inside the slice.
                    let both_texels = unsafe {
                        let left = two_rows(texels.texels.as_ptr().add(index[$k] as usize), stride);
                        let right = two_rows(texels.texels.as_ptr().add(index[$k + 4] as usize), stride);
                        _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(left), right)
                    };
                    let across = _mm256_maddubs_epi16(
                        _mm256_shuffle_epi8(both_texels, interleave),
                        _mm256_shuffle_epi8(weights_x, $wx),
                    );
                    let weights = _mm256_shuffle_epi32::<$wy>(weights_y);
                    sums[$k] = _mm256_add_epi32(sums[$k], _mm256_madd_epi16(across, weights));
                }};
            }
            pair!(
                0,
                both(&[0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1]),
                0b00_00_00_00
            );
            pair!(
                1,
                both(&[4, 5, 4, 5, 4, 5, 4, 5, 4, 5, 4, 5, 4, 5, 4, 5]),
                0b01_01_01_01
            );
            pair!(
                2,
                both(&[8, 9, 8, 9, 8, 9, 8, 9, 8, 9, 8, 9, 8, 9, 8, 9]),
                0b10_10_10_10
            );
            pair!(
                3,
                both(&[12, 13, 12, 13, 12, 13, 12, 13, 12, 13, 12, 13, 12, 13, 12, 13]),
                0b11_11_11_11
            );
        }
        let shift = _mm_cvtsi32_si128(7 + log2 as i32);
        let [a, b, c, d] = sums.map(|sum| _mm256_sra_epi32(sum, shift));
        let (ab, cd) = (_mm256_packs_epi32(a, b), _mm256_packs_epi32(c, d));
        let first = _mm256_permute2x128_si256::<0x20>(ab, cd);
        let last = _mm256_permute2x128_si256::<0x31>(ab, cd);
        // SAFETY: `Colours` is 32 integers of 16 bits.
        unsafe {
            _mm256_storeu_si256(out.as_mut_ptr().cast(), first);
            _mm256_storeu_si256(out.as_mut_ptr().add(16).cast(), last);
        }
    }
}

/// Two neighbouring texels and the two below them.
///
/// # Safety
/// All four exist.
#[target_feature(enable = "avx2")]
unsafe fn two_rows(at: *const u32, stride: usize) -> __m128i {
    // SAFETY: promised by the caller.
    unsafe { _mm_unpacklo_epi64(_mm_loadl_epi64(at.cast()), _mm_loadl_epi64(at.add(stride).cast())) }
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
/// The processor has AVX2; the lengths are those that `Kernel::shade` checks.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn shade(colours: &[Colours], shading: &Shading<'_>, row: &mut [u8]) {
    let spread = |first: usize| {
        let m = [
            middle(first),
            middle(first + 1),
            middle(first + 2),
            middle(first + 3),
        ];
        _mm256_setr_epi16(
            m[0], m[0], m[0], m[0], m[1], m[1], m[1], m[1], m[2], m[2], m[2], m[2], m[3], m[3], m[3], m[3],
        )
    };
    let parts = [spread(0), spread(4)];
    let alpha = both(&[6, 7, 6, 7, 6, 7, 6, 7, 14, 15, 14, 15, 14, 15, 14, 15]);
    let drop_alpha = both(&[0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1]);
    let close_up = _mm256_setr_epi32(0, 1, 2, 4, 5, 6, 7, 7);
    let (dark, fall) = (
        _mm256_set1_epi16(shading.noise_dark),
        _mm256_set1_epi16(shading.noise_fall),
    );
    let (white, half) = (_mm256_set1_epi16(4095), _mm256_set1_epi16(8));
    for (g, (colours, row)) in colours.iter().zip(row.chunks_mut(3 * GROUP)).enumerate() {
        let (gain, gain_step) = nodes(&shading.gain[g], &shading.gain[g + 1]);
        let (glow, glow_step) = nodes(&shading.glow[g], &shading.glow[g + 1]);
        let noise = &shading.noise[4 * GROUP * g..][..4 * GROUP];
        // SAFETY: 32 bytes.
        let noise = unsafe { _mm256_loadu_si256(noise.as_ptr().cast()) };
        // Bytes in the upper halves of 16-bit lanes; the permutation makes the lower half of the result come first.
        let noise = _mm256_permute4x64_epi64::<0b11_01_10_00>(noise);
        let noise = [
            _mm256_unpacklo_epi8(_mm256_setzero_si256(), noise),
            _mm256_unpackhi_epi8(_mm256_setzero_si256(), noise),
        ];
        let mut values = [_mm256_setzero_si256(); 2];
        for i in 0..2 {
            // SAFETY: `Colours` is twice 16 integers of 16 bits.
            let colour = unsafe { _mm256_loadu_si256(colours.as_ptr().add(16 * i).cast()) };
            let gain = _mm256_add_epi16(gain, _mm256_mulhrs_epi16(gain_step, parts[i]));
            let glow = _mm256_add_epi16(glow, _mm256_mulhrs_epi16(glow_step, parts[i]));
            let lit = _mm256_mulhi_epu16(colour, gain);
            let mirrored = _mm256_mulhi_epu16(_mm256_shuffle_epi8(colour, alpha), glow);
            let (high, low) = (_mm256_max_epi16(lit, mirrored), _mm256_min_epi16(lit, mirrored));
            let sum = _mm256_sub_epi16(high, _mm256_srai_epi16::<3>(high));
            let sum = _mm256_max_epi16(high, _mm256_add_epi16(sum, _mm256_srai_epi16::<1>(low)));
            let level = _mm256_sub_epi16(dark, _mm256_mulhrs_epi16(_mm256_min_epi16(sum, white), fall));
            let value = _mm256_add_epi16(sum, _mm256_mulhrs_epi16(noise[i], level));
            values[i] = _mm256_srai_epi16::<4>(_mm256_add_epi16(value, half));
        }
        // Packing works within halves: pixels 0 1 4 5 | 2 3 6 7, put right by the permutation.
        let bytes = _mm256_packus_epi16(values[0], values[1]);
        let bytes = _mm256_permute4x64_epi64::<0b11_01_10_00>(bytes);
        let bytes = _mm256_permutevar8x32_epi32(_mm256_shuffle_epi8(bytes, drop_alpha), close_up);
        let (low, high) = (
            _mm256_castsi256_si128(bytes),
            _mm256_extracti128_si256::<1>(bytes),
        );
        if row.len() == 3 * GROUP {
            // SAFETY: 16 + 8 bytes into 24.
            unsafe {
                _mm_storeu_si128(row.as_mut_ptr().cast(), low);
                _mm_storel_epi64(row.as_mut_ptr().add(16).cast(), high);
            }
        } else {
            let mut whole = [0u8; 32];
            // SAFETY: 32 bytes into 32.
            unsafe { _mm256_storeu_si256(whole.as_mut_ptr().cast(), bytes) };
            row.copy_from_slice(&whole[..row.len()]);
        }
    }
}

/// The first node in every pixel's place, and the step to the second.
#[target_feature(enable = "avx2")]
fn nodes(a: &[i16; 4], b: &[i16; 4]) -> (__m256i, __m256i) {
    let whole = |node: &[i16; 4]| {
        let bits = node
            .iter()
            .rev()
            .fold(0u64, |bits, value| bits << 16 | u64::from(*value as u16));
        _mm256_set1_epi64x(bits as i64)
    };
    let (a, b) = (whole(a), whole(b));
    (a, _mm256_sub_epi16(b, a))
}
