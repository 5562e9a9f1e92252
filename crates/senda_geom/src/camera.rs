//! Cameras: lens, mounting on the vehicle, and the map between pixels, rays and the floor.
//!
//! Three frames: *vehicle* (origin on the floor below the axle's centre, x forward, y left, z up), *camera* (optical:
//! x right in the image, y down, z along the axis) and *image* (pixels, u right, v down, pixel centres at +0.5).

use crate::{Mat3, Vec2, Vec3, trig};
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

    /// The pixel that a direction in the camera frame falls on; `None` behind the camera (or beyond the lens).
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
            } => (direction.z > 1e-9).then(|| {
                let ideal = Vec2::new(direction.x / direction.z, direction.y / direction.z);
                let bent = brown(ideal, &distortion);
                Vec2::new(
                    centre_u_px + focal_u_px * bent.x,
                    centre_v_px + focal_v_px * bent.y,
                )
            }),
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
                let bent = kannala_brandt(trig::atan2(across, direction.z), &distortion).0;
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
                let mut ideal = bent;
                for _ in 0..50 {
                    ideal += bent - brown(ideal, &distortion);
                }
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
                let mut theta = radius;
                for _ in 0..20 {
                    let (value, slope) = kannala_brandt(theta, &distortion);
                    theta = (theta - (value - radius) / slope.max(0.05)).clamp(0.0, std::f64::consts::PI);
                }
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

fn brown(ideal: Vec2, [k1, k2, p1, p2, k3]: &[f64; 5]) -> Vec2 {
    let r2 = ideal.length_squared();
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    Vec2::new(
        ideal.x * radial + 2.0 * p1 * ideal.x * ideal.y + p2 * (r2 + 2.0 * ideal.x * ideal.x),
        ideal.y * radial + p1 * (r2 + 2.0 * ideal.y * ideal.y) + 2.0 * p2 * ideal.x * ideal.y,
    )
}

/// Radius of the polynomial at θ and its slope.
fn kannala_brandt(theta: f64, [k1, k2, k3, k4]: &[f64; 4]) -> (f64, f64) {
    let t2 = theta * theta;
    let value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
    let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
    (value, slope)
}

/// Where a camera sits on the vehicle and where it looks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mounting {
    /// Ahead of the axle's centre (m).
    pub x_m: f64,
    /// To the left of the vehicle's middle (m).
    #[serde(default)]
    pub y_m: f64,
    /// Height of the lens above the floor (m).
    pub z_m: f64,
    /// Turned to the left (rad).
    #[serde(default)]
    pub yaw_rad: f64,
    /// Tilted **down** from the horizontal (rad): 0 looks at the horizon.
    pub tilt_rad: f64,
    /// Rolled clockwise as seen from behind (rad).
    #[serde(default)]
    pub roll_rad: f64,
}

impl Mounting {
    /// Position of the lens in the vehicle frame (m).
    pub fn position(&self) -> Vec3 {
        Vec3::new(self.x_m, self.y_m, self.z_m)
    }

    /// Rotation that takes directions of the camera frame to the vehicle frame.
    pub fn vehicle_from_camera(&self) -> Mat3 {
        // Optical axes of a level camera looking forward: x right = -y, y down = -z, z = forward.
        let level = Mat3::from_cols(Vec3::NEG_Y, Vec3::NEG_Z, Vec3::X);
        rotation_z(self.yaw_rad) * rotation_y(self.tilt_rad) * rotation_x(self.roll_rad) * level
    }
}

fn rotation_x(angle_rad: f64) -> Mat3 {
    let (s, c) = trig::sincos(angle_rad);
    Mat3::from_cols(Vec3::X, Vec3::new(0.0, c, s), Vec3::new(0.0, -s, c))
}

fn rotation_y(angle_rad: f64) -> Mat3 {
    let (s, c) = trig::sincos(angle_rad);
    Mat3::from_cols(Vec3::new(c, 0.0, -s), Vec3::Y, Vec3::new(s, 0.0, c))
}

fn rotation_z(angle_rad: f64) -> Mat3 {
    let (s, c) = trig::sincos(angle_rad);
    Mat3::from_cols(Vec3::new(c, s, 0.0), Vec3::new(-s, c, 0.0), Vec3::Z)
}

