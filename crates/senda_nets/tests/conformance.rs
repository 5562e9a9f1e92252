//! Every layer kind and every ready network passes the same suite.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use senda_nets::{Inference, Loss, Network, TrainOptions, Trainer, Weights};

/// Small networks that together hold every kind of layer, each behind a trained layer so that the gradient of its input
/// is checked as well.
const CASES: &[(&str, &str)] = &[
    ("convolution", include_str!("networks/convolution.toml")),
    ("strides", include_str!("networks/strides.toml")),
    ("dense", include_str!("networks/dense.toml")),
    ("pooling", include_str!("networks/pooling.toml")),
    ("mixed", include_str!("networks/mixed.toml")),
    ("frozen", include_str!("networks/frozen.toml")),
    ("recurrent", include_str!("networks/recurrent.toml")),
    ("activations", include_str!("networks/activations.toml")),
];

fn networks() -> Vec<Network> {
    let own = CASES
        .iter()
        .map(|(name, text)| Network::parse(name, text).unwrap());
    let ready = Network::names().map(|name| Network::named(name).unwrap());
    // The largest one takes seconds for each pass; its layers are the others'.
    own.chain(ready.filter(|network| network.multiply_adds() < 100_000_000))
        .collect()
}

fn values(seed: u64, count: usize) -> Vec<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| random.random_range(-1.0..1.0)).collect()
}

/// Weights with everything away from zero: fresh biases of zero would hide mistakes.
fn weights(network: &Network) -> Weights {
    let mut weights = Weights::random(network, 5);
    let noise = values(6, weights.values.len());
    for (weight, noise) in weights.values.iter_mut().zip(noise) {
        *weight += 0.1 * noise;
    }
    weights
}

fn options(threads: usize) -> TrainOptions {
    TrainOptions {
        threads,
        seed: 3,
        loss: Loss::Mse,
        ..TrainOptions::default()
    }
}

struct Data {
    steps: usize,
    sequences: usize,
    inputs: Vec<f32>,
    targets: Vec<f32>,
}

fn data(network: &Network, steps: usize, sequences: usize) -> Data {
    let steps = if network.is_recurrent() { steps } else { 1 };
    Data {
        steps,
        sequences,
        inputs: values(1, steps * sequences * network.input().len()),
        targets: values(2, steps * sequences * network.output_len()),
    }
}

/// The loss as training sees it, dropout masks of step 0.
fn loss(network: &Network, weights: &Weights, data: &Data) -> f64 {
    let mut trainer = Trainer::new(network.clone(), weights.clone(), options(1)).unwrap();
    let (_, loss) = trainer.gradient(data.steps, data.sequences, &data.inputs, &data.targets);
    f64::from(loss)
}

