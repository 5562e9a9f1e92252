//! What is in a data set, in a few lines.

use crate::open::{Format, open_runs};
use crate::{DataError, Recording};
use senda_core::{Body, ImageFormat, Steering};
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Bins of the steering histogram: an odd number, so that straight on has one of its own.
const BINS: usize = 21;

/// What is in a data set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Info {
    /// Where it lies.
    pub path: String,
    /// Its format.
    pub format: Format,
    /// Separate drives in it.
    pub runs: usize,
    /// Steps of the drive loop.
    pub steps: usize,
    /// Pictures of all cameras.
    pub frames: usize,
    /// Pictures that cannot be decoded.
    pub damaged_frames: usize,
    /// Sum of the runs' durations (s).
    pub duration_s: f64,
    /// The vehicle.
    pub vehicle: String,
    /// The driver.
    pub driver: String,
    /// The senda that recorded or imported it.
    pub senda: String,
    /// Steps whose true state is known.
    pub truths: usize,
    /// Cameras in the order of their first picture.
    pub cameras: Vec<CameraInfo>,
    /// How often which steering was commanded.
    pub steering: SteeringHistogram,
    /// The summary of the run, where there is exactly one.
    pub summary: Option<serde_json::Value>,
    /// What was wrong.
    pub warnings: Vec<String>,
}

/// One camera's pictures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraInfo {
    /// Its name.
    pub name: String,
    /// Number of pictures.
    pub frames: usize,
    /// Width of the first good one (px).
    pub width_px: usize,
    /// Height of the first good one (px).
    pub height_px: usize,
    /// Format of the first one.
    pub format: ImageFormat,
    /// Compressed bytes of all.
    pub bytes: usize,
}

/// How often which steering was commanded, left positive, as angle of the front wheels (of a car as long as the
/// track is wide, where there are none).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SteeringHistogram {
    /// Largest angle counted (rad); bins go evenly from minus this (right) to this (left), what is beyond is in the outer.
    pub limit_rad: f64,
    /// Steps in each bin, from right to left.
    pub counts: Vec<usize>,
    /// Mean (rad).
    pub mean_rad: f64,
    /// Smallest: furthest right (rad).
    pub min_rad: f64,
    /// Largest: furthest left (rad).
    pub max_rad: f64,
}

/// Looks into any data set. `body` is the vehicle that recorded foreign data; recordings of senda bring their own.
/// Decodes every picture, to count the damaged ones.
pub fn info(path: &Path, body: &Body) -> Result<Info, DataError> {
    let format = Format::detect(path)?;
    let recordings = open_runs(path, body)?;
    Ok(about(path, format, &recordings))
}

fn about(path: &Path, format: Format, recordings: &[Recording]) -> Info {
    let first = recordings.first().map(|recording| &recording.header);
    let body = first.map(|header| &header.body);
    let mut info = Info {
        path: path.display().to_string(),
        format,
        runs: recordings.len(),
        steps: 0,
        frames: 0,
        damaged_frames: 0,
        duration_s: 0.0,
        vehicle: body.map(|body| body.name.clone()).unwrap_or_default(),
        driver: first.map(|header| header.driver.clone()).unwrap_or_default(),
        senda: first.map(|header| header.senda.clone()).unwrap_or_default(),
        truths: 0,
        cameras: Vec::new(),
        steering: SteeringHistogram::new(body.map_or(1.0, limit_rad)),
        summary: match recordings {
            [only] => only.summary.clone(),
            _ => None,
        },
        warnings: Vec::new(),
    };
    let mut image = senda_core::Image::default();
    for recording in recordings {
        info.duration_s += recording.duration_s();
        info.warnings.extend(recording.warnings.iter().cloned());
        for step in &recording.steps {
            info.truths += usize::from(step.truth.is_some());
            let body = &recording.header.body;
            let angle_rad = body.steering_of(step.command.turn, body.speed_of(&step.command));
            info.steering.add(angle_rad);
            info.steps += 1;
            for frame in &step.frames {
                info.frames += 1;
                let good = frame.encoded.decode_into(&mut image).is_ok();
                info.damaged_frames += usize::from(!good);
                let size = if good {
                    (image.width(), image.height())
                } else {
                    (0, 0)
                };
                info.count(
                    &frame.camera,
                    frame.encoded.format,
                    size,
                    frame.encoded.bytes.len(),
                );
            }
        }
    }
    info
}

