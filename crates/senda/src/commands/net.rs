//! `senda net`: networks as lists of layers.

use anyhow::Result;
use clap::{Args, Subcommand};
use senda_learn::learn::find_network;
use senda_nets::{Network, Shape};

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Names of the ready networks
    List {
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Layers, shapes, parameters and multiply-adds
    Show {
        /// Ready network or network file
        network: String,
        /// Print as JSON
        #[arg(long)]
        json: bool,
    },
    /// Print the network's file, to change it
    Print {
        /// Ready network or network file
        network: String,
    },
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    match arguments.command {
        Command::List { json } => {
            if json {
                let mut all = Vec::new();
                for name in Network::names() {
                    let network = Network::named(name)?;
                    all.push(serde_json::json!({
                        "name": name,
                        "parameters": network.parameter_count(),
                        "multiply_adds": network.multiply_adds(),
                        "description": network.description(),
                    }));
                }
                return crate::terminal::print(&serde_json::to_string_pretty(&all)?);
            }
            for name in Network::names() {
                let network = Network::named(name)?;
                say!(
                    "{name:26} {:>9} parameters  {:>8.2} M multiply-adds  {}",
                    network.parameter_count(),
                    network.multiply_adds() as f64 * 1e-6,
                    network.description()
                )?;
            }
        }
        Command::Show { network, json } => show(&find_network(&network)?, json)?,
        Command::Print { network } => say!("{}", find_network(&network)?.to_toml().trim_end())?,
    }
    Ok(())
}

fn shape(shape: Shape) -> String {
    if shape.is_flat() {
        shape.len().to_string()
    } else {
        format!("{}x{}x{}", shape.height, shape.width, shape.channels)
    }
}

/// Layers, shapes, parameters, multiply-adds.
pub(crate) fn show(network: &Network, json: bool) -> Result<()> {
    if json {
        let layers: Vec<_> = network
            .layers()
            .iter()
            .map(|layer| {
                serde_json::json!({
                    "name": layer.name,
                    "kind": layer.kind.name(),
                    "output": [layer.output.height, layer.output.width, layer.output.channels],
                    "parameters": layer.parameter_count(),
                    "trainable": layer.trainable_count(),
                    "multiply_adds": layer.multiply_adds,
                })
            })
            .collect();
        let input = network.input();
        let value = serde_json::json!({
            "name": network.name(),
            "input": [input.height, input.width, input.channels],
            "layers": layers,
            "parameters": network.parameter_count(),
            "trainable": network.trainable_count(),
            "multiply_adds": network.multiply_adds(),
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    say!("{}  {}", network.name(), network.description())?;
    say!(
        "{:24} {:20} {:>14} {:>12} {:>14}",
        "layer",
        "kind",
        "output",
        "parameters",
        "multiply-adds"
    )?;
    say!("{:24} {:20} {:>14}", "input", "", shape(network.input()))?;
    for layer in network.layers() {
        say!(
            "{:24} {:20} {:>14} {:>12} {:>14}",
            layer.name,
            layer.kind.name(),
            shape(layer.output),
            layer.parameter_count(),
            layer.multiply_adds
        )?;
    }
    say!(
        "{} parameters, {} of them trainable; {:.2} M multiply-adds",
        network.parameter_count(),
        network.trainable_count(),
        network.multiply_adds() as f64 * 1e-6
    )?;
    Ok(())
}
