//! Elementwise functions, compiled for the widest registers, with the same bits everywhere: only `+ - * /`, `sqrt` and
//! bit operations, never fused.
#![allow(unsafe_code)]

use crate::network::Activation;

/// Defines a function over slices whose body is also compiled for AVX2.
macro_rules! vectorised {
    ($(#[$meta:meta])* fn $name:ident($($argument:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$meta])*
        pub(crate) fn $name($($argument: $type),*) {
            #[inline(always)]
            fn body($($argument: $type),*) $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn wide($($argument: $type),*) {
                    body($($argument),*)
                }
                if std::arch::is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has AVX2.
                    return unsafe { wide($($argument),*) };
                }
            }
            body($($argument),*)
        }
    };
}
pub(crate) use vectorised;

/// `exp(x)` to about 1e-7 relative (Cephes' polynomial); below -87 it stays at 1.6e-38, above 88 at 1.6e38.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    // Adding and subtracting 1.5 · 2^23 rounds to the nearest whole number.
    const ROUND: f32 = 12_582_912.0;
    let x = if x < -87.0 { -87.0 } else { x };
    let x = if x > 88.0 { 88.0 } else { x };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let whole = shifted - ROUND;
    let rest = x - whole * 0.693_359_4 - whole * -2.121_944_4e-4;
    let mut poly = 1.987_569_2e-4f32;
    poly = poly * rest + 1.398_2e-3;
    poly = poly * rest + 8.333_452e-3;
    poly = poly * rest + 4.166_579_6e-2;
    poly = poly * rest + 1.666_666_5e-1;
    poly = poly * rest + 0.5;
    let value = poly * rest * rest + rest + 1.0;
    let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127);
    value * f32::from_bits(exponent << 23)
}

#[inline(always)]
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

#[inline(always)]
pub(crate) fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (exp(2.0 * x) + 1.0)
}

vectorised! {
    /// Applies an activation in place.
    fn activate(activation: Activation, values: &mut [f32]) {
        match activation {
            Activation::Linear => {}
            Activation::Relu => values.iter_mut().for_each(|x| *x = if *x > 0.0 { *x } else { 0.0 }),
            Activation::LeakyRelu(slope) => {
                values.iter_mut().for_each(|x| *x *= if *x > 0.0 { 1.0 } else { slope });
            }
            Activation::Relu6 => values.iter_mut().for_each(|x| {
                let low = if *x > 0.0 { *x } else { 0.0 };
                *x = if low < 6.0 { low } else { 6.0 };
            }),
            Activation::Elu => values.iter_mut().for_each(|x| {
                let below = exp(*x) - 1.0;
                *x = if *x > 0.0 { *x } else { below };
            }),
            Activation::Sigmoid => values.iter_mut().for_each(|x| *x = sigmoid(*x)),
            Activation::Tanh => values.iter_mut().for_each(|x| *x = tanh(*x)),
        }
    }
}

vectorised! {
    /// Multiplies a gradient by the derivative, taken from the activated `values`.
    fn differentiate(activation: Activation, values: &[f32], gradient: &mut [f32]) {
        let all = gradient.iter_mut().zip(values);
        match activation {
            Activation::Linear => {}
            Activation::Relu => all.for_each(|(g, y)| *g = if *y > 0.0 { *g } else { 0.0 }),
            Activation::LeakyRelu(slope) => all.for_each(|(g, y)| *g *= if *y > 0.0 { 1.0 } else { slope }),
            Activation::Relu6 => all.for_each(|(g, y)| *g = if *y > 0.0 && *y < 6.0 { *g } else { 0.0 }),
            Activation::Elu => all.for_each(|(g, y)| *g *= if *y > 0.0 { 1.0 } else { *y + 1.0 }),
            Activation::Sigmoid => all.for_each(|(g, y)| *g *= *y * (1.0 - *y)),
            Activation::Tanh => all.for_each(|(g, y)| *g *= 1.0 - *y * *y),
        }
    }
}

vectorised! {
    /// `to += from`.
    fn add(from: &[f32], to: &mut [f32]) {
        for (to, from) in to.iter_mut().zip(from) {
            *to += *from;
        }
    }
}

vectorised! {
    /// `to = from · factor + term`, rounded twice.
    fn scale(factor: f32, term: f32, from: &[f32], to: &mut [f32]) {
        for (to, from) in to.iter_mut().zip(from) {
            *to = *from * factor + term;
        }
    }
}

/// `to = from` or `to += from`.
pub(crate) fn put(from: &[f32], to: &mut [f32], accumulate: bool) {
    if accumulate {
        add(from, to);
    } else {
        to.copy_from_slice(from);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_geom::trig;

    #[test]
    fn functions_are_as_good_as_single_precision() {
        for i in -8700..8800 {
            let x = i as f32 / 100.0;
            let exact = trig::exp(f64::from(x));
            assert!((f64::from(exp(x)) / exact - 1.0).abs() < 3e-7, "exp({x})");
            let exact = trig::tanh(f64::from(x));
            assert!((f64::from(tanh(x)) - exact).abs() < 3e-7, "tanh({x})");
        }
        assert_eq!((exp(0.0), sigmoid(0.0), tanh(0.0)), (1.0, 0.5, 0.0));
        assert!(exp(f32::NAN).is_nan() && tanh(1e9) == 1.0 && tanh(-1e9) == -1.0);
        // The same constants must hold on x86-64 and aarch64.
        assert_eq!(exp(1.0).to_bits(), 0x402d_f854);
    }

    #[test]
    fn derivatives_follow_from_the_activated_value() {
        for activation in [
            Activation::Linear,
            Activation::Relu,
            Activation::LeakyRelu(0.1),
            Activation::Relu6,
            Activation::Elu,
            Activation::Sigmoid,
            Activation::Tanh,
        ] {
            for x in [-3.0f32, -0.7, 0.4, 2.0, 7.0] {
                let at = |x: f32| {
                    let mut value = [x];
                    activate(activation, &mut value);
                    value[0]
                };
                let slope = (at(x + 0.01) - at(x - 0.01)) / 0.02;
                let mut derivative = [1.0];
                differentiate(activation, &[at(x)], &mut derivative);
                assert!((slope - derivative[0]).abs() < 1e-3, "{activation:?} {x}");
            }
        }
    }
}
