//! The pixel loops, twice: portable integer code and AVX2, with the same bits.
//!
//! A row is drawn in two passes over groups of eight pixels. [`Kernel::sample`] looks the texture up, bilinear, and
//! leaves 16-bit colours; [`Kernel::shade`] applies exposure, vignetting, reflections and noise and writes bytes.
//! Positions are `f32` with plain `+ - *` (exact and equal everywhere), everything after them is integers.

mod groups;
mod portable;

#[cfg(target_arch = "x86_64")]
mod avx2;

pub(super) use groups::{Detail, Group, GroupRun, Groups, Positions};

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

/// Which pixel of its group stands where in [`Positions`]: so ordered, vectors of two halves come out in the picture's order.
pub(super) const SLOTS: [usize; GROUP] = [0, 1, 4, 5, 2, 3, 6, 7];

/// A texel and, in the upper half, the one below it: the four of a bilinear look are two neighbours, 16 bytes.
pub(super) type Texel = u64;

/// Texels side by side in a strip. Textures are stored as upright strips, so that looks along any direction stay
/// within few memory pages (rows of a large floor lie a page or more apart).
pub(super) const STRIP: usize = 16;

/// Texels from one row of a strip to the next: the strip and the first texel of its right neighbour.
pub(super) const STRIDE: usize = STRIP + 1;

/// How a level of a texture lies in memory.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LevelLayout {
    /// Index of the first texel.
    pub(super) base: u32,
    /// Texels from one strip to the next.
    pub(super) strip: u32,
    /// Largest coordinates, in texels times [`STEPS_PER_TEXEL`], whose right neighbours exist.
    pub(super) limit: [f32; 2],
}

impl LevelLayout {
    /// Index of the texel in a column and row.
    #[inline(always)]
    pub(super) fn index(&self, x: u32, y: u32) -> usize {
        (self.base + x / STRIP as u32 * self.strip + y * STRIDE as u32 + x % STRIP as u32) as usize
    }
}

/// A texture with its levels: what the kernels look into.
#[derive(Debug, Clone, Copy)]
pub(super) struct Texels<'a> {
    texels: &'a [Texel],
    layouts: &'a [LevelLayout; LEVELS],
}

impl<'a> Texels<'a> {
    /// Checks once what the AVX2 code relies on: every coordinate within its limit, and its neighbours, is inside.
    pub(super) fn new(texels: &'a [Texel], layouts: &'a [LevelLayout; LEVELS]) -> Self {
        for layout in layouts {
            let [x, y] = layout.limit.map(|limit| limit as usize / 128);
            // The last strip's last row; a pair of texels never leaves its row of a strip.
            let rows = layout.strip as usize / STRIDE;
            let end = layout.base as usize + (x / STRIP + 1) * layout.strip as usize;
            assert!(
                y < rows && end <= texels.len() && texels.len() < i32::MAX as usize,
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

/// Light at a corner of a group: gain of R, G, B, 0 ([`GAIN_ONE`]), then reflected light of R, G, B, 0 ([`GLOW_ONE`]).
pub(super) type LightNode = [i16; 8];

/// What a pixel's direction does to light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface {
    /// Share of light that polish reflects at this angle (Schlick 1994).
    pub(super) fresnel: f32,
    /// Square root of the light that vignetting leaves.
    pub(super) vignette: f32,
}

/// What [`Kernel::shade`] needs besides colours.
pub(super) struct Shading<'a> {
    /// Nodes above the row, at the left edge of every group and the right edge of the last.
    pub(super) above: &'a [LightNode],
    /// Nodes below the row.
    pub(super) below: &'a [LightNode],
    /// How far the row lies towards those below (Q15).
    pub(super) part: i16,
    /// Whether any reflected light is not 0.
    pub(super) glows: bool,
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
        groups: GroupRun<'_>,
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

    /// Light at nodes: `gain` and, for light `mirrored` in the floor, `glow` are factors for R, G, B, 0.
    pub(super) fn expose(
        self,
        surfaces: &[Surface],
        mirrored: &[[f32; 4]],
        gain: [f32; 4],
        glow: [f32; 4],
        out: &mut [LightNode],
    ) {
        match self {
            Self::Portable => portable::expose(surfaces, mirrored, gain, glow, out),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2(_) => unsafe { avx2::expose(surfaces, mirrored, gain, glow, out) },
        }
    }

    /// Blurs a row across: every pixel takes `weight` (Q15, of the mean of both) from its neighbours; the ends repeat.
    pub(super) fn blur_across(self, row: &[Colours], weight: i16, out: &mut [Colours]) {
        assert!(row.len() == out.len() && !row.is_empty());
        match self {
            Self::Portable => portable::blur_across(row, weight, out),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above; the lengths are equal.
            Self::Avx2(_) => unsafe { avx2::blur_across(row, weight, out) },
        }
    }

    /// Blurs a row with those above and below, likewise.
    pub(super) fn blur_down(self, rows: [&[Colours]; 3], weight: i16, out: &mut [Colours]) {
        assert!(rows.iter().all(|row| row.len() == out.len()));
        match self {
            Self::Portable => portable::blur_down(rows, weight, out),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above; the lengths are equal.
            Self::Avx2(_) => unsafe { avx2::blur_down(rows, weight, out) },
        }
    }

    /// Turns the colours of a row into bytes R, G, B.
    pub(super) fn shade(self, colours: &[Colours], shading: &Shading<'_>, row: &mut [u8]) {
        let groups = colours.len();
        assert!(shading.above.len() > groups && shading.below.len() > groups);
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

/// (a·b + 2¹⁴) / 2¹⁵, rounded down.
#[inline(always)]
fn rounded_product(a: i16, b: i16) -> i16 {
    ((((i32::from(a) * i32::from(b)) >> 14) + 1) >> 1) as i16
}

/// The part (Q15) of a group's width at the middle of pixel `k` of it.
pub(super) const fn middle(k: usize) -> i16 {
    ((2 * k + 1) * 2048) as i16
}
