//! Runs a piece of code compiled for AVX2 where the processor has it.
//!
//! The kernels are plain integer Rust that the compiler vectorises; the only difference between the two builds is
//! the width of the registers, so both give the same bits. This is the crate's only unsafe code.
#![allow(unsafe_code)]

/// Which build of the kernels to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Level {
    /// What every processor of the architecture has (SSE2 on x86-64, NEON on aarch64).
    Baseline,
    /// AVX2, detected at run time. Only [`Level::detect`] makes it.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

/// A piece of work. `run` must be `#[inline(always)]`, or it is compiled for the baseline only.
pub(crate) trait Kernel {
    type Output;
    fn run(self) -> Self::Output;
}

impl Level {
    /// The best that this processor has.
    pub(crate) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Baseline
    }

    /// Runs the kernel.
    #[inline]
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Baseline => kernel.run(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Level::Avx2` exists only where `detect` saw AVX2 on this processor.
            Self::Avx2 => unsafe { run_avx2(kernel) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}
