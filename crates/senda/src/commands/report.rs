//! `senda report`: a page of recordings; and the page that other commands write.

use super::write_file;
use crate::terminal;
use anyhow::Result;
use clap::Args;
use senda_data::{Recording, open::recordings_among};
use senda_eval::{
    Summary,
    report::{self, Look, Page, ReportRun},
};
use senda_run::{Scenario, referee, replay::recorded_world};
use std::path::PathBuf;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Recordings (MCAP)
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Where to write the report (one HTML file)
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
    /// Title of the page
    #[arg(long, default_value = "Recorded runs")]
    title: String,
    /// Show in the player what this model looks at (VisualBackProp)
    #[arg(long, value_name = "MODEL")]
    look: Option<PathBuf>,
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let mut runs = Vec::new();
    let (recordings, left_out) = recordings_among(&arguments.recordings);
    terminal::warn(&left_out);
    for path in &recordings {
        let recording = super::replay::read_recording(path)?;
        let mut run = PageRun::recorded(recording);
        if let Some(model) = &arguments.look {
            run.look = Some(super::look::for_player(model, &run.recording)?);
        }
        runs.push(run);
    }
    write_file(
        &arguments.out,
        page(&arguments.title, &command_line(), &runs)?.as_bytes(),
    )?;
    say!("{}", arguments.out.display())?;
    Ok(())
}

/// A run to put on a page.
pub(crate) struct PageRun {
    pub(crate) recording: Recording,
    /// Taken from the recording where it has one.
    pub(crate) summary: Summary,
    pub(crate) frame_times_ns: Vec<u64>,
    pub(crate) look: Option<Look>,
}

impl PageRun {
    /// With the summary that the recording holds, or a new one where it was cut short or imported: what an import holds
    /// has no figures of a run.
    pub(crate) fn recorded(recording: Recording) -> Self {
        let held = recording
            .summary
            .clone()
            .filter(|_| recording.header.origin().is_none())
            .and_then(|value| serde_json::from_value(value).ok());
        let summary = held.unwrap_or_else(|| Summary::from_recording(&recording, None));
        Self {
            recording,
            summary,
            frame_times_ns: Vec::new(),
            look: None,
        }
    }
}

/// One page of runs, in their worlds where they had one.
pub(crate) fn page(title: &str, command: &str, runs: &[PageRun]) -> Result<String> {
    let mut worlds = Vec::new();
    for run in runs {
        worlds.push(recorded_world(&run.recording)?);
    }
    let scenarios: Vec<Option<Scenario>> = runs
        .iter()
        .map(|run| toml::from_str(&run.recording.header.scenario).ok())
        .collect();
    let commands: Vec<String> = scenarios
        .iter()
        .map(|scenario| scenario.as_ref().map_or(String::new(), as_command))
        .collect();
    let times_s: Vec<Vec<f64>> = runs
        .iter()
        .map(|run| run.frame_times_ns.iter().map(|ns| *ns as f64 * 1e-9).collect())
        .collect();
    let titles: Vec<String> = runs.iter().map(|run| foreign_title(&run.recording)).collect();
    let shown: Vec<ReportRun> = runs
        .iter()
        .enumerate()
        .map(|(i, run)| ReportRun {
            title: &titles[i],
            summary: &run.summary,
            recording: &run.recording,
            world: worlds[i].as_ref(),
            course: match (&scenarios[i], &worlds[i]) {
                (Some(scenario), Some(world)) => Some(referee::course(scenario, world)),
                _ => None,
            },
            command: &commands[i],
            frame_times_s: &times_s[i],
            look: run.look.as_ref(),
        })
        .collect();
    let mut head = Page::new(title, command);
    head.notes = runs
        .iter()
        .flat_map(|run| run.recording.warnings.iter().cloned())
        .take(20)
        .collect();
    Ok(report::html(&head, &shown))
}

/// `human on donkeycar, tub warehouse` of imported data; empty for runs of senda, whose world and driver name them.
fn foreign_title(recording: &Recording) -> String {
    let header = &recording.header;
    let title = |origin: senda_data::Origin| {
        let (driver, vehicle) = (&header.driver, &header.body.name);
        format!("{driver} on {vehicle}, {} {}", origin.format, origin.source)
    };
    header.origin().map_or_else(String::new, title)
}

/// The command line that repeats a scenario.
pub(crate) fn as_command(scenario: &Scenario) -> String {
    let mut words = vec![
        format!(
            "senda drive --world {} --vehicle {} --driver {}",
            scenario.world, scenario.vehicle, scenario.driver
        ),
        format!("--laps {} --seed {}", scenario.laps, scenario.seed),
    ];
    let mut flag = |name: &str, value: Option<String>| {
        if let Some(value) = value {
            words.push(format!("--{name} {value}"));
        }
    };
    flag("package", scenario.package.clone());
    flag("light", scenario.light.clone());
    flag("floor", scenario.floor.clone());
    flag("speed", scenario.speed_mps.map(|speed| speed.to_string()));
    flag(
        "image",
        scenario
            .image_px
            .map(|[width, height]| format!("{width}x{height}")),
    );
    let start = scenario.start;
    let nonzero = |value: f64| (value != 0.0).then(|| value.to_string());
    flag("latency", nonzero(scenario.latency_s));
    flag("lost-frames", nonzero(scenario.lost_frames));
    flag("start-station", nonzero(start.station_m));
    flag("start-offset", nonzero(start.offset_m));
    flag("start-heading", nonzero(start.heading_rad));
    flag("start-speed", nonzero(start.speed_mps));
    flag("time-limit", scenario.time_limit_s.map(|limit| limit.to_string()));
    flag("calibration", scenario.calibration.clone());
    for (key, value) in &scenario.driver_options {
        words.push(format!("--option '{key}={value}'"));
    }
    if scenario.reverse {
        words.push("--reverse".into());
    }
    words.join(" ")
}

/// The command line as it was typed.
pub(crate) fn command_line() -> String {
    let words = std::env::args().skip(1).map(|word| {
        if word.contains(' ') {
            format!("'{word}'")
        } else {
            word
        }
    });
    std::iter::once("senda".to_owned())
        .chain(words)
        .collect::<Vec<_>>()
        .join(" ")
}
