//! Pictures of the sheet for tests, drawn from the camera model alone, with the blemishes of real pictures.

use super::Sheet;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use senda_core::{Channels, Image};
use senda_geom::{Camera, Lens, Mounting, Pose2, Vec2, trig};

/// The GoPiGo's camera: 54° x 42.3°, 9.5 cm high, 33° down (C18).
pub(super) fn gopigo(width_px: u32, height_px: u32) -> Camera {
    Camera {
        name: "center".into(),
        width_px,
        height_px,
        lens: Lens::pinhole(width_px, height_px, 54f64.to_radians(), 42.3f64.to_radians()),
        mounting: Mounting {
            x_m: 0.04,
            y_m: 0.0,
            z_m: 0.095,
            yaw_rad: 0.0,
            tilt_rad: 33f64.to_radians(),
            roll_rad: 0.0,
        },
    }
}

/// What lies around the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Floor {
    /// One brightness.
    Plain(f64),
    /// A dark floor with bright and dark specks of up to 1 cm.
    Speckled,
    /// Tiles of 4 cm, nearly black and grey.
    Checked,
}

/// A scene to photograph.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    pub(super) sheet: Sheet,
    /// The sheet's frame in the vehicle's: zero when the vehicle stands right.
    pub(super) vehicle_from_sheet: Pose2,
    pub(super) floor: Floor,
    /// Black squares of the sheet that are there.
    pub(super) squares: Vec<[Vec2; 4]>,
    /// Brightness of the paper, 0..255.
    pub(super) paper: f64,
    /// Light at the right edge of the picture over the light at the left edge.
    pub(super) gradient: f64,
    /// Light inside a shadow with a straight edge across the sheet; 1: none.
    pub(super) shadow: f64,
    /// A reflection: its middle (parts of width and height), its radius (part of the width), its brightness (0..255).
    pub(super) glare: Option<[f64; 4]>,
    /// Standard deviation of the noise, 0..255.
    pub(super) noise: f64,
    pub(super) seed: u64,
}

impl Scene {
    pub(super) fn new(sheet: &Sheet) -> Self {
        Self {
            sheet: *sheet,
            vehicle_from_sheet: Pose2::new(0.0, 0.0, 0.0),
            floor: Floor::Plain(110.0),
            squares: sheet.squares().to_vec(),
            paper: 220.0,
            gradient: 1.0,
            shadow: 1.0,
            glare: None,
            noise: 0.0,
            seed: 1,
        }
    }

    /// Brightness of a point in the sheet's frame, without light.
    fn reflectance(&self, p: Vec2) -> f64 {
        if self.squares.iter().any(|square| inside(square, p)) {
            return 0.1 * self.paper;
        }
        if inside(&self.sheet.page(), p) {
            return self.paper;
        }
        let cell = |size: f64| ((p.x / size).floor() as i64, (p.y / size).floor() as i64);
        match self.floor {
            Floor::Plain(brightness) => brightness,
            Floor::Checked => {
                let (i, j) = cell(0.04);
                if (i + j) % 2 == 0 { 25.0 } else { 120.0 }
            }
            Floor::Speckled => {
                let (i, j) = cell(0.008);
                // A fixed scatter of cells: any mixing of the two numbers does.
                match (i.wrapping_mul(7919) ^ j.wrapping_mul(104_729)).rem_euclid(7) {
                    0 => 235.0,
                    1 => 15.0,
                    _ => 70.0,
                }
            }
        }
    }

    /// The picture that a camera takes: pixels are means over 64 places where something changes.
    pub(super) fn photograph(&self, camera: &Camera) -> Image {
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let sheet_from_vehicle = self.vehicle_from_sheet.inverse();
        // Camera::floor_from_pixel computes the rotation anew for every pixel; here it stands still.
        let (vehicle_from_camera, place) =
            (camera.mounting.vehicle_from_camera(), camera.mounting.position());
        let look = |u: f64, v: f64| {
            let direction = vehicle_from_camera * camera.lens.ray(Vec2::new(u, v));
            if direction.z > -1e-9 {
                return 150.0;
            }
            let floor = place + direction * (place.z / -direction.z);
            self.reflectance(sheet_from_vehicle.transform(floor.truncate()))
        };
        // Values at pixel corners decide where to look more closely.
        let stride = width + 1;
        let corners: Vec<f64> = (0..stride * (height + 1))
            .map(|i| look((i % stride) as f64, (i / stride) as f64))
            .collect();
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut image = Image::new(width, height, Channels::Gray);
        for y in 0..height {
            for x in 0..width {
                let first = corners[y * stride + x];
                let same = [(1, 0), (0, 1), (1, 1)]
                    .iter()
                    .all(|(i, j)| corners[(y + j) * stride + x + i] == first);
                let mean = if same {
                    first
                } else {
                    // 64 different heights and widths (Hammersley's points), so that level edges are not rounded to
                    // eighths of a pixel.
                    let spread = |k: u32| f64::from(k.reverse_bits() >> 26);
                    let at = |k: u32| ((f64::from(k) + 0.5) / 64.0, (spread(k) + 0.5) / 64.0);
                    let total: f64 = (0..64)
                        .map(at)
                        .map(|(i, j)| look(x as f64 + i, y as f64 + j))
                        .sum();
                    total / 64.0
                };
                let across = (x as f64 + 0.5) / width as f64;
                let mut light = 1.0 + (self.gradient - 1.0) * across;
                if across + 0.3 * y as f64 / height as f64 > 0.62 {
                    light *= self.shadow;
                }
                let shine = self.glare.map_or(0.0, |[u, v, radius, brightness]| {
                    let down = (y as f64 + 0.5) / height as f64;
                    let away = Vec2::new(across - u, (down - v) * height as f64 / width as f64) / radius;
                    brightness * trig::exp(-away.length_squared())
                });
                let value = mean * light + shine + self.noise * normal(&mut random);
                image.row_mut(y)[x] = value.round().clamp(0.0, 255.0) as u8;
            }
        }
        image
    }
}

/// Nearly normal: the sum of twelve uniform numbers.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    (0..12)
        .map(|_| f64::from(random.next_u32()) / f64::from(u32::MAX))
        .sum::<f64>()
        - 6.0
}

/// Inside a convex polygon of either direction.
fn inside(polygon: &[Vec2; 4], p: Vec2) -> bool {
    let side = |i: usize| (polygon[(i + 1) % 4] - polygon[i]).perp_dot(p - polygon[i]);
    (0..4).all(|i| side(i) >= 0.0) || (0..4).all(|i| side(i) <= 0.0)
}