impl Info {
    fn count(
        &mut self,
        name: &str,
        format: ImageFormat,
        (width_px, height_px): (usize, usize),
        bytes: usize,
    ) {
        match self.cameras.iter_mut().find(|camera| camera.name == name) {
            Some(camera) => {
                camera.frames += 1;
                camera.bytes += bytes;
                if camera.width_px == 0 {
                    (camera.width_px, camera.height_px) = (width_px, height_px);
                }
            }
            None => self.cameras.push(CameraInfo {
                name: name.to_owned(),
                frames: 1,
                width_px,
                height_px,
                format,
                bytes,
            }),
        }
    }
}

impl SteeringHistogram {
    /// Nothing counted yet.
    pub(crate) fn new(limit_rad: f64) -> Self {
        Self {
            limit_rad,
            counts: vec![0; BINS],
            mean_rad: 0.0,
            min_rad: 0.0,
            max_rad: 0.0,
        }
    }

    /// Counts an angle; what is no number is not counted.
    pub(crate) fn add(&mut self, angle_rad: f64) {
        if !angle_rad.is_finite() {
            return;
        }
        let before: usize = self.counts.iter().sum();
        if before == 0 {
            (self.min_rad, self.max_rad) = (angle_rad, angle_rad);
        }
        self.min_rad = self.min_rad.min(angle_rad);
        self.max_rad = self.max_rad.max(angle_rad);
        self.mean_rad += (angle_rad - self.mean_rad) / (before + 1) as f64;
        let part = (angle_rad / self.limit_rad + 1.0) / 2.0;
        let last = self.counts.len() - 1;
        // A cast limits what is beyond.
        let bin = (part * self.counts.len() as f64) as usize;
        self.counts[bin.min(last)] += 1;
    }
}

/// The angle at which the histogram ends.
pub(crate) fn limit_rad(body: &Body) -> f64 {
    match body.steering {
        Steering::Ackermann {
            steering_limit_rad, ..
        } if steering_limit_rad > 0.0 => steering_limit_rad,
        // A vehicle that turns in place has no limit: up to 60° of the car that it is compared with.
        _ => std::f64::consts::FRAC_PI_3,
    }
}

impl fmt::Display for Info {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}", self.path, self.format.name().replace('_', " "))?;
        let runs = if self.runs == 1 { "run" } else { "runs" };
        writeln!(
            f,
            "  {} {runs}, {} steps, {:.1} s, driven by {} ({}), {} senda {}",
            self.runs,
            self.steps,
            self.duration_s,
            self.driver,
            self.vehicle,
            if self.format == Format::Recording {
                "recorded by"
            } else {
                "read by"
            },
            self.senda
        )?;
        for camera in &self.cameras {
            writeln!(
                f,
                "  camera {}: {} frames of {}x{} px, {:?}, {:.1} MB",
                camera.name,
                camera.frames,
                camera.width_px,
                camera.height_px,
                camera.format,
                camera.bytes as f64 * 1e-6
            )?;
        }
        if self.damaged_frames > 0 {
            writeln!(f, "  {} frames cannot be decoded", self.damaged_frames)?;
        }
        if self.truths > 0 {
            writeln!(f, "  the true state is known in {} steps", self.truths)?;
        }
        self.steering.fmt(f)?;
        for warning in &self.warnings {
            writeln!(f, "  warning: {warning}")?;
        }
        Ok(())
    }
}

impl fmt::Display for SteeringHistogram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let most = self.counts.iter().copied().max().unwrap_or(0);
        if most == 0 {
            return Ok(());
        }
        writeln!(
            f,
            "  steering {:.1}° to {:.1}° (left positive), mean {:.1}°",
            self.min_rad.to_degrees(),
            self.max_rad.to_degrees(),
            self.mean_rad.to_degrees()
        )?;
        let width = 2.0 * self.limit_rad / self.counts.len() as f64;
        for (bin, count) in self.counts.iter().enumerate().rev() {
            let middle = (bin as f64 + 0.5) * width - self.limit_rad;
            // `+ 0.0` turns -0.0 into 0.0.
            let degrees = (middle.to_degrees() * 10.0).round() / 10.0 + 0.0;
            let bar = "#".repeat((count * 40).div_ceil(most));
            writeln!(f, "  {degrees:>6.1}° {count:>7} {bar}")?;
        }
        Ok(())
    }
}
