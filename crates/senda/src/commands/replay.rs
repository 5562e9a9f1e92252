//! `senda replay`: a driver over recorded or real frames.

use super::{
    drive::{merge, parse_option_list},
    report::{PageRun, command_line, page},
    watched_lane, write_file,
};
use crate::terminal;
use anyhow::{Result, anyhow, bail};
use clap::Args;
use senda_data::Recording;
use senda_eval::{
    Summary, agreement,
    report::{Page, real_data_html},
    text,
};
use senda_run::{
    calibration::{believed_body, note},
    replay,
    scenario::find_vehicle,
};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Recording (MCAP), or a Donkeycar tub (folder or .tar.gz)
    data: PathBuf,
    /// Another driver than the recorded one; for foreign data, imported or not, `lane` unless given
    #[arg(long, value_name = "DRIVER")]
    driver: Option<String>,
    /// Trained network for the driver `neural`
    #[arg(long, value_name = "FILE")]
    model: Option<String>,
    /// Vehicle that foreign data come from, donkeycar unless given: its camera tells where the floor is (recordings and imported
    /// data bring theirs)
    #[arg(long, value_name = "VEHICLE")]
    vehicle: Option<String>,
    /// Calibration file of the camera that the data come from: where the floor is, instead of what the vehicle's file says
    #[arg(long, value_name = "FILE")]
    calibration: Option<String>,
    /// Another cruising speed in m/s
    #[arg(long, value_name = "MPS")]
    speed: Option<f64>,
    /// Option of the driver, as `key=value` (value in TOML); may be repeated
    #[arg(long = "option", value_name = "KEY=VALUE")]
    options: Vec<String>,
    /// Write a report (one HTML file)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// A recording of ours, with its warnings printed.
pub(crate) fn read_recording(path: &Path) -> Result<Recording> {
    if !path.exists() {
        bail!("{}: no such file", path.display());
    }
    let recording = Recording::read(path)?;
    terminal::warn(&recording.warnings);
    Ok(recording)
}

