//! Roads in open land: what the car's cameras see, and how it obeys throttle and brake.

use senda_core::{Command, Drive, Image, Observation, Turn, Vehicle};
use senda_sim::{Images, SimOptions, Simulator, Start};
use senda_world::{VehicleSpec, World};

/// A straight road between water at the left and trees at the right, with a wall ahead on the right.
const ROAD: &str = "
lane_width_m = 6
texel_m = 0.25
margin_m = 20
[path]
pieces = [{ kind = 'straight', length_m = 120 }]
[[markings]]
width_m = 6
colour = '#707070'
[[areas]]
points = [[0, 6], [120, 6], [120, 22], [0, 22]]
colour = '#6090c0'
ragged_m = 0
[[woods]]
count = 60
from_m = 40
near_m = -6
far_m = -16
[[walls]]
from_m = 10
to_m = 30
offset_m = -4
height_m = 1.0
colour = '#d0c0b0'
second_colour = '#d0c0b0'
[floor]
kind = 'grass'
[light]
thing_shadows = 0.4
elevation_deg = 40
[backdrop]
horizon = '#c0d4ea'
zenith = '#5080d0'
hills = '#788050'
";

fn sedan() -> VehicleSpec {
    VehicleSpec::named("sedan").unwrap().with_raw_frames()
}

fn simulator(options: SimOptions) -> Simulator {
    let world = World::parse("road.toml", ROAD).unwrap().0;
    Simulator::new(world, &sedan(), options).unwrap()
}

fn pixel(image: &Image, u: usize, v: usize) -> [u8; 3] {
    let at = 3 * (v * image.width() + u);
    [image.pixels()[at], image.pixels()[at + 1], image.pixels()[at + 2]]
}

#[test]
fn three_cameras_see_road_water_sky_trees_and_wall() {
    let mut simulator = simulator(SimOptions::default());
    let mut observation = Observation::default();
    simulator.observe(&mut observation).unwrap();
    let names: Vec<&str> = observation.frames.iter().map(|f| f.camera.as_str()).collect();
    assert_eq!(names, ["center", "left", "right"]);
    let image = &observation.frames[0].image;
    assert_eq!((image.width(), image.height()), (320, 160));
    let road = pixel(image, 160, 120);
    assert!(
        road.iter().max().unwrap() - road.iter().min().unwrap() < 12,
        "grey: {road:?}"
    );
    let [r, _, b] = pixel(image, 160, 5);
    assert!(b > r + 40, "blue sky");
    let [r, _, b] = pixel(image, 20, 68);
    assert!(b > r + 30, "water at the left");
    let [r, g, b] = pixel(image, 225, 70);
    assert!(r > 100 && r >= g && g >= b, "wall at the right: {r} {g} {b}");
    // Crowns stand dark before the sky.
    let dark = |u: usize| (20..54).any(|v| pixel(image, u, v).iter().all(|c| *c < 90));
    assert!(
        (180..270).any(dark) && !(30..120).any(dark),
        "trees at the right only"
    );
    // The left camera sees the road's left edge nearer to the middle of its picture.
    let edge = |frame: usize| {
        (0..160)
            .rev()
            .find(|u| pixel(&observation.frames[frame].image, *u, 120)[2] < 90)
            .unwrap_or(0)
    };
    assert!(
        edge(1) > edge(0) && edge(0) >= edge(2),
        "{} {} {}",
        edge(1),
        edge(0),
        edge(2)
    );
}

#[test]
fn the_same_seed_gives_the_same_pictures() {
    let frames = || {
        let mut simulator = simulator(SimOptions::default());
        let mut observation = Observation::default();
        for _ in 0..3 {
            simulator.observe(&mut observation).unwrap();
            simulator.actuate(&Command::steering(0.05, 8.0)).unwrap();
        }
        observation
    };
    assert!(frames() == frames());
}

#[test]
fn throttle_brake_and_cruise_control_drive_the_car() {
    let mut simulator = simulator(SimOptions {
        images: Images::Never,
        start: Start {
            station_m: Some(1.0),
            ..Start::default()
        },
        ..SimOptions::default()
    });
    let mut observation = Observation::default();
    let mut drive = |drive: Drive, seconds: f64| {
        for _ in 0..(seconds * 14.0) as usize {
            simulator.observe(&mut observation).unwrap();
            let turn = Turn::SteeringRad(0.0);
            simulator.actuate(&Command { turn, drive }).unwrap();
        }
        (
            observation.speed_mps.unwrap(),
            simulator.truth().unwrap().speed_mps,
        )
    };
    let (shown, quarter) = drive(Drive::Throttle(0.25), 4.0);
    assert!(
        (1.5..4.0).contains(&quarter) && (shown - quarter).abs() < 0.3,
        "{shown} {quarter}"
    );
    let full = drive(Drive::Throttle(1.0), 2.0).1;
    assert!(full > quarter + 4.0, "{quarter} {full}");
    let full = drive(Drive::Throttle(0.0), 0.2).1.max(full);
    let coasting = drive(Drive::Throttle(0.0), 1.0).1;
    assert!(coasting < full && coasting > full - 0.5, "{full} {coasting}");
    let cruising = drive(Drive::SpeedMps(5.0), 6.0).1;
    assert!((cruising - 5.0).abs() < 0.1, "{cruising}");
    assert_eq!(drive(Drive::Throttle(-1.0), 3.0).1, 0.0);
}
