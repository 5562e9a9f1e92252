//! The car of document B on its laps: the expert and a person drive them.

use senda_core::{Drive, Observation, Truth, Turn, Vehicle};
use senda_geom::Tracker;
use senda_run::Pilot;
use senda_sim::{Images, SimOptions, Simulator};
use senda_world::{VehicleSpec, World};

/// What a lap looked like: mean and largest |offset| (m), mean speed (m/s), and steering and pedals frame by frame.
struct Lap {
    mean_m: f64,
    most_m: f64,
    speed_mps: f64,
    steering: Vec<f64>,
    pedals: Vec<f64>,
}

/// Drives a lap without pictures; the first 30 m do not count.
fn lap(world: &World, driver: &str, seed: i64) -> Lap {
    let spec = VehicleSpec::named("sedan").unwrap();
    let options = SimOptions {
        images: Images::Never,
        ..SimOptions::default()
    };
    let mut car = Simulator::new(world.clone(), &spec, options).unwrap();
    let mut table = toml::Table::new();
    if driver == "human" {
        table.insert("seed".into(), seed.into());
    }
    let mut pilot = Pilot::named(driver, &spec.body(), Some(&world.path), Some(8.0), &table).unwrap();
    let mut observation = Observation::default();
    let mut tracker = Tracker::new(world.start_station_m);
    let (mut offsets, mut speeds, mut steering, mut pedals) = (vec![], vec![], vec![], vec![]);
    while tracker.travelled_m() < world.path.length_m() {
        assert!(car.observe(&mut observation).unwrap() && observation.stamp.as_s() < 400.0);
        let truth: Truth = *car.truth().unwrap();
        let place = tracker.advance(&world.path, truth.world_from_vehicle.position());
        let command = pilot.drive(&observation, Some(&truth));
        if tracker.travelled_m() > 30.0 {
            offsets.push(place.offset_m.abs());
            speeds.push(truth.speed_mps);
            if let Turn::SteeringRad(angle) = command.turn {
                steering.push(angle);
            }
            if let Drive::Throttle(pedal) = command.drive {
                pedals.push(pedal);
            }
        }
        car.actuate(&command).unwrap();
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    Lap {
        mean_m: mean(&offsets),
        most_m: offsets.iter().copied().fold(0.0, f64::max),
        speed_mps: mean(&speeds),
        steering,
        pedals,
    }
}

#[test]
fn the_expert_drives_every_lap_near_the_middle() {
    for name in ["lake", "meadow", "heath", "forest"] {
        let lap = lap(&World::named(name).unwrap(), "expert", 0);
        assert!(
            lap.mean_m < 0.1 && lap.most_m < 0.6,
            "{name}: {} {}",
            lap.mean_m,
            lap.most_m
        );
    }
}

#[test]
fn a_person_wanders_trembles_and_uses_both_pedals_but_stays_on_the_road() {
    let world = World::named("lake").unwrap();
    let (first, again, other) = (
        lap(&world, "human", 1),
        lap(&world, "human", 1),
        lap(&world, "human", 2),
    );
    assert_eq!(first.steering, again.steering);
    assert_ne!(first.steering, other.steering);
    for lap in [&first, &other] {
        assert!(
            (0.05..0.6).contains(&lap.mean_m) && lap.most_m < 1.8,
            "{} {}",
            lap.mean_m,
            lap.most_m
        );
        assert!((6.0..8.2).contains(&lap.speed_mps), "{}", lap.speed_mps);
        let range = lap
            .pedals
            .iter()
            .fold((0.0f64, 0.0f64), |(low, high), p| (low.min(*p), high.max(*p)));
        assert!(range.0 < -0.02 && range.1 > 0.1, "{range:?}");
        assert_eq!(lap.pedals.len(), lap.steering.len());
    }
}
