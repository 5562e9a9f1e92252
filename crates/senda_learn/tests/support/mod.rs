//! What the tests share: a network that trains in milliseconds, and data that it can learn.
#![allow(dead_code, reason = "every test file uses its own part")]

use senda_core::{Body, Command, Encoded, Image, Stamp, Steering, codec::encode_jpeg};
use senda_data::{EncodedFrame, Recording, RecordingHeader, Step};
use senda_learn::{Answers, Augmentation, LearnError, Samples, Training, train::Lesson, train::Trained};
use senda_nets::{Initialisation, InputSpec, Network, Weights};
use senda_run::Ears;
use std::path::Path;

pub(crate) const NETWORK: &str = r#"
[input]
height = 8
width = 12
channels = 1

[[layer]]
kind = "convolution"
filters = 4
kernel = 3
stride = 2
activation = "elu"

[[layer]]
kind = "flatten"

[[layer]]
kind = "dropout"
rate = 0.2

[[layer]]
kind = "dense"
units = 8
activation = "relu"

[[layer]]
kind = "dense"
units = 1
"#;

pub(crate) fn network() -> Network {
    Network::parse("tiny.toml", NETWORK).unwrap()
}

/// A bright column in a dark frame: the answer is where it stands, left positive.
pub(crate) fn column(place: usize) -> (Vec<u8>, f32) {
    let mut pixels = vec![30u8; 8 * 12];
    for row in pixels.chunks_exact_mut(12) {
        row[place % 12] = 220;
    }
    (pixels, (5.5 - (place % 12) as f32) / 5.5)
}

pub(crate) fn samples(frames: usize) -> Samples {
    let mut samples = Samples::new(8 * 12, 1);
    samples.begin_run("columns", "made");
    for number in 0..frames {
        let (pixels, target) = column(number * 7);
        samples.push(&pixels, &[target]);
    }
    samples
}

pub(crate) fn options() -> Training {
    Training {
        epochs: 3,
        batch: 8,
        curve_weight: 1.0,
        augmentation: Augmentation {
            shift: 0.2,
            steering_per_shift: 2.0,
            ..Augmentation::default()
        },
        threads: 1,
        ..Training::default()
    }
}

/// Trains the tiny network; `interrupted` answers before every step.
pub(crate) fn train(
    training: &Samples,
    validation: &Samples,
    options: &Training,
    checkpoint: Option<&Path>,
    interrupted: &dyn Fn() -> bool,
) -> Result<Trained, LearnError> {
    train_from(7, training, validation, options, checkpoint, interrupted)
}

/// The same from the first weights of another seed.
pub(crate) fn train_from(
    first: u64,
    training: &Samples,
    validation: &Samples,
    options: &Training,
    checkpoint: Option<&Path>,
    interrupted: &dyn Fn() -> bool,
) -> Result<Trained, LearnError> {
    let network = network();
    let weights = Weights::initialised(&network, Initialisation::Small, first);
    let mut ears = Ears {
        progress: Box::new(|_| {}),
        interrupted: Box::new(interrupted),
        clock_ns: Box::new(|| 0),
    };
    senda_learn::train(
        &Lesson {
            input: &InputSpec::of(network.input()),
            network: &network,
            answers: &Answers { is_turn: vec![true] },
            training,
            validation,
            options,
            checkpoint,
        },
        weights,
        &mut ears,
        &mut |_| {},
    )
}

pub(crate) fn car() -> Body {
    Body {
        name: "car".into(),
        steering: Steering::Ackermann {
            wheelbase_m: 0.17,
            steering_limit_rad: 0.4,
        },
        width_m: 0.2,
        length_m: 0.3,
        speed_limit_mps: 2.0,
        yaw_rate_limit_radps: 4.0,
        period_s: 0.05,
        encoders: None,
        cameras: vec![],
    }
}

pub(crate) fn jpeg(number: usize) -> Encoded {
    let pixels = (0..24 * 16 * 3).map(|i| (i * 7 + number * 13) as u8).collect();
    let image = Image::from_pixels(24, 16, senda_core::Channels::Rgb, pixels).unwrap();
    encode_jpeg(&image, 90).unwrap()
}

/// A recording whose steering grows step by step, with these cameras.
pub(crate) fn recording(steps: usize, world: &str, cameras: &[&str]) -> Recording {
    Recording {
        lost: Vec::new(),
        header: RecordingHeader {
            senda: "0.1.0".into(),
            commit: String::new(),
            scenario: String::new(),
            world: Some(format!("name = \"{world}\"\n")),
            reversed: false,
            body: car(),
            driver: "expert".into(),
            seed: 1,
        },
        steps: (0..steps)
            .map(|number| Step {
                stamp: Stamp::from_ns(number as u64 * 50_000_000),
                frames: cameras
                    .iter()
                    .map(|camera| EncodedFrame {
                        camera: (*camera).to_owned(),
                        stamp: Stamp::from_ns(number as u64 * 50_000_000),
                        encoded: jpeg(number),
                    })
                    .collect(),
                speed_mps: None,
                wheels: None,
                battery_v: None,
                command: Command {
                    turn: senda_core::Turn::SteeringRad(0.004 * number as f64),
                    drive: senda_core::Drive::SpeedMps(1.0),
                },
                truth: None,
                explanation: Default::default(),
            })
            .collect(),
        summary: None,
        warnings: vec![],
    }
}
