//! Lenses: the map between directions and pixels.

use crate::{Vec2, Vec3, trig};
use serde::{Deserialize, Serialize};

/// How directions become pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Lens {
    /// Straight lines stay straight. Focal lengths in pixels.
    Pinhole {
        /// Horizontal focal length (px).
        focal_u_px: f64,
        /// Vertical focal length (px).
        focal_v_px: f64,
        /// Principal point (px).
        centre_u_px: f64,
        /// Principal point (px).
        centre_v_px: f64,
    },
    /// Wide lens: r = f·(θ + k1·θ³ + k2·θ⁵ + k3·θ⁷ + k4·θ⁹) with θ the angle to the axis
    /// (Kannala & Brandt 2006, as in OpenCV's fisheye model). All k = 0 is the equidistant lens.
    KannalaBrandt {
        /// Horizontal focal length (px).
        focal_u_px: f64,
        /// Vertical focal length (px).
        focal_v_px: f64,
        /// Principal point (px).
        centre_u_px: f64,
        /// Principal point (px).
        centre_v_px: f64,
        /// Distortion coefficients k1..k4 of θ³, θ⁵, θ⁷, θ⁹.
        distortion: [f64; 4],
    },
    /// Pinhole with radial and tangential distortion k1, k2, p1, p2, k3 (Brown 1971, OpenCV's order).
    Brown {
        /// Horizontal focal length (px).
        focal_u_px: f64,
        /// Vertical focal length (px).
        focal_v_px: f64,
        /// Principal point (px).
        centre_u_px: f64,
        /// Principal point (px).
        centre_v_px: f64,
        /// k1, k2, p1, p2, k3.
        distortion: [f64; 5],
    },
}

impl Lens {
    /// A pinhole lens from view angles (rad), principal point in the middle.
    pub fn pinhole(width_px: u32, height_px: u32, horizontal_view_rad: f64, vertical_view_rad: f64) -> Self {
        let (half_width, half_height) = (f64::from(width_px) / 2.0, f64::from(height_px) / 2.0);
        Self::Pinhole {
            focal_u_px: half_width / trig::tan(horizontal_view_rad / 2.0),
            focal_v_px: half_height / trig::tan(vertical_view_rad / 2.0),
            centre_u_px: half_width,
            centre_v_px: half_height,
        }
    }

    /// An equidistant wide lens that sees `horizontal_view_rad` across the width, square pixels.
    pub fn equidistant(width_px: u32, height_px: u32, horizontal_view_rad: f64) -> Self {
        let focal_px = f64::from(width_px) / horizontal_view_rad;
        Self::KannalaBrandt {
            focal_u_px: focal_px,
            focal_v_px: focal_px,
            centre_u_px: f64::from(width_px) / 2.0,
            centre_v_px: f64::from(height_px) / 2.0,
            distortion: [0.0; 4],
        }
    }

    /// The same lens with its focal lengths times `factor`: a narrower view above 1, a wider one below.
    pub fn zoomed(mut self, factor: f64) -> Self {
        match &mut self {
            Self::Pinhole {
                focal_u_px,
                focal_v_px,
                ..
            }
            | Self::KannalaBrandt {
                focal_u_px,
                focal_v_px,
                ..
            }
            | Self::Brown {
                focal_u_px,
                focal_v_px,
                ..
            } => {
                *focal_u_px *= factor;
                *focal_v_px *= factor;
            }
        }
        self
    }

    /// The pixel that a direction in the camera frame falls on; `None` behind the camera, or so far off the axis that
    /// the distortion polynomial folds back (it would put what the lens cannot see into the middle of the image).
    pub fn project(&self, direction: Vec3) -> Option<Vec2> {
        match *self {
            Self::Pinhole {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
            } => (direction.z > 1e-9).then(|| {
                Vec2::new(
                    centre_u_px + focal_u_px * direction.x / direction.z,
                    centre_v_px + focal_v_px * direction.y / direction.z,
                )
            }),
            Self::Brown {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion,
            } => {
                if direction.z <= 1e-9 {
                    return None;
                }
                let ideal = Vec2::new(direction.x / direction.z, direction.y / direction.z);
                if brown_folds(ideal.length_squared(), &distortion) {
                    return None;
                }
                let bent = brown(ideal, &distortion);
                Some(Vec2::new(
                    centre_u_px + focal_u_px * bent.x,
                    centre_v_px + focal_v_px * bent.y,
                ))
            }
            Self::KannalaBrandt {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion,
            } => {
                let across = trig::hypot(direction.x, direction.y);
                if across < 1e-12 {
                    return (direction.z > 0.0).then(|| Vec2::new(centre_u_px, centre_v_px));
                }
                let theta = trig::atan2(across, direction.z);
                if kannala_brandt_folds(theta, &distortion) {
                    return None;
                }
                let bent = kannala_brandt(theta, &distortion).0;
                Some(Vec2::new(
                    centre_u_px + focal_u_px * bent * direction.x / across,
                    centre_v_px + focal_v_px * bent * direction.y / across,
                ))
            }
        }
    }

