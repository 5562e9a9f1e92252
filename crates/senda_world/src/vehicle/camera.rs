//! Cameras of a vehicle: lens and place, exposure, blur, noise, JPEG.

use crate::error::WorldError;
use crate::reader::Table;
use crate::writer::{Document, float};
use senda_geom::{Camera, Lens, Mounting, trig};
use std::f64::consts::PI;

/// A camera with everything that makes its picture imperfect.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSpec {
    /// Name, size, lens and place.
    pub camera: Camera,
    /// Time from the middle of the exposure to the observation (s).
    pub latency_s: f64,
    /// Exposure.
    pub exposure: Exposure,
    /// Noise of the sensor.
    pub noise: ImageNoise,
    /// Share of the light that is lost in the image's corners, 0 ..= 1.
    pub vignetting: f64,
    /// Standard deviation of the lens's blur at 320 px width (px); scales with the width.
    pub blur_px: f64,
    /// JPEG quality 1..=100 of the delivered frames; `None`: raw frames.
    pub jpeg_quality: Option<u8>,
    /// Standard deviation of the lasting error of tilt and yaw (rad), drawn once a run: a mounting that was bumped.
    pub mounting_std_rad: f64,
}

/// Automatic exposure and shutter.
#[derive(Debug, Clone, PartialEq)]
pub struct Exposure {
    /// Mean image value that the automatic exposure aims at, 0 ..= 1 of the encoded range.
    pub target: f64,
    /// Factor on the right exposure at the first frame: above 1 over-exposed, as USB cameras start (FORMATS 10).
    pub start_gain: f64,
    /// Time constant of its settling (s); 0: every frame is right at once.
    pub time_constant_s: f64,
    /// Time during which the shutter is open at light level 1 (s): motion blur. Dimmer light lengthens it.
    pub shutter_s: f64,
    /// Longest time that the shutter stays open (s); beyond that the gain, and with it the noise, rises.
    pub shutter_limit_s: f64,
    /// Whether exposure adapts during the run. `false`: fixed at level 1.
    pub automatic: bool,
}

/// Noise of an image sensor, in steps of the 8-bit encoded range at light level 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImageNoise {
    /// Standard deviation in the dark.
    pub read: f64,
    /// Standard deviation of photon noise at full brightness; grows with the square root of brightness.
    pub shot: f64,
}

impl CameraSpec {
    pub(super) fn read(mut table: Table) -> Result<Self, WorldError> {
        let name = table
            .optional_string("name")?
            .unwrap_or_else(|| "center".to_owned());
        let whole = |value: Option<u64>| value.map(|value| value as u32);
        let width_px = whole(table.optional_u64("width_px", 16, 8192)?)
            .ok_or_else(|| table.missing("width_px", "a whole number"))?;
        let height_px = whole(table.optional_u64("height_px", 16, 8192)?)
            .ok_or_else(|| table.missing("height_px", "a whole number"))?;
        let mounting = match table.optional_table("mounting")? {
            Some(mounting) => read_mounting(mounting)?,
            None => return Err(table.missing("mounting", "a table with x_m, z_m, tilt_deg")),
        };
        let lens = match table.optional_table("lens")? {
            Some(lens) => read_lens(lens, width_px, height_px)?,
            None => return Err(table.missing("lens", "a table with kind and view angles")),
        };
        let exposure = match table.optional_table("exposure")? {
            Some(exposure) => read_exposure(exposure)?,
            None => Exposure::default(),
        };
        let noise = match table.optional_table("noise")? {
            Some(mut noise) => {
                let read = ImageNoise {
                    read: noise.f64("read", 0.0, 64.0, 0.0)?,
                    shot: noise.f64("shot", 0.0, 64.0, 0.0)?,
                };
                noise.finish()?;
                read
            }
            None => ImageNoise::default(),
        };
        let spec = Self {
            camera: Camera {
                name,
                width_px,
                height_px,
                lens,
                mounting,
            },
            latency_s: table.f64("latency_s", 0.0, 2.0, 0.0)?,
            exposure,
            noise,
            vignetting: table.f64("vignetting", 0.0, 1.0, 0.0)?,
            blur_px: table.f64("blur_px", 0.0, 10.0, 0.0)?,
            jpeg_quality: table
                .optional_u64("jpeg_quality", 1, 100)?
                .map(|quality| quality as u8),
            mounting_std_rad: table
                .optional_angle("mounting_std_rad", "mounting_std_deg", 0.0, 0.3)?
                .unwrap_or(0.0),
        };
        table.finish()?;
        Ok(spec)
    }

