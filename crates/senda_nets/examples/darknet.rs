//! Writes what `parity/darknet_parity.py` compares: a detector's `.cfg` and `.weights` with random values, inputs, what the
//! engine answers and finds, and its ONNX form; measures the time of an answer.
//!
//! `cargo run --release -p senda_nets --example darknet -- FOLDER [DETECTOR...]`
#![allow(
    clippy::print_stdout,
    clippy::disallowed_types,
    reason = "a measurement for a person to read"
)]

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use senda_nets::{Darknet, DarknetWeights, Inference, Weights};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folder, names) = arguments
        .split_first()
        .ok_or("give a folder, and detectors if not all")?;
    let all: Vec<String> = Darknet::names().map(str::to_owned).collect();
    for name in if names.is_empty() { &all } else { names } {
        write(&Path::new(folder).join(name), &Darknet::find(name)?)?;
    }
    Ok(())
}

/// Values as darknet's training leaves them: kernels of unit gain, statistics around 0 and 1.
fn weights(darknet: &Darknet) -> Weights {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut weights = Weights::random(&darknet.network, 1);
    for tensor in darknet.network.tensors() {
        let [low, high] = match tensor.name.rsplit('.').next() {
            Some("running_var") => [0.3, 1.7],
            Some("weight") if tensor.shape.len() == 1 => [0.8, 1.6],
            Some("weight") => continue,
            _ => [-0.3, 0.3],
        };
        for value in &mut weights.values[tensor.range()] {
            *value = random.random_range(low..high);
        }
    }
    weights
}

fn write(folder: &Path, darknet: &Darknet) -> Result<(), Box<dyn std::error::Error>> {
    std::fs::create_dir_all(folder)?;
    let network = &darknet.network;
    let written = DarknetWeights {
        weights: weights(darknet),
        seen: 64,
        convolutions: 0,
    };
    std::fs::write(folder.join("network.cfg"), darknet.to_cfg()?)?;
    let bytes = written.to_bytes(network)?;
    std::fs::write(folder.join("network.weights"), &bytes)?;
    // What is measured and compared is what was read back.
    let text = std::fs::read_to_string(folder.join("network.cfg"))?;
    let darknet = Darknet::parse("network.cfg", &text)?;
    let read = DarknetWeights::from_bytes("network.weights", &bytes, &darknet.network, None)?;
    let (folded, folded_weights) = darknet.network.folded(&read.weights);
    std::fs::write(folder.join("network.onnx"), folded.to_onnx(&folded_weights))?;
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let shape = darknet.network.input();
    let input: Vec<f32> = (0..shape.len()).map(|_| random.random_range(0.0..1.0)).collect();
    let mut exact = Inference::new(&darknet.network, &read.weights, 1);
    let output = exact.run(&input).to_vec();
    let mut found = Vec::new();
    darknet
        .detection
        .decode(&output, [shape.width, shape.height], 0.0, &mut found);
    let boxes: Vec<f32> = found
        .iter()
        .filter(|one| one.class == 0)
        .flat_map(|one| {
            [
                one.rect.x,
                one.rect.y,
                one.rect.width,
                one.rect.height,
                one.confidence,
            ]
        })
        .collect();
    for (name, values) in [("inputs", &input), ("outputs", &output), ("boxes", &boxes)] {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        std::fs::write(folder.join(name), bytes)?;
    }
    let mut fast = Inference::new(&folded, &folded_weights, 1);
    let mut times: Vec<f64> = (0..20)
        .map(|_| {
            let begin = std::time::Instant::now();
            fast.run(&input);
            begin.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    std::fs::write(folder.join("milliseconds"), format!("{} {}", times[0], times[10]))?;
    println!(
        "{}: {} multiply-adds, {:.1} ms at best, {:.1} ms in the median of 20, one thread",
        folder.display(),
        folded.multiply_adds(),
        times[0],
        times[10]
    );
    Ok(())
}
