//! From pictures to calibrations, over many cameras and blemishes; what is found when it is not the sheet.

use super::synthetic::{Floor, Scene, gopigo};
use super::*;
use proptest::prelude::*;
use senda_core::{Channels, codec};
use senda_geom::{Camera, Mounting, Pose2, Vec2, trig};

fn accepting() -> CalibrationOptions {
    CalibrationOptions {
        misplaced: Misplaced::Accept,
        ..CalibrationOptions::default()
    }
}

fn with_lens(camera: &Camera) -> CalibrationOptions {
    CalibrationOptions {
        lens: Some(camera.lens),
        ..accepting()
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

/// Whether the camera shows all corners of the sheet, with room to spare and the far square at least 7 px high.
fn shows(camera: &Camera, sheet: &Sheet) -> bool {
    let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
    let margin = 0.03 * width;
    let corners = sheet.corners().map(|c| camera.pixel_from_floor(c));
    let inside = |p: &Option<Vec2>| {
        p.is_some_and(|p| p.x > margin && p.y > margin && p.x < width - margin && p.y < height - margin)
    };
    corners.iter().all(inside) && corners[4].unwrap().y - corners[6].unwrap().y > 7.0
}

fn cameras(width_px: u32, height_px: u32) -> impl Strategy<Value = Camera> {
    let mounting = (
        0.0..0.08f64,
        -0.01..0.01f64,
        0.07..0.2f64,
        -0.1..0.1f64,
        0.4..1.0f64,
        -0.05..0.05f64,
    );
    (mounting, 0.7..1.2f64)
        .prop_map(
            move |((x_m, y_m, z_m, yaw_rad, tilt_rad, roll_rad), view)| Camera {
                lens: Lens::pinhole(
                    width_px,
                    height_px,
                    view,
                    2.0 * trig::atan(0.75 * trig::tan(view / 2.0)),
                ),
                mounting: Mounting {
                    x_m,
                    y_m,
                    z_m,
                    yaw_rad,
                    tilt_rad,
                    roll_rad,
                },
                ..gopigo(width_px, height_px)
            },
        )
        .prop_filter("the camera shows the sheet", |camera| {
            shows(camera, &Sheet::default())
        })
}

fn check_pose(camera: &Camera, noise: f64, seed: u64, floor_m: f64, floor_with_lens_m: f64) {
    let scene = Scene {
        noise,
        seed,
        gradient: 0.8,
        ..Scene::new(&Sheet::default())
    };
    let picture = scene.photograph(camera);
    let plain = calibrate(&picture, &scene.sheet, &accepting()).unwrap();
    let lens = calibrate(&picture, &scene.sheet, &with_lens(camera)).unwrap();
    let corners_px = corner_error(&plain, camera, &scene);
    assert!(corners_px < 0.3, "corners {corners_px} px");
    let plain_m = floor_error(&plain, camera, 0.3);
    let lens_m = floor_error(&lens, camera, 0.3);
    assert!(
        plain_m < floor_m && lens_m < floor_with_lens_m,
        "floor {plain_m} m, with lens {lens_m} m"
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10, max_global_rejects: 10_000, ..ProptestConfig::default() })]

    /// Noise of 2 of 255: a webcam in room light.
    #[test]
    fn the_floor_is_within_a_millimetre_for_any_camera_at_640(camera in cameras(640, 480), seed in 0..1000u64) {
        check_pose(&camera, 2.0, seed, 1e-3, 0.5e-3);
    }

    #[test]
    fn a_known_lens_keeps_the_floor_within_a_millimetre_at_320(camera in cameras(320, 240), seed in 0..1000u64) {
        check_pose(&camera, 2.0, seed, 2e-3, 1e-3);
    }

    #[test]
    fn small_pictures_are_within_some_millimetres(camera in cameras(123, 92), seed in 0..1000u64) {
        check_pose(&camera, 2.0, seed, 8e-3, 4e-3);
    }
}