    pub(super) fn write(&self, document: &mut Document) {
        let camera = &self.camera;
        document.item("cameras");
        document.text("name", &camera.name);
        document.line("width_px", camera.width_px);
        document.line("height_px", camera.height_px);
        document.number("latency_s", self.latency_s);
        document.number("vignetting", self.vignetting);
        document.number("blur_px", self.blur_px);
        if let Some(quality) = self.jpeg_quality {
            document.line("jpeg_quality", quality);
        }
        document.number("mounting_std_rad", self.mounting_std_rad);
        let mounting = &camera.mounting;
        document.header("cameras.mounting");
        document.number("x_m", mounting.x_m);
        document.number("y_m", mounting.y_m);
        document.number("z_m", mounting.z_m);
        document.number("yaw_rad", mounting.yaw_rad);
        document.number("tilt_rad", mounting.tilt_rad);
        document.number("roll_rad", mounting.roll_rad);
        document.header("cameras.lens");
        let (kind, focal_u_px, focal_v_px, centre_u_px, centre_v_px, distortion) = match camera.lens {
            Lens::Pinhole {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
            } => (
                "pinhole",
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                Vec::new(),
            ),
            Lens::KannalaBrandt {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion,
            } => (
                "kannala-brandt",
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion.to_vec(),
            ),
            Lens::Brown {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion,
            } => (
                "brown",
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion.to_vec(),
            ),
        };
        document.text("kind", kind);
        document.number("focal_u_px", focal_u_px);
        document.number("focal_v_px", focal_v_px);
        document.number("centre_u_px", centre_u_px);
        document.number("centre_v_px", centre_v_px);
        if !distortion.is_empty() {
            let numbers: Vec<String> = distortion.into_iter().map(float).collect();
            document.line("distortion", format!("[{}]", numbers.join(", ")));
        }
        let exposure = &self.exposure;
        document.header("cameras.exposure");
        document.line("automatic", exposure.automatic);
        document.number("target", exposure.target);
        document.number("start_gain", exposure.start_gain);
        document.number("time_constant_s", exposure.time_constant_s);
        document.number("shutter_s", exposure.shutter_s);
        document.number("shutter_limit_s", exposure.shutter_limit_s);
        document.header("cameras.noise");
        document.number("read", self.noise.read);
        document.number("shot", self.noise.shot);
    }
}

impl Default for Exposure {
    /// Right at once, no blur.
    fn default() -> Self {
        Self {
            target: 0.5,
            start_gain: 1.0,
            time_constant_s: 0.0,
            shutter_s: 0.0,
            shutter_limit_s: 0.0,
            automatic: true,
        }
    }
}

fn read_exposure(mut table: Table) -> Result<Exposure, WorldError> {
    let usual = Exposure::default();
    let shutter_s = table.f64("shutter_s", 0.0, 1.0, usual.shutter_s)?;
    let exposure = Exposure {
        automatic: table.bool("automatic", usual.automatic)?,
        target: table.f64("target", 0.05, 0.95, usual.target)?,
        start_gain: table.f64("start_gain", 0.05, 20.0, usual.start_gain)?,
        time_constant_s: table.f64("time_constant_s", 0.0, 10.0, usual.time_constant_s)?,
        shutter_s,
        shutter_limit_s: table.f64("shutter_limit_s", 0.0, 1.0, shutter_s)?,
    };
    if exposure.shutter_limit_s < exposure.shutter_s {
        return Err(table.problem(
            "shutter_limit_s",
            "at least shutter_s",
            format!("{}", exposure.shutter_limit_s),
            "",
        ));
    }
    table.finish()?;
    Ok(exposure)
}

fn read_mounting(mut table: Table) -> Result<Mounting, WorldError> {
    let x_m = table.f64("x_m", -10.0, 10.0, 0.0)?;
    let y_m = table.f64("y_m", -10.0, 10.0, 0.0)?;
    let z_m = table.required_f64("z_m", 0.005, 20.0)?;
    let Some(tilt_rad) = table.optional_angle("tilt_rad", "tilt_deg", -PI / 2.0, PI / 2.0)? else {
        return Err(table.missing("tilt_deg", "an angle, down positive"));
    };
    let mounting = Mounting {
        x_m,
        y_m,
        z_m,
        tilt_rad,
        yaw_rad: table
            .optional_angle("yaw_rad", "yaw_deg", -PI, PI)?
            .unwrap_or(0.0),
        roll_rad: table
            .optional_angle("roll_rad", "roll_deg", -PI, PI)?
            .unwrap_or(0.0),
    };
    table.finish()?;
    Ok(mounting)
}

