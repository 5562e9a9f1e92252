//! The calibration file: round trip, other image sizes, damage.

use super::super::synthetic::{Scene, gopigo};
use super::super::{CalibrationOptions, calibrate, overlay};
use super::*;
use crate::WidthProfile;
use proptest::prelude::*;
use senda_core::Shape;

fn calibrated(with_lens: bool) -> Calibration {
    let camera = gopigo(160, 120);
    let scene = Scene {
        noise: 2.0,
        ..Scene::new(&Sheet::default())
    };
    let options = CalibrationOptions {
        lens: with_lens.then_some(camera.lens),
        ..CalibrationOptions::default()
    };
    calibrate(&scene.photograph(&camera), &scene.sheet, &options).unwrap()
}

fn refused(text: &str) -> CalibrationFileError {
    Calibration::parse("gopigo.toml", text).unwrap_err()
}

#[test]
fn what_was_written_is_read_back_to_the_bit() {
    for with_lens in [false, true] {
        let calibration = calibrated(with_lens);
        assert_eq!(calibration.camera.is_some(), with_lens);
        let text = calibration.to_toml();
        assert_eq!(
            Calibration::parse("gopigo.toml", &text).unwrap(),
            calibration,
            "{text}"
        );
        assert!(text.lines().all(|line| line.len() < 120), "{text}");
    }
}

/// The layout of points was done by replacing brackets in the whole file, the camera's name included.
#[test]
fn a_name_with_brackets_survives() {
    let mut calibration = calibrated(true);
    calibration.camera.as_mut().unwrap().name = "a [[b], [c]]\n[[d]]".into();
    let text = calibration.to_toml();
    assert_eq!(
        Calibration::parse("gopigo.toml", &text).unwrap(),
        calibration,
        "{text}"
    );
}

#[test]
fn a_calibration_serves_other_image_sizes() {
    for with_lens in [false, true] {
        let calibration = calibrated(with_lens);
        for (width, height) in [(123u32, 92u32), (160, 120), (320, 240), (640, 320)] {
            let camera = gopigo(width, height);
            let map = calibration.floor_map(width as usize, height as usize);
            for floor in [Vec2::new(0.15, 0.02), Vec2::new(0.2, -0.03), Vec2::new(0.25, 0.0)] {
                let pixel = camera.pixel_from_floor(floor).unwrap();
                let found = calibration.floor_from_pixel(pixel, width, height).unwrap();
                assert!((found - floor).length() < 1e-3, "{width} {floor} {found}");
                let back = calibration.pixel_from_floor(found, width, height).unwrap();
                assert!((back - pixel).length() < 1e-6);
                assert!((map.floor(pixel).unwrap() - found).length() < 1e-9);
            }
            assert_eq!(
                calibration.floor_from_pixel(Vec2::new(80.0, -200.0), width, height),
                None
            );
            assert_eq!(
                calibration.pixel_from_floor(Vec2::new(-0.3, 0.0), width, height),
                None
            );
        }
    }
}

#[test]
fn line_widths_follow_from_the_squares() {
    let profile = calibrated(false).width_profile(0.02);
    for (width, height) in [(160, 120), (320, 240)] {
        let truth = WidthProfile::from_camera(&gopigo(width, height), 0.02);
        let found = profile.scaled(width, height);
        for part in [0.2, 0.5, 0.9] {
            let row = part * f64::from(height);
            assert!(
                (found.at(row) - truth.at(row)).abs() < 0.02 * truth.at(row),
                "row {row}"
            );
        }
    }
}

#[test]
fn unknown_and_missing_keys_are_named_with_their_line() {
    let text = calibrated(false).to_toml();
    let error = refused(&text.replace("height_px", "hight_px")).to_string();
    assert!(
        error.starts_with("gopigo.toml:9: unknown field `hight_px`"),
        "{error}"
    );
    assert!(error.ends_with("did you mean `height_px`?"), "{error}");
    let error = refused(&text.replace("track_m", "trak_m")).to_string();
    assert!(error.contains("did you mean `track_m`?"), "{error}");
    // The list of known keys is short at the top of the file, and the nearest of them was `sheet`.
    let error = refused(&format!("nmae = 1\n{text}")).to_string();
    assert!(
        error.contains("unknown field `nmae`") && !error.contains("did you mean"),
        "{error}"
    );
    let text_of_lens = calibrated(true).to_toml();
    let error = refused(&text_of_lens.replace("\nname = ", "\nnmae = ")).to_string();
    assert!(error.contains("did you mean `name`?"), "{error}");
    let error = refused(&text.replace("width_px = 160\n", "")).to_string();
    assert!(
        error.contains("missing field `width_px`") && error.contains("calibrate again"),
        "{error}"
    );
    let error = refused(&text.replace("width_px = 160", "width_px = ")).to_string();
    assert!(error.starts_with("gopigo.toml:8: "), "{error}");
    assert!(refused("").to_string().contains("missing field"));
}

