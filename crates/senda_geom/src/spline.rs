//! Points joined by a smooth curve that passes through them.

use crate::{CurveError, Vec2};

/// Points closer than this (m) count as one: far below what a printed floor can show, far above rounding.
const MERGE_M: f64 = 1e-6;

/// The longest path (m) that is sampled. At the coarsest spacing it has 200,000 samples.
const LARGEST_LENGTH_M: f64 = 1e5;

/// Closely spaced points on the centripetal Catmull-Rom spline through `points` (Yuksel et al. 2011), the last one
/// included; a closed spline ends where it begins.
pub(crate) fn dense_points(points: &[Vec2], closed: bool) -> Result<Vec<Vec2>, CurveError> {
    if let Some(bad) = points.iter().position(|p| !p.is_finite()) {
        return Err(CurveError::BadLength(bad));
    }
    let mut length_m = 0.0;
    for (index, pair) in points.windows(2).enumerate() {
        length_m += (pair[1] - pair[0]).length();
        if length_m > LARGEST_LENGTH_M {
            return Err(CurveError::TooLong(index + 1));
        }
    }
    let distinct = merged(points, closed);
    if distinct.len() < 2 || (closed && distinct.len() < 3) {
        return Err(CurveError::TooFewPoints);
    }
    let count = distinct.len() as isize;
    let at = |i: isize| -> Vec2 {
        if closed {
            distinct[i.rem_euclid(count) as usize]
        } else if i < 0 {
            distinct[0] * 2.0 - distinct[1]
        } else if i >= count {
            distinct[(count - 1) as usize] * 2.0 - distinct[(count - 2) as usize]
        } else {
            distinct[i as usize]
        }
    };
    let total: f64 = (0..count - 1).map(|i| (at(i + 1) - at(i)).length()).sum();
    let spacing_m = (total / 4000.0).clamp(0.002, 0.5);
    let pieces = if closed { count } else { count - 1 };
    let mut dense = Vec::new();
    for i in 0..pieces {
        let (p0, p1, p2, p3) = (at(i - 1), at(i), at(i + 1), at(i + 2));
        let steps = ((p2 - p1).length() / spacing_m).ceil().max(1.0) as usize;
        for k in 0..steps {
            dense.push(catmull_rom(p0, p1, p2, p3, k as f64 / steps as f64));
        }
    }
    dense.push(if closed { distinct[0] } else { at(count - 1) });
    Ok(dense)
}

/// Without points that repeat their neighbour; the first and the last of a closed list are neighbours.
fn merged(points: &[Vec2], closed: bool) -> Vec<Vec2> {
    let mut distinct: Vec<Vec2> = Vec::with_capacity(points.len());
    for point in points {
        if distinct
            .last()
            .is_none_or(|last| (*point - *last).length() > MERGE_M)
        {
            distinct.push(*point);
        }
    }
    if closed && distinct.len() > 1 && (distinct[0] - distinct[distinct.len() - 1]).length() <= MERGE_M {
        distinct.pop();
    }
    distinct
}

/// Barry-Goldman evaluation with centripetal knots, `part` in 0..1 between p1 and p2.
fn catmull_rom(p0: Vec2, p1: Vec2, p2: Vec2, p3: Vec2, part: f64) -> Vec2 {
    let knot = |a: Vec2, b: Vec2| (b - a).length().sqrt().max(1e-9);
    let (t0, t1) = (0.0, knot(p0, p1));
    let t2 = t1 + knot(p1, p2);
    let t3 = t2 + knot(p2, p3);
    let t = t1 + (t2 - t1) * part;
    let mix = |a: Vec2, b: Vec2, ta: f64, tb: f64| a * ((tb - t) / (tb - ta)) + b * ((t - ta) / (tb - ta));
    let (a1, a2, a3) = (mix(p0, p1, t0, t1), mix(p1, p2, t1, t2), mix(p2, p3, t2, t3));
    mix(mix(a1, a2, t0, t2), mix(a2, a3, t1, t3), t1, t2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Samples a hair apart have no direction: headings and curvatures of a curve made from them were not numbers.
        #[test]
        fn neighbours_are_apart(
            points in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 3..8),
            closed in any::<bool>(),
        ) {
            let points: Vec<Vec2> = points.iter().map(|(x, y)| Vec2::new(*x, *y)).collect();
            let dense = dense_points(&points, closed).unwrap();
            for pair in dense.windows(2) {
                prop_assert!((pair[1] - pair[0]).length() > 0.0);
            }
            prop_assert!((dense[0] - points[0]).length() < 1e-12);
        }
    }

    #[test]
    fn repeated_points_count_once() {
        let square = [Vec2::ZERO, Vec2::X, Vec2::X, Vec2::ONE, Vec2::Y, Vec2::ZERO];
        assert_eq!(merged(&square, true).len(), 4);
        assert_eq!(merged(&square, false).len(), 5);
    }
}