/// A camera on a vehicle: everything needed to go between pixels and the floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// `center`, `left`, `right`, …: the name that recordings and drivers use.
    pub name: String,
    /// Image width (px).
    pub width_px: u32,
    /// Image height (px).
    pub height_px: u32,
    /// The lens, in pixels of this size.
    pub lens: Lens,
    /// Place and direction on the vehicle.
    pub mounting: Mounting,
}

impl Camera {
    /// The floor point (vehicle frame, m) that a pixel sees; `None` at or above the horizon.
    pub fn floor_from_pixel(&self, pixel: Vec2) -> Option<Vec2> {
        let direction = self.mounting.vehicle_from_camera() * self.lens.ray(pixel);
        if direction.z > -1e-9 {
            return None;
        }
        let reach = self.mounting.z_m / -direction.z;
        Some(Vec2::new(
            self.mounting.x_m + reach * direction.x,
            self.mounting.y_m + reach * direction.y,
        ))
    }

    /// The pixel on which a point of the vehicle frame (m) falls, inside the image or not; `None` behind the lens.
    pub fn pixel_from_point(&self, point: Vec3) -> Option<Vec2> {
        let direction = self.mounting.vehicle_from_camera().transpose() * (point - self.mounting.position());
        self.lens.project(direction)
    }

    /// The pixel on which a floor point (vehicle frame, m) falls.
    pub fn pixel_from_floor(&self, point: Vec2) -> Option<Vec2> {
        self.pixel_from_point(Vec3::new(point.x, point.y, 0.0))
    }

    /// The same camera delivering images of another size.
    pub fn resized(&self, width_px: u32, height_px: u32) -> Self {
        let scale_u = f64::from(width_px) / f64::from(self.width_px);
        let scale_v = f64::from(height_px) / f64::from(self.height_px);
        Self {
            width_px,
            height_px,
            lens: self.lens.scaled(scale_u, scale_v),
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera(lens: Lens) -> Camera {
        let mounting = Mounting {
            x_m: 0.05,
            y_m: 0.01,
            z_m: 0.095,
            yaw_rad: 0.05,
            tilt_rad: 0.576,
            roll_rad: 0.02,
        };
        Camera {
            name: "center".into(),
            width_px: 320,
            height_px: 240,
            lens,
            mounting,
        }
    }

    fn lenses() -> [Lens; 3] {
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

    proptest! {
        #[test]
        fn rays_invert_projection(u in 5.0..315.0f64, v in 5.0..235.0f64) {
            for lens in lenses() {
                let back = lens.project(lens.ray(Vec2::new(u, v)) * 2.5).unwrap();
                prop_assert!((back - Vec2::new(u, v)).length() < 1e-6, "{lens:?} {back}");
            }
        }

        #[test]
        fn floor_inverts_pixels(u in 5.0..315.0f64, v in 100.0..235.0f64) {
            for lens in lenses() {
                let camera = camera(lens);
                if let Some(floor) = camera.floor_from_pixel(Vec2::new(u, v)) {
                    let back = camera.pixel_from_floor(floor).unwrap();
                    prop_assert!((back - Vec2::new(u, v)).length() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn left_on_the_floor_is_left_in_the_image_and_near_is_low() {
        for lens in lenses() {
            let camera = camera(lens);
            let left = camera.pixel_from_floor(Vec2::new(0.3, 0.05)).unwrap();
            let right = camera.pixel_from_floor(Vec2::new(0.3, -0.05)).unwrap();
            let near = camera.pixel_from_floor(Vec2::new(0.15, 0.0)).unwrap();
            assert!(left.x < right.x && near.y > left.y);
        }
    }

    #[test]
    fn tilt_decides_the_near_limit() {
        // C2: near limit h·tan(90° - tilt - half view) ahead of the lens.
        let mounting = Mounting {
            x_m: 0.0,
            y_m: 0.0,
            z_m: 0.095,
            yaw_rad: 0.0,
            tilt_rad: 33f64.to_radians(),
            roll_rad: 0.0,
        };
        let lens = Lens::pinhole(320, 240, 54f64.to_radians(), 42.3f64.to_radians());
        let camera = Camera {
            name: "center".into(),
            width_px: 320,
            height_px: 240,
            lens,
            mounting,
        };
        let near = camera.floor_from_pixel(Vec2::new(160.0, 240.0)).unwrap();
        assert!((near.x - 0.095 * trig::tan((68.85f64 - 33.0).to_radians())).abs() < 1e-9);
    }
}
