//! Driving allocates nothing per frame once the first frames have passed.

#[path = "../../senda_core/tests/counting/mod.rs"]
mod counting;
mod support;

use senda_core::{Command, Driver, Explanation, Observation};
use senda_drivers::{
    HoughDriver, HoughDriverOptions, LaneDriver, LaneOptions, LineDriver, LineOptions, Mask,
};
use support::{Floor, Loop, gopigo, s_curve};

/// Counts the frames in which its driver allocated.
struct Counted<D> {
    driver: D,
    frame: usize,
    allocating: Vec<usize>,
}

impl<D: Driver> Driver for Counted<D> {
    fn drive(&mut self, observation: &Observation) -> Command {
        let before = counting::allocations();
        let command = self.driver.drive(observation);
        let after = counting::allocations();
        self.frame += 1;
        if after > before {
            self.allocating.push(self.frame);
        }
        command
    }

    fn explain(&self, explanation: &mut Explanation) {
        self.driver.explain(explanation);
    }
}

#[test]
fn no_camera_driver_allocates_per_frame() {
    // Lines and floors with which both drivers also search: dashes, lamps' images, a lane that is elsewhere at times.
    let path = s_curve(0.4);
    let mut floor = Floor::around(&path, 0.9, 90);
    for side in [0.08, -0.08] {
        floor.dashes(&path.offset(side), 0.018, 230, 0.2, 0.06);
        floor.dashes(&path.offset(side * 2.0), 0.018, 230, 0.1, 0.2);
    }
    floor.speckle(20);
    let body = gopigo(160, 120);
    let mut run = Loop::new(&body, &floor, &path);
    run.goal_m = path.length_m() - 0.7;
    run.seconds = 15.0;
    // The lines are white. Where it sees none of them, it shall drive on nevertheless.
    let mut white: HoughDriverOptions =
        toml::from_str("colours = [{ low = [0, 0, 180], high = [180, 60, 255] }]").unwrap();
    white.loss.stop_after_m = 100.0;
    let strong = HoughDriverOptions {
        mask: Mask::Strength,
        ..white.clone()
    };
    let drivers: [Box<dyn Driver>; 4] = [
        Box::new(LineDriver::new(&body, LineOptions::default()).unwrap()),
        Box::new(LaneDriver::new(&body, LaneOptions::default()).unwrap()),
        Box::new(HoughDriver::new(&body, white).unwrap()),
        Box::new(HoughDriver::new(&body, strong).unwrap()),
    ];
    for (index, driver) in drivers.into_iter().enumerate() {
        let mut counted = Counted {
            driver: Boxed(driver),
            frame: 0,
            allocating: Vec::with_capacity(1000),
        };
        run.drive(&mut counted);
        let warm = counted.frame;
        // The same way again; a buffer may still grow when a frame shows more than any before it.
        run.drive(&mut counted);
        let late = counted.allocating.iter().filter(|frame| **frame > warm).count();
        assert!(
            warm > 100 && late <= 3,
            "driver {index}: {:?}, {warm} frames at first",
            counted.allocating
        );
    }
}

struct Boxed(Box<dyn Driver>);

impl Driver for Boxed {
    fn drive(&mut self, observation: &Observation) -> Command {
        self.0.drive(observation)
    }

    fn explain(&self, explanation: &mut Explanation) {
        self.0.explain(explanation);
    }
}
