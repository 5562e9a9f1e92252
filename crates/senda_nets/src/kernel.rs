//! The two inner loops under convolutions and products.
//!
//! Both give the same bits on every processor and for every batch and thread count. [`product`]: each output is one
//! chain of fused multiply-adds in a fixed order, whatever the tile it was computed in. [`correlate`]: each result is
//! sixteen such chains, added in a fixed tree, whatever the width of the registers. (A processor without fused
//! multiply-add computes it in software: right, and slow.)
#![allow(unsafe_code)]

/// Rows of a panel of packed weights.
pub(crate) const PANEL: usize = 8;
/// Registers of a tile's row.
pub(crate) const VECTORS: usize = 3;
/// Lanes of the widest register.
pub(crate) const WIDEST: usize = 16;
/// Values behind the end of a buffer that wide loads may touch.
pub(crate) const SLACK: usize = 64;
const TILE: usize = VECTORS * WIDEST;

/// Which registers the processor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Level {
    /// Eight values in an array; the compiler does what it can.
    #[cfg_attr(
        target_arch = "aarch64",
        allow(dead_code, reason = "every such processor has Neon; tests compare the two")
    )]
    Portable,
    /// Only [`Level::detect`] makes the others, where it saw that the processor has what they need.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "aarch64")]
    Neon,
}

impl Level {
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if std::arch::is_x86_feature_detected!("avx512f") {
                return Self::Avx512;
            }
            if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
                return Self::Avx2;
            }
            Self::Portable
        }
        #[cfg(target_arch = "aarch64")]
        {
            Self::Neon
        }
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        {
            Self::Portable
        }
    }

    /// A level with half the lanes that is better for narrow images, where there is one: on processors that work on the widest
    /// registers in two halves, so that every lane that is not needed costs.
    #[allow(clippy::unnecessary_wraps, reason = "depends on the architecture")]
    pub(crate) fn narrower(self) -> Option<Self> {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512
                if works_in_halves()
                    && std::arch::is_x86_feature_detected!("avx2")
                    && std::arch::is_x86_feature_detected!("fma") =>
            {
                Some(Self::Avx2)
            }
            _ => None,
        }
    }

    pub(crate) fn lanes(self) -> usize {
        match self {
            Self::Portable => 8,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => 8,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => 16,
            #[cfg(target_arch = "aarch64")]
            Self::Neon => 4,
        }
    }

    /// Rows that fit into the registers at once.
    fn rows(self) -> usize {
        match self {
            Self::Portable => 1,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => 4,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => 8,
            #[cfg(target_arch = "aarch64")]
            Self::Neon => 8,
        }
    }
}

/// Whether the processor works on 512 bits in two halves, as AMD's Zen 4 does (family 0x19). Intel's and Zen 5's work on them at
/// once (measured on Sapphire Rapids: PilotNet learns 1.4 times as fast with them on rows of 22 as with 256).
#[cfg(target_arch = "x86_64")]
fn works_in_halves() -> bool {
    use std::arch::x86_64::__cpuid;
    let vendor = __cpuid(0);
    let vendor = [vendor.ebx, vendor.edx, vendor.ecx].map(u32::to_le_bytes);
    let signature = __cpuid(1).eax;
    let family = ((signature >> 8) & 0xf) + ((signature >> 20) & 0xff);
    vendor.as_flattened() != b"GenuineIntel" && family < 0x1a
}

/// A run of neighbouring outputs of one row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Position {
    /// Place of the first in the source, before a tap's offset is added.
    pub(crate) source: u32,
    /// Place of the first in an output plane.
    pub(crate) output: u32,
    /// How many; at most the level's lanes.
    pub(crate) len: u32,
}

/// Everything about the outputs that one call computes.
pub(crate) struct Product<'a> {
    pub(crate) level: Level,
    /// Left factor: value of tap `k` and row `r` at `k · left_step + r`.
    pub(crate) left: &'a [f32],
    pub(crate) left_step: usize,
    /// Number of rows to compute.
    pub(crate) rows: usize,
    /// What a row starts with; zero when empty.
    pub(crate) start: &'a [f32],
    /// Right factor, with [`SLACK`] behind it.
    pub(crate) source: &'a [f32],
    /// One offset into the source for each tap.
    pub(crate) offsets: &'a [u32],
    /// The largest of them.
    pub(crate) largest_offset: usize,
    /// Which outputs, in the order of their places, without gaps.
    pub(crate) positions: &'a [Position],
    /// Values from the end of the last output to the end of a plane are left alone; the distance between rows.
    pub(crate) output_pitch: usize,
}

