//! Writes what this engine computes for networks, for `parity/parity.py` to compare:
//! `cargo run --release -p senda_nets --example parity -- FOLDER NETWORK...` (names, network files or ONNX files).
#![allow(clippy::print_stdout, reason = "a tool for developers")]

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use senda_nets::{
    Imported, Inference, InputSpec, Model, Network, OutputSpec, Provenance, TrainOptions, Trainer, Weights,
};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("expected a folder and networks")?;
    for argument in arguments {
        let path = Path::new(&argument);
        if !argument.contains('=') && path.extension().is_some_and(|extension| extension == "onnx") {
            let imported = Imported::load(path)?;
            let name = path.file_stem().unwrap_or_default();
            let folder = Path::new(&folder).join(name);
            write(&folder, &imported.network, imported.weights)?;
            std::fs::copy(path, folder.join("network.onnx"))?;
            println!("{}", path.display());
            continue;
        }
        // NETWORK@8 is the network on an 8-bit grid.
        if let Some(name) = argument.strip_suffix("@8") {
            write_quantised(&Path::new(&folder).join(&argument), &Network::named(name)?)?;
            println!("{argument}");
            continue;
        }
        // NETWORK=FILE adopts the weights of a safetensors or ONNX file.
        let (argument, adopted) = match argument.split_once('=') {
            Some((network, file)) => (network.to_owned(), Some(file.to_owned())),
            None => (argument, None),
        };
        let network = match Network::named(&argument) {
            Ok(network) => network,
            Err(_) => Network::load(Path::new(&argument))?,
        };
        // Other frameworks draw other masks.
        let text = network.to_toml();
        let lines = text.lines().map(|line| {
            if line.starts_with("rate = ") {
                "rate = 0.0"
            } else {
                line
            }
        });
        let network = Network::parse(&argument, &lines.collect::<Vec<_>>().join("\n"))?;
        let folder = Path::new(&folder).join(network.name());
        let mut weights = noisy_weights(&network);
        if let Some(file) = adopted {
            let adopted = weights.adopt(&network, Path::new(&file))?;
            println!(
                "{} tensors of {file}, not {:?}",
                adopted.filled.len(),
                adopted.kept
            );
        }
        write(&folder, &network, weights.clone())?;
        std::fs::write(folder.join("network.onnx"), network.to_onnx(&weights))?;
        println!("{}", network.name());
    }
    Ok(())
}

fn noise(seed: u64, count: usize) -> Vec<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| random.random_range(-1.0..1.0)).collect()
}

fn noisy_weights(network: &Network) -> Weights {
    let mut weights = Weights::random(network, 3);
    let shift = noise(7, weights.values.len());
    for tensor in network.tensors() {
        for i in tensor.range() {
            // Variances stay positive.
            weights.values[i] += if tensor.name.ends_with("running_var") {
                0.4
            } else {
                0.05
            } * shift[i];
        }
    }
    weights
}

fn write(folder: &Path, network: &Network, weights: Weights) -> Result<(), Box<dyn std::error::Error>> {
    std::fs::create_dir_all(folder)?;
    let steps = if network.is_recurrent() { 3 } else { 1 };
    let batch = if network.multiply_adds() > 100_000_000 {
        2
    } else {
        6
    };
    let inputs = noise(8, steps * batch * network.input().len());
    let targets = noise(9, steps * batch * network.output_len());
    let mut inference = Inference::new(network, &weights, batch);
    let mut outputs = Vec::new();
    for step in inputs.chunks_exact(batch * network.input().len()) {
        outputs.extend_from_slice(inference.run(step));
    }
    let options = TrainOptions {
        threads: 2,
        ..TrainOptions::default()
    };
    let mut trainer = Trainer::new(network.clone(), weights.clone(), options)?;
    let (gradient, loss) = trainer.gradient(steps, batch, &inputs, &targets);
    std::fs::write(folder.join("network.toml"), network.to_toml())?;
    std::fs::write(folder.join("shape.txt"), format!("{steps} {batch} {loss:?}"))?;
    for (name, values) in [
        ("weights", &weights.values),
        ("inputs", &inputs),
        ("targets", &targets),
        ("outputs", &outputs),
        ("gradient", &gradient),
    ] {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        std::fs::write(folder.join(name), bytes)?;
    }
    Ok(())
}

fn write_quantised(folder: &Path, network: &Network) -> Result<(), Box<dyn std::error::Error>> {
    std::fs::create_dir_all(folder)?;
    let shape = network.input();
    let output = OutputSpec {
        name: "output".to_owned(),
        unit: String::new(),
    };
    let model = Model {
        network: network.clone(),
        weights: noisy_weights(network),
        input: InputSpec::of(shape),
        outputs: vec![output; network.output_len()],
        provenance: Provenance::default(),
        grids: vec![],
        detection: None,
        forgets: false,
    };
    let batch = 6;
    let inputs = noise(8, batch * shape.len());
    let quantised = model.quantised(&inputs)?;
    let mut inference = quantised.inference();
    let outputs: Vec<f32> = inputs
        .chunks_exact(shape.len())
        .flat_map(|input| inference.run(input).to_vec())
        .collect();
    std::fs::write(folder.join("shape.txt"), format!("1 {batch} 0"))?;
    std::fs::write(folder.join("network.onnx"), quantised.to_onnx())?;
    for (name, values) in [("inputs", &inputs), ("outputs", &outputs)] {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        std::fs::write(folder.join(name), bytes)?;
    }
    Ok(())
}
