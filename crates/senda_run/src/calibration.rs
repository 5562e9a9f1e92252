//! A driver that believes a calibration file's camera instead of the vehicle file's.

use crate::RunError;
use crate::own_file::{self, Kind};
use senda_core::Body;
use senda_geom::Camera;
use senda_vision::calibration::Calibration;
use std::path::Path;

const CALIBRATION_FILE: Kind = Kind {
    name: "calibration file",
    help: "`senda calibrate camera` writes one from a photograph of its sheet",
};

/// A camera that is further from the vehicle file's than this is another vehicle's (m, rad): mounting one again by hand comes nearer.
const OTHER_HEIGHT_M: f64 = 0.02;
const OTHER_TILT_RAD: f64 = 0.052;

/// The vehicle as its driver knows it: with the camera of a calibration file, if there is one.
pub fn believed_body(body: &Body, calibration: Option<&str>) -> Result<Body, RunError> {
    let mut body = body.clone();
    if let (Some(path), Some(camera)) = (calibration, body.cameras.first_mut()) {
        let found = camera_of(Path::new(path))?;
        *camera = Camera {
            name: camera.name.clone(),
            ..found.resized(camera.width_px, camera.height_px)
        };
    }
    Ok(body)
}

/// What to say where a calibration's camera is plainly not the vehicle's.
pub fn note(body: &Body, calibration: Option<&str>) -> Result<Option<String>, RunError> {
    let (Some(path), Some(camera)) = (calibration, body.cameras.first()) else {
        return Ok(None);
    };
    let (found, expected) = (camera_of(Path::new(path))?.mounting, camera.mounting);
    let is_other = (found.z_m - expected.z_m).abs() > OTHER_HEIGHT_M
        || (found.tilt_rad - expected.tilt_rad).abs() > OTHER_TILT_RAD;
    let words = |height_m: f64, tilt_rad: f64| {
        format!(
            "{:.1} cm up and tilted by {:.1}°",
            100.0 * height_m,
            tilt_rad.to_degrees()
        )
    };
    Ok(is_other.then(|| {
        format!(
            "{path}: its camera is {}, that of {} {}: the calibration is of another vehicle, or the camera was moved",
            words(found.z_m, found.tilt_rad),
            body.name,
            words(expected.z_m, expected.tilt_rad)
        )
    }))
}

fn camera_of(path: &Path) -> Result<Camera, RunError> {
    let text = own_file::read(path, &CALIBRATION_FILE)?;
    let wrong = |reason: String| RunError::File {
        path: path.to_owned(),
        reason,
    };
    let calibration =
        Calibration::parse(&path.display().to_string(), &text).map_err(|error| wrong(error.to_string()))?;
    calibration.camera.ok_or_else(|| {
        wrong(
            "it holds the floor map alone, without a camera, because the lens was unknown and could not be told from the sheet: \
             calibrate again with --vehicle and without --unknown-lens"
                .into(),
        )
    })
}
