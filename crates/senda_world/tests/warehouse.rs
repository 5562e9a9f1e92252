//! Warehouses: document D's measures, streets that join, places that lie on them, and made-up ones.

use senda_geom::Vec2;
use senda_world::{LightProgram, PlaceKind, Texture, VehicleSpec, WarehouseLayout, World};

fn things<'a>(world: &'a World, start: &'a str) -> Vec<&'a senda_world::Thing> {
    world
        .things
        .iter()
        .filter(|thing| thing.name.starts_with(start))
        .collect()
}

/// D in SPEC: 220 x 320 cm, streets 20 cm, straight pieces 40 cm, inner radius 20 cm, two junctions, three depots.
#[test]
fn the_test_track_has_the_documents_measures() {
    let world = World::named("warehouse").unwrap();
    let (low, high) = world.bounds();
    let size = high - low - Vec2::splat(2.0 * world.margin_m);
    assert!((size - Vec2::new(2.2, 3.2)).length() < 1e-3, "{size}");
    let warehouse = world.warehouse.as_ref().unwrap();
    assert_eq!(warehouse.street_width_m, 0.2);
    assert_eq!(warehouse.streets.len(), 2);
    let radius_m = senda_world::smallest_radius_m(&world.path) - warehouse.street_width_m / 2.0;
    assert!((radius_m - 0.2).abs() < 1e-9);
    let names: Vec<String> = warehouse.places.iter().map(|place| place.name()).collect();
    assert_eq!(
        names,
        ["start", "area 0", "depot 0", "area 1", "depot 1", "depot 2"]
    );
    assert_eq!(things(&world, "F").len(), 3);
    assert_eq!(
        (things(&world, "sign").len(), things(&world, "light").len()),
        (2, 1)
    );
}

/// A street leaves the ring and comes back to it along its direction, for whoever follows its line.
#[test]
fn streets_leave_and_join_the_ring_tangentially() {
    for seed in 0..30 {
        let world = World::random_warehouse(seed, seed % 2 == 0);
        for street in &world.warehouse.as_ref().unwrap().streets {
            for station_m in [0.0, street.path.length_m()] {
                let end = street.path.pose_at(station_m);
                let place = world.path.project(end.position());
                let ring = world.path.pose_at(place.station_m);
                assert!(place.offset_m.abs() < 1e-6, "{seed} {}", street.name);
                assert!(
                    end.forward().dot(ring.forward()) > 0.99999,
                    "{seed} {}",
                    street.name
                );
            }
        }
    }
}

/// From where a vehicle stops, everything that it must find stands within a turn in place, in front of it and faces it.
#[test]
fn what_is_to_be_found_faces_the_vehicle_that_stops() {
    for seed in 0..40 {
        let world = World::random_warehouse(seed, true);
        let warehouse = world.warehouse.as_ref().unwrap();
        for place in &warehouse.places {
            let PlaceKind::Area { depot, light } = &place.kind else {
                continue;
            };
            let edge = warehouse.edge_of(&world.path, place);
            let mut names = vec![format!("sign {depot}")];
            names.extend(light.clone());
            for name in names {
                let thing = world.things.iter().find(|thing| thing.name == name).unwrap();
                let seen = edge.inverse().transform(thing.pose.position());
                assert!(
                    seen.x > 0.0 && seen.x < 0.5 && seen.y.abs() > 0.13 && seen.y.abs() < 0.4,
                    "{seed} {name}"
                );
                let towards = (edge.position() - thing.pose.position()).normalize();
                assert!(thing.pose.forward().dot(towards) > 0.7, "{seed} {name}");
                // Nothing stands on a street.
                for corner in thing.footprint() {
                    let (_, at) = warehouse.nearest_street(&world.path, corner);
                    assert!(at.offset_m.abs() > 0.1, "{seed} {name} {}", at.offset_m);
                }
            }
        }
    }
}

