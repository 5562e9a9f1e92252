//! The pixel loops, twice: portable integer code and AVX2, with the same bits.
//!
//! A row is drawn in two passes over groups of eight pixels. [`Kernel::sample`] looks the texture up, bilinear, and
//! leaves 16-bit colours; [`Kernel::shade`] applies exposure, vignetting, reflections and noise and writes bytes.
//! Positions are `f32` with plain `+ - *` (exact and equal everywhere), everything after them is integers.

mod portable;

#[cfg(target_arch = "x86_64")]
mod avx2;

/// Pixels handled together. The level of detail and the light are uniform or linear within such a group.
pub(super) const GROUP: usize = 8;

/// Sub-texel positions: 7 bits, so that two weighted bytes fit 15 bits.
pub(super) const STEPS_PER_TEXEL: f64 = 128.0;

/// What a full byte (255) becomes in sampled colours: horizontal weights sum to 127.
pub(super) const COLOUR_SCALE: i32 = 127;

/// Most levels that a texture may have.
pub(super) const LEVELS: usize = 14;

/// Weight 1.0 of gain nodes: an output of 16 per grey level.
pub(super) const GAIN_ONE: f64 = 16.0 * 65536.0 / 127.0;

/// Weight of one grey level of reflected light at full gloss.
pub(super) const GLOW_ONE: f64 = 16.0 * 65536.0 / (127.0 * 255.0);

/// Where eight neighbouring pixels look on a plane, in texels of their level times [`STEPS_PER_TEXEL`].
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub(super) struct Group {
    /// Along the vehicle's x axis.
    pub(super) x: [f32; GROUP],
    /// Along the vehicle's y axis.
    pub(super) y: [f32; GROUP],
    /// The longer axis of a pixel's footprint, over which several looks are spread.
    pub(super) spread: [f32; 2],
    /// Level of detail.
    pub(super) level: u32,
    /// Logarithm (base 2) of the looks that the footprint needs.
    pub(super) looks_log2: u32,
}

/// How a level of a texture lies in memory.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LevelLayout {
    /// Index of the first texel.
    pub(super) base: u32,
    /// Texels from one row to the next.
    pub(super) stride: u32,
    /// Largest coordinates, in texels times [`STEPS_PER_TEXEL`], whose right and lower neighbours exist.
    pub(super) limit: [f32; 2],
}

/// A texture with its levels: what the kernels look into.
#[derive(Debug, Clone, Copy)]
pub(super) struct Texels<'a> {
    texels: &'a [u32],
    layouts: &'a [LevelLayout; LEVELS],
}

impl<'a> Texels<'a> {
    /// Checks once what the AVX2 code relies on: every coordinate within its limit, and its neighbours, is inside.
    pub(super) fn new(texels: &'a [u32], layouts: &'a [LevelLayout; LEVELS]) -> Self {
        for layout in layouts {
            let [x, y] = layout.limit.map(|limit| limit as usize / 128);
            let last = layout.base as usize + (y + 1) * layout.stride as usize + x + 1;
            assert!(
                last < texels.len() && texels.len() < i32::MAX as usize && layout.stride as usize > x + 1,
                "a texture level reaches beyond its texels"
            );
        }
        Self { texels, layouts }
    }
}

/// One look: the motion from the vehicle to the texture at one instant of the exposure.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Look {
    /// Cosine of the heading.
    pub(super) cos: f32,
    /// Sine of the heading.
    pub(super) sin: f32,
    /// Which part of the footprint's longer axis this look takes, in -0.5..0.5.
    pub(super) part: f32,
    /// Position of the vehicle in each level's texels times [`STEPS_PER_TEXEL`].
    pub(super) origin: [[f32; 2]; LEVELS],
}

/// The looks of a frame for 1, 2, 4 and 8 looks a pixel: those of n looks start at n - 1.
pub(super) type Looks = [Look; 15];

/// Logarithm (base 2) of the most looks a pixel.
pub(super) const MOST_LOOKS_LOG2: u32 = 3;

/// Colours of a group: R, G, B, gloss of each pixel, 0..=255 times [`COLOUR_SCALE`].
pub(super) type Colours = [i16; 4 * GROUP];

/// What [`Kernel::shade`] needs besides colours.
pub(super) struct Shading<'a> {
    /// Gain of R, G, B at the left edge of every group and the right edge of the last ([`GAIN_ONE`]).
    pub(super) gain: &'a [[i16; 4]],
    /// Reflected light of R, G, B at the same places ([`GLOW_ONE`]).
    pub(super) glow: &'a [[i16; 4]],
    /// Noise of this row: R, G, B, 0 of every pixel, standard deviation 32.
    pub(super) noise: &'a [i8],
    /// Noise of black (standard deviation in grey levels times 64).
    pub(super) noise_dark: i16,
    /// How much the noise falls towards white (Q15 of 1/16 grey level).
    pub(super) noise_fall: i16,
}

/// Which implementation runs. Both give the same bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kernel {
    /// Plain integer code for every machine.
    Portable,
    /// 256-bit vectors. Only [`Kernel::fastest`] makes it, after asking the processor.
    #[cfg(target_arch = "x86_64")]
    Avx2(Detected),
}

/// Proof that the processor was asked.
#[cfg(target_arch = "x86_64")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Detected(());

impl Kernel {
    /// The fastest that this processor runs.
    pub fn fastest() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Self::Avx2(Detected(()));
        }
        Self::Portable
    }

    /// A word for reports: `avx2` or `portable`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => "avx2",
        }
    }

    /// Looks up the texture for consecutive groups of a row, with at least `2^looks_log2` looks a pixel.
    pub(super) fn sample(
        self,
        texels: Texels<'_>,
        looks: &Looks,
        looks_log2: u32,
        groups: &[Group],
        out: &mut [Colours],
    ) {
        assert!(groups.len() <= out.len());
        match self {
            Self::Portable => portable::sample(texels, looks, looks_log2, groups, out),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Detected` only exists after the processor said that it has AVX2.
            Self::Avx2(_) => unsafe { avx2::sample(texels, looks, looks_log2, groups, out) },
        }
    }

    /// Turns the colours of a row into bytes R, G, B.
    pub(super) fn shade(self, colours: &[Colours], shading: &Shading<'_>, row: &mut [u8]) {
        let groups = colours.len();
        assert!(shading.gain.len() > groups && shading.glow.len() > groups);
        assert!(shading.noise.len() >= groups * 4 * GROUP);
        assert!(row.len() <= groups * 3 * GROUP && row.len() + 3 * GROUP > groups * 3 * GROUP);
        match self {
            Self::Portable => portable::shade(colours, shading, row),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2(_) => unsafe { avx2::shade(colours, shading, row) },
        }
    }
}

/// `a + (b - a)·part` for nodes, `part` in Q15. The rounding is that of the vector instruction `pmulhrsw`.
pub(super) fn between(a: &[[i16; 4]], b: &[[i16; 4]], part: i16, out: &mut [[i16; 4]]) {
    for ((a, b), out) in a.iter().zip(b).zip(out) {
        for lane in 0..4 {
            out[lane] = a[lane] + rounded_product(b[lane] - a[lane], part);
        }
    }
}

/// (a·b + 2¹⁴) / 2¹⁵, rounded down.
#[inline(always)]
fn rounded_product(a: i16, b: i16) -> i16 {
    ((((i32::from(a) * i32::from(b)) >> 14) + 1) >> 1) as i16
}

/// The part (Q15) of a group's width at the middle of pixel `k` of it.
pub(super) const fn middle(k: usize) -> i16 {
    ((2 * k + 1) * 2048) as i16
}
