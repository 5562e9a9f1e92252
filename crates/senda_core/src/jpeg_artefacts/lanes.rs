//! Eight whole numbers at once: in a plain array, or in a register of AVX2.
#![allow(unsafe_code)]

/// Eight `i32`. Sums, differences and products wrap.
///
/// All of it is inlined into a function that is compiled for the processor that the vectors need.
pub(super) trait Lanes: Copy {
    fn splat(value: i32) -> Self;
    fn load(values: &[i32; 8]) -> Self;
    fn load_short(values: &[i16; 8]) -> Self;
    /// Values must be within 0..=32767.
    fn store_short(self, values: &mut [i16; 8]);
    fn add(self, other: Self) -> Self;
    fn subtract(self, other: Self) -> Self;
    fn times(self, other: Self) -> Self;
    fn left<const BITS: i32>(self) -> Self;
    fn right<const BITS: i32>(self) -> Self;
    fn or(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// Negated where `sign` is negative; zero where that is zero.
    fn signed_as(self, sign: Self) -> Self;
    /// Within 0..=255.
    fn clamped(self) -> Self;
    fn first(self) -> i32;
    fn without_first(self) -> Self;
    fn is_zero(self) -> bool;
    fn transpose(block: &mut [Self; 8]);
    /// Sixteen pixels become sixteen values of each channel.
    fn take_apart(pixels: &[u8; 48]) -> [[u8; 16]; 3];
    /// The way back.
    fn put_together(channels: &[[u8; 16]; 3]) -> [u8; 48];
}

impl Lanes for [i32; 8] {
    #[inline(always)]
    fn splat(value: i32) -> Self {
        [value; 8]
    }

    #[inline(always)]
    fn load(values: &[i32; 8]) -> Self {
        *values
    }

    #[inline(always)]
    fn load_short(values: &[i16; 8]) -> Self {
        values.map(i32::from)
    }