#[test]
fn the_documents_camera_is_calibrated_at_every_size() {
    for (width, height) in [(123, 92), (160, 120), (320, 240), (640, 480), (1280, 960)] {
        let camera = gopigo(width, height);
        let scene = Scene::new(&Sheet::default());
        let picture = scene.photograph(&camera);
        for options in [CalibrationOptions::default(), with_lens(&camera)] {
            let calibration = calibrate(&picture, &scene.sheet, &options).unwrap();
            assert!(corner_error(&calibration, &camera, &scene) < 0.05, "{width}");
            assert!(floor_error(&calibration, &camera, 0.5) < 0.5e-3, "{width}");
            assert!(calibration.reprojection.max_px < 0.05 && calibration.reprojection.max_m < 1e-4);
        }
    }
}

#[test]
fn blemishes_do_not_move_the_corners() {
    let sheet = Sheet::default();
    let plain = Scene {
        noise: 3.0,
        ..Scene::new(&sheet)
    };
    let scenes = [
        (
            "dark floor",
            Scene {
                floor: Floor::Plain(15.0),
                ..plain.clone()
            },
        ),
        (
            "floor like paper",
            Scene {
                floor: Floor::Plain(220.0),
                ..plain.clone()
            },
        ),
        (
            "speckled floor",
            Scene {
                floor: Floor::Speckled,
                ..plain.clone()
            },
        ),
        (
            "tiles",
            Scene {
                floor: Floor::Checked,
                ..plain.clone()
            },
        ),
        (
            "light from one side",
            Scene {
                gradient: 0.35,
                ..plain.clone()
            },
        ),
        (
            "shadow across",
            Scene {
                shadow: 0.5,
                ..plain.clone()
            },
        ),
        (
            "dim",
            Scene {
                paper: 70.0,
                floor: Floor::Plain(30.0),
                ..plain.clone()
            },
        ),
        (
            "noisy",
            Scene {
                noise: 10.0,
                ..plain.clone()
            },
        ),
        (
            "reflection on the floor",
            Scene {
                glare: Some([0.15, 0.4, 0.12, 200.0]),
                floor: Floor::Plain(40.0),
                ..plain.clone()
            },
        ),
        (
            "reflection over a square's edge",
            Scene {
                glare: Some([0.66, 0.6, 0.05, 90.0]),
                ..plain.clone()
            },
        ),
        (
            "speckled, from one side",
            Scene {
                floor: Floor::Speckled,
                gradient: 0.5,
                noise: 6.0,
                ..plain
            },
        ),
    ];
    for (width, height) in [(123, 92), (160, 120), (320, 240)] {
        let camera = gopigo(width, height);
        for (name, scene) in &scenes {
            let picture = scene.photograph(&camera);
            let jpeg = codec::encode_jpeg(&picture, 85).unwrap().decode().unwrap();
            for (kind, picture) in [("raw", picture), ("jpeg", jpeg)] {
                let calibration = calibrate(&picture, &sheet, &accepting())
                    .unwrap_or_else(|error| panic!("{name} {kind} {width}: {error}"));
                let error_px = corner_error(&calibration, &camera, scene);
                assert!(error_px < 0.3, "{name} {kind} {width}: {error_px} px");
            }
        }
    }
}

#[test]
fn sheets_for_other_vehicles_work_as_well() {
    // A kit car's camera, higher and further ahead, that sees a sheet beyond its bumper.
    let mut camera = gopigo(320, 240);
    camera.mounting.x_m = 0.12;
    camera.mounting.z_m = 0.16;
    camera.mounting.tilt_rad = 0.7;
    for sheet in [Sheet::a4_landscape().moved(0.08), Sheet::a4_portrait().moved(0.1)] {
        sheet.check().unwrap();
        let scene = Scene {
            noise: 2.0,
            ..Scene::new(&sheet)
        };
        let calibration = calibrate(&scene.photograph(&camera), &sheet, &with_lens(&camera)).unwrap();
        assert!(corner_error(&calibration, &camera, &scene) < 0.2);
        assert!(floor_error(&calibration, &camera, 0.6) < 1e-3);
    }
}