#[test]
fn made_up_warehouses_are_repeatable_valid_and_different() {
    let mut seen = Vec::new();
    for seed in [0, 1, 2, 3, 17, 10_000, u64::MAX] {
        for any in [false, true] {
            let world = World::random_warehouse(seed, any);
            assert_eq!(world, World::random_warehouse(seed, any));
            let (back, warnings) = World::parse("made.toml", &world.to_toml()).unwrap();
            assert_eq!((&back, warnings.len()), (&world, 0), "{seed}: {warnings:?}");
            let cart = VehicleSpec::named("warehouse-cart").unwrap();
            assert_eq!(world.check_vehicle(&cart), []);
            seen.push(world.to_toml());
        }
    }
    seen.sort();
    seen.dedup();
    assert_eq!(seen.len(), 14);
    let mirrored = (0..40)
        .filter(|seed| WarehouseLayout::random(*seed, false).mirrored)
        .count();
    assert!((10..30).contains(&mirrored));
}

/// The light's program comes back from the file, and a shift of a whole cycle changes nothing.
#[test]
fn lights_and_packages_can_be_set() {
    let world = World::named("warehouse").unwrap().with_package("I2").unwrap();
    assert!(matches!(&things(&world, "package")[0].texture, Texture::Qr { text, .. } if text == "I2"));
    assert!(world.clone().with_package("").is_none());
    let program = |world: &World| match &things(world, "light")[0].texture {
        Texture::Light { program, .. } => *program,
        other => panic!("{other:?}"),
    };
    let LightProgram {
        green_s,
        red_s,
        offset_s,
    } = program(&world);
    assert_eq!((green_s, red_s, offset_s), (6.0, 7.0, 0.0));
    assert!((program(&world.clone().with_lights_later(0.5)).offset_s - 6.5).abs() < 1e-9);
    assert!(program(&world.with_lights_later(1.0)).offset_s.abs() < 1e-9);
}

/// Regression-like checks of the reader: each mistake names its key.
#[test]
fn mistakes_in_warehouses_are_answered_with_their_key() {
    let good = World::named("warehouse").unwrap().to_toml();
    for (from, to, key) in [
        ("street = \"street 1\"", "street = \"street 9\"", "street"),
        ("kind = \"area\"", "kind = \"aera\"", "kind"),
        ("number = 1", "number = 11", "number"),
        ("text = \"P\"", "text = \"\"", "text"),
        ("name = \"street 2\"", "name = \"street 1\"", "name"),
        ("crossing_m = 0.7", "crossing_m = 70.0", "crossing_m"),
        ("red_s = 7.0", "red_s = -7.0", "red_s"),
    ] {
        assert!(good.contains(from), "{from}");
        let error = World::parse("bad.toml", &good.replacen(from, to, 1))
            .unwrap_err()
            .to_string();
        assert!(error.contains("bad.toml:") && error.contains(key), "{error}");
    }
}

/// Line, street and crossing lie on each other in this order, also where streets meet.
#[test]
fn paint_lies_on_streets_and_crossings_on_lines() {
    let world = World::named("warehouse").unwrap();
    let painting = senda_world::paint::paint(&world, 0.005);
    let at = |point: Vec2| {
        let place = (point - painting.origin) / painting.metres_per_texel;
        painting.texels[place.y as usize * painting.width + place.x as usize]
    };
    let strongest = |[r, g, b, _]: [u8; 4]| {
        if r > g + 40 {
            'r'
        } else if g > r + 40 && g > b + 30 {
            'g'
        } else {
            '-'
        }
    };
    let warehouse = world.warehouse.as_ref().unwrap();
    for place in &warehouse.places {
        let edge = warehouse.edge_of(&world.path, place);
        assert_eq!(
            strongest(at(edge.transform(Vec2::new(0.04, 0.0)))),
            'r',
            "{}",
            place.name()
        );
        assert_eq!(
            strongest(at(edge.transform(Vec2::new(-0.05, 0.0)))),
            'g',
            "{}",
            place.name()
        );
        assert_eq!(
            strongest(at(edge.transform(Vec2::new(-0.05, 0.06)))),
            '-',
            "{}",
            place.name()
        );
    }
    // The line into a street begins on the ring.
    for street in &warehouse.streets {
        for station_m in [0.02, 0.1, 0.3, street.path.length_m() - 0.05] {
            assert_eq!(
                strongest(at(street.path.pose_at(station_m).position())),
                'g',
                "{station_m}"
            );
        }
    }
}