    /// The unit direction in the camera frame that a pixel sees.
    pub fn ray(&self, pixel: Vec2) -> Vec3 {
        match *self {
            Self::Pinhole {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
            } => Vec3::new(
                (pixel.x - centre_u_px) / focal_u_px,
                (pixel.y - centre_v_px) / focal_v_px,
                1.0,
            )
            .normalize(),
            Self::Brown {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion,
            } => {
                let bent = Vec2::new(
                    (pixel.x - centre_u_px) / focal_u_px,
                    (pixel.y - centre_v_px) / focal_v_px,
                );
                // Fixed-point inversion, as the literature does; contracts for the distortion of real lenses.
                let ideal = repeated(bent, 50, |ideal| ideal + (bent - brown(ideal, &distortion)));
                Vec3::new(ideal.x, ideal.y, 1.0).normalize()
            }
            Self::KannalaBrandt {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion,
            } => {
                let bent = Vec2::new(
                    (pixel.x - centre_u_px) / focal_u_px,
                    (pixel.y - centre_v_px) / focal_v_px,
                );
                let radius = bent.length();
                if radius < 1e-12 {
                    return Vec3::Z;
                }
                let theta = repeated(radius, 20, |theta| {
                    let (value, slope) = kannala_brandt(theta, &distortion);
                    (theta - (value - radius) / slope.max(0.05)).clamp(0.0, std::f64::consts::PI)
                });
                let (sin, cos) = trig::sincos(theta);
                Vec3::new(bent.x / radius * sin, bent.y / radius * sin, cos)
            }
        }
    }

    /// The same lens for an image scaled by `scale_u`, `scale_v`.
    pub fn scaled(&self, scale_u: f64, scale_v: f64) -> Self {
        let mut scaled = *self;
        let (Self::Pinhole {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
        }
        | Self::Brown {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
            ..
        }
        | Self::KannalaBrandt {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
            ..
        }) = &mut scaled;
        *focal_u_px *= scale_u;
        *centre_u_px *= scale_u;
        *focal_v_px *= scale_v;
        *centre_v_px *= scale_v;
        scaled
    }
}

/// `step` applied `times` times, without the rest once it stands still or swings between two values.
fn repeated<T: PartialEq + Copy>(start: T, times: usize, step: impl Fn(T) -> T) -> T {
    let (mut before, mut now) = (start, start);
    for left in (0..times).rev() {
        let next = step(now);
        if next == before {
            return if left % 2 == 0 { next } else { now };
        }
        (before, now) = (now, next);
    }
    now
}

fn brown(ideal: Vec2, [k1, k2, p1, p2, k3]: &[f64; 5]) -> Vec2 {
    let r2 = ideal.length_squared();
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    Vec2::new(
        ideal.x * radial + 2.0 * p1 * ideal.x * ideal.y + p2 * (r2 + 2.0 * ideal.x * ideal.x),
        ideal.y * radial + p1 * (r2 + 2.0 * ideal.y * ideal.y) + 2.0 * p2 * ideal.x * ideal.y,
    )
}