impl Product<'_> {
    /// `output[r · pitch + p] = start[r] + Σ left[k, r] · source[offset[k] + source[p]]`.
    pub(crate) fn run(&self, output: &mut [f32]) {
        let (Some(first), Some(last)) = (self.positions.first(), self.positions.last()) else {
            return;
        };
        let lanes = self.level.lanes();
        let depth = self.offsets.len();
        let end = (last.output + last.len) as usize;
        let highest = self.positions.iter().map(|p| p.source).max().unwrap_or(0) as usize;
        assert!(
            self.rows > 0
                && depth > 0
                && first.output <= last.output
                && end <= self.output_pitch
                && output.len() >= (self.rows - 1) * self.output_pitch + end
                && self.left.len() >= (depth - 1) * self.left_step + self.rows
                && self.rows <= self.left_step
                && (self.start.is_empty() || self.start.len() >= self.rows)
                && self.source.len() >= self.largest_offset + highest + WIDEST,
            "a plan that does not fit its buffers"
        );
        debug_assert!(self.offsets.iter().all(|o| *o as usize <= self.largest_offset));
        let mut row = 0;
        while row < self.rows {
            let rows = largest_power(self.rows - row, self.level.rows());
            for group in self.positions.chunks(VECTORS) {
                let mut call = Call {
                    depth,
                    left: self.left[row..].as_ptr(),
                    left_step: self.left_step,
                    start: if self.start.is_empty() {
                        std::ptr::null()
                    } else {
                        self.start[row..].as_ptr()
                    },
                    source: self.source.as_ptr(),
                    offsets: self.offsets.as_ptr(),
                    sources: [0; VECTORS],
                    output: output[row * self.output_pitch..].as_mut_ptr(),
                    output_pitch: self.output_pitch,
                    outputs: [0; VECTORS],
                };
                for (v, position) in group.iter().enumerate() {
                    call.sources[v] = position.source as usize;
                    call.outputs[v] = position.output as usize;
                }
                let last = group[group.len() - 1];
                // Whole registers may spill into outputs that come later, but not into the next row's first ones, which
                // are there already, and not past the end.
                if last.output as usize + lanes <= end {
                    // SAFETY: all loads and stores lie inside the slices by the assertion above: sources plus offsets
                    // plus a register inside `source`, outputs plus a register inside the row's plane.
                    unsafe { run_product(self.level, rows, group.len(), &call) };
                } else {
                    let mut tile = [0.0f32; PANEL * TILE];
                    call.output = tile.as_mut_ptr();
                    call.output_pitch = TILE;
                    call.outputs = [0, WIDEST, 2 * WIDEST];
                    // SAFETY: loads as above; the tile has room for every row and register.
                    unsafe { run_product(self.level, rows, group.len(), &call) };
                    for r in 0..rows {
                        for (v, position) in group.iter().enumerate() {
                            let len = position.len as usize;
                            let to = (row + r) * self.output_pitch + position.output as usize;
                            let from = r * TILE + v * WIDEST;
                            output[to..to + len].copy_from_slice(&tile[from..from + len]);
                        }
                    }
                }
            }
            row += rows;
        }
    }
}

/// Gradient of weights: sums over positions of products of two images.
pub(crate) struct Correlation<'a> {
    pub(crate) level: Level,
    /// Gradient of the output, rows `gradient_pitch` apart, zero beyond each image row's end.
    pub(crate) gradient: &'a [f32],
    pub(crate) gradient_pitch: usize,
    pub(crate) rows: usize,
    pub(crate) source: &'a [f32],
    /// One offset into the source for each tap.
    pub(crate) offsets: &'a [u32],
    pub(crate) largest_offset: usize,
    /// Places in gradient and source of sixteen neighbours each.
    pub(crate) steps: &'a [[u32; 2]],
}

