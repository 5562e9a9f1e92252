//! Transcendental functions that give the same bits on every platform.
//!
//! The standard library calls the platform's mathematics library, whose last bits differ between
//! systems; a simulation that uses it is not reproducible. These wrap the pure-Rust `libm`.
//! `+ - * / sqrt mul_add floor round` of the standard library are exact everywhere and stay allowed.

pub use libm::{
    acos, acosf, asin, asinf, atan, atan2, atan2f, atanf, cbrt, cos, cosf, exp, expf, hypot, hypotf, log,
    log2, log10, logf, pow, powf, sin, sincos, sincosf, sinf, tan, tanf, tanh, tanhf,
};

#[cfg(test)]
mod tests {
    #[test]
    fn bits_are_pinned() {
        // The same constants must hold on x86-64 and aarch64.
        assert_eq!(super::sin(0.7).to_bits(), libm::sin(0.7).to_bits());
        assert_eq!(super::sin(1.0).to_bits(), 0x3fea_ed54_8f09_0cee);
        assert_eq!(super::exp(1.0).to_bits(), 0x4005_bf0a_8b14_576a);
    }
}