/// Whether the radial polynomial stops growing somewhere between the axis and radius² `r2`.
fn brown_folds(r2: f64, [k1, k2, _, _, k3]: &[f64; 5]) -> bool {
    // Slope of r·(1 + k1·r² + k2·r⁴ + k3·r⁶) against r, with x = r².
    let slope = |x: f64| 1.0 + x * (3.0 * k1 + x * (5.0 * k2 + x * 7.0 * k3));
    if slope(r2) <= 0.0 {
        return true;
    }
    // Its least values lie where its own derivative 3·k1 + 10·k2·x + 21·k3·x² is 0.
    let (a, b, c) = (21.0 * k3, 10.0 * k2, 3.0 * k1);
    let dips = |x: f64| x > 0.0 && x < r2 && slope(x) <= 0.0;
    if a == 0.0 {
        return b != 0.0 && dips(-c / b);
    }
    let inner = b * b - 4.0 * a * c;
    inner >= 0.0 && (dips((-b + inner.sqrt()) / (2.0 * a)) || dips((-b - inner.sqrt()) / (2.0 * a)))
}

/// Whether the polynomial stops growing somewhere between the axis and θ, looked at in sixteen places: narrower dips do
/// not occur in real lenses.
fn kannala_brandt_folds(theta: f64, distortion: &[f64; 4]) -> bool {
    *distortion != [0.0; 4]
        && (1..=16).any(|i| kannala_brandt(theta * f64::from(i) / 16.0, distortion).1 <= 0.0)
}

/// Radius of the polynomial at θ and its slope.
fn kannala_brandt(theta: f64, [k1, k2, k3, k4]: &[f64; 4]) -> (f64, f64) {
    let t2 = theta * theta;
    let value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
    let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
    (value, slope)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// One of each kind, 320x240.
    pub(crate) fn lenses() -> [Lens; 3] {
        let pinhole = Lens::pinhole(320, 240, 0.942, 0.738);
        let Lens::Pinhole {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
        } = pinhole
        else {
            unreachable!()
        };
        let brown = Lens::Brown {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
            distortion: [-0.2, 0.05, 0.001, -0.001, 0.0],
        };
        [pinhole, Lens::equidistant(320, 240, 2.09), brown]
    }

    /// The short way gives the bits of the long one: on values that settle, swing, run away and are no numbers.
    #[test]
    fn repeating_stops_early_with_the_same_bits() {
        let steps: [fn(f64) -> f64; 5] = [
            |x| 0.5 * (x + 2.0 / x),
            |x| -x,
            |x| 1.0 - x,
            |x| x * 1.5 + 0.1,
            |x| (x - 3.0).sqrt(),
        ];
        for step in steps {
            for times in 0..60 {
                let long = (0..times).fold(1.25, |x, _| step(x));
                assert_eq!(repeated(1.25, times, step).to_bits(), long.to_bits(), "{times}");
            }
        }
    }

    proptest! {
        #[test]
        fn rays_invert_projection(u in 5.0..315.0f64, v in 5.0..235.0f64) {
            for lens in lenses() {
                let back = lens.project(lens.ray(Vec2::new(u, v)) * 2.5).unwrap();
                prop_assert!((back - Vec2::new(u, v)).length() < 1e-6, "{lens:?} {back}");
            }
        }
    }

    /// With barrel distortion the polynomial turns back: a point far to the left was drawn inside the image.
    #[test]
    fn what_the_lens_cannot_see_is_not_folded_into_the_image() {
        let [_, equidistant, _] = lenses();
        let (mut brown, mut wide) = (lenses()[2], equidistant);
        if let Lens::Brown { distortion, .. } = &mut brown {
            *distortion = [-0.3, 0.0, 0.0, 0.0, 0.0];
        }
        if let Lens::KannalaBrandt { distortion, .. } = &mut wide {
            *distortion = [-0.3, 0.0, 0.0, 0.0];
        }
        let late = |k: [f64; 5]| brown_folds(4.0, &k);
        assert!(
            late([-0.5, 0.1, 0.0, 0.0, 0.0]),
            "dips and recovers before r² = 4"
        );
        assert!(late([-1.0, 0.2, 0.0, 0.0, 0.01]) && !late([-0.01, 0.0, 0.0, 0.0, 0.0]));
        for lens in [brown, wide] {
            assert!(lens.project(Vec3::new(0.3, 0.0, 1.0)).is_some());
            assert_eq!(lens.project(Vec3::new(1.8, 0.0, 1.0)), None, "{lens:?}");
        }
        assert!(equidistant.project(Vec3::new(1.8, 0.0, 1.0)).is_some());
    }
}