/// Any data, with the camera that their vehicle is believed to have.
fn open(path: &Path, vehicle: Option<&str>, calibration: Option<&str>) -> Result<Recording> {
    if !path.exists() {
        bail!("{}: no such file or folder", path.display());
    }
    let body = find_vehicle(vehicle.unwrap_or("donkeycar"))?.body();
    let mut recording = senda_data::open(path, &body)?;
    terminal::warn(&recording.warnings);
    if recording.steps.is_empty() {
        bail!(
            "{}: expected steps to replay, but found none that can be used; the warnings say why",
            path.display()
        );
    }
    let own = &recording.header.body;
    if vehicle.is_some() && own.name != body.name {
        terminal::warn(&[format!(
            "{}: it brings its own vehicle, {}: --vehicle is for data that bring none, and is left out",
            path.display(),
            own.name
        )]);
    }
    terminal::warn(&Vec::from_iter(note(own, calibration)?));
    recording.header.body = believed_body(own, calibration)?;
    Ok(recording)
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let recording = open(
        &arguments.data,
        arguments.vehicle.as_deref(),
        arguments.calibration.as_deref(),
    )?;
    let foreign = recording.header.origin().is_some();
    let driver = arguments
        .driver
        .clone()
        .or_else(|| foreign.then(|| "lane".to_owned()));
    let mut driver_options = toml::Table::new();
    if let Some(model) = &arguments.model {
        driver_options.insert("model".to_owned(), model.as_str().into());
    }
    merge(&mut driver_options, parse_option_list(&arguments.options)?);
    if foreign && driver.as_deref() == Some("lane") {
        driver_options = watched_lane::options(&recording.header.body, &driver_options);
        tell!(
            "options for a vehicle that does not obey: {}",
            watched_lane::words(&driver_options)
        );
    }
    let options = replay::Options {
        driver,
        speed_mps: arguments.speed,
        driver_options,
    };
    let changed = options
        .driver
        .as_deref()
        .is_some_and(|driver| driver != recording.header.driver)
        || options.speed_mps.is_some()
        || arguments.calibration.is_some()
        || !options.driver_options.is_empty();
    let human = recording.clone();
    let bar = terminal::bar("replay");
    let mut ears = terminal::ears(&bar);
    let replayed = replay::run(recording, &options, &mut ears)?;
    drop(ears);
    bar.finish_and_clear();
    let agreement = agreement::of_recordings(&human, &replayed.recording);
    let times_s: Vec<f64> = replayed
        .frame_times_ns
        .iter()
        .map(|ns| *ns as f64 * 1e-9)
        .collect();
    let summary = Summary::from_recording(&replayed.recording, None).with_frame_times(&times_s);
    let longest_s = times_s.iter().copied().reduce(f64::max);
    if let Some(path) = &arguments.report {
        let page = if foreign {
            let title = format!("{} on real frames", replayed.recording.header.driver);
            let mut head = Page::new(&title, &command_line());
            head.notes.clone_from(&replayed.recording.warnings);
            real_data_html(&head, &human, &replayed.recording, &times_s)
        } else {
            let mut run = PageRun::recorded(replayed.recording.clone());
            run.summary = summary.clone();
            run.frame_times_ns.clone_from(&replayed.frame_times_ns);
            page("Replay", &command_line(), &[run])?
        };
        write_file(path, page.as_bytes())?;
        tell!("report: {}", path.display());
    }
    // Whoever made it: the same observations through the same driver give the same commands.
    let verdict = if foreign || changed || replayed.unexplained == 0 {
        Ok(())
    } else {
        Err(anyhow!(
            "{} of {} commands differ from the recorded ones: the recording was made by another version of senda ({}), or senda is broken",
            replayed.different_commands,
            replayed.steps,
            human.header.senda
        ))
    };
    if arguments.json {
        let value = serde_json::json!({
            "steps": replayed.steps,
            "recorded_steps": replayed.recorded_steps,
            "interrupted": replayed.interrupted,
            "different_commands": replayed.different_commands,
            "gaps": replayed.gaps,
            "warnings": human.warnings,
            "damaged_frames": replayed.damaged_frames,
            "found_rate": summary.found_rate,
            "lost": summary.lost,
            "frame_time_mean_s": summary.frame_time_mean_s,
            "frame_time_p95_s": summary.frame_time_p95_s,
            "frame_time_max_s": longest_s,
            "driver": replayed.recording.header.driver,
            "agreement": agreement,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return verdict;
    }
    say!(
        "{} steps replayed with driver {}",
        replayed.steps,
        replayed.recording.header.driver
    )?;
    if let Some(interruption) = replayed.interruption() {
        say!("{interruption}")?;
    }
    if replayed.damaged_frames > 0 {
        say!("{} damaged frames left out", replayed.damaged_frames)?;
    }
    if let Some(found) = summary.found_rate {
        say!("line or lane found in {:.1} % of the frames", found * 100.0)?;
    }
    if let (Some(mean_s), Some(longest_s)) = (summary.frame_time_mean_s, longest_s) {
        say!(
            "time a frame: mean {} ms, largest {} ms",
            text::short(1e3 * mean_s),
            text::short(1e3 * longest_s)
        )?;
    }
    if foreign {
        say!("{}", agreement.to_text())?;
    } else if replayed.different_commands == 0 {
        say!("every command equals the recorded one")?;
    } else if changed {
        say!(
            "{} commands differ from the recorded driver's",
            replayed.different_commands
        )?;
    } else if let (0, Some(step)) = (replayed.unexplained, replayed.first_damaged) {
        say!(
            "{} commands differ from the recorded ones, all of them from {:.3} s on, where the recording is damaged: a driver that \
             remembers answers otherwise there",
            replayed.different_commands,
            human.steps[step].stamp.as_s()
        )?;
    }
    verdict
}
