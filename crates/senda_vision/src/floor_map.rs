//! From pixels to the floor in the vehicle frame and back.

use senda_geom::{Camera, Homography, Lens, Mat3, Vec2, Vec3};

/// Takes pixels of one image size (u right, v down, pixel centres at +0.5) to floor points in the vehicle frame
/// (x forward, y left, m; origin below the axle's centre) and back.
///
/// A pinhole camera and a calibration are one matrix. A lens with distortion costs an iteration per pixel, so
/// its rays are computed once on a grid and interpolated: within 0.2 mm of the exact point up to half a metre away.
#[derive(Debug, Clone)]
pub struct FloorMap {
    width: usize,
    height: usize,
    way: Way,
}

#[derive(Debug, Clone)]
enum Way {
    Plane {
        floor_from_image: Mat3,
        image_from_floor: Mat3,
    },
    Rays {
        camera: Box<Camera>,
        grid: RayGrid,
    },
}

impl FloorMap {
    /// For a camera delivering frames of `width` x `height` px (its own size or another).
    pub fn from_camera(camera: &Camera, width: usize, height: usize) -> Self {
        let camera = camera.resized(width as u32, height as u32);
        let way = match camera.lens {
            Lens::Pinhole {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
            } => {
                let ray_from_image = Mat3::from_cols(
                    Vec3::new(1.0 / focal_u_px, 0.0, 0.0),
                    Vec3::new(0.0, 1.0 / focal_v_px, 0.0),
                    Vec3::new(-centre_u_px / focal_u_px, -centre_v_px / focal_v_px, 1.0),
                );
                // A ray (a, b, c) of the vehicle frame meets the floor at x = x0 - z0·a/c, so (x·c, y·c, c) is
                // linear in the ray. The sign makes the last value positive below the horizon.
                let at = camera.mounting.position();
                let floor_from_ray = Mat3::from_cols(
                    Vec3::new(at.z, 0.0, 0.0),
                    Vec3::new(0.0, at.z, 0.0),
                    Vec3::new(-at.x, -at.y, -1.0),
                );
                Way::plane(floor_from_ray * camera.mounting.vehicle_from_camera() * ray_from_image)
            }
            _ => Way::Rays {
                grid: RayGrid::new(&camera),
                camera: Box::new(camera),
            },
        };
        Self { width, height, way }
    }

    /// From a calibration: `floor_from_image` maps pixels of an image of `calibrated_width` x `calibrated_height` to
    /// the floor (m); the map is for frames of `width` x `height` (C6 in SPEC). What lies beyond the horizon is told
    /// by the lower edge, which must see the floor.
    pub fn from_homography(
        floor_from_image: &Homography,
        calibrated_width: usize,
        calibrated_height: usize,
        width: usize,
        height: usize,
    ) -> Self {
        let calibrated_from_image = Mat3::from_diagonal(Vec3::new(
            calibrated_width as f64 / width as f64,
            calibrated_height as f64 / height as f64,
            1.0,
        ));
        let matrix = floor_from_image.matrix() * calibrated_from_image;
        let below = matrix * Vec3::new(width as f64 / 2.0, height as f64, 1.0);
        let way = Way::plane(if below.z < 0.0 { matrix * -1.0 } else { matrix });
        Self { width, height, way }
    }

    /// Width of the frames that this map is for (px).
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height of the frames that this map is for (px).
    pub fn height(&self) -> usize {
        self.height
    }

    /// The floor point (vehicle frame, m) that a pixel sees, inside the image or not; `None` at or above the horizon.
    pub fn floor(&self, pixel: Vec2) -> Option<Vec2> {
        match &self.way {
            Way::Plane { floor_from_image, .. } => {
                let point = *floor_from_image * pixel.extend(1.0);
                (point.z > 1e-9).then(|| Vec2::new(point.x, point.y) / point.z)
            }
            Way::Rays { camera, grid } => match grid.ray(pixel) {
                Some(ray) if ray.z < -1e-9 => {
                    let at = camera.mounting.position();
                    let reach = at.z / -ray.z;
                    Some(Vec2::new(at.x + reach * ray.x, at.y + reach * ray.y))
                }
                Some(_) => None,
                None => camera.floor_from_pixel(pixel),
            },
        }
    }

