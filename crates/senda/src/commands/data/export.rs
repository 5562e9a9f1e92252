//! `senda data export`: recordings for other people's programs.

use crate::terminal;
use anyhow::{Context, Result};
use clap::Args;
use senda_data::Format;
use senda_run::scenario::find_vehicle;
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Recording or folder of recordings, tub, Udacity folder or named pictures
    data: PathBuf,
    /// tub (Donkeycar), udacity or named-frames (the angle in the name)
    #[arg(long, value_name = "FORMAT", value_parser = parse_format)]
    format: Format,
    /// New or empty folder; several runs become folders in it
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Vehicle that foreign data come from
    #[arg(long, default_value = "donkeycar")]
    vehicle: String,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

fn parse_format(text: &str) -> Result<Format, String> {
    let wanted = text.replace('-', "_");
    Format::ALL
        .into_iter()
        .filter(|format| *format != Format::Recording)
        .find(|format| format.name() == wanted)
        .ok_or_else(|| format!("expected tub, udacity or named-frames, but found `{text}`"))
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let body = find_vehicle(&arguments.vehicle)?.body();
    let all = senda_data::export(&arguments.data, &body, arguments.format, &arguments.out)
        .with_context(|| format!("cannot export {}", arguments.data.display()))?;
    let warnings: Vec<String> = all.iter().flat_map(|run| run.warnings.clone()).collect();
    terminal::warn(&warnings);
    if arguments.json {
        say!("{}", serde_json::to_string_pretty(&all)?)?;
        return Ok(());
    }
    for run in all {
        let skipped = match run.skipped {
            0 => String::new(),
            count => format!(", {count} steps without a usable picture left out"),
        };
        say!("{}: {} frames{skipped}", run.path.display(), run.frames)?;
    }
    Ok(())
}
