//! The line extraction against scenes of known pose (C3 to C6 and C9 in SPEC).

mod support;

use senda_core::{Channels, Image};
use senda_vision::{
    BlobLimits, Channel, Contrast, ExtractorOptions, FloorLine, FloorMap, LineExtractor, LineFitter,
    WidthProfile,
};
use support::{Floor, Line, gopigo_camera, grey, render};

const SIZES: [(u32, u32); 4] = [(123, 92), (160, 120), (320, 240), (640, 480)];

struct Eye {
    extractor: LineExtractor,
    map: FloorMap,
    fitter: LineFitter,
}

impl Eye {
    fn new(width: u32, height: u32) -> Self {
        let camera = gopigo_camera(width, height);
        let profile = WidthProfile::from_camera(&camera, 0.02);
        let (width, height) = (width as usize, height as usize);
        Self {
            extractor: LineExtractor::new(width, height, &profile, ExtractorOptions::default()),
            map: FloorMap::from_camera(&camera, width, height),
            fitter: LineFitter::new(),
        }
    }
}

/// The two floors of most tests: dark tape on light, light tape on dark.
const TAPES: [(Contrast, f64, f64); 2] = [(Contrast::Dark, 170.0, 45.0), (Contrast::Light, 80.0, 220.0)];

#[test]
fn straight_lines_give_their_state_at_every_size() {
    for (width, height) in SIZES {
        let mut eye = Eye::new(width, height);
        for (contrast, floor, line) in TAPES {
            for (d_m, theta_rad) in [(0.0, 0.0), (0.03, 0.1), (-0.06, 0.25), (0.05, -0.5), (-0.06, 0.8)] {
                let image = render(
                    &gopigo_camera(width, height),
                    &Floor::plain(floor),
                    &[Line::straight(d_m, theta_rad, line)],
                );
                let place = format!("{width}x{height} {contrast:?} d {d_m} theta {theta_rad}");
                let blobs = eye.extractor.extract(&image, contrast);
                assert_eq!(blobs.len(), 1, "{place}");
                let fitted = eye.fitter.straight(blobs, &eye.map).unwrap().state();
                assert!((fitted.d_m - d_m).abs() < 1.5e-3, "{place}: {fitted:?}");
                assert!(
                    (fitted.theta_rad - theta_rad).abs() < 0.5f64.to_radians(),
                    "{place}: {fitted:?}"
                );
                // The document's way, from centroid and orientation alone: the picture's edge cuts the blob
                // askew, and that turns its axis.
                let axis = FloorLine::from_blob_axis(&blobs[0], &eye.map).unwrap().state();
                assert!((axis.d_m - d_m).abs() < 0.015, "{place}: {axis:?}");
                assert!(
                    (axis.theta_rad - theta_rad).abs() < 8f64.to_radians(),
                    "{place}: {axis:?}"
                );
            }
        }
    }
}

#[test]
fn centroid_and_orientation_are_those_of_the_painted_pixels() {
    // A leaning line drawn in the image itself, away from the edges.
    for (width, height) in SIZES {
        let scale = f64::from(width) / 320.0;
        let (width, height) = (width as usize, height as usize);
        for lean in [-1.0f64, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0] {
            let (sin, cos) = lean.sin_cos_of_test();
            let mut image = Image::new(width, height, Channels::Gray);
            for y in 0..height {
                for (x, pixel) in image.row_mut(y).iter_mut().enumerate() {
                    let (u, v) = ((x as f64 + 0.5) / scale - 160.0, (y as f64 + 0.5) / scale - 120.0);
                    let (along, across) = (u * sin + v * cos, u * cos - v * sin);
                    *pixel = if across.abs() < 8.0 && along.abs() < 90.0 {
                        40
                    } else {
                        180
                    };
                }
            }
            let profile = WidthProfile {
                intercept_px: 16.0 * scale,
                slope_px_per_row: 0.0,
                width_px: width as u32,
                height_px: height as u32,
            };
            let mut extractor = LineExtractor::new(width, height, &profile, ExtractorOptions::default());
            let blobs = extractor.extract(&image, Contrast::Dark);
            assert_eq!(blobs.len(), 1, "{width}x{height} lean {lean}");
            let blob = &blobs[0];
            let centre = senda_geom::Vec2::new(160.0, 120.0) * scale;
            assert!(
                (blob.centroid - centre).length() < 0.6,
                "{width}x{height} lean {lean}: {blob:?}"
            );
            assert!(
                (blob.orientation_rad - lean).abs() < 0.02,
                "{width}x{height} lean {lean}: {}",
                blob.orientation_rad
            );
            assert!(blob.ellipticity > 5.0 && blob.residue_mean > 50.0);
        }
    }
}

