//! What `senda bench` measures of this crate. Nothing here reads a clock: the caller calls and times.

use crate::render::{Optics, Renderer, Scene, Sharpness, Shot};
use crate::{Images, SimError, SimOptions, Simulator};
use senda_core::{Command, Image, Observation, Vehicle};
use senda_geom::{Camera, Lens, Mounting, Pose2};
use senda_world::{VehicleSpec, World};
use std::sync::Arc;

/// Something to call many times and to time from outside.
pub struct Case {
    /// What one call does, such as `frame 320x160 wide lens, full light`.
    pub name: &'static str,
    /// Calls a second that are promised on one core of a 2-core AVX2 machine; 0: none.
    pub target_per_s: f64,
    /// One call.
    pub call: Box<dyn FnMut() + Send>,
}

/// The cases of this crate.
pub fn cases() -> Result<Vec<Case>, SimError> {
    let world = bench_world();
    let scene = Arc::new(Scene::new(&world, 0.002));
    let matt = Arc::new(Scene::new(&matt_world(), 0.002));
    let world = Arc::new(world);
    let wide = Camera {
        lens: Lens::equidistant(320, 160, 120f64.to_radians()),
        ..camera()
    };
    let full = Optics {
        vignetting: 0.3,
        blur_px: 0.7,
        ..Optics::default()
    };
    let single = |optics: Optics| Optics {
        sharpness: Sharpness::Single,
        ..optics
    };
    let plain = Optics::default();
    let mut cases = vec![
        frames(
            "frame 320x160, any lens, full light",
            2500.0,
            &wide,
            &scene,
            &full,
            true,
        ),
        frames(
            "the same, one look a pixel",
            2500.0,
            &wide,
            &scene,
            &single(full),
            true,
        ),
        frames("frame 320x160, pinhole", 0.0, &camera(), &matt, &plain, false),
        frames(
            "pinhole, one look a pixel",
            8000.0,
            &camera(),
            &matt,
            &single(plain),
            false,
        ),
    ];
    let gopigo = VehicleSpec::named("gopigo").expect("the library has a gopigo");
    for (name, target_per_s, images, jpeg) in [
        ("step of gopigo, 160x120, JPEG", 0.0, Images::Always, true),
        ("step of gopigo, 160x120, raw frames", 0.0, Images::Always, false),
        ("step of gopigo without images", 100_000.0, Images::Never, false),
    ] {
        let spec = if jpeg {
            gopigo.clone()
        } else {
            gopigo.clone().with_raw_frames()
        };
        let options = SimOptions {
            images,
            ..SimOptions::default()
        };
        let mut simulator = Simulator::in_scene(Arc::clone(&world), Arc::clone(&scene), &spec, options)?;
        let mut observation = Observation::default();
        cases.push(Case {
            name,
            target_per_s,
            call: Box::new(move || {
                // A slow circle: it stays on the painted floor.
                let command = Command::curvature(1.5, 0.13);
                let outcome = simulator.observe(&mut observation);
                let outcome = outcome.and_then(|_| simulator.actuate(&command));
                assert!(outcome.is_ok(), "the bench's vehicle works");
            }),
        });
    }
    Ok(cases)
}

/// Frames along a circle, so that every one looks at other texels.
fn frames(
    name: &'static str,
    target_per_s: f64,
    camera: &Camera,
    scene: &Arc<Scene>,
    optics: &Optics,
    full: bool,
) -> Case {
    let mut renderer = Renderer::new(camera, scene, optics);
    let scene = Arc::clone(scene);
    let mut image = Image::default();
    let mut pose = Pose2::new(0.5, 0.2, 0.0);
    let mut seed = 0;
    Case {
        name,
        target_per_s,
        call: Box::new(move || {
            pose = pose.advance(0.5, 0.7, 0.02);
            seed += 1;
            let mut shot = Shot::still(pose);
            if full {
                shot.gain = [1.2, 1.15, 1.0];
                shot.noise.dark = 1.5;
                shot.noise.bright = 3.0;
                shot.noise.seed = seed;
            }
            renderer.render(&scene, &shot, &mut image);
        }),
    }
}

/// A camera such as small cars wear: 20 cm high, tilted so that the horizon is out of sight.
fn camera() -> Camera {
    Camera {
        name: "center".into(),
        width_px: 320,
        height_px: 160,
        lens: Lens::pinhole(320, 160, 80f64.to_radians(), 45.5f64.to_radians()),
        mounting: Mounting {
            x_m: 0.1,
            y_m: 0.0,
            z_m: 0.2,
            yaw_rad: 0.0,
            tilt_rad: 0.5,
            roll_rad: 0.0,
        },
    }
}

/// A glossy floor under lamps.
fn bench_world() -> World {
    World::named("oval")
        .and_then(|world| world.with_floor("glossy-speckled"))
        .and_then(|world| world.with_light("mixed"))
        .expect("the library has these")
}

fn matt_world() -> World {
    World::named("oval")
        .and_then(|world| world.with_floor("carpet"))
        .expect("the library has these")
}