impl Correlation<'_> {
    /// `result[r · taps + k] (+)= Σ gradient[r · pitch + g] · source[offset[k] + s]`.
    pub(crate) fn run(&self, result: &mut [f32], accumulate: bool) {
        let taps = self.offsets.len();
        let highest = |i: usize| self.steps.iter().map(|step| step[i]).max().unwrap_or(0) as usize;
        assert!(
            self.rows > 0
                && taps > 0
                && result.len() >= self.rows * taps
                && self.gradient.len() >= (self.rows - 1) * self.gradient_pitch + highest(0) + WIDEST
                && self.source.len() >= self.largest_offset + highest(1) + WIDEST,
            "a plan that does not fit its buffers"
        );
        debug_assert!(self.offsets.iter().all(|o| *o as usize <= self.largest_offset));
        let mut tile = [0.0f32; PANEL * TILE];
        let mut row = 0;
        while row < self.rows {
            let rows = largest_power(self.rows - row, self.level.rows());
            for first in (0..taps).step_by(VECTORS) {
                let vectors = VECTORS.min(taps - first);
                let mut offsets = [0; VECTORS];
                for (v, offset) in self.offsets[first..first + vectors].iter().enumerate() {
                    offsets[v] = *offset as usize;
                }
                let call = CorrelationCall {
                    steps: self.steps.as_ptr(),
                    count: self.steps.len(),
                    gradient: self.gradient[row * self.gradient_pitch..].as_ptr(),
                    gradient_pitch: self.gradient_pitch,
                    source: self.source.as_ptr(),
                    offsets,
                    tile: tile.as_mut_ptr(),
                };
                // SAFETY: sixteen values behind every place lie inside the slices by the assertion above; the tile has
                // sixteen values for each of at most PANEL rows and VECTORS taps.
                unsafe { run_correlation(self.level, rows, vectors, &call) };
                for r in 0..rows {
                    for v in 0..vectors {
                        let from = (r * VECTORS + v) * WIDEST;
                        let sum = tree_sum(&tile[from..from + WIDEST]);
                        let place = &mut result[(row + r) * taps + first + v];
                        *place = if accumulate { *place + sum } else { sum };
                    }
                }
            }
            row += rows;
        }
    }
}

#[inline]
fn tree_sum(lanes: &[f32]) -> f32 {
    let mut eight = [0.0f32; 8];
    for i in 0..8 {
        eight[i] = lanes[i] + lanes[i + 8];
    }
    let four = [
        eight[0] + eight[4],
        eight[1] + eight[5],
        eight[2] + eight[6],
        eight[3] + eight[7],
    ];
    (four[0] + four[2]) + (four[1] + four[3])
}

fn largest_power(rows: usize, limit: usize) -> usize {
    let mut power = limit;
    while power > rows {
        power /= 2;
    }
    power
}

struct Call {
    depth: usize,
    left: *const f32,
    left_step: usize,
    start: *const f32,
    source: *const f32,
    offsets: *const u32,
    sources: [usize; VECTORS],
    output: *mut f32,
    output_pitch: usize,
    outputs: [usize; VECTORS],
}

struct CorrelationCall {
    steps: *const [u32; 2],
    count: usize,
    gradient: *const f32,
    gradient_pitch: usize,
    source: *const f32,
    offsets: [usize; VECTORS],
    tile: *mut f32,
}

/// A register of floats. Every function needs the processor feature of its implementation.
trait Register: Copy {
    const LANES: usize;
    unsafe fn splat(value: f32) -> Self;
    unsafe fn load(from: *const f32) -> Self;
    unsafe fn store(self, to: *mut f32);
    /// `self · factor + term`, rounded once.
    unsafe fn fused(self, factor: Self, term: Self) -> Self;
}

#[inline(always)]
unsafe fn product_tile<F: Register, const R: usize, const V: usize>(call: &Call) {
    // SAFETY: the caller promises the processor feature and that every place lies inside its buffer.
    unsafe {
        let mut sums = [[F::splat(0.0); V]; R];
        if !call.start.is_null() {
            for r in 0..R {
                sums[r] = [F::splat(*call.start.add(r)); V];
            }
        }
        let mut left = call.left;
        for k in 0..call.depth {
            let tap = call.source.add(*call.offsets.add(k) as usize);
            let mut right = [F::splat(0.0); V];
            for v in 0..V {
                right[v] = F::load(tap.add(call.sources[v]));
            }
            for r in 0..R {
                let factor = F::splat(*left.add(r));
                for v in 0..V {
                    sums[r][v] = factor.fused(right[v], sums[r][v]);
                }
            }
            left = left.wrapping_add(call.left_step);
        }
        for r in 0..R {
            for v in 0..V {
                sums[r][v].store(call.output.add(r * call.output_pitch + call.outputs[v]));
            }
        }
    }
}

