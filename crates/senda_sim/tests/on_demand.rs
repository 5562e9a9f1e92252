//! A floor that is painted where cameras look gives the pictures of one that was painted at once.

use proptest::prelude::*;
use senda_core::Image;
use senda_geom::{Camera, Lens, Mounting, Pose2};
use senda_sim::render::{Motion, Optics, Renderer, Scene, Sharpness, Shot};
use senda_world::{World, paint};

/// Worlds with all that a painter does: kinds of floor, worn and dashed lines, shadows, lamps, areas, trees.
fn world(number: usize) -> (World, f64) {
    let named = |name: &str| World::named(name).unwrap();
    let oval = |floor: &str, light: &str| {
        let mut world = named("oval")
            .with_floor(floor)
            .unwrap()
            .with_light(light)
            .unwrap();
        world.markings[0].wear = 0.4;
        world.markings[0].stain = 0.4;
        (world, 0.003)
    };
    match number {
        0 => oval("plain", "mixed"),
        1 => oval("glossy-wood", "lamp"),
        2 => oval("tiles", "mixed"),
        3 => oval("carpet", "mixed"),
        4 => (named("s-curves-lane"), 0.005),
        5 => (named("warehouse"), 0.005),
        _ => (named("lake"), 0.6),
    }
}

fn camera(lens: usize, tilt_rad: f64, z_m: f64) -> Camera {
    let (width_px, height_px) = (120, 77);
    Camera {
        name: "center".into(),
        width_px,
        height_px,
        lens: match lens {
            0 => Lens::pinhole(width_px, height_px, 1.0, 0.8),
            1 => Lens::equidistant(width_px, height_px, 2.1),
            _ => Lens::pinhole(width_px, height_px, 0.4, 0.3),
        },
        mounting: Mounting {
            x_m: 0.05,
            y_m: 0.02,
            z_m,
            yaw_rad: 0.1,
            tilt_rad,
            roll_rad: -0.04,
        },
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(14))]
    #[test]
    fn whoever_looks_first_sees_the_same(
        number in 0usize..7, lens in 0usize..3, tilt in 0.0..0.8f64, single: bool,
        places in proptest::collection::vec((-0.1..1.1f64, -0.1..1.1f64, -3.2..3.2f64, 0.0..0.1f64), 5),
    ) {
        let (world, texel_m) = world(number);
        let painting = paint::paint(&world, texel_m);
        let at_once = Scene::of_painting(&world, &painting);
        let on_demand = Scene::new(&world, texel_m);
        let (low, high) = world.bounds();
        let size = high - low;
        // From a tenth of the usual height to one from which the whole world is seen.
        let camera = camera(lens, tilt, 0.15 * texel_m / 0.003);
        let optics = Optics {
            sharpness: if single { Sharpness::Single } else { Sharpness::Spread },
            ..Optics::default()
        };
        let mut renderer = Renderer::new(&camera, &on_demand, &optics);
        let (mut a, mut b) = (Image::default(), Image::default());
        for (x, y, heading, exposure_s) in places {
            let pose = Pose2::new(low.x + x * size.x, low.y + y * size.y, heading);
            let shot = Shot {
                motion: Motion { speed_mps: 1.5, yaw_rate_radps: heading, exposure_s },
                ..Shot::still(pose)
            };
            renderer.render(&on_demand, &shot, &mut a);
            renderer.render(&at_once, &shot, &mut b);
            prop_assert!(a == b, "world {number}, {pose:?}");
        }
    }
}

#[test]
fn threads_share_a_floor_while_it_is_painted() {
    let (world, texel_m) = world(1);
    let at_once = Scene::of_painting(&world, &paint::paint(&world, texel_m));
    let on_demand = Scene::new(&world, texel_m);
    let camera = camera(1, 0.5, 0.15);
    let pose = |i: usize| world.path.pose_at(0.07 * i as f64);
    let drive = |scene: &Scene, first: usize| {
        let mut renderer = Renderer::new(&camera, scene, &Optics::default());
        let frame = |i: usize| {
            let mut image = Image::default();
            renderer.render(scene, &Shot::still(pose(i)), &mut image);
            image
        };
        (first..first + 40).map(frame).collect::<Vec<_>>()
    };
    std::thread::scope(|scope| {
        let (on_demand, drive) = (&on_demand, &drive);
        let runs = [0, 5, 33].map(|first| (first, scope.spawn(move || drive(on_demand, first))));
        for (first, run) in runs {
            assert!(
                run.join().unwrap() == drive(&at_once, first),
                "from frame {first}"
            );
        }
    });
}