#[test]
fn colour_pictures_give_the_same() {
    let camera = gopigo(160, 120);
    let scene = Scene::new(&Sheet::default());
    let gray = scene.photograph(&camera);
    let pixels = gray.pixels().iter().flat_map(|v| [*v; 3]).collect();
    let rgb = Image::from_pixels(160, 120, Channels::Rgb, pixels).unwrap();
    let from_gray = calibrate(&gray, &scene.sheet, &accepting()).unwrap();
    let from_rgb = calibrate(&rgb, &scene.sheet, &accepting()).unwrap();
    for (a, b) in from_gray.corners_px.iter().zip(&from_rgb.corners_px) {
        assert!((*a - *b).length() < 1e-3);
    }
}

#[test]
fn a_known_wide_lens_is_undone() {
    let mut camera = gopigo(320, 240);
    camera.lens = Lens::equidistant(320, 240, 2.0);
    let scene = Scene {
        noise: 2.0,
        ..Scene::new(&Sheet::default())
    };
    let picture = scene.photograph(&camera);
    let calibration = calibrate(&picture, &scene.sheet, &with_lens(&camera)).unwrap();
    assert!(corner_error(&calibration, &camera, &scene) < 0.15);
    assert!(floor_error(&calibration, &camera, 0.3) < 3e-3);
    // A homography takes a small sheet's corners as they are (0.1 px off), but is wrong where the lens bends most.
    let plain = calibrate(&picture, &scene.sheet, &accepting()).unwrap();
    assert!(floor_error(&plain, &camera, 0.3) > 2.0 * floor_error(&calibration, &camera, 0.3));
}

#[test]
fn the_mounting_follows_from_a_known_lens() {
    let mut camera = gopigo(320, 240);
    camera.mounting.yaw_rad = 0.02;
    let scene = Scene {
        noise: 2.0,
        ..Scene::new(&Sheet::default())
    };
    let found = calibrate(&scene.photograph(&camera), &scene.sheet, &with_lens(&camera)).unwrap();
    let (found, truth) = (found.camera.unwrap().mounting, camera.mounting);
    for (a, b) in [
        (found.x_m, truth.x_m),
        (found.y_m, truth.y_m),
        (found.z_m, truth.z_m),
    ] {
        assert!((a - b).abs() < 1e-3, "{found:?}");
    }
    for (a, b) in [
        (found.yaw_rad, truth.yaw_rad),
        (found.tilt_rad, truth.tilt_rad),
        (found.roll_rad, 0.0),
    ] {
        assert!((a - b).abs() < 0.25f64.to_radians(), "{found:?}");
    }
}

/// The lens of another camera, and pictures of another shape, gave a wrong mounting without a word.
#[test]
fn a_lens_that_does_not_fit_is_refused_and_the_right_one_found() {
    for (width, height) in [(320, 240), (640, 360), (640, 480)] {
        let [camera, wider] = [54.0f64, 70.0].map(|view_deg| {
            let mut camera = gopigo(width, height);
            let square = |focal_px: f64| Lens::Pinhole {
                focal_u_px: focal_px,
                focal_v_px: focal_px,
                centre_u_px: f64::from(width) / 2.0,
                centre_v_px: f64::from(height) / 2.0,
            };
            let half_rad = view_deg.to_radians() / 2.0;
            camera.lens = square(f64::from(width) / 2.0 / senda_geom::trig::tan(half_rad));
            camera
        });
        let sheet = Sheet::for_camera(&wider, false).unwrap_or_default();
        let scene = Scene {
            noise: 2.0,
            ..Scene::new(&sheet)
        };
        let picture = scene.photograph(&wider);
        let error = calibrate(&picture, &scene.sheet, &with_lens(&camera)).unwrap_err();
        assert!(
            matches!(error, CalibrationError::OtherLens { error_px, limit_px } if error_px > limit_px),
            "{width}x{height}: {error}"
        );
        let lens = calibrate(&picture, &scene.sheet, &accepting())
            .unwrap()
            .pinhole_lens()
            .unwrap();
        let told = CalibrationOptions {
            lens: Some(lens),
            ..accepting()
        };
        let found = calibrate(&picture, &scene.sheet, &told).unwrap();
        assert!(floor_error(&found, &wider, 0.3) < 3e-3, "{width}x{height}");
        let (found, truth) = (found.camera.unwrap().mounting, wider.mounting);
        assert!(
            (found.z_m - truth.z_m).abs() < 3e-3,
            "{width}x{height}: {found:?}"
        );
        assert!(
            (found.tilt_rad - truth.tilt_rad).abs() < 1f64.to_radians(),
            "{width}x{height}: {found:?}"
        );
    }
}