    #[inline(always)]
    fn store_short(self, values: &mut [i16; 8]) {
        *values = self.map(|value| value as i16);
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].wrapping_add(other[i]))
    }

    #[inline(always)]
    fn subtract(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].wrapping_sub(other[i]))
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].wrapping_mul(other[i]))
    }

    #[inline(always)]
    fn left<const BITS: i32>(self) -> Self {
        self.map(|value| value << BITS)
    }

    #[inline(always)]
    fn right<const BITS: i32>(self) -> Self {
        self.map(|value| value >> BITS)
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i] | other[i])
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.map(i32::wrapping_abs)
    }

    #[inline(always)]
    fn signed_as(self, sign: Self) -> Self {
        std::array::from_fn(|i| self[i].wrapping_mul(sign[i].signum()))
    }

    #[inline(always)]
    fn clamped(self) -> Self {
        self.map(|value| value.clamp(0, 255))
    }

    #[inline(always)]
    fn first(self) -> i32 {
        self[0]
    }

    #[inline(always)]
    fn without_first(self) -> Self {
        let [_, rest @ ..] = self;
        let [a, b, c, d, e, f, g] = rest;
        [0, a, b, c, d, e, f, g]
    }

    #[inline(always)]
    fn is_zero(self) -> bool {
        self == [0; 8]
    }

    #[inline(always)]
    fn transpose(block: &mut [Self; 8]) {
        let from = *block;
        *block = std::array::from_fn(|y| std::array::from_fn(|x| from[x][y]));
    }

    #[inline(always)]
    fn take_apart(pixels: &[u8; 48]) -> [[u8; 16]; 3] {
        std::array::from_fn(|channel| std::array::from_fn(|i| pixels[3 * i + channel]))
    }

    #[inline(always)]
    fn put_together(channels: &[[u8; 16]; 3]) -> [u8; 48] {
        std::array::from_fn(|i| channels[i % 3][i / 3])
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::Lanes;
    use std::arch::x86_64::*;

    /// A register of AVX2.
    ///
    /// Only code that is inlined into a function with `target_feature(enable = "avx2")` may use it: that is what makes every
    /// `unsafe` below sound.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2(__m256i);

    /// For each channel, where its values are in each third of sixteen pixels; 0x80 is nowhere and gives zero.
    const APART: [[[u8; 16]; 3]; 3] = {
        let mut places = [[[0x80; 16]; 3]; 3];
        let mut byte = 0;
        while byte < 48 {
            places[byte % 3][byte / 16][byte / 3] = (byte % 16) as u8;
            byte += 1;
        }
        places
    };

    /// For each third of sixteen pixels, which value of each channel goes where.
    const TOGETHER: [[[u8; 16]; 3]; 3] = {
        let mut places = [[[0x80; 16]; 3]; 3];
        let mut byte = 0;
        while byte < 48 {
            places[byte / 16][byte % 3][byte % 16] = (byte / 3) as u8;
            byte += 1;
        }
        places
    };

    /// Three results, each the union of what `places` picks from the three sources.
    #[inline(always)]
    fn pick(sources: [&[u8; 16]; 3], places: &[[[u8; 16]; 3]; 3]) -> [[u8; 16]; 3] {
        // SAFETY: as for `Avx2`; every pointer is to sixteen bytes.
        unsafe {
            let [a, b, c] = sources.map(|bytes| _mm_loadu_si128(bytes.as_ptr().cast()));
            std::array::from_fn(|i| {
                let [in_a, in_b, in_c] = [0, 1, 2].map(|k| _mm_loadu_si128(places[i][k].as_ptr().cast()));
                let first_two = _mm_or_si128(_mm_shuffle_epi8(a, in_a), _mm_shuffle_epi8(b, in_b));
                let all = _mm_or_si128(first_two, _mm_shuffle_epi8(c, in_c));
                let mut bytes = [0; 16];
                _mm_storeu_si128(bytes.as_mut_ptr().cast(), all);
                bytes
            })
        }
    }

    /// Calls an intrinsic.
    macro_rules! avx2 {
        ($call:expr) => {
            // SAFETY: the caller is inlined into a function compiled for AVX2 (see `Avx2`), and the references that pointers
            // come from are to as many bytes as the instruction touches.
            Avx2(unsafe { $call })
        };
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        fn splat(value: i32) -> Self {
            avx2!(_mm256_set1_epi32(value))
        }

        #[inline(always)]
        fn load(values: &[i32; 8]) -> Self {
            avx2!(_mm256_loadu_si256(values.as_ptr().cast()))
        }

        #[inline(always)]
        fn load_short(values: &[i16; 8]) -> Self {
            avx2!(_mm256_cvtepi16_epi32(_mm_loadu_si128(values.as_ptr().cast())))
        }

        #[inline(always)]
        fn store_short(self, values: &mut [i16; 8]) {
            // SAFETY: as for the macro.
            unsafe {
                let (low, high) = (
                    _mm256_castsi256_si128(self.0),
                    _mm256_extracti128_si256::<1>(self.0),
                );
                _mm_storeu_si128(values.as_mut_ptr().cast(), _mm_packs_epi32(low, high));
            }
        }

        #[inline(always)]
        fn add(self, other: Self) -> Self {
            avx2!(_mm256_add_epi32(self.0, other.0))
        }

        #[inline(always)]
        fn subtract(self, other: Self) -> Self {
            avx2!(_mm256_sub_epi32(self.0, other.0))
        }

        #[inline(always)]
        fn times(self, other: Self) -> Self {
            avx2!(_mm256_mullo_epi32(self.0, other.0))
        }

        #[inline(always)]
        fn left<const BITS: i32>(self) -> Self {
            avx2!(_mm256_slli_epi32::<BITS>(self.0))
        }

        #[inline(always)]
        fn right<const BITS: i32>(self) -> Self {
            avx2!(_mm256_srai_epi32::<BITS>(self.0))
        }

        #[inline(always)]
        fn or(self, other: Self) -> Self {
            avx2!(_mm256_or_si256(self.0, other.0))
        }

        #[inline(always)]
        fn abs(self) -> Self {
            avx2!(_mm256_abs_epi32(self.0))
        }

        #[inline(always)]
        fn signed_as(self, sign: Self) -> Self {
            avx2!(_mm256_sign_epi32(self.0, sign.0))
        }

        #[inline(always)]
        fn clamped(self) -> Self {
            avx2!(_mm256_min_epi32(
                _mm256_max_epi32(self.0, _mm256_setzero_si256()),
                _mm256_set1_epi32(255)
            ))
        }

        #[inline(always)]
        fn first(self) -> i32 {
            // SAFETY: as for the macro.
            unsafe { _mm256_cvtsi256_si32(self.0) }
        }

        #[inline(always)]
        fn without_first(self) -> Self {
            avx2!(_mm256_blend_epi32::<1>(self.0, _mm256_setzero_si256()))
        }

        #[inline(always)]
        fn is_zero(self) -> bool {
            // SAFETY: as for the macro.
            unsafe { _mm256_testz_si256(self.0, self.0) == 1 }
        }

        #[inline(always)]
        fn transpose(block: &mut [Self; 8]) {
            let [r0, r1, r2, r3, r4, r5, r6, r7] = block.map(|row| row.0);
            // SAFETY: as for the macro.
            unsafe {
                let pairs = |a, b| (_mm256_unpacklo_epi32(a, b), _mm256_unpackhi_epi32(a, b));
                let fours = |a, b| (_mm256_unpacklo_epi64(a, b), _mm256_unpackhi_epi64(a, b));
                let ((a0, a1), (a2, a3)) = (pairs(r0, r1), pairs(r2, r3));
                let ((a4, a5), (a6, a7)) = (pairs(r4, r5), pairs(r6, r7));
                let ((b0, b1), (b2, b3)) = (fours(a0, a2), fours(a1, a3));
                let ((b4, b5), (b6, b7)) = (fours(a4, a6), fours(a5, a7));
                *block = [
                    _mm256_permute2x128_si256::<0x20>(b0, b4),
                    _mm256_permute2x128_si256::<0x20>(b1, b5),
                    _mm256_permute2x128_si256::<0x20>(b2, b6),
                    _mm256_permute2x128_si256::<0x20>(b3, b7),
                    _mm256_permute2x128_si256::<0x31>(b0, b4),
                    _mm256_permute2x128_si256::<0x31>(b1, b5),
                    _mm256_permute2x128_si256::<0x31>(b2, b6),
                    _mm256_permute2x128_si256::<0x31>(b3, b7),
                ]
                .map(Avx2);
            }
        }

        #[inline(always)]
        fn take_apart(pixels: &[u8; 48]) -> [[u8; 16]; 3] {
            let (thirds, _) = pixels.as_chunks::<16>();
            pick([&thirds[0], &thirds[1], &thirds[2]], &APART)
        }

        #[inline(always)]
        fn put_together(channels: &[[u8; 16]; 3]) -> [u8; 48] {
            let thirds = pick(channels.each_ref(), &TOGETHER);
            let mut pixels = [0; 48];
            for (to, from) in pixels.as_chunks_mut::<16>().0.iter_mut().zip(thirds) {
                *to = from;
            }
            pixels
        }
    }
}
