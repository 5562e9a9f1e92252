//! Speed of the engine: `cargo run --release -p senda_nets --example speed`. Medians of several rounds.
#![allow(
    clippy::print_stdout,
    clippy::disallowed_types,
    reason = "a measurement for a person to read"
)]

use senda_nets::{Inference, Network, TrainOptions, Trainer, Weights};
use std::time::Instant;

fn median(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_by(f64::total_cmp);
    seconds[seconds.len() / 2]
}

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    println!("Training: batches of 32; networks with a memory learn from 16 moments of 32 runs.");
    println!("network                       inference ms   images/s training: 1 thread   2 threads");
    for name in Network::names().filter(|name| wanted.is_empty() || wanted.iter().any(|w| w == name)) {
        let network = Network::named(name).expect("a ready network");
        let weights = Weights::random(&network, 1);
        let repeats = (100_000_000 / network.multiply_adds()).clamp(1, 2_000) as usize;
        let mut inference = Inference::new(&network, &weights, 1);
        let input = vec![0.25; network.input().len()];
        let single = median(
            (0..9)
                .map(|_| {
                    let start = Instant::now();
                    for _ in 0..repeats {
                        inference.run(&input);
                    }
                    start.elapsed().as_secs_f64() / repeats as f64
                })
                .collect(),
        );
        let mut rates = [0.0; 2];
        for (rate, threads) in rates.iter_mut().zip([1, 2]) {
            let options = TrainOptions {
                threads,
                ..TrainOptions::default()
            };
            let mut trainer =
                Trainer::new(network.clone(), weights.clone(), options).expect("a good trainer");
            let moments = if network.is_recurrent() { 16 } else { 1 };
            let count = moments * 32;
            let inputs: Vec<f32> = (0..count * network.input().len())
                .map(|i| (i % 97) as f32 / 97.0)
                .collect();
            let targets = vec![0.1; count * network.output_len()];
            trainer.step_sequence(moments, 32, &inputs, &targets, None);
            let steps = (repeats / 16 / moments).max(1);
            let seconds = median(
                (0..7)
                    .map(|_| {
                        let start = Instant::now();
                        for _ in 0..steps {
                            trainer.step_sequence(moments, 32, &inputs, &targets, None);
                        }
                        start.elapsed().as_secs_f64() / steps as f64
                    })
                    .collect(),
            );
            *rate = count as f64 / seconds;
        }
        println!("{name:30}{:10.4}{:28.0}{:12.0}", 1e3 * single, rates[0], rates[1]);
    }
}
