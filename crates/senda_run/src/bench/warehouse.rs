//! What a warehouse vehicle sees and how long looking takes: street, codes, signs and lights, apart from each other.

use super::Case;
use crate::{RunError, Scenario};
use senda_core::{Image, Observation, Vehicle};
use senda_drivers::NetworkDetector;
use senda_nets::{Darknet, Weights};
use senda_sim::{SimOptions, Simulator, Start};
use senda_vision::street::trace::Expected;
use senda_vision::{ClassicalDetector, Detector, ObjectClass, QrLimits, QrReader, StreetEyes};
use std::sync::OnceLock;

/// Stations of the test track from which pictures are taken (m): before the start's and an area's crossing and along the way.
const STATIONS_M: [f64; 6] = [0.3, 0.9, 1.5, 2.1, 2.9, 3.6];
/// Frames until the exposure has settled.
const SETTLING: usize = 6;

/// Pictures of 640x480 px on document D's test track, some with codes, signs or the light in view.
///
/// # Errors
/// When the ready world or vehicle cannot be driven, which a test excludes.
pub fn warehouse_frames() -> Result<Vec<Image>, RunError> {
    let scenario = Scenario::new("warehouse", "warehouse-cart", "mission");
    let (world, spec) = (scenario.resolve_world()?, scenario.resolve_vehicle()?);
    let mut frames = Vec::new();
    for station_m in STATIONS_M {
        let options = SimOptions {
            start: Start {
                station_m: Some(station_m),
                ..Start::default()
            },
            ..SimOptions::default()
        };
        let mut simulator = Simulator::new(world.clone(), &spec, options)?;
        let mut observation = Observation::default();
        for _ in 0..SETTLING {
            simulator.observe(&mut observation)?;
            simulator.actuate(&senda_core::Command::STOP)?;
        }
        frames.extend(observation.frames.into_iter().next().map(|frame| frame.image));
    }
    Ok(frames)
}

/// The small detector with random values: how long it takes does not depend on them.
///
/// # Errors
/// When the ready network is broken, which a test excludes.
pub fn random_detector() -> Result<NetworkDetector, RunError> {
    let broken = |reason: String| RunError::DriverOptions {
        driver: "mission".into(),
        reason,
    };
    let darknet = Darknet::find("detector-small")
        .and_then(|darknet| darknet.with_classes(&ObjectClass::DOCUMENT.map(ObjectClass::name)))
        .map_err(|error| broken(error.to_string()))?;
    let weights = Weights::random(&darknet.network, 5);
    let model = darknet.into_model(weights);
    NetworkDetector::new(&model, 0.5).map_err(|error| broken(error.to_string()))
}

/// The pictures are taken when the first case is called: nobody waits for them who measures something else.
static FRAMES: OnceLock<Vec<Image>> = OnceLock::new();

fn case(name: &'static str, target_per_s: f64, mut look: impl FnMut(&Image) + Send + 'static) -> Case {
    let mut number = 0;
    Case {
        name,
        target_per_s,
        call: Box::new(move || {
            let frames = FRAMES.get_or_init(|| warehouse_frames().unwrap_or_default());
            if let Some(frame) = frames.get(number % frames.len().max(1)) {
                look(frame);
            }
            number += 1;
        }),
    }
}

pub(super) fn cases() -> Result<Vec<Case>, RunError> {
    let scenario = Scenario::new("warehouse", "warehouse-cart", "mission");
    let body = scenario.resolve_vehicle()?.body();
    let mut eyes = StreetEyes::new(&body.cameras[0], 640, 480, Default::default());
    let mut reader = QrReader::default();
    let mut everywhere = QrReader::new(QrLimits {
        everywhere: true,
        ..QrLimits::default()
    });
    let mut classical = ClassicalDetector::default();
    let mut network = random_detector()?;
    // Document D: 50 frames a second without its detector, 5 with it.
    Ok(vec![
        case("warehouse: street, 640x480", 50.0, move |frame| {
            std::hint::black_box(eyes.look(frame, Expected::default()).line.points.len());
        }),
        case("warehouse: codes, 640x480", 50.0, move |frame| {
            std::hint::black_box(reader.read(frame).len());
        }),
        case("warehouse: codes everywhere, 640x480", 0.0, move |frame| {
            std::hint::black_box(everywhere.read(frame).len());
        }),
        case("warehouse: signs by shape, 640x480", 20.0, move |frame| {
            std::hint::black_box(classical.detect(frame).len());
        }),
        case("warehouse: signs by detector-small", 20.0, move |frame| {
            std::hint::black_box(network.detect(frame).len());
        }),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_track_is_in_the_pictures() {
        let frames = warehouse_frames().unwrap();
        assert_eq!(frames.len(), STATIONS_M.len());
        let mut reader = QrReader::default();
        let codes: usize = frames.iter().map(|frame| reader.read(frame).len()).sum();
        assert!(codes > 0, "no picture shows a code");
        for mut case in cases().unwrap() {
            (case.call)();
        }
    }
}