#[test]
fn a_misplaced_sheet_is_measured_and_refused() {
    let camera = gopigo(320, 240);
    for (lateral_m, turn_rad, fine) in [
        (0.0, 0.0, true),
        (0.001, 0.0, true),
        (0.004, 0.0, false),
        (0.0, 0.06, false),
        (-0.006, -0.1, false),
    ] {
        let scene = Scene {
            vehicle_from_sheet: Pose2::new(0.0, lateral_m, turn_rad),
            ..Scene::new(&Sheet::default())
        };
        let corners = scene
            .sheet
            .corners()
            .map(|c| scene.vehicle_from_sheet.transform(c));
        let u = |i: usize| camera.pixel_from_floor(corners[i]).unwrap().x;
        let near = (u(0) + u(1) + u(2) + u(3)) / 4.0;
        let far = (u(4) + u(5) + u(6) + u(7)) / 4.0;
        let picture = scene.photograph(&camera);
        let result = calibrate(&picture, &scene.sheet, &CalibrationOptions::default());
        let calibration = match result {
            Ok(calibration) if fine => calibration,
            Err(CalibrationError::Misplaced { calibration }) if !fine => *calibration,
            other => panic!("{lateral_m} {turn_rad}: {other:?}"),
        };
        let placement = calibration.placement;
        assert!(
            (placement.position_px - (near - 160.0)).abs() < 0.1,
            "{placement:?}"
        );
        assert!(
            (placement.orientation_px - (near - far)).abs() < 0.1,
            "{placement:?}"
        );
        assert!((placement.lateral_m - lateral_m).abs() < 0.5e-3, "{placement:?}");
        assert!((placement.turn_rad - turn_rad).abs() < 0.005, "{placement:?}");
        assert_eq!(placement.limit_px, 3.2);
        assert_eq!(placement.is_within_limit(), fine);
        assert_eq!(
            calibrate(&picture, &scene.sheet, &accepting()).unwrap(),
            calibration
        );
    }
}

#[test]
fn the_advice_moves_the_vehicle_towards_the_sheet() {
    let camera = gopigo(320, 240);
    let advice = |lateral_m, turn_rad| {
        let scene = Scene {
            vehicle_from_sheet: Pose2::new(0.0, lateral_m, turn_rad),
            ..Scene::new(&Sheet::default())
        };
        calibrate(
            &scene.photograph(&camera),
            &scene.sheet,
            &CalibrationOptions::default(),
        )
        .unwrap_err()
        .to_string()
    };
    assert!(advice(0.01, 0.0).contains("; move it 10 mm to the left, or accept"));
    assert!(advice(-0.01, 0.0).contains("; move it 10 mm to the right, or accept"));
    let turned = advice(0.0, -0.1);
    assert!(
        turned.contains("turn it 5.7° to the right") || turned.contains("turn it 5.8° to the right"),
        "{turned}"
    );
    assert!(advice(-0.006, 0.1).contains("to the right, turn it"));
}