    /// The pixel on which a floor point (vehicle frame, m) falls, inside the image or not; `None` behind the camera.
    pub fn pixel(&self, floor: Vec2) -> Option<Vec2> {
        match &self.way {
            Way::Plane { image_from_floor, .. } => {
                let point = *image_from_floor * floor.extend(1.0);
                (point.z > 1e-12).then(|| Vec2::new(point.x, point.y) / point.z)
            }
            Way::Rays { camera, .. } => camera.pixel_from_floor(floor),
        }
    }

    /// How many metres of floor one pixel to the right spans, at a pixel; `None` at or above the horizon.
    pub fn metres_per_pixel(&self, pixel: Vec2) -> Option<f64> {
        let half = Vec2::new(0.5, 0.0);
        Some((self.floor(pixel + half)? - self.floor(pixel - half)?).length())
    }
}

impl Way {
    /// `floor_from_image` has a positive third coordinate below the horizon; so must the inverse in front.
    fn plane(floor_from_image: Mat3) -> Self {
        let inverse = floor_from_image.inverse();
        let image_from_floor = if inverse.is_finite() {
            // M⁻¹·(M·p) = p, whose third coordinate is 1: the sign is already right.
            inverse
        } else {
            // A singular matrix maps nothing back: every point is "behind".
            Mat3::ZERO
        };
        Self::Plane {
            floor_from_image,
            image_from_floor,
        }
    }
}

/// Directions in the vehicle frame on a grid of pixels.
#[derive(Debug, Clone)]
struct RayGrid {
    columns: usize,
    rows: usize,
    rays: Vec<Vec3>,
}

/// Distance between grid lines (px). The error of the interpolation grows with its square.
const GRID_STEP_PX: usize = 4;

impl RayGrid {
    fn new(camera: &Camera) -> Self {
        let vehicle_from_camera = camera.mounting.vehicle_from_camera();
        let columns = (camera.width_px as usize).div_ceil(GRID_STEP_PX) + 1;
        let rows = (camera.height_px as usize).div_ceil(GRID_STEP_PX) + 1;
        let rays = (0..rows * columns)
            .map(|i| {
                let (row, column) = (i / columns, i % columns);
                let pixel = Vec2::new((column * GRID_STEP_PX) as f64, (row * GRID_STEP_PX) as f64);
                vehicle_from_camera * camera.lens.ray(pixel)
            })
            .collect();
        Self { columns, rows, rays }
    }

