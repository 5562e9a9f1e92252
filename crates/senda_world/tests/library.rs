//! Every world and vehicle of the library parses without a warning, survives writing and reading, and is what the
//! documents ask for.

use senda_core::Steering;
use senda_world::{FLOOR_PRESETS, LIGHT_PRESETS, VehicleSpec, World, smallest_radius_m};
use std::path::Path;

#[test]
fn every_world_survives_writing_and_reading() {
    for name in World::names() {
        let world = World::named(name).unwrap();
        assert_eq!(world.name, name);
        for world in [world.clone(), world.clone().reversed()] {
            let text = world.to_toml();
            let (back, warnings) = World::parse("resolved.toml", &text).unwrap();
            assert_eq!(warnings, [], "{name}");
            assert_eq!(back, world, "{name}");
            assert_eq!(back.to_toml(), text, "{name}");
        }
    }
}

#[test]
fn every_vehicle_survives_writing_and_reading() {
    for name in VehicleSpec::names() {
        let vehicle = VehicleSpec::named(name).unwrap();
        assert_eq!(vehicle.name, name);
        let text = vehicle.to_toml();
        let (back, warnings) = VehicleSpec::parse("resolved.toml", &text).unwrap();
        assert_eq!(warnings, [], "{name}");
        assert_eq!(back, vehicle, "{name}\n{text}");
    }
}

/// The library in the binary is the folder: no file is forgotten, none is warned about.
#[test]
fn the_library_is_the_folder() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let stems = |folder: &str| -> Vec<String> {
        let mut stems: Vec<String> = std::fs::read_dir(root.join(folder))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
            .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
            .collect();
        stems.sort();
        stems
    };
    let sorted = |names: Vec<&str>| {
        let mut names: Vec<String> = names.into_iter().map(str::to_owned).collect();
        names.sort();
        names
    };
    assert_eq!(stems("worlds"), sorted(World::names().collect()));
    assert_eq!(stems("vehicles"), sorted(VehicleSpec::names().collect()));
    for name in World::names() {
        let (world, warnings) = World::load(&root.join(format!("worlds/{name}.toml"))).unwrap();
        assert_eq!(warnings, []);
        assert_eq!(world, World::named(name).unwrap());
        assert!(!world.description.is_empty(), "{name}");
    }
    for name in VehicleSpec::names() {
        let (_, warnings) = VehicleSpec::load(&root.join(format!("vehicles/{name}.toml"))).unwrap();
        assert_eq!(warnings, []);
    }
}

/// Document A: lanes about 120 % of the kit car's width, at least 2 m long, no two alike, all drivable.
#[test]
fn circuits_suit_the_kit_car() {
    let car = VehicleSpec::named("picar").unwrap();
    let mut worlds = Vec::new();
    for name in World::names().filter(|name| name.starts_with("circuit") || name.starts_with("unseen")) {
        let world = World::named(name).unwrap();
        assert_eq!(world.check_vehicle(&car), [], "{name}");
        let width_m = world.lane_width_m.unwrap();
        assert!(
            width_m / car.width_m > 1.15 && width_m / car.width_m < 1.6,
            "{name}"
        );
        assert!(world.path.length_m() > 2.0, "{name}");
        worlds.push(world);
    }
    assert_eq!(worlds.len(), 10);
    for (i, a) in worlds.iter().enumerate() {
        for b in &worlds[..i] {
            assert!((a.path.length_m() - b.path.length_m()).abs() > 0.01);
            assert!(a.floor != b.floor || a.markings != b.markings);
        }
    }
}

#[test]
fn line_worlds_suit_document_c() {
    let robot = VehicleSpec::named("gopigo").unwrap();
    for (name, least_m, most_m) in [
        ("oval", 0.45, 0.6),
        ("s-curves", 0.3, 0.6),
        ("hard-curves", 0.19, 0.26),
    ] {
        for name in [name.to_owned(), format!("{name}-lane")] {
            let world = World::named(&name).unwrap();
            assert_eq!(world.check_vehicle(&robot), []);
            let radius_m = smallest_radius_m(&world.path);
            assert!((least_m..most_m).contains(&radius_m), "{name}: {radius_m}");
            assert!((0.015..=0.02).contains(&world.markings[0].width_m));
            assert_eq!(world.lane_width_m.is_some(), name.ends_with("lane"));
        }
    }
}