/// The lint bans the standard library's trigonometry, tests included.
trait SinCosOfTest {
    fn sin_cos_of_test(self) -> (f64, f64);
}

impl SinCosOfTest for f64 {
    fn sin_cos_of_test(self) -> (f64, f64) {
        senda_geom::trig::sincos(self)
    }
}

#[test]
fn speckles_gradients_and_worn_paint_do_not_move_the_line() {
    for (width, height) in [(123, 92), (320, 240)] {
        let mut eye = Eye::new(width, height);
        for (contrast, floor_grey, line_grey) in TAPES {
            for (seed, (speckle, gradient, wear)) in [
                (50.0, 0.0, 0.0),
                (0.0, 0.4, 0.0),
                (0.0, 0.0, 0.25),
                (40.0, 0.3, 0.15),
            ]
            .into_iter()
            .enumerate()
            {
                let floor = Floor {
                    speckle,
                    gradient,
                    noise: 4.0,
                    seed: seed as u64,
                    ..Floor::plain(floor_grey)
                };
                let line = Line {
                    wear,
                    ..Line::straight(0.02, -0.2, line_grey)
                };
                let image = render(&gopigo_camera(width, height), &floor, &[line]);
                let place = format!("{width}x{height} {contrast:?} {floor:?} wear {wear}");
                assert_eq!(eye.extractor.decide_contrast(&image), contrast, "{place}");
                let blobs = eye.extractor.extract(&image, contrast);
                assert_eq!(blobs.len(), 1, "{place}");
                let state = eye.fitter.arc(blobs, &eye.map).unwrap().state();
                assert!((state.d_m - 0.02).abs() < 4e-3, "{place}: {state:?}");
                assert!(
                    (state.theta_rad + 0.2).abs() < 3f64.to_radians(),
                    "{place}: {state:?}"
                );
            }
        }
    }
}

#[test]
fn curves_give_their_curvature() {
    for (width, height) in [(160, 120), (320, 240)] {
        let mut eye = Eye::new(width, height);
        for curvature_per_m in [-4.0, -2.0, -0.7, 0.7, 2.0, 4.0] {
            let line = Line {
                curvature_per_m,
                ..Line::straight(0.0, 0.0, 45.0)
            };
            let image = render(&gopigo_camera(width, height), &Floor::plain(170.0), &[line]);
            let blobs = eye.extractor.extract(&image, Contrast::Dark);
            assert_eq!(blobs.len(), 1, "{width}x{height} curvature {curvature_per_m}");
            let line = eye.fitter.arc(blobs, &eye.map).unwrap();
            let state = line.state();
            assert!(
                (state.curvature_per_m - curvature_per_m).abs() < 0.05 * curvature_per_m.abs(),
                "{line:?}"
            );
            assert!(
                state.d_m.abs() < 1e-3 && state.theta_rad.abs() < 1f64.to_radians(),
                "{state:?}"
            );
        }
    }
}