#[inline(always)]
unsafe fn correlation_tile<F: Register, const R: usize, const V: usize>(call: &CorrelationCall) {
    // SAFETY: the caller promises the processor feature and that every place lies inside its buffer.
    unsafe {
        for lane in (0..WIDEST).step_by(F::LANES) {
            let mut sums = [[F::splat(0.0); V]; R];
            for i in 0..call.count {
                let [gradient, source] = *call.steps.add(i);
                let gradient = call.gradient.add(gradient as usize + lane);
                let source = call.source.add(source as usize + lane);
                let mut right = [F::splat(0.0); V];
                for v in 0..V {
                    right[v] = F::load(source.add(call.offsets[v]));
                }
                for r in 0..R {
                    let left = F::load(gradient.add(r * call.gradient_pitch));
                    for v in 0..V {
                        sums[r][v] = left.fused(right[v], sums[r][v]);
                    }
                }
            }
            for r in 0..R {
                for v in 0..V {
                    sums[r][v].store(call.tile.add((r * VECTORS + v) * WIDEST + lane));
                }
            }
        }
    }
}

/// One compiled variant for each number of rows and registers.
macro_rules! variants {
    ($tile:ident, $register:ty, $rows:expr, $vectors:expr, $call:expr) => {
        match ($rows, $vectors) {
            (8, 3) => $tile::<$register, 8, 3>($call),
            (8, 2) => $tile::<$register, 8, 2>($call),
            (8, _) => $tile::<$register, 8, 1>($call),
            (4, 3) => $tile::<$register, 4, 3>($call),
            (4, 2) => $tile::<$register, 4, 2>($call),
            (4, _) => $tile::<$register, 4, 1>($call),
            (2, 3) => $tile::<$register, 2, 3>($call),
            (2, 2) => $tile::<$register, 2, 2>($call),
            (2, _) => $tile::<$register, 2, 1>($call),
            (_, 3) => $tile::<$register, 1, 3>($call),
            (_, 2) => $tile::<$register, 1, 2>($call),
            (_, _) => $tile::<$register, 1, 1>($call),
        }
    };
}

