//! From pictures to calibrations and back, over many cameras and blemishes.

use super::synthetic::{Scene, gopigo};
use super::*;
use senda_geom::{Camera, Vec2};

fn options_with(camera: &Camera) -> CalibrationOptions {
    CalibrationOptions {
        lens: Some(camera.lens),
        misplaced: Misplaced::Accept,
        ..CalibrationOptions::default()
    }
}

/// Largest distance between the corners found and the true ones (px).
fn corner_error(calibration: &Calibration, camera: &Camera, scene: &Scene) -> f64 {
    let mut worst = 0.0f64;
    for (found, corner) in calibration.corners_px.iter().zip(scene.sheet.corners()) {
        let truth = camera
            .pixel_from_floor(scene.vehicle_from_sheet.transform(corner))
            .unwrap();
        worst = worst.max((*found - truth).length());
    }
    worst
}

/// Largest error (m) on the floor, where the camera sees it, up to `far_m` ahead of the axle.
fn floor_error(calibration: &Calibration, camera: &Camera, far_m: f64) -> f64 {
    let (width, height) = (camera.width_px, camera.height_px);
    let mut worst = 0.0f64;
    for i in 0..=16 {
        for j in 0..=16 {
            let pixel = Vec2::new(f64::from(width * i) / 16.0, f64::from(height * j) / 16.0);
            let Some(truth) = camera.floor_from_pixel(pixel).filter(|p| p.x < far_m) else {
                continue;
            };
            let found = calibration.floor_from_pixel(pixel, width, height).unwrap();
            worst = worst.max((found - truth).length());
        }
    }
    worst
}

#[test]
fn the_documents_camera_is_calibrated_at_every_size() {
    for (width, height) in [(123, 92), (160, 120), (320, 240), (640, 480), (1280, 960)] {
        let camera = gopigo(width, height);
        let scene = Scene::new(&Sheet::default());
        let picture = scene.photograph(&camera);
        for options in [CalibrationOptions::default(), options_with(&camera)] {
            let calibration = calibrate(&picture, &scene.sheet, &options).unwrap();
            assert!(corner_error(&calibration, &camera, &scene) < 0.05, "{width}");
            assert!(floor_error(&calibration, &camera, 0.5) < 0.5e-3, "{width}");
        }
    }
}
