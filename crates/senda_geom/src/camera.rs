//! Cameras: mounting on the vehicle, and the map between pixels and the floor.
//!
//! Three frames: *vehicle* (origin on the floor below the axle's centre, x forward, y left, z up), *camera* (optical:
//! x right in the image, y down, z along the axis) and *image* (pixels, u right, v down, pixel centres at +0.5).

use crate::{Lens, Mat3, Vec2, Vec3, trig};
use serde::{Deserialize, Serialize};

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
        // Also refuses what is not a number: a pixel far outside a lens whose inversion diverges there.
        if direction.z.is_nan() || direction.z > -1e-9 {
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
    use crate::lens::tests::lenses;
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

    proptest! {
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

    /// The inversion of a strong distortion diverges outside the image; the floor point was NaN, not `None`.
    #[test]
    fn pixels_far_outside_see_no_floor_or_a_finite_one() {
        for lens in lenses() {
            let camera = camera(lens);
            for pixel in [
                Vec2::new(-1e6, 1e6),
                Vec2::new(1e9, 1e9),
                Vec2::new(160.0, 1e300),
                Vec2::NAN,
            ] {
                assert!(
                    camera
                        .floor_from_pixel(pixel)
                        .is_none_or(|floor| floor.is_finite()),
                    "{lens:?} {pixel}"
                );
            }
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