#[test]
fn vehicles_have_the_documents_figures() {
    let robot = VehicleSpec::named("gopigo").unwrap();
    assert_eq!(robot.steering, Steering::Differential { track_m: 0.11 });
    assert_eq!(robot.wheels.diameter_m, 0.065);
    assert_eq!(robot.encoders.as_ref().unwrap().ticks_per_turn, 18);
    let motor = robot.motor.as_ref().unwrap();
    // C11: one turn a second at 9.277 V needs the slope plus the intercept; at half the voltage, twice the slope.
    assert!((motor.value_for(1.0, 9.277) - (115.7985 + 18.1987)).abs() < 1e-9);
    assert!((motor.value_for(1.0, 9.277 / 2.0) - (2.0 * 115.7985 + 18.1987)).abs() < 1e-9);
    assert!((motor.turns_per_s(motor.value_for(0.8, 8.4), 8.4) - 0.8).abs() < 1e-9);
    assert_eq!(motor.turns_per_s(15.0, 9.0), 0.0);
    let camera = &robot.cameras[0].camera;
    // C: sees from 7 to 50 cm ahead of the lens.
    let bottom = camera
        .floor_from_pixel(senda_geom::Vec2::new(80.0, 120.0))
        .unwrap();
    let top = camera.floor_from_pixel(senda_geom::Vec2::new(80.0, 0.0)).unwrap();
    let ahead = |x: f64| x - camera.mounting.x_m;
    assert!((ahead(bottom.x) - 0.0686).abs() < 0.002, "{bottom}");
    assert!((ahead(top.x) - 0.4533).abs() < 0.01, "{top}");

    let car = VehicleSpec::named("picar").unwrap();
    let camera = &car.cameras[0].camera;
    assert_eq!((camera.width_px, camera.height_px), (320, 240));
    let (left, right) = (
        camera.lens.ray(senda_geom::Vec2::new(0.0, 120.0)),
        camera.lens.ray(senda_geom::Vec2::new(320.0, 120.0)),
    );
    let view_deg = senda_geom::trig::acos(left.dot(right)).to_degrees();
    assert!((view_deg - 120.0).abs() < 0.1, "{view_deg}");
    let small = car.with_camera_size(160, 120);
    assert_eq!(small.body().cameras[0].width_px, 160);
}

#[test]
fn presets_fit_every_world() {
    for name in ["oval", "circuit-3"] {
        for floor in FLOOR_PRESETS {
            for light in LIGHT_PRESETS {
                let world = World::named(name).unwrap().with_floor(floor).unwrap();
                let world = world.with_light(light).unwrap();
                for marking in &world.markings {
                    let above = marking.colour.luminance() - world.floor.colour.luminance();
                    assert!(above.abs() >= 50.0, "{name} {floor}");
                }
                let (back, warnings) = World::parse("resolved.toml", &world.to_toml()).unwrap();
                assert_eq!((back, warnings), (world, vec![]));
            }
        }
    }
}

#[test]
fn light_changes_along_the_lap_and_around_its_joint() {
    let world = World::named("oval").unwrap().with_light("mixed").unwrap();
    let length_m = world.path.length_m();
    let at = |part: f64| world.light_level_at(part * length_m);
    assert!((at(0.0) - 1.0).abs() < 1e-9 && (at(0.5) - 0.45).abs() < 1e-9);
    assert!((at(0.75) - 0.725).abs() < 1e-9 && (at(0.999_999) - 1.0).abs() < 1e-5);
    let back = world.clone().reversed();
    for part in [0.1, 0.3, 0.7] {
        assert!((back.light_level_at((1.0 - part) * length_m) - at(part)).abs() < 1e-9);
    }
}

#[test]
fn unknown_names_list_the_nearest() {
    for (error, near) in [
        (World::named("ovall").unwrap_err(), "oval"),
        (VehicleSpec::named("gopgo").unwrap_err(), "gopigo"),
        (
            World::named("oval").unwrap().with_floor("woood").unwrap_err(),
            "wood",
        ),
        (
            World::named("oval").unwrap().with_light("sunst").unwrap_err(),
            "sunset",
        ),
    ] {
        let text = error.to_string();
        assert!(text.contains(&format!("did you mean {near:?}?")), "{text}");
    }
}
