//! What the pictures show: geometry, light, blur, and the same bytes from every implementation.

use proptest::prelude::*;
use senda_core::Image;
use senda_geom::{Camera, Lens, Mounting, Pose2, Vec2};
use senda_sim::render::{Kernel, Motion, Noise, Optics, Renderer, Scene, Sharpness, Shot};
use senda_world::{FloorPainting, World};

fn world(extra: &str) -> World {
    let toml = format!(
        "[path]\npoints = [[0, 0], [2, 0]]\n[[markings]]\noffset_m = 0\nwidth_m = 0.02\ncolour = \"black\"\n[floor]\nkind = \"plain\"\n{extra}"
    );
    World::parse("test.toml", &toml).unwrap().0
}

/// A floor of 4 m x 4 m around the origin, coloured by a function of the place.
fn painted(metres_per_texel: f64, outside: [u8; 4], colour: impl Fn(Vec2) -> [u8; 4]) -> FloorPainting {
    let side = (4.0 / metres_per_texel).round() as usize;
    let origin = Vec2::splat(-2.0);
    let texels = (0..side * side)
        .map(|i| {
            let cell = Vec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5);
            colour(origin + cell * metres_per_texel)
        })
        .collect();
    FloorPainting {
        width: side,
        height: side,
        origin,
        metres_per_texel,
        texels,
        outside,
    }
}

fn camera(lens: Lens, width_px: u32, height_px: u32) -> Camera {
    Camera {
        name: "center".into(),
        width_px,
        height_px,
        lens,
        mounting: Mounting {
            x_m: 0.05,
            y_m: 0.01,
            z_m: 0.15,
            yaw_rad: 0.05,
            tilt_rad: 0.5,
            roll_rad: 0.03,
        },
    }
}

