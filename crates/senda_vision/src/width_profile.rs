//! The expected width of a line along an image row, against the row.

use senda_geom::{Camera, Vec2};
use serde::{Deserialize, Serialize};

/// Expected line width (px) = intercept + slope · row, the row counted from the top of the image (C1 and C3 in SPEC).
///
/// Exact for a pinhole camera without roll over a flat floor; a straight-line approximation for other lenses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WidthProfile {
    /// Width at the upper edge (px); negative when the horizon is in the picture.
    pub intercept_px: f64,
    /// Growth of the width per row downwards (px).
    pub slope_px_per_row: f64,
    /// Width of the image that this holds for (px).
    pub width_px: u32,
    /// Height of the image that this holds for (px).
    pub height_px: u32,
}

impl WidthProfile {
    /// What a camera sees of a line `line_width_m` wide that runs straight ahead.
    ///
    /// Least squares over the rows whose middle sees the floor. All zero when none does.
    pub fn from_camera(camera: &Camera, line_width_m: f64) -> Self {
        let middle_u = f64::from(camera.width_px) / 2.0;
        let half = Vec2::new(0.0, line_width_m / 2.0);
        let (mut n, mut sum_v, mut sum_w, mut sum_vv, mut sum_vw) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for row in 0..camera.height_px {
            let v = f64::from(row) + 0.5;
            let Some(floor) = camera.floor_from_pixel(Vec2::new(middle_u, v)) else {
                continue;
            };
            let (Some(left), Some(right)) = (
                camera.pixel_from_floor(floor + half),
                camera.pixel_from_floor(floor - half),
            ) else {
                continue;
            };
            let width = (right - left).length();
            if width < 0.25 {
                continue;
            }
            n += 1.0;
            sum_v += v;
            sum_w += width;
            sum_vv += v * v;
            sum_vw += v * width;
        }
        let spread = n * sum_vv - sum_v * sum_v;
        let (slope, intercept) = if spread > 0.0 {
            let slope = (n * sum_vw - sum_v * sum_w) / spread;
            (slope, (sum_w - slope * sum_v) / n)
        } else {
            (0.0, 0.0)
        };
        Self {
            intercept_px: intercept,
            slope_px_per_row: slope,
            width_px: camera.width_px,
            height_px: camera.height_px,
        }
    }

    /// The same profile for an image of another size (C6): widths scale with the width, rows with the height.
    pub fn scaled(&self, width_px: u32, height_px: u32) -> Self {
        let factor_u = f64::from(width_px) / f64::from(self.width_px.max(1));
        let factor_v = f64::from(height_px) / f64::from(self.height_px.max(1));
        Self {
            intercept_px: self.intercept_px * factor_u,
            slope_px_per_row: self.slope_px_per_row * factor_u / factor_v,
            width_px,
            height_px,
        }
    }

    /// The profile of a line `factor` times as wide: a calibration sheet's 5 cm squares to 2 cm tape is 0.4.
    pub fn widened(&self, factor: f64) -> Self {
        Self {
            intercept_px: self.intercept_px * factor,
            slope_px_per_row: self.slope_px_per_row * factor,
            ..*self
        }
    }

    /// Expected width (px) at image row `v` (px, pixel centres at +0.5); never negative.
    pub fn at(&self, v: f64) -> f64 {
        (self.intercept_px + self.slope_px_per_row * v).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_geom::{Lens, Mounting};

    fn gopigo() -> Camera {
        Camera {
            name: "center".into(),
            width_px: 320,
            height_px: 240,
            lens: Lens::pinhole(320, 240, 54f64.to_radians(), 42.3f64.to_radians()),
            mounting: Mounting {
                x_m: 0.0,
                y_m: 0.0,
                z_m: 0.095,
                yaw_rad: 0.0,
                tilt_rad: 33f64.to_radians(),
                roll_rad: 0.0,
            },
        }
    }

    #[test]
    fn pinhole_widths_are_a_straight_line_over_the_rows() {
        let camera = gopigo();
        let profile = WidthProfile::from_camera(&camera, 0.02);
        for v in [0.5, 60.5, 120.5, 239.5] {
            let floor = camera.floor_from_pixel(Vec2::new(160.0, v)).unwrap();
            let left = camera.pixel_from_floor(floor + Vec2::new(0.0, 0.01)).unwrap();
            let right = camera.pixel_from_floor(floor - Vec2::new(0.0, 0.01)).unwrap();
            assert!((profile.at(v) - (right.x - left.x)).abs() < 1e-6);
        }
    }

    #[test]
    fn scaling_a_profile_equals_scaling_the_camera() {
        let camera = gopigo();
        let scaled = WidthProfile::from_camera(&camera, 0.02).scaled(123, 92);
        let direct = WidthProfile::from_camera(&camera.resized(123, 92), 0.02);
        for v in [0.5, 40.0, 91.5] {
            assert!((scaled.at(v) - direct.at(v)).abs() < 1e-6);
        }
        let wide = WidthProfile::from_camera(&camera, 0.05).widened(0.4);
        assert!((wide.at(100.0) - WidthProfile::from_camera(&camera, 0.02).at(100.0)).abs() < 0.05);
    }

    #[test]
    fn a_camera_that_sees_no_floor_gives_zero() {
        let mut camera = gopigo();
        camera.mounting.tilt_rad = -1.0;
        assert_eq!(WidthProfile::from_camera(&camera, 0.02).at(200.0), 0.0);
    }
}