#[test]
fn what_is_found_instead_is_said() {
    let sheet = Sheet::default();
    let camera = gopigo(320, 240);
    let fails = |squares: Vec<[Vec2; 4]>, camera: &Camera| {
        let scene = Scene {
            squares,
            noise: 2.0,
            ..Scene::new(&sheet)
        };
        calibrate(&scene.photograph(camera), &sheet, &accepting()).unwrap_err()
    };
    let [near, far] = sheet.squares();
    assert!(matches!(
        fails(vec![], &camera),
        CalibrationError::NoSquare { .. }
    ));
    let one = fails(vec![near], &camera);
    assert!(
        matches!(one, CalibrationError::OneSquare { column_px, .. } if (column_px - 160.0).abs() < 1.0),
        "{one}"
    );
    assert!(matches!(
        fails(vec![far], &camera),
        CalibrationError::OneSquare { .. }
    ));

    // A third square where another sheet would have one: shrinking would leave the wrong two.
    let mut look_ahead = camera.clone();
    look_ahead.mounting.tilt_rad = 0.48;
    let third = far.map(|c| c + Vec2::new(0.075, 0.0));
    let three = fails(vec![near, far, third], &look_ahead);
    assert!(
        matches!(three, CalibrationError::TooManySquares { found: 3 }),
        "{three}"
    );
    assert!(three.to_string().contains("found 3"));

    // A square of half the size in place of the far one.
    let middle = Vec2::new(0.24, 0.0);
    let small = fails(vec![near, far.map(|c| middle + (c - middle) * 0.5)], &camera);
    assert!(matches!(small, CalibrationError::DoNotFit { .. }), "{small}");

    let mut up = camera.clone();
    up.mounting.tilt_rad = 0.25;
    let cut = fails(vec![near, far], &up);
    assert!(
        matches!(
            cut,
            CalibrationError::CutOff {
                side: Side::Bottom,
                whole: 1
            }
        ),
        "{cut}"
    );
    assert!(cut.to_string().contains("further ahead"));
    let mut aside = camera.clone();
    aside.mounting.y_m = -0.055;
    let cut = fails(vec![near, far], &aside);
    assert!(
        matches!(cut, CalibrationError::CutOff { side: Side::Left, .. }),
        "{cut}"
    );
}

#[test]
fn pictures_that_show_nothing_say_why() {
    let sheet = Sheet::default();
    let camera = gopigo(160, 120);
    let dark = Scene {
        paper: 25.0,
        floor: Floor::Plain(10.0),
        ..Scene::new(&sheet)
    };
    let error = calibrate(&dark.photograph(&camera), &sheet, &accepting()).unwrap_err();
    assert!(
        matches!(error, CalibrationError::TooDark { brightest: 25, .. }),
        "{error}"
    );
    let upside_down = {
        let picture = Scene::new(&sheet).photograph(&camera);
        let mut pixels = picture.pixels().to_vec();
        pixels.reverse();
        Image::from_pixels(160, 120, Channels::Gray, pixels).unwrap()
    };
    let error = calibrate(&upside_down, &sheet, &accepting()).unwrap_err();
    assert!(matches!(error, CalibrationError::UpsideDown), "{error}");
    let impossible = Sheet {
        far_square_m: 0.1,
        ..sheet
    };
    let error = calibrate(&upside_down, &impossible, &accepting()).unwrap_err();
    assert!(matches!(error, CalibrationError::Sheet(_)), "{error}");
}

#[test]
fn a_tile_of_other_size_beyond_the_sheet_is_cut_away() {
    let sheet = Sheet::default();
    let tile = sheet.squares()[1].map(|c| Vec2::new(c.x * 0.8 + 0.13, c.y * 2.0));
    let mut camera = gopigo(320, 240);
    camera.mounting.tilt_rad = 0.45;
    let mut scene = Scene::new(&sheet);
    scene.squares.push(tile);
    scene.floor = Floor::Plain(160.0);
    let calibration = calibrate(&scene.photograph(&camera), &sheet, &accepting()).unwrap();
    assert!(corner_error(&calibration, &camera, &scene) < 0.05);
}

#[test]
fn noise_is_never_taken_for_a_sheet() {
    use rand_chacha::rand_core::{Rng, SeedableRng};
    for seed in 0..24 {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let (width, height, cell) = (
            96 + 3 * seed as usize,
            72 + 2 * seed as usize,
            1 + seed as usize % 11,
        );
        let values: Vec<u8> = (0..width * height).map(|_| random.next_u32() as u8).collect();
        let pixels = (0..width * height).map(|i| values[i / width / cell * width + i % width / cell]);
        let image = Image::from_pixels(width, height, Channels::Gray, pixels.collect()).unwrap();
        let result = calibrate(&image, &Sheet::default(), &accepting());
        assert!(result.is_err(), "seed {seed}: {result:?}");
    }
}
