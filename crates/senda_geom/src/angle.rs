//! Angles in radians, counter-clockwise positive.

use std::f64::consts::PI;

/// Brings an angle into (-π, π].
pub fn wrap(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    let turns = ((angle_rad + PI) / (2.0 * PI)).ceil() - 1.0;
    let wrapped = angle_rad - turns * 2.0 * PI;
    // Rounding can leave the value just outside the interval.
    if wrapped <= -PI {
        PI
    } else if wrapped > PI {
        wrapped - 2.0 * PI
    } else {
        wrapped
    }
}

/// The smallest signed rotation that takes `from_rad` to `to_rad`, in (-π, π].
pub fn difference(to_rad: f64, from_rad: f64) -> f64 {
    wrap(to_rad - from_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn wrapped_is_in_range_and_equivalent(angle in -1e4..1e4f64) {
            let wrapped = wrap(angle);
            prop_assert!(wrapped > -PI && wrapped <= PI);
            let turns = (angle - wrapped) / (2.0 * PI);
            prop_assert!((turns - turns.round()).abs() < 1e-9);
        }
    }

    #[test]
    fn edges() {
        assert_eq!(wrap(PI), PI);
        assert!((wrap(-PI) - PI).abs() < 1e-15);
        assert!((wrap(3.0 * PI) - PI).abs() < 1e-12);
        assert!((difference(-3.0, 3.0) - (2.0 * PI - 6.0)).abs() < 1e-12);
    }
}
