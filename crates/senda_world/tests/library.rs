//! Every world and vehicle of the library parses without a warning and survives writing and reading.

use senda_world::{VehicleSpec, World};

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