#[test]
fn impossible_values_are_named_with_their_line() {
    let text = calibrated(true).to_toml();
    let line_of = |needle: &str| {
        text.lines()
            .position(|line| line.starts_with(needle))
            .map(|i| i + 1)
    };
    let check = |from: &str, to: &str, key: &str, found: &str| {
        let error = refused(&text.replacen(from, to, 1));
        assert_eq!(error.key.as_deref(), Some(key), "{error}");
        assert_eq!(error.line, line_of(from.split(' ').next().unwrap()), "{error}");
        assert!(error.to_string().contains(found), "{error}");
    };
    check("version = 1", "version = 7", "version", "expected 1, but found 7");
    check(
        "width_px = 160",
        "width_px = 0",
        "width_px",
        "expected 1 to 65536 px, but found 0",
    );
    check(
        "limit_px = 1.6",
        "limit_px = -1.6",
        "placement.limit_px",
        "found -1.6",
    );
    check(
        "rms_px = 0.",
        "rms_px = nan # 0.",
        "reprojection.rms_px",
        "found NaN",
    );
    check(
        "position_px = ",
        "position_px = 1 # ",
        "placement.position_px",
        "corners_px give",
    );
    check(
        "slope_px_per_row = 0",
        "slope_px_per_row = 1 # 0",
        "square_width.slope_px_per_row",
        "calibrate again",
    );
    let error = refused(&text.replacen("page_width_m = 0.21", "page_width_m = 21.0", 1));
    assert!(
        error
            .to_string()
            .contains("page_width_m from 0.05 to 2 m, but found 21"),
        "{error}"
    );
}

#[test]
fn a_changed_map_is_noticed() {
    let mut calibration = calibrated(false);
    calibration.floor_from_image =
        Homography::from_matrix(calibration.floor_from_image.matrix() + Mat3::from_cols_array(&[1e-4; 9]));
    let error = refused(&calibration.to_toml());
    assert_eq!(error.key.as_deref(), Some("floor_from_image"), "{error}");
    calibration.floor_from_image = Homography::from_matrix(Mat3::ZERO);
    assert!(Calibration::parse("zero", &calibration.to_toml()).is_err());
    let mut calibration = calibrated(true);
    calibration.camera.as_mut().unwrap().mounting.z_m += 0.01;
    assert_eq!(refused(&calibration.to_toml()).key.as_deref(), Some("camera"));
}

#[test]
fn the_overlay_shows_corners_and_verdict() {
    let calibration = calibrated(false);
    let texts = |shapes: &[Shape]| {
        let text = |shape: &Shape| match shape {
            Shape::Text { text, .. } => Some(text.clone()),
            _ => None,
        };
        shapes.iter().filter_map(text).collect::<Vec<_>>().join("\n")
    };
    let shapes = overlay(&Ok(calibration.clone()), 320, 240);
    let circles: Vec<_> = shapes
        .iter()
        .filter(|s| matches!(s, Shape::Circle { .. }))
        .collect();
    assert_eq!(circles.len(), 8);
    let Shape::Circle { centre, .. } = circles[0] else {
        unreachable!()
    };
    let first = calibration.corners_px[0] * 2.0;
    assert!((f64::from(centre[0]) - first.x).abs() < 1e-3 && (f64::from(centre[1]) - first.y).abs() < 1e-3);
    assert!(texts(&shapes).starts_with("accepted: position"));
    let misplaced = Err(super::super::CalibrationError::Misplaced {
        calibration: Box::new(calibration),
    });
    assert!(texts(&overlay(&misplaced, 160, 120)).starts_with("misplaced: "));
    let nothing = Err(super::super::CalibrationError::NoSquare { dark_regions: 3 });
    assert!(texts(&overlay(&nothing, 160, 120)).contains("found none (3 dark regions"));
}

proptest! {
    /// A flipped character is noticed or changes no number by much; no damage makes the reader panic.
    #[test]
    fn damage_is_survived(place in 0.0..1.0f64, byte in 32..127u8, cut in any::<bool>()) {
        let calibration = sample();
        let text = calibration.to_toml();
        let at = (place * text.len() as f64) as usize;
        let damaged = if cut {
            text[..text.floor_char_boundary(at)].to_owned()
        } else {
            let mut chars: Vec<char> = text.chars().collect();
            let index = at.min(chars.len() - 1);
            chars[index] = char::from(byte);
            chars.into_iter().collect()
        };
        if let Ok(read) = Calibration::parse("damaged", &damaged) {
            for floor in read.sheet.corners() {
                // At the file's own size, since a digit of the size may change unnoticed: 125 rows for 120.
                let a = read.pixel_from_floor(floor, read.width_px, read.height_px).unwrap();
                let b = calibration.pixel_from_floor(floor, 160, 120).unwrap();
                prop_assert!((a - b).length() < 3.0, "{damaged}");
            }
        }
    }
}

/// Without a picture, for tests that need many.
fn sample() -> Calibration {
    let camera = gopigo(160, 120);
    let sheet = Sheet::default();
    let corners_px = sheet.corners().map(|c| camera.pixel_from_floor(c).unwrap());
    let calibration = Calibration {
        width_px: 160,
        height_px: 120,
        floor_from_image: Homography::fit(&corners_px, &sheet.corners()).unwrap(),
        corners_px,
        sheet,
        placement: placement(&corners_px, &sheet, 160, 0.01),
        reprojection: Reprojection {
            rms_px: 0.0,
            max_px: 0.0,
            max_m: 0.0,
        },
        square_width: square_width(&corners_px, 160, 120),
        camera: None,
    };
    Calibration::parse("sample", &calibration.to_toml()).unwrap()
}