#[test]
fn a_lane_shows_both_lines() {
    let mut eye = Eye::new(320, 240);
    for (contrast, floor, grey) in TAPES {
        let lines = [Line::straight(0.05, 0.1, grey), Line::straight(-0.05, 0.1, grey)];
        let image = render(&gopigo_camera(320, 240), &Floor::plain(floor), &lines);
        let blobs = eye.extractor.extract(&image, contrast);
        assert_eq!(blobs.len(), 2, "{contrast:?}");
        let mut offsets: Vec<f64> = blobs
            .iter()
            .map(|blob| eye.fitter.straight([blob], &eye.map).unwrap().state().d_m)
            .collect();
        offsets.sort_by(f64::total_cmp);
        assert!(
            (offsets[0] + 0.05).abs() < 1.5e-3 && (offsets[1] - 0.05).abs() < 1.5e-3,
            "{offsets:?}"
        );
    }
}

#[test]
fn contrast_is_decided_for_all_poses_and_sizes() {
    for (width, height) in [(123, 92), (160, 120)] {
        let mut eye = Eye::new(width, height);
        for (contrast, floor, line) in TAPES {
            for gradient in [0.0, 0.35] {
                for d_m in [-0.03, 0.0, 0.03] {
                    for theta_rad in [-0.3, 0.0, 0.15] {
                        let floor = Floor {
                            gradient,
                            ..Floor::plain(floor)
                        };
                        let line = Line::straight(d_m, theta_rad, line);
                        let image = render(&gopigo_camera(width, height), &floor, &[line]);
                        assert_eq!(
                            eye.extractor.decide_contrast(&image),
                            contrast,
                            "{width}x{height} d {d_m} theta {theta_rad} gradient {gradient}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn an_empty_floor_shows_no_line() {
    for (width, height) in SIZES {
        let mut eye = Eye::new(width, height);
        for speckle in [0.0, 20.0, 60.0] {
            let floor = Floor {
                speckle,
                noise: 4.0,
                seed: 5,
                ..Floor::plain(140.0)
            };
            let image = render(&gopigo_camera(width, height), &floor, &[]);
            for contrast in [Contrast::Dark, Contrast::Light] {
                let found = eye.extractor.extract(&image, contrast).len();
                assert_eq!(found, 0, "{width}x{height} speckle {speckle} {contrast:?}");
            }
        }
    }
}

#[test]
fn colour_and_grey_pictures_give_the_same_blobs() {
    let mut eye = Eye::new(160, 120);
    let image = render(
        &gopigo_camera(160, 120),
        &Floor::plain(170.0),
        &[Line::straight(0.01, 0.1, 45.0)],
    );
    let from_colour = eye.extractor.extract(&image, Contrast::Dark).to_vec();
    assert_eq!(from_colour, eye.extractor.extract(&grey(&image), Contrast::Dark));
}

#[test]
fn tape_of_the_floors_brightness_is_found_by_its_colour() {
    // Pink on grey, blue on grey, green on red: all of luminance 140 within one level.
    let tapes = [
        ([140.0, 140.0, 140.0], [205.0, 104.0, 155.0]),
        ([140.0, 140.0, 140.0], [90.0, 150.0, 220.0]),
        ([200.0, 115.0, 112.0], [90.0, 165.0, 142.0]),
    ];
    let mut eye = Eye::new(160, 120);
    for (floor_color, tape) in tapes {
        let floor = Floor {
            color: floor_color,
            speckle: 20.0,
            gradient: 0.15,
            noise: 3.0,
            ..Floor::plain(0.0)
        };
        let line = Line {
            color: tape,
            ..Line::straight(0.02, -0.15, 0.0)
        };
        let image = render(&gopigo_camera(160, 120), &floor, &[line]);
        let contrast = eye.extractor.decide(&image);
        assert_ne!(eye.extractor.options().channel, Channel::Luminance, "{tape:?}");
        let blobs = eye.extractor.extract(&image, contrast);
        assert_eq!(blobs.len(), 1, "{tape:?}");
        let state = eye.fitter.straight(blobs, &eye.map).unwrap().state();
        assert!(
            (state.d_m - 0.02).abs() < 3e-3 && (state.theta_rad + 0.15).abs() < 0.03,
            "{tape:?} {state:?}"
        );
    }
}

#[test]
fn black_and_white_tape_keep_luminance() {
    let mut eye = Eye::new(160, 120);
    for (contrast, floor, line) in TAPES {
        let floor = Floor {
            speckle: 20.0,
            noise: 4.0,
            ..Floor::plain(floor)
        };
        let image = render(
            &gopigo_camera(160, 120),
            &floor,
            &[Line::straight(-0.01, 0.1, line)],
        );
        assert_eq!(eye.extractor.decide(&image), contrast);
        assert_eq!(eye.extractor.options().channel, Channel::Luminance);
    }
}

#[test]
fn frames_of_another_size_are_stretched() {
    let mut eye = Eye::new(160, 120);
    let line = Line::straight(0.01, 0.1, 45.0);
    let image = render(&gopigo_camera(320, 240), &Floor::plain(170.0), &[line]);
    let blobs = eye.extractor.extract(&image, Contrast::Dark);
    assert_eq!(blobs.len(), 1);
    let state = eye.fitter.straight(blobs, &eye.map).unwrap().state();
    assert!(
        (state.d_m - 0.01).abs() < 3e-3 && (state.theta_rad - 0.1).abs() < 0.02,
        "{state:?}"
    );
}

#[test]
fn odd_pictures_do_no_harm() {
    let profile = WidthProfile {
        intercept_px: 5.0,
        slope_px_per_row: 0.1,
        width_px: 320,
        height_px: 240,
    };
    for (width, height) in [(0, 0), (1, 1), (1, 40), (40, 1), (7, 5), (33, 31)] {
        let mut extractor = LineExtractor::new(width, height, &profile, ExtractorOptions::default());
        for image in [
            Image::default(),
            Image::new(1, 1, Channels::Rgb),
            Image::new(width, height, Channels::Gray),
            Image::from_pixels(3, 1, Channels::Gray, vec![0, 255, 0]).unwrap(),
        ] {
            assert!(extractor.extract(&image, Contrast::Dark).len() < 2);
            extractor.decide_contrast(&image);
        }
    }
    let senseless = WidthProfile {
        intercept_px: f64::NAN,
        slope_px_per_row: f64::INFINITY,
        width_px: 0,
        height_px: 0,
    };
    let options = ExtractorOptions {
        wide_part: f64::INFINITY,
        narrow_part: -3.0,
        blur_sigma_px: 1e300,
        threshold_max_part: f64::NAN,
        limits: BlobLimits {
            area_part: f64::NAN,
            ..BlobLimits::default()
        },
        ..ExtractorOptions::default()
    };
    let mut extractor = LineExtractor::new(40, 30, &senseless, options);
    extractor.extract(&Image::new(40, 30, Channels::Rgb), Contrast::Light);
}

#[test]
fn the_same_frame_gives_the_same_blobs_whatever_came_before() {
    let camera = gopigo_camera(160, 120);
    let frames: Vec<Image> = (0..4)
        .map(|i| {
            let line = Line::straight(0.02 * f64::from(i) - 0.03, 0.1, 45.0);
            render(
                &camera,
                &Floor {
                    speckle: 30.0,
                    ..Floor::plain(160.0)
                },
                &[line],
            )
        })
        .collect();
    let mut used = Eye::new(160, 120);
    for frame in &frames {
        for contrast in [Contrast::Light, Contrast::Dark] {
            used.extractor.extract(frame, contrast);
        }
        let mut fresh = Eye::new(160, 120);
        assert_eq!(
            fresh.extractor.extract(frame, Contrast::Dark),
            used.extractor.blobs()
        );
    }
}
