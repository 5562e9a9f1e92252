//! What `senda bench` measures: each room's own cases and the whole loop. Nothing here reads a clock.

use crate::{Guard, Pilot, RunError, Scenario};
use senda_core::{Image, Observation, Vehicle};
use senda_sim::{SimOptions, Simulator};
use senda_vision::{Contrast, ExtractorOptions, LineExtractor, WidthProfile};

mod warehouse;

pub use senda_sim::bench::Case;
pub use warehouse::{random_detector, warehouse_frames};

/// All cases, with the rates that are promised for one core of a 2-core AVX2 machine.
pub fn cases() -> Result<Vec<Case>, RunError> {
    let mut cases = senda_sim::bench::cases()?;
    cases.push(extraction(320, 240, "line extraction 320x240")?);
    cases.push(extraction(160, 120, "line extraction 160x120")?);
    cases.push(closed_loop(
        "line",
        "oval",
        "closed loop, line driver, 160x120",
        1000.0,
    )?);
    cases.push(closed_loop(
        "lane",
        "oval-lane",
        "closed loop, lane driver, 160x120",
        0.0,
    )?);
    cases.extend(warehouse::cases()?);
    Ok(cases)
}

/// C3 to C5 on a simulated frame.
fn extraction(width: u32, height: u32, name: &'static str) -> Result<Case, RunError> {
    let image = simulated_frame(width, height)?;
    let spec = crate::scenario::find_vehicle("gopigo")?.with_camera_size(width, height);
    let profile = WidthProfile::from_camera(&spec.body().cameras[0], 0.018);
    let mut extractor = LineExtractor::new(
        width as usize,
        height as usize,
        &profile,
        ExtractorOptions::default(),
    );
    Ok(Case {
        name,
        target_per_s: 0.0,
        call: Box::new(move || {
            std::hint::black_box(extractor.extract(&image, Contrast::Dark).len());
        }),
    })
}

fn simulated_frame(width: u32, height: u32) -> Result<Image, RunError> {
    let scenario = Scenario {
        image_px: Some([width, height]),
        ..Scenario::new("oval", "gopigo", "line")
    };
    let mut simulator = Simulator::new(
        scenario.resolve_world()?,
        &scenario.resolve_vehicle()?,
        SimOptions::default(),
    )?;
    let mut observation = Observation::default();
    for _ in 0..20 {
        simulator.observe(&mut observation)?;
    }
    Ok(observation
        .frames
        .into_iter()
        .next()
        .map(|frame| frame.image)
        .unwrap_or_default())
}

/// One step of the loop: observe, drive, guard, actuate. When the vehicle has gone far enough it begins anew.
fn closed_loop(driver: &str, world: &str, name: &'static str, target_per_s: f64) -> Result<Case, RunError> {
    let scenario = Scenario::new(world, "gopigo", driver);
    let world = scenario.resolve_world()?;
    let spec = scenario.resolve_vehicle()?;
    let mut simulator = Simulator::new(world, &spec, SimOptions::default())?;
    let body = simulator.body().clone();
    let mut pilot = Pilot::named(driver, &body, None, Some(0.13), &toml::Table::new())?;
    let mut guard = Guard::new(&body);
    let mut observation = Observation::default();
    Ok(Case {
        name,
        target_per_s,
        call: Box::new(move || {
            // The simulator never ends by itself and cannot fail once it runs.
            if simulator.observe(&mut observation).is_ok() {
                let command = guard.check(&observation, pilot.drive(&observation, simulator.truth()));
                let _ = simulator.actuate(&command);
            }
        }),
    })
}