#[test]
fn gradients_agree_with_differences() {
    for (name, text) in CASES {
        let network = Network::parse(name, text).unwrap();
        let weights = weights(&network);
        let data = data(&network, 3, 5);
        let mut trainer = Trainer::new(network.clone(), weights.clone(), options(2)).unwrap();
        let (gradient, _) = trainer.gradient(data.steps, data.sequences, &data.inputs, &data.targets);
        let mut at = 0;
        for (number, tensor) in network.tensors().filter(|tensor| tensor.is_trainable).enumerate() {
            let own = &gradient[at..at + tensor.len()];
            at += tensor.len();
            // Along the gradient of one tensor the loss changes most, and rounding matters least.
            let norm = own
                .iter()
                .map(|g| f64::from(*g) * f64::from(*g))
                .sum::<f64>()
                .sqrt();
            assert!(norm > 1e-7, "{name}: {} has no gradient", tensor.name);
            let other = values(90 + number as u64, own.len());
            for direction in [own.to_vec(), other] {
                let length = direction
                    .iter()
                    .map(|d| f64::from(*d) * f64::from(*d))
                    .sum::<f64>()
                    .sqrt();
                let shifted = |sign: f64, step: f64| {
                    let mut weights = weights.clone();
                    for (weight, d) in weights.values[tensor.range()].iter_mut().zip(&direction) {
                        *weight += (sign * step * f64::from(*d) / length) as f32;
                    }
                    loss(&network, &weights, &data)
                };
                let measured = |step: f64| (shifted(1.0, step) - shifted(-1.0, step)) / (2.0 * step);
                let expected = own
                    .iter()
                    .zip(&direction)
                    .map(|(g, d)| f64::from(*g) * f64::from(*d) / length)
                    .sum::<f64>();
                // A corner of an activation between the two points is avoided by a smaller step, which rounding disturbs more.
                let nearest = [4e-3, 5e-4, 6e-5]
                    .map(measured)
                    .into_iter()
                    .min_by(|a, b| (a - expected).abs().total_cmp(&(b - expected).abs()))
                    .unwrap();
                // Where many corners are near, differences are a rough measure; PyTorch (parity/) is the exact one.
                let tolerance = if *name == "activations" { 0.06 } else { 0.02 };
                assert!(
                    (nearest - expected).abs() < tolerance * norm + 2e-5,
                    "{name}: {}: {nearest} measured, {expected} computed, gradient {norm}",
                    tensor.name
                );
            }
        }
        assert_eq!(at, gradient.len());
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for network in networks() {
        let data = data(&network, 2, 11);
        let mut results = Vec::new();
        for threads in [1, 2, 3, 8] {
            let mut trainer = Trainer::new(network.clone(), weights(&network), options(threads)).unwrap();
            for _ in 0..2 {
                trainer.step_sequence(data.steps, data.sequences, &data.inputs, &data.targets, None);
            }
            results.push(trainer.weights().clone());
        }
        assert_ne!(results[0], weights(&network), "{}", network.name());
        assert!(
            results.iter().all(|weights| *weights == results[0]),
            "{}",
            network.name()
        );
    }
}

#[test]
fn resumed_is_uninterrupted() {
    for network in networks() {
        let data = data(&network, 2, 5);
        let step = |trainer: &mut Trainer| {
            trainer.reset_state();
            trainer.step_sequence(data.steps, data.sequences, &data.inputs, &data.targets, None)
        };
        let mut whole = Trainer::new(network.clone(), weights(&network), options(1)).unwrap();
        step(&mut whole);
        whole.set_learning_rate(5e-4);
        let state = whole.state();
        step(&mut whole);
        let mut other_options = options(2);
        other_options.seed = 99;
        let mut resumed = Trainer::new(network.clone(), Weights::random(&network, 1), other_options).unwrap();
        resumed.resume(&state).unwrap();
        step(&mut resumed);
        assert_eq!(whole.weights(), resumed.weights(), "{}", network.name());
        assert_eq!(whole.state(), resumed.state());
        for broken in [
            &state[..state.len() - 1],
            &state[..10],
            b"something else that is no state".as_slice(),
        ] {
            assert!(resumed.resume(broken).is_err());
        }
        assert_eq!(whole.state(), resumed.state(), "a refused state changes nothing");
    }
}

#[test]
fn a_batch_of_one_gives_the_bits_of_a_batch_of_many() {
    for network in networks() {
        let weights = weights(&network);
        let count = 5;
        let inputs = values(7, count * network.input().len());
        let mut many = Inference::new(&network, &weights, 8);
        let outputs = many.run(&inputs).to_vec();
        let again = many.run(&inputs).to_vec();
        assert_eq!(network.is_recurrent(), outputs != again, "{}", network.name());
        many.reset_state();
        assert_eq!(many.run(&inputs), outputs);
        for (image, expected) in inputs
            .chunks_exact(network.input().len())
            .zip(outputs.chunks_exact(network.output_len()))
        {
            let mut one = Inference::new(&network, &weights, 1);
            assert_eq!(one.run(image), expected, "{}", network.name());
        }
        let mut trainer = Trainer::new(network.clone(), weights.clone(), options(2)).unwrap();
        let mut predicted = vec![0.0; outputs.len()];
        trainer.predict(&inputs, &mut predicted);
        assert_eq!(predicted, outputs, "{}", network.name());
    }
}

#[test]
fn every_network_learns_a_few_samples_by_heart() {
    for network in networks() {
        let network = Network::parse(
            network.name(),
            &network.to_toml().replace("rate = ", "rate = 0.0 #"),
        )
        .unwrap();
        let data = data(&network, 1, 4);
        let mut trainer = Trainer::new(network.clone(), Weights::random(&network, 1), options(2)).unwrap();
        let first = trainer.step(&data.inputs, &data.targets, None);
        let steps = if network.multiply_adds() > 1_000_000 {
            12
        } else {
            150
        };
        let mut last = first;
        for _ in 0..steps {
            trainer.reset_state();
            last = trainer.step(&data.inputs, &data.targets, None);
        }
        assert!(last < 0.8 * first, "{}: {first} then {last}", network.name());
    }
}

#[test]
fn weights_of_samples_and_outputs_and_clipping_count() {
    let network = Network::named("tinypilotnet").unwrap().with_outputs(2).unwrap();
    let data = data(&network, 1, 2);
    let train = |options: TrainOptions, sample_weights: Option<&[f32]>| {
        let mut trainer = Trainer::new(network.clone(), weights(&network), options).unwrap();
        let loss = trainer.step(&data.inputs, &data.targets, sample_weights);
        (loss, trainer.weights().clone())
    };
    let (_, both) = train(options(1), None);
    let (_, ones) = train(options(1), Some(&[1.0, 1.0]));
    assert_eq!(both, ones);
    let (only_first, _) = train(options(1), Some(&[1.0, 0.0]));
    let (only_second, _) = train(options(1), Some(&[0.0, 1.0]));
    let (all, _) = train(options(1), None);
    assert!((only_first + only_second - all).abs() < 1e-6);
    let no_output = TrainOptions {
        output_weights: vec![0.0, 0.0],
        ..options(1)
    };
    assert_eq!(train(no_output, None).0, 0.0);
    let huber = TrainOptions {
        loss: Loss::Huber { delta: 0.01 },
        ..options(1)
    };
    assert!(train(huber, None).0 < all);
    assert!(
        Trainer::new(
            network.clone(),
            weights(&network),
            TrainOptions {
                output_weights: vec![1.0],
                ..options(1)
            }
        )
        .is_err()
    );
    assert!(Trainer::new(network.clone(), Weights::default(), options(1)).is_err());
    // Adam's first step does not depend on the gradient's length; its memory of squares does.
    let clipped = TrainOptions {
        clip_norm: Some(1e-6),
        ..options(1)
    };
    let mut trainer = Trainer::new(network.clone(), weights(&network), clipped).unwrap();
    trainer.step(&data.inputs, &data.targets, None);
    assert_ne!(*trainer.weights(), both);
}

/// Running statistics only move; what training saw is what inference would see after many steps.
#[test]
fn batch_norms_learn_the_statistics_of_their_input() {
    let text = r#"
        [input]
        height = 1
        width = 4
        channels = 2
        [[layer]]
        kind = "batch_norm"
        momentum = 0.5
        [[layer]]
        kind = "flatten"
        [[layer]]
        kind = "dense"
        units = 1
    "#;
    let network = Network::parse("norm", text).unwrap();
    let mut trainer = Trainer::new(network.clone(), Weights::random(&network, 1), options(2)).unwrap();
    let inputs: Vec<f32> = values(4, 10 * 8).iter().map(|x| 3.0 + 2.0 * x).collect();
    let targets = values(5, 10);
    for _ in 0..40 {
        trainer.step(&inputs, &targets, None);
    }
    let own: Vec<f32> = inputs
        .chunks_exact(8)
        .flat_map(|image| image[..4].to_vec())
        .collect();
    let mean = own.iter().sum::<f32>() / own.len() as f32;
    let variance = own.iter().map(|x| (x - mean) * (x - mean)).sum::<f32>() / own.len() as f32;
    let tensor = |name: &str| network.tensors().find(|t| t.name.ends_with(name)).unwrap().offset;
    let weights = &trainer.weights().values;
    assert!((weights[tensor("running_mean")] - mean).abs() < 1e-4);
    assert!((weights[tensor("running_var")] - variance).abs() < 1e-4);
}