    /// Bilinear; not of unit length. `None` outside the grid.
    fn ray(&self, pixel: Vec2) -> Option<Vec3> {
        let at = pixel / GRID_STEP_PX as f64;
        let inside =
            at.x >= 0.0 && at.y >= 0.0 && at.x <= (self.columns - 1) as f64 && at.y <= (self.rows - 1) as f64;
        if !inside {
            return None;
        }
        let column = (at.x as usize).min(self.columns.saturating_sub(2));
        let row = (at.y as usize).min(self.rows.saturating_sub(2));
        let (right, down) = (at.x - column as f64, at.y - row as f64);
        let corner = row * self.columns + column;
        let upper = self.rays[corner].lerp(self.rays[corner + 1], right);
        let lower = self.rays[corner + self.columns].lerp(self.rays[corner + self.columns + 1], right);
        Some(upper.lerp(lower, down))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_geom::Mounting;

    fn camera(lens: Lens, width_px: u32, height_px: u32) -> Camera {
        Camera {
            name: "center".into(),
            width_px,
            height_px,
            lens,
            mounting: Mounting {
                x_m: 0.06,
                y_m: -0.01,
                z_m: 0.095,
                yaw_rad: 0.03,
                tilt_rad: 0.576,
                roll_rad: -0.02,
            },
        }
    }

    fn lenses(width: u32, height: u32) -> [Lens; 3] {
        let f = f64::from(width);
        [
            Lens::pinhole(width, height, 0.942, 0.738),
            Lens::equidistant(width, height, 2.09),
            Lens::Brown {
                focal_u_px: 0.98 * f,
                focal_v_px: 0.98 * f,
                centre_u_px: 0.51 * f,
                centre_v_px: 0.37 * f,
                distortion: [-0.2, 0.05, 0.001, -0.001, 0.0],
            },
        ]
    }

    /// Pixels all over an image, at places without a pattern.
    fn pixels(width: f64, height: f64) -> impl Iterator<Item = Vec2> {
        (0..2000u32).map(move |i| {
            let part = |step: f64| (0.5 + step * f64::from(i)).fract();
            Vec2::new(width * part(0.754_877_666), height * part(0.569_840_291))
        })
    }

    #[test]
    fn maps_agree_with_the_camera() {
        for lens in lenses(320, 240) {
            let camera = camera(lens, 320, 240);
            let map = FloorMap::from_camera(&camera, 320, 240);
            for pixel in pixels(320.0, 240.0) {
                let Some(exact) = camera.floor_from_pixel(pixel) else {
                    assert!(map.floor(pixel).is_none(), "{lens:?} {pixel}");
                    continue;
                };
                if (exact - camera.mounting.position().truncate()).length() < 0.5 {
                    let floor = map.floor(pixel).unwrap();
                    assert!(
                        (floor - exact).length() < 2e-4,
                        "{lens:?} {pixel}: {floor} {exact}"
                    );
                    assert!(
                        (map.pixel(exact).unwrap() - pixel).length() < 1e-6,
                        "{lens:?} {pixel}"
                    );
                }
            }
        }
    }

    #[test]
    fn size_of_the_frames_does_not_move_the_floor() {
        for lens in lenses(320, 240) {
            let camera = camera(lens, 320, 240);
            let large = FloorMap::from_camera(&camera, 640, 480);
            let small = FloorMap::from_camera(&camera, 123, 92);
            for part in pixels(1.0, 1.0).filter(|part| part.y > 0.45) {
                let a = large.floor(part * Vec2::new(640.0, 480.0)).unwrap();
                let b = small.floor(part * Vec2::new(123.0, 92.0)).unwrap();
                // The small image's grid is coarser in angle.
                assert!((a - b).length() < 2e-3 * (1.0 + a.length()), "{lens:?} {a} {b}");
            }
        }
    }

    #[test]
    fn a_homography_maps_like_the_camera_that_it_was_fitted_to() {
        let camera = camera(lenses(320, 240)[0], 320, 240);
        let corners = [
            (20.0, 30.0),
            (300.0, 30.0),
            (300.0, 230.0),
            (20.0, 230.0),
            (150.0, 120.0),
        ]
        .map(Vec2::from);
        let floors = corners.map(|pixel| camera.floor_from_pixel(pixel).unwrap());
        let homography = Homography::fit(&corners, &floors).unwrap();
        for sign in [1.0, -1.0] {
            let homography = Homography::from_matrix(homography.matrix() * sign);
            let map = FloorMap::from_homography(&homography, 320, 240, 160, 120);
            for pixel in pixels(160.0, 120.0).filter(|pixel| pixel.y > 10.0) {
                let exact = camera.resized(160, 120).floor_from_pixel(pixel).unwrap();
                assert!((map.floor(pixel).unwrap() - exact).length() < 1e-6);
                assert!((map.pixel(exact).unwrap() - pixel).length() < 1e-5);
            }
        }
    }

    #[test]
    fn nothing_beyond_the_horizon() {
        let mut level = camera(lenses(320, 240)[0], 320, 240);
        level.mounting.tilt_rad = 0.0;
        level.mounting.roll_rad = 0.0;
        let map = FloorMap::from_camera(&level, 320, 240);
        assert!(map.floor(Vec2::new(160.0, 119.0)).is_none());
        assert!(map.floor(Vec2::new(160.0, 121.0)).unwrap().x > 1.0);
        assert!(map.pixel(Vec2::new(-1.0, 0.0)).is_none());
        assert!(map.metres_per_pixel(Vec2::new(160.0, 200.0)).unwrap() < 0.01);
    }

    #[test]
    fn a_useless_homography_does_no_harm() {
        let map = FloorMap::from_homography(&Homography::from_matrix(Mat3::ZERO), 320, 240, 320, 240);
        assert!(map.floor(Vec2::new(1.0, 2.0)).is_none());
        assert!(map.pixel(Vec2::new(1.0, 2.0)).is_none());
    }
}
