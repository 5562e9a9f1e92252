//! Projective maps between two planes.

use crate::{Mat3, Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// A projective map from one plane to another, such as from image pixels to metres on the floor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Homography {
    matrix: Mat3,
}

impl Homography {
    /// From a 3x3 matrix in column-major order (glam's). A scale factor does not matter.
    pub fn from_matrix(matrix: Mat3) -> Self {
        Self { matrix }
    }

    /// The least-squares map that takes each `from[i]` to `to[i]` (normalised direct linear transform,
    /// Hartley & Zisserman, 2nd ed., algorithm 4.2). `None` with fewer than four pairs or degenerate points.
    pub fn fit(from: &[Vec2], to: &[Vec2]) -> Option<Self> {
        if from.len() < 4 || from.len() != to.len() {
            return None;
        }
        let (from_norm, to_norm) = (normalisation(from)?, normalisation(to)?);
        let mut normal = nalgebra::SMatrix::<f64, 9, 9>::zeros();
        for (f, t) in from.iter().zip(to) {
            let f = from_norm * Vec3::new(f.x, f.y, 1.0);
            let t = to_norm * Vec3::new(t.x, t.y, 1.0);
            let rows = [
                [-f.x, -f.y, -1.0, 0.0, 0.0, 0.0, t.x * f.x, t.x * f.y, t.x],
                [0.0, 0.0, 0.0, -f.x, -f.y, -1.0, t.y * f.x, t.y * f.y, t.y],
            ];
            for row in rows {
                for i in 0..9 {
                    for j in 0..9 {
                        normal[(i, j)] += row[i] * row[j];
                    }
                }
            }
        }
        let eigen = normal.symmetric_eigen();
        let mut order: Vec<usize> = (0..9).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        // A second null direction means the points do not determine the map (three on a line, say).
        if eigen.eigenvalues[order[1]] < 1e-9 * eigen.eigenvalues[order[8]] {
            return None;
        }
        let h = eigen.eigenvectors.column(order[0]);
        let fitted = Mat3::from_cols(
            Vec3::new(h[0], h[3], h[6]),
            Vec3::new(h[1], h[4], h[7]),
            Vec3::new(h[2], h[5], h[8]),
        );
        let matrix = to_norm.inverse() * fitted * from_norm;
        let scale = matrix.z_axis.z;
        let matrix = if scale.abs() > 1e-12 {
            matrix * (1.0 / scale)
        } else {
            matrix
        };
        matrix.is_finite().then_some(Self { matrix })
    }

    /// The image of a point; `None` when it maps to infinity.
    pub fn map(&self, point: Vec2) -> Option<Vec2> {
        let mapped = self.matrix * Vec3::new(point.x, point.y, 1.0);
        (mapped.z.abs() > 1e-12).then(|| Vec2::new(mapped.x / mapped.z, mapped.y / mapped.z))
    }

    /// The reverse map; `None` when the matrix is singular.
    pub fn inverse(&self) -> Option<Self> {
        let inverse = self.matrix.inverse();
        inverse.is_finite().then_some(Self { matrix: inverse })
    }

    /// The matrix, column-major.
    pub fn matrix(&self) -> Mat3 {
        self.matrix
    }
}

/// Similarity that moves the centroid to 0 and the mean distance to √2.
fn normalisation(points: &[Vec2]) -> Option<Mat3> {
    let count = points.len() as f64;
    let centre = points.iter().copied().sum::<Vec2>() / count;
    let spread = points.iter().map(|p| (*p - centre).length()).sum::<f64>() / count;
    // Equal points, or one that is not a number.
    if spread.is_nan() || spread <= 1e-12 {
        return None;
    }
    let scale = std::f64::consts::SQRT_2 / spread;
    Some(Mat3::from_cols(
        Vec3::new(scale, 0.0, 0.0),
        Vec3::new(0.0, scale, 0.0),
        Vec3::new(-scale * centre.x, -scale * centre.y, 1.0),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn fit_recovers_the_map(a in 0.5..2.0f64, b in -0.3..0.3f64, c in -5.0..5.0f64, g in -0.01..0.01f64) {
            let truth = Homography::from_matrix(Mat3::from_cols(
                Vec3::new(a, b, g), Vec3::new(-b, 1.0, 0.02), Vec3::new(c, 1.0, 1.0)));
            let from: Vec<Vec2> = [(0.0, 0.0), (10.0, 0.0), (10.0, 8.0), (0.0, 8.0), (5.0, 3.0), (2.0, 7.0)]
                .iter().map(|(x, y)| Vec2::new(*x, *y)).collect();
            let to: Vec<Vec2> = from.iter().map(|p| truth.map(*p).unwrap()).collect();
            let fitted = Homography::fit(&from, &to).unwrap();
            let back = fitted.inverse().unwrap();
            for p in &from {
                prop_assert!((fitted.map(*p).unwrap() - truth.map(*p).unwrap()).length() < 1e-6);
                prop_assert!((back.map(truth.map(*p).unwrap()).unwrap() - *p).length() < 1e-5);
            }
        }
    }

    #[test]
    fn collinear_points_are_refused() {
        let line: Vec<Vec2> = (0..5).map(|i| Vec2::new(i as f64, 2.0 * i as f64)).collect();
        assert!(Homography::fit(&line, &line).is_none());
        assert!(Homography::fit(&line[..3], &line[..3]).is_none());
    }
}
