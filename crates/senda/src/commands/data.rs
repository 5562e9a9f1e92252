//! `senda data …`: look into data, clean, split and convert them.

mod clean;
mod export;
mod split;
mod stats;

use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::{Args, Subcommand};
use senda_run::scenario::find_vehicle;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// What is in a data set: frames, duration, cameras, steering
    Info {
        /// Recording (MCAP), Donkeycar tub, Udacity folder or named pictures; folders or .tar.gz
        data: PathBuf,
        /// Vehicle that foreign data come from
        #[arg(long, default_value = "donkeycar")]
        vehicle: String,
        /// Print as JSON
        #[arg(long)]
        json: bool,
    },
    /// Histogram, speeds, suspicious frames, and whether the camera has moved; edits applied
    Stats(stats::Arguments),
    /// Leave out frames and correct labels, in a file beside the data
    Clean(clean::Arguments),
    /// Show which runs a network would learn from and which would judge it
    Split(split::Arguments),
    /// Write recordings for other programs (Donkeycar, Udacity, named pictures); edits applied
    Export(export::Arguments),
    /// Turn foreign data into recordings
    Import {
        /// Donkeycar tub, Udacity folder or named pictures; folder or .tar.gz
        data: PathBuf,
        /// Folder for the recordings
        #[arg(long, value_name = "DIR", default_value = "recordings")]
        out: PathBuf,
        /// Vehicle that the data come from
        #[arg(long, default_value = "donkeycar")]
        vehicle: String,
        /// Print as JSON
        #[arg(long)]
        json: bool,
    },
}

/// The end of a command that showed data in which there is nothing to use.
fn expect_steps(steps: usize, data: &Path) -> Result<()> {
    if steps == 0 {
        bail!(
            "{}: expected records that can be used, but found none; the warnings say why",
            data.display()
        );
    }
    Ok(())
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    match arguments.what {
        What::Info { data, vehicle, json } => {
            let body = find_vehicle(&vehicle)?.body();
            let info = senda_data::info(&data, &body)?;
            if json {
                say!("{}", serde_json::to_string_pretty(&info)?)?;
            } else {
                say!("{}", info)?;
            }
            expect_steps(info.steps, &data)
        }
        What::Stats(arguments) => stats::run(arguments),
        What::Clean(arguments) => clean::run(arguments),
        What::Split(arguments) => split::run(arguments),
        What::Export(arguments) => export::run(arguments),
        What::Import {
            data,
            out,
            vehicle,
            json,
        } => {
            let body = find_vehicle(&vehicle)?.body();
            let all = senda_data::import(&data, &body, &out)
                .with_context(|| format!("cannot import {}", data.display()))?;
            if json {
                say!("{}", serde_json::to_string_pretty(&all)?)?;
                return Ok(());
            }
            for written in all {
                say!(
                    "{}: {} steps, {:.1} s",
                    written.path.display(),
                    written.steps,
                    written.duration_s
                )?;
                terminal::warn(&written.warnings);
            }
            Ok(())
        }
    }
}
