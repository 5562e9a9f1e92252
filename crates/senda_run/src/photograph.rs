//! A simulated photograph of the calibration sheet (C1 in SPEC).

use crate::RunError;
use senda_core::{Image, Observation, Vehicle, VehicleError};
use senda_geom::Vec2;
use senda_sim::{SimOptions, Simulator, Start, render::Scene};
use senda_vision::calibration::Sheet;
use senda_world::{VehicleSpec, World, paint};
use std::sync::Arc;

/// A plain floor, large enough for a sheet.
const FLOOR: &str = "
name = 'calibration'
[path]
closed = false
pieces = [{ kind = 'straight', length_m = 1.0 }]
[[markings]]
width_m = 0.001
colour = 'white'
[floor]
kind = 'plain'
";
/// Printed black reflects about this much, white paper about that much (sRGB; a guess from photographs of prints).
const INK: u8 = 38;
const PAPER: u8 = 236;
/// Fine enough for corners to a tenth of a pixel (m).
const TEXEL_M: f64 = 0.0005;
/// Pictures until the exposure has settled.
const SETTLING: usize = 40;

/// What the vehicle's first camera sees when it stands right on the sheet, once its exposure has settled.
pub fn of_sheet(spec: &VehicleSpec, sheet: &Sheet, seed: u64) -> Result<Image, RunError> {
    let mut world = World::parse("the calibration floor", FLOOR)?.0;
    world.markings.clear();
    let mut painting = paint::paint(&world, TEXEL_M);
    for (polygon, shade) in
        std::iter::once((sheet.page(), PAPER)).chain(sheet.squares().map(|square| (square, INK)))
    {
        fill(&mut painting, &polygon, shade);
    }
    let scene = Arc::new(Scene::of_painting(&world, &painting));
    let start = Start {
        station_m: Some(0.0),
        ..Start::default()
    };
    let options = SimOptions {
        seed,
        start,
        ..SimOptions::default()
    };
    let mut simulator = Simulator::in_scene(Arc::new(world), scene, spec, options)?;
    let mut observation = Observation::default();
    for _ in 0..SETTLING {
        simulator.observe(&mut observation)?;
    }
    observation
        .frames
        .into_iter()
        .next()
        .map(|frame| frame.image)
        .ok_or_else(|| {
            RunError::Vehicle(VehicleError::Sensor {
                sensor: "camera".into(),
                reason: format!("vehicle `{}` has no camera: give it one", spec.name),
            })
        })
}

/// Fills a convex polygon (m, counter-clockwise or clockwise) with a shade of gray.
fn fill(painting: &mut paint::FloorPainting, polygon: &[Vec2], shade: u8) {
    let size_m = painting.metres_per_texel;
    let (low, high) = polygon.iter().fold((polygon[0], polygon[0]), |(low, high), p| {
        (low.min(*p), high.max(*p))
    });
    let [low, high] = [low, high].map(|corner| ((corner - painting.origin) / size_m).max(Vec2::ZERO));
    for row in low.y as usize..painting.height.min(high.y as usize + 1) {
        for column in low.x as usize..painting.width.min(high.x as usize + 1) {
            let point = painting.origin + Vec2::new(column as f64 + 0.5, row as f64 + 0.5) * size_m;
            let sides = (0..polygon.len()).map(|i| {
                let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                (b - a).perp_dot(point - a)
            });
            let (mut left, mut right) = (true, true);
            for side in sides {
                left &= side >= 0.0;
                right &= side <= 0.0;
            }
            if left || right {
                painting.texels[row * painting.width + column] = [shade, shade, shade, 0];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_vision::calibration::{CalibrationOptions, calibrate};

    /// Only the GoPiGo's camera saw a sheet; the others' lay outside the picture.
    #[test]
    fn every_simulated_camera_near_the_floor_calibrates_itself() {
        for vehicle in ["unicycle", "picar", "donkeycar", "warehouse-cart"] {
            let spec = VehicleSpec::named(vehicle).unwrap();
            let camera = spec.body().cameras[0].clone();
            let sheet = Sheet::for_camera(&camera, false).unwrap();
            let image = of_sheet(&spec, &sheet, 1).unwrap();
            let options = CalibrationOptions {
                lens: Some(camera.lens),
                misplaced: senda_vision::calibration::Misplaced::Accept,
                ..CalibrationOptions::default()
            };
            let calibration =
                calibrate(&image, &sheet, &options).unwrap_or_else(|error| panic!("{vehicle}: {error}"));
            let found = calibration.camera.unwrap().mounting;
            // The simulated mounting is off by some tenths of a degree: that is what calibration is for.
            let off_m = (found.z_m - camera.mounting.z_m).abs();
            let off_rad = (found.tilt_rad - camera.mounting.tilt_rad).abs();
            assert!(
                off_m < 0.03 * camera.mounting.z_m && off_rad < 0.03,
                "{vehicle}: {off_m} m, {off_rad} rad"
            );
        }
    }

    #[test]
    fn the_simulated_camera_calibrates_itself() {
        let spec = VehicleSpec::named("gopigo").unwrap().with_camera_size(320, 240);
        let sheet = Sheet::a4_portrait();
        let image = of_sheet(&spec, &sheet, 3).unwrap();
        let camera = spec.body().cameras[0].clone();
        let options = CalibrationOptions {
            lens: Some(camera.lens),
            misplaced: senda_vision::calibration::Misplaced::Accept,
            ..CalibrationOptions::default()
        };
        let found = calibrate(&image, &sheet, &options).unwrap().camera.unwrap();
        // The simulated mounting is off by some tenths of a degree: that is what calibration is for.
        assert!(
            (found.mounting.z_m - camera.mounting.z_m).abs() < 0.002,
            "{:?}",
            found.mounting
        );
        assert!(
            (found.mounting.tilt_rad - camera.mounting.tilt_rad).abs() < 0.03,
            "{:?}",
            found.mounting
        );
    }
}