fn lenses() -> [(&'static str, Lens); 4] {
    let pinhole = Lens::pinhole(320, 240, 1.2, 0.95);
    let Lens::Pinhole {
        focal_u_px,
        focal_v_px,
        centre_u_px,
        centre_v_px,
    } = pinhole
    else {
        unreachable!()
    };
    [
        ("pinhole", pinhole),
        ("equidistant", Lens::equidistant(320, 240, 2.3)),
        (
            "wide distorted",
            Lens::KannalaBrandt {
                focal_u_px: 150.0,
                focal_v_px: 152.0,
                centre_u_px: 165.0,
                centre_v_px: 118.0,
                distortion: [-0.03, 0.005, 0.0, 0.0],
            },
        ),
        (
            "brown",
            Lens::Brown {
                focal_u_px,
                focal_v_px,
                centre_u_px,
                centre_v_px,
                distortion: [-0.2, 0.05, 0.001, -0.001, 0.0],
            },
        ),
    ]
}

fn green(image: &Image, u: usize, v: usize) -> f64 {
    f64::from(image.pixel(u, v)[1])
}

fn shoot(camera: &Camera, scene: &Scene, optics: &Optics, shot: &Shot) -> Image {
    let mut image = Image::default();
    Renderer::new(camera, scene, optics).render(scene, shot, &mut image);
    image
}

#[test]
fn a_line_on_the_floor_appears_where_the_camera_model_says() {
    // A white line 2 cm wide along x at y = 0.06 m of the world, seen from a turned and displaced vehicle.
    let painting = painted(0.002, [0; 4], |p| {
        if (p.y - 0.06).abs() < 0.01 {
            [255, 255, 255, 0]
        } else {
            [0; 4]
        }
    });
    let scene = Scene::of_painting(&world(""), &painting);
    let pose = Pose2::new(-0.4, -0.03, 0.2);
    let vehicle_from_world = pose.inverse();
    for sharpness in [Sharpness::Single, Sharpness::Spread] {
        for (name, lens) in lenses() {
            let camera = camera(lens, 320, 240);
            let optics = Optics {
                sharpness,
                ..Optics::default()
            };
            let image = shoot(&camera, &scene, &optics, &Shot::still(pose));
            // The line's image as points every millimetre.
            let curve: Vec<Vec2> = (-300..1500)
                .map(|mm| vehicle_from_world.transform(Vec2::new(f64::from(mm) * 0.001 - 0.3, 0.06)))
                .filter(|p| p.x > 0.1)
                .filter_map(|p| camera.pixel_from_floor(p))
                .collect();
            let mut checked = 0;
            // In the distance single looks use texels wider than the line.
            let top = if sharpness == Sharpness::Single { 90 } else { 60 };
            for v in (top..236).step_by(4) {
                let row = v as f64 + 0.5;
                let crossings: Vec<f64> = curve
                    .windows(2)
                    .filter(|w| (w[0].y - row) * (w[1].y - row) <= 0.0 && w[0].y != w[1].y)
                    .map(|w| w[0].x + (w[1].x - w[0].x) * (row - w[0].y) / (w[1].y - w[0].y))
                    .collect();
                let [expected] = crossings[..] else { continue };
                if !(30.0..290.0).contains(&expected) {
                    continue;
                }
                let (mut sum, mut weighted) = (0.0, 0.0);
                for u in (expected as usize - 25)..(expected as usize + 25) {
                    sum += green(&image, u, v);
                    weighted += green(&image, u, v) * (u as f64 + 0.5);
                }
                assert!(sum > 200.0, "{name}: nothing in row {v}");
                let error = weighted / sum - expected;
                assert!(
                    error.abs() < 0.5,
                    "{name} {sharpness:?}: row {v} off by {error:.2} px"
                );
                checked += 1;
            }
            assert!(checked > 20, "{name}: only {checked} rows");
        }
    }
}

#[test]
fn a_fine_pattern_becomes_its_mean_in_the_distance() {
    let painting = painted(0.002, [128, 128, 128, 0], |p| {
        let odd = ((p.x / 0.004).floor() + (p.y / 0.004).floor()).rem_euclid(2.0);
        if odd < 1.0 { [255, 255, 255, 0] } else { [0; 4] }
    });
    let scene = Scene::of_painting(&world(""), &painting);
    let mut camera = camera(Lens::pinhole(320, 240, 1.2, 0.95), 320, 240);
    camera.mounting.tilt_rad = 0.25;
    for sharpness in [Sharpness::Single, Sharpness::Spread] {
        let optics = Optics {
            sharpness,
            ..Optics::default()
        };
        let image = shoot(&camera, &scene, &optics, &Shot::still(Pose2::new(-1.5, 0.0, 0.0)));
        let row: Vec<f64> = (100..220).map(|u| green(&image, u, 85)).collect();
        let mean = row.iter().sum::<f64>() / row.len() as f64;
        let spread = (row.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / row.len() as f64).sqrt();
        assert!(
            (mean - 128.0).abs() < 4.0 && spread < 8.0,
            "{sharpness:?}: {mean} ± {spread}"
        );
    }
}

#[test]
fn vignetting_darkens_corners_and_gain_brightens() {
    let scene = Scene::of_painting(
        &world(""),
        &painted(0.02, [100, 100, 100, 0], |_| [100, 100, 100, 0]),
    );
    let mut camera = camera(Lens::pinhole(320, 240, 1.0, 0.8), 320, 240);
    camera.mounting.tilt_rad = 1.0;
    let optics = Optics {
        vignetting: 0.36,
        ..Optics::default()
    };
    let mut shot = Shot::still(Pose2::default());
    let image = shoot(&camera, &scene, &optics, &shot);
    assert!((green(&image, 160, 120) - 100.0).abs() < 1.5);
    // A light of 0.64 at the corner is 0.8 in the square roots that pictures keep.
    assert!(
        (green(&image, 1, 1) - 80.0).abs() < 2.0,
        "{}",
        green(&image, 1, 1)
    );
    shot.gain = [4.0; 3];
    assert!((green(&shoot(&camera, &scene, &optics, &shot), 160, 120) - 200.0).abs() < 2.0);
    shot.gain = [1e6; 3];
    assert_eq!(green(&shoot(&camera, &scene, &optics, &shot), 160, 120), 255.0);
}

const LAMP: &str = "gloss = 0.8\n[light]\nambient = 0.6\n[[light.lamps]]\nx_m = 2.6\ny_m = 0.9\nheight_m = 1.5\nradius_m = 0.05\nstrength = 0.5";

#[test]
fn a_lamp_shines_in_a_glossy_floor_where_a_mirror_would_show_it_and_moves_with_the_view() {
    let glossy = Scene::of_painting(
        &world(LAMP),
        &painted(0.01, [60, 60, 60, 255], |_| [60, 60, 60, 255]),
    );
    let matt = Scene::of_painting(&world(LAMP), &painted(0.01, [60, 60, 60, 0], |_| [60, 60, 60, 0]));
    let camera = camera(Lens::pinhole(320, 240, 1.2, 0.95), 320, 240);
    let lamp = Vec2::new(2.6, 0.9);
    let mut places = Vec::new();
    for pose in [Pose2::new(0.4, 0.1, 0.3), Pose2::new(0.5, 0.0, 0.35)] {
        let image = shoot(&camera, &glossy, &Optics::default(), &Shot::still(pose));
        let (mut sum, mut weighted) = (0.0, Vec2::ZERO);
        for v in 0..240 {
            for u in 0..320 {
                let light = (green(&image, u, v) - 200.0).max(0.0);
                sum += light;
                weighted += Vec2::new(u as f64 + 0.5, v as f64 + 0.5) * light;
            }
        }
        assert!(sum > 1000.0, "no highlight");
        let seen = weighted / sum;
        let lens = pose.transform(Vec2::new(0.05, 0.01));
        let mirror = lens + (lamp - lens) * (0.15 / (0.15 + 1.5));
        let expected = camera.pixel_from_floor(pose.inverse().transform(mirror)).unwrap();
        assert!((seen - expected).length() < 6.0, "{seen} {expected}");
        places.push(mirror);
        let image = shoot(&camera, &matt, &Optics::default(), &Shot::still(pose));
        assert!(
            image.pixels().iter().all(|value| *value < 70),
            "a matt floor shines"
        );
    }
    assert!((places[0] - places[1]).length() > 0.05);
}

/// Standard deviations (px) of a bright dot's picture, across and down.
fn dot_size(motion: Motion, blur_px: f64) -> Vec2 {
    let painting = painted(0.001, [0; 4], |p| {
        if (p - Vec2::new(0.35, 0.0)).length() < 0.003 {
            [255; 4]
        } else {
            [0; 4]
        }
    });
    let scene = Scene::of_painting(&world(""), &painting);
    let mut camera = camera(Lens::pinhole(320, 240, 1.2, 0.95), 320, 240);
    camera.mounting = Mounting {
        x_m: 0.0,
        y_m: 0.0,
        z_m: 0.2,
        yaw_rad: 0.0,
        tilt_rad: 0.5,
        roll_rad: 0.0,
    };
    let shot = Shot {
        motion,
        ..Shot::still(Pose2::default())
    };
    let optics = Optics {
        blur_px,
        ..Optics::default()
    };
    let image = shoot(&camera, &scene, &optics, &shot);
    let (mut sum, mut mean, mut square) = (0.0, Vec2::ZERO, Vec2::ZERO);
    for v in 0..240 {
        for u in 0..320 {
            let (weight, at) = (green(&image, u, v), Vec2::new(u as f64, v as f64));
            sum += weight;
            mean += at * weight;
            square += at * at * weight;
        }
    }
    assert!(sum > 100.0);
    let (mean, square) = (mean / sum, square / sum);
    Vec2::new(
        (square.x - mean.x * mean.x).sqrt(),
        (square.y - mean.y * mean.y).sqrt(),
    )
}

#[test]
fn motion_smears_along_itself() {
    let still = dot_size(Motion::default(), 0.0);
    let ahead = dot_size(
        Motion {
            speed_mps: 1.0,
            exposure_s: 0.03,
            ..Motion::default()
        },
        0.0,
    );
    let turning = dot_size(
        Motion {
            yaw_rate_radps: 2.0,
            exposure_s: 0.03,
            ..Motion::default()
        },
        0.0,
    );
    assert!(
        ahead.y > still.y + 2.0 && ahead.x < still.x + 0.5,
        "{still} {ahead}"
    );
    assert!(
        turning.x > still.x + 2.0 && turning.y < still.y + 0.5,
        "{still} {turning}"
    );
    let soft = dot_size(Motion::default(), 1.0);
    assert!(soft.x > still.x + 0.3 && soft.y > still.y + 0.3, "{still} {soft}");
}

#[test]
fn noise_has_the_asked_strength_and_changes_with_the_seed() {
    let scene = Scene::of_painting(
        &world(""),
        &painted(
            0.02,
            [0; 4],
            |p| if p.y > 0.0 { [200; 4] } else { [40, 40, 40, 0] },
        ),
    );
    let mut camera = camera(Lens::pinhole(320, 240, 1.0, 0.8), 320, 240);
    camera.mounting.tilt_rad = 1.2;
    let mut shot = Shot::still(Pose2::default());
    let clean = shoot(&camera, &scene, &Optics::default(), &shot);
    shot.noise = Noise {
        dark: 2.0,
        bright: 6.0,
        seed: 1,
    };
    let noisy = shoot(&camera, &scene, &Optics::default(), &shot);
    shot.noise.seed = 2;
    assert_ne!(noisy, shoot(&camera, &scene, &Optics::default(), &shot));
    for (value, expected) in [(200, 2.0 + 4.0 * 200.0 / 255.0), (40, 2.0 + 4.0 * 40.0 / 255.0)] {
        let differences: Vec<f64> = clean
            .pixels()
            .iter()
            .zip(noisy.pixels())
            .filter(|(clean, _)| **clean == value)
            .map(|(clean, noisy)| f64::from(*noisy) - f64::from(*clean))
            .collect();
        assert!(differences.len() > 10_000);
        let count = differences.len() as f64;
        let mean = differences.iter().sum::<f64>() / count;
        let deviation = (differences.iter().map(|d| d * d).sum::<f64>() / count).sqrt();
        assert!(
            mean.abs() < 0.15 && (deviation - expected).abs() < 0.3,
            "{value}: {mean} {deviation} {expected}"
        );
    }
}

const BOARDS: &str = r##"
[[things]]
kind = "board"
x_m = 0.8
y_m = 0.0
heading_deg = 180
width_m = 0.3
height_m = 0.2
colour = "#ff0000"
[[things]]
kind = "board"
x_m = 0.6
y_m = 0.1
heading_deg = 180
width_m = 0.2
height_m = 0.1
colour = "#00ff00"
[[things]]
kind = "box"
x_m = 0.7
y_m = -0.35
heading_deg = 30
length_m = 0.1
width_m = 0.15
height_m = 0.12
colour = "#0000ff"
"##;

#[test]
fn boards_stand_where_they_are_and_the_near_one_hides_the_far_one() {
    let scene = Scene::of_painting(&world(BOARDS), &painted(0.01, [0; 4], |_| [0; 4]));
    for (name, lens) in lenses() {
        let mut camera = camera(lens, 320, 240);
        camera.mounting.tilt_rad = 0.25;
        let pose = Pose2::new(0.0, 0.0, 0.02);
        let image = shoot(&camera, &scene, &Optics::default(), &Shot::still(pose));
        let colour = |x: f64, y: f64, z: f64| {
            let flat = pose.inverse().transform(Vec2::new(x, y));
            let at = camera.pixel_from_point(flat.extend(z)).unwrap();
            let pixel = image.pixel(at.x as usize, at.y as usize);
            [pixel[0], pixel[1], pixel[2]].map(|value| value > 60)
        };
        let (red, green, blue, floor) = (
            [true, false, false],
            [false, true, false],
            [false, false, true],
            [false; 3],
        );
        // Just inside and just outside of every edge of the far board, where the near one is not.
        for (y, z, expected) in [
            (-0.14, 0.1, red),
            (-0.16, 0.01, floor),
            (0.0, 0.19, red),
            (-0.1, 0.01, red),
        ] {
            assert_eq!(colour(0.8, y, z), expected, "{name}: {y} {z}");
        }
        for (y, z) in [(0.01, 0.05), (0.19, 0.05), (0.1, 0.09), (0.1, 0.01)] {
            assert_eq!(colour(0.6, y, z), green, "{name}: {y} {z}");
        }
        assert_eq!(colour(0.67, -0.33, 0.06), blue, "{name}: box");
        assert_eq!(colour(0.58, 0.1, 0.0), floor, "{name}: floor before the board");
    }
}

#[test]
fn the_room_turns_with_the_heading() {
    let scene = Scene::of_painting(
        &world("[light]\npreset = \"daylight\""),
        &painted(0.01, [90; 4], |_| [90; 4]),
    );
    let mut camera = camera(Lens::equidistant(320, 160, 2.0), 320, 160);
    camera.mounting.tilt_rad = 0.0;
    let picture = |heading| {
        shoot(
            &camera,
            &scene,
            &Optics::default(),
            &Shot::still(Pose2::new(0.0, 0.0, heading)),
        )
    };
    assert_ne!(picture(0.0), picture(0.5));
    // The panorama has no seam.
    let (before, after) = (
        picture(std::f64::consts::PI - 1e-6),
        picture(-std::f64::consts::PI + 1e-6),
    );
    let worst = before
        .pixels()
        .iter()
        .zip(after.pixels())
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    assert!(worst.unwrap() < 6, "{worst:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn every_kernel_gives_the_same_bytes(
        x in -3.0..3.0f64, y in -3.0..3.0f64, heading in -4.0..4.0f64,
        lens in 0usize..4, width in 60u32..200, height in 33u32..120, tilt in 0.0..0.9f64,
        gain in 0.1..6.0f64, noise in 0.0..9.0f64, seed: u64,
        blur in 0.0..1.5f64, speed in 0.0..2.0f64, exposure in 0.0..0.05f64, single: bool,
    ) {
        let name = std::format!("{LAMP}\n{BOARDS}");
        let scene = Scene::of_painting(&world(&name), &painted(0.01, [90, 80, 70, 60], |p| {
            let stripe = ((p.x * 13.0 + p.y * 29.0) * 20.0) as i64;
            [(stripe % 251).unsigned_abs() as u8, (stripe % 83).unsigned_abs() as u8, 120, (stripe % 256).unsigned_abs() as u8]
        }));
        let mut camera = camera(lenses()[lens].1, 320, 240).resized(width, height);
        camera.mounting.tilt_rad = tilt;
        let optics = Optics {
            vignetting: 0.3,
            blur_px: blur,
            sharpness: if single { Sharpness::Single } else { Sharpness::Spread },
        };
        let shot = Shot {
            gain: [gain, gain * 0.9, gain * 1.1],
            motion: Motion { speed_mps: speed, yaw_rate_radps: 1.0 - speed, exposure_s: exposure },
            noise: Noise { dark: noise, bright: 9.0 - noise, seed },
            ..Shot::still(Pose2::new(x, y, heading))
        };
        let mut fast = Renderer::new(&camera, &scene, &optics);
        let mut portable = fast.clone().with_kernel(Kernel::Portable);
        let (mut a, mut b) = (Image::default(), Image::default());
        fast.render(&scene, &shot, &mut a);
        portable.render(&scene, &shot, &mut b);
        prop_assert!(a == b, "{} differs from portable", Kernel::fastest().name());
        // And again: nothing of the last frame stays behind.
        fast.render(&scene, &shot, &mut b);
        prop_assert!(a == b);
    }
}