/// View angles or focal lengths; the principal point is the middle unless given.
fn read_lens(mut table: Table, width_px: u32, height_px: u32) -> Result<Lens, WorldError> {
    let kind = table.required_word("kind", &["pinhole", "equidistant", "kannala-brandt", "brown"])?;
    let wide = matches!(kind, "equidistant" | "kannala-brandt");
    let (half_width, half_height) = (f64::from(width_px) / 2.0, f64::from(height_px) / 2.0);
    let widest_rad = if wide { 1.9 * PI } else { 0.95 * PI };
    let distortion = match kind {
        "kannala-brandt" => read_distortion(&mut table, 4)?,
        "brown" => read_distortion(&mut table, 5)?,
        _ => vec![0.0; 5],
    };
    // Radius on the sensor, in focal lengths, of a ray at half the view angle.
    let reach = |view_rad: f64| {
        let theta = view_rad / 2.0;
        let t2 = theta * theta;
        if wide {
            let polynomial = distortion.iter().take(4).rev().fold(0.0, |sum, k| t2 * (sum + k));
            theta * (1.0 + polynomial)
        } else {
            let tan = trig::tan(theta);
            let r2 = tan * tan;
            tan * (1.0 + r2 * (distortion[0] + r2 * (distortion[1] + r2 * distortion[4])))
        }
    };
    let mut focals = [None, None];
    for (index, (angle_rad, angle_deg, focal, half)) in [
        (
            "horizontal_view_rad",
            "horizontal_view_deg",
            "focal_u_px",
            half_width,
        ),
        (
            "vertical_view_rad",
            "vertical_view_deg",
            "focal_v_px",
            half_height,
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let view = table.optional_angle(angle_rad, angle_deg, 0.02, widest_rad)?;
        let given = table.optional_f64(focal, 0.1, 1e6)?;
        focals[index] = match (view, given) {
            (Some(_), Some(_)) => {
                return Err(table.problem(focal, "a view angle or a focal length", "both", "remove one"));
            }
            (Some(view_rad), None) => {
                let reached = reach(view_rad);
                if !(reached > 1e-6 && reached.is_finite()) {
                    return Err(table.problem(
                        "distortion",
                        "distortion that reaches the view angle",
                        "one that folds before it",
                        "check signs and order",
                    ));
                }
                Some(half / reached)
            }
            (None, given) => given,
        };
    }
    // One of the two is enough: pixels are square unless both are given.
    let (focal_u_px, focal_v_px) = match focals {
        [Some(u), Some(v)] => (u, v),
        [Some(u), None] => (u, u),
        [None, Some(v)] => (v, v),
        [None, None] => {
            return Err(table.missing("horizontal_view_deg", "a view angle, or focal_u_px"));
        }
    };
    let centre_u_px = table.f64("centre_u_px", -1e5, 1e5, half_width)?;
    let centre_v_px = table.f64("centre_v_px", -1e5, 1e5, half_height)?;
    table.finish()?;
    let five = |values: &[f64]| [values[0], values[1], values[2], values[3], values[4]];
    Ok(match kind {
        "pinhole" => Lens::Pinhole {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
        },
        "brown" => Lens::Brown {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
            distortion: five(&distortion),
        },
        _ => Lens::KannalaBrandt {
            focal_u_px,
            focal_v_px,
            centre_u_px,
            centre_v_px,
            distortion: [distortion[0], distortion[1], distortion[2], distortion[3]],
        },
    })
}

fn read_distortion(table: &mut Table, count: usize) -> Result<Vec<f64>, WorldError> {
    let Some(numbers) = table.optional_numbers("distortion", -100.0, 100.0)? else {
        return Ok(vec![0.0; count]);
    };
    if numbers.len() != count {
        return Err(table.problem(
            "distortion",
            format!("{count} numbers"),
            format!("{}", numbers.len()),
            if count == 4 {
                "k1, k2, k3, k4"
            } else {
                "k1, k2, p1, p2, k3"
            },
        ));
    }
    Ok(numbers)
}