/// The two loops compiled for one level.
macro_rules! compiled {
    ($module:ident, $register:ty, $($feature:literal)?) => {
        mod $module {
            use super::*;

            $(#[target_feature(enable = $feature)])?
            pub(super) unsafe fn product(rows: usize, vectors: usize, call: &Call) {
                // SAFETY: passed on to the caller.
                unsafe { variants!(product_tile, $register, rows, vectors, call) }
            }

            $(#[target_feature(enable = $feature)])?
            pub(super) unsafe fn correlation(rows: usize, vectors: usize, call: &CorrelationCall) {
                // SAFETY: passed on to the caller.
                unsafe { variants!(correlation_tile, $register, rows, vectors, call) }
            }
        }
    };
}

unsafe fn run_product(level: Level, rows: usize, vectors: usize, call: &Call) {
    // SAFETY: the level says that the processor has the feature; the rest is the caller's promise.
    unsafe {
        match level {
            Level::Portable => portable::product(rows, vectors, call),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => avx2::product(rows, vectors, call),
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => avx512::product(rows, vectors, call),
            #[cfg(target_arch = "aarch64")]
            Level::Neon => neon::product(rows, vectors, call),
        }
    }
}

unsafe fn run_correlation(level: Level, rows: usize, vectors: usize, call: &CorrelationCall) {
    // SAFETY: the level says that the processor has the feature; the rest is the caller's promise.
    unsafe {
        match level {
            Level::Portable => portable::correlation(rows, vectors, call),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => avx2::correlation(rows, vectors, call),
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => avx512::correlation(rows, vectors, call),
            #[cfg(target_arch = "aarch64")]
            Level::Neon => neon::correlation(rows, vectors, call),
        }
    }
}

impl Register for [f32; 8] {
    const LANES: usize = 8;
    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        [value; 8]
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller promises eight values.
        unsafe { from.cast::<Self>().read_unaligned() }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller promises room for eight values.
        unsafe { to.cast::<Self>().write_unaligned(self) }
    }
    #[inline(always)]
    unsafe fn fused(self, factor: Self, term: Self) -> Self {
        std::array::from_fn(|i| self[i].mul_add(factor[i], term[i]))
    }
}

compiled!(portable, [f32; 8],);

/// The four functions of a register type by the architecture's own.
macro_rules! register {
    ($type:ty, $lanes:literal, $splat:ident, $load:ident, $store:ident, |$a:ident, $b:ident, $c:ident| $fused:expr) => {
        impl Register for $type {
            const LANES: usize = $lanes;
            #[inline(always)]
            unsafe fn splat(value: f32) -> Self {
                // SAFETY: the caller promises the feature.
                unsafe { $splat(value) }
            }
            #[inline(always)]
            unsafe fn load(from: *const f32) -> Self {
                // SAFETY: the caller promises the feature and the values.
                unsafe { $load(from) }
            }
            #[inline(always)]
            unsafe fn store(self, to: *mut f32) {
                // SAFETY: the caller promises the feature and the room.
                unsafe { $store(to, self) }
            }
            #[inline(always)]
            unsafe fn fused(self, factor: Self, term: Self) -> Self {
                let ($a, $b, $c) = (self, factor, term);
                // SAFETY: the caller promises the feature.
                unsafe { $fused }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;
#[cfg(target_arch = "x86_64")]
register!(
    __m256,
    8,
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    |a, b, c| _mm256_fmadd_ps(a, b, c)
);
#[cfg(target_arch = "x86_64")]
register!(
    __m512,
    16,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    |a, b, c| _mm512_fmadd_ps(a, b, c)
);
#[cfg(target_arch = "x86_64")]
compiled!(avx2, __m256, "avx2,fma");
#[cfg(target_arch = "x86_64")]
compiled!(avx512, __m512, "avx512f");

#[cfg(target_arch = "aarch64")]
use std::arch::aarch64::*;
#[cfg(target_arch = "aarch64")]
register!(float32x4_t, 4, vdupq_n_f32, vld1q_f32, vst1q_f32, |a, b, c| {
    vfmaq_f32(c, a, b)
});
#[cfg(target_arch = "aarch64")]
compiled!(neon, float32x4_t, "neon");

#[cfg(test)]
mod tests {
    use super::*;

    fn levels() -> Vec<Level> {
        let mut levels = vec![Level::Portable, Level::detect()];
        levels.extend(Level::detect().narrower());
        levels
    }

    fn ramp(len: usize, step: f32) -> Vec<f32> {
        (0..len).map(|i| ((i as f32 * step) % 1.7) - 0.8).collect()
    }

    fn positions(width: usize, lanes: usize) -> Vec<Position> {
        (0..width)
            .step_by(lanes)
            .map(|x| Position {
                source: x as u32,
                output: x as u32,
                len: lanes.min(width - x) as u32,
            })
            .collect()
    }

    #[test]
    fn every_level_gives_the_same_bits_as_one_chain() {
        let (rows, depth, width) = (15, 37, 67);
        let (left, source) = (ramp(rows * depth, 0.37), ramp(depth * width + SLACK, 0.13));
        let offsets: Vec<u32> = (0..depth).map(|k| (k * width) as u32).collect();
        let start = ramp(rows, 0.7);
        for level in levels() {
            let mut output = vec![9.0; rows * width];
            let positions = positions(width, level.lanes());
            Product {
                level,
                left: &left,
                left_step: rows,
                rows,
                start: &start,
                source: &source,
                offsets: &offsets,
                largest_offset: (depth - 1) * width,
                positions: &positions,
                output_pitch: width,
            }
            .run(&mut output);
            for r in 0..rows {
                for p in 0..width {
                    let chain = (0..depth).fold(start[r], |sum, k| {
                        left[k * rows + r].mul_add(source[k * width + p], sum)
                    });
                    assert_eq!(
                        output[r * width + p].to_bits(),
                        chain.to_bits(),
                        "{level:?} {r} {p}"
                    );
                }
            }
        }
    }

    #[test]
    fn every_level_correlates_to_the_same_bits() {
        let (rows, taps, places) = (7, 11, 5 * WIDEST);
        let (gradient, source) = (ramp(rows * places, 0.37), ramp(places + taps + SLACK, 0.13));
        let offsets: Vec<u32> = (0..taps as u32).collect();
        let steps: Vec<[u32; 2]> = (0..5).map(|i| [16 * i, 16 * i]).collect();
        let mut results = Vec::new();
        for level in levels() {
            let mut result = vec![1.0; rows * taps];
            Correlation {
                level,
                gradient: &gradient,
                gradient_pitch: places,
                rows,
                source: &source,
                offsets: &offsets,
                largest_offset: taps - 1,
                steps: &steps,
            }
            .run(&mut result, true);
            results.push(result);
        }
        assert!(results.windows(2).all(|pair| pair[0] == pair[1]));
        let exact: f32 = 1.0
            + (0..places)
                .map(|i| gradient[places + i] * source[i + 3])
                .sum::<f32>();
        assert!((results[0][taps + 3] - exact).abs() < 1e-4);
    }
}
