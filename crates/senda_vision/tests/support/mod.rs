//! Small scenes with lines of known pose, as the document's camera sees them. Not a simulator: just enough to know
//! the truth that a test checks against.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test, example and benchmark uses its own part"
)]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use senda_core::{Channels, Image};
use senda_geom::{Camera, Lens, Mounting, Pose2, Vec2, trig};
use senda_vision::FloorMap;

/// The camera of C in SPEC: 54° x 42.3°, 9.5 cm high, 33° down.
pub fn gopigo_camera(width: u32, height: u32) -> Camera {
    Camera {
        name: "center".into(),
        width_px: width,
        height_px: height,
        lens: Lens::pinhole(width, height, 54f64.to_radians(), 42.3f64.to_radians()),
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

/// One painted line: an arc that passes the vehicle.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Where the vehicle stands relative to the line: left of it positive (m).
    pub d_m: f64,
    /// Its heading against the line (rad), left positive.
    pub theta_rad: f64,
    /// Curvature (1/m), left positive.
    pub curvature_per_m: f64,
    pub width_m: f64,
    pub color: [f64; 3],
    /// Dashes: painted length and gap (m).
    pub dash_m: Option<(f64, f64)>,
    /// Part of the paint that is worn away, in spots of 3 mm.
    pub wear: f64,
}

impl Line {
    pub fn straight(d_m: f64, theta_rad: f64, grey: f64) -> Self {
        Self {
            d_m,
            theta_rad,
            curvature_per_m: 0.0,
            width_m: 0.02,
            color: [grey; 3],
            dash_m: None,
            wear: 0.0,
        }
    }

    /// Station and offset of a point of the vehicle frame relative to the line.
    pub fn place(&self, point: Vec2) -> (f64, f64) {
        let vehicle = Pose2::new(0.0, self.d_m, self.theta_rad);
        let at = vehicle.transform(point);
        if self.curvature_per_m.abs() < 1e-9 {
            return (at.x, at.y);
        }
        let radius = 1.0 / self.curvature_per_m;
        let from_centre = at - Vec2::new(0.0, radius);
        let offset = radius.signum() * (radius.abs() - from_centre.length());
        let turn = trig::atan2(from_centre.x, -from_centre.y * radius.signum());
        (turn * radius.abs(), offset)
    }
}

/// What lies around the lines.
#[derive(Debug, Clone, Copy)]
pub struct Floor {
    pub color: [f64; 3],
    /// Amplitude of speckles of about 4 mm (grey levels).
    pub speckle: f64,
    /// Brightness falls by this part from the left to the right edge of the picture.
    pub gradient: f64,
    /// Standard deviation of the sensor's noise (grey levels).
    pub noise: f64,
    pub seed: u64,
}

impl Floor {
    pub fn plain(grey: f64) -> Self {
        Self {
            color: [grey; 3],
            speckle: 0.0,
            gradient: 0.0,
            noise: 1.5,
            seed: 1,
        }
    }
}

fn hash(i: i64, j: i64, seed: u64) -> f64 {
    let mut h = (i as u64)
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add((j as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f))
        .wrapping_add(seed.wrapping_mul(0x1656_67b1_9e37_79f9));
    h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 32)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 11) as f64 / (1u64 << 53) as f64
}

/// The picture that `camera` takes.
pub fn render(camera: &Camera, floor: &Floor, lines: &[Line]) -> Image {
    let (width, height) = (camera.width_px as usize, camera.height_px as usize);
    let map = FloorMap::from_camera(camera, width, height);
    let mut image = Image::new(width, height, Channels::Rgb);
    let mut random = ChaCha8Rng::seed_from_u64(floor.seed);
    for y in 0..height {
        let row = image.row_mut(y);
        for x in 0..width {
            let mut sum = [0.0; 3];
            for (du, dv) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                let pixel = Vec2::new(x as f64 + du, y as f64 + dv);
                let color = map
                    .floor(pixel)
                    .map_or([90.0; 3], |point| color_at(point, floor, lines));
                for (sum, color) in sum.iter_mut().zip(color) {
                    *sum += 0.25 * color;
                }
            }
            let light = 1.0 - floor.gradient * (x as f64 + 0.5) / width as f64;
            for (i, value) in sum.iter().enumerate() {
                // Sum of four uniform numbers of 0..=255: close to a Gaussian of standard deviation 147.8.
                let bytes = random.next_u32().to_le_bytes();
                let gauss = (bytes.iter().map(|byte| f64::from(*byte)).sum::<f64>() - 510.0) / 147.8;
                row[3 * x + i] = (value * light + floor.noise * gauss).round().clamp(0.0, 255.0) as u8;
            }
        }
    }
    image
}

/// Colour of a floor point before the light.
fn color_at(point: Vec2, floor: &Floor, lines: &[Line]) -> [f64; 3] {
    let cell = |size: f64, seed: u64| {
        hash(
            (point.x / size).floor() as i64,
            (point.y / size).floor() as i64,
            seed,
        )
    };
    for line in lines {
        let (station, offset) = line.place(point);
        if offset.abs() < line.width_m / 2.0
            && line
                .dash_m
                .is_none_or(|(dash, gap)| station.rem_euclid(dash + gap) < dash)
            && (line.wear == 0.0 || cell(0.003, floor.seed + 7) >= line.wear)
        {
            return line.color;
        }
    }
    if floor.speckle == 0.0 {
        return floor.color;
    }
    let speck = floor.speckle * (cell(0.004, floor.seed) - 0.5);
    floor.color.map(|c| c + speck)
}

/// The luminance of an RGB image.
pub fn grey(image: &Image) -> Image {
    let mut pixels = vec![0; image.width() * image.height()];
    senda_vision::luminance::luminance(image.pixels(), &mut pixels);
    Image::from_pixels(image.width(), image.height(), Channels::Gray, pixels).expect("one byte a pixel")
}

/// Twelve frames that the benchmarks run over: dark and light, straight and curved, plain and speckled.
pub fn benchmark_frames(width: u32, height: u32) -> Vec<Image> {
    let camera = gopigo_camera(width, height);
    (0..12u32)
        .map(|i| {
            let (floor_grey, line_grey) = if i.is_multiple_of(2) {
                (170.0, 45.0)
            } else {
                (90.0, 220.0)
            };
            let floor = Floor {
                speckle: 12.0 * f64::from(i % 4),
                gradient: 0.1 * f64::from(i % 3),
                noise: 2.5,
                seed: u64::from(i),
                ..Floor::plain(floor_grey)
            };
            let lean = f64::from(i) - 5.5;
            let line = Line {
                curvature_per_m: if i >= 6 { 0.4 * lean } else { 0.0 },
                ..Line::straight(0.008 * lean, 0.06 * lean, line_grey)
            };
            render(&camera, &floor, &[line])
        })
        .collect()
}
