//! `senda drive`: one run.

use super::{
    hands::{HandFlags, Mode, Prepared, seat},
    report::{PageRun, command_line, page},
    write_file,
};
use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::Args;
use senda_eval::Summary;
use senda_run::{
    Scenario,
    drive::{self, Ending},
    scenario::{usual_driver, usual_vehicle},
};
use std::{
    fs::File,
    io::{self, BufWriter, Cursor, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

/// The flags that make a scenario; each overrides the same key of a scenario file.
#[derive(Args, Clone, Default)]
pub(crate) struct ScenarioFlags {
    /// Scenario file (TOML), or a recording (MCAP) to repeat; flags override its keys
    #[arg(long, value_name = "FILE")]
    pub(crate) scenario: Option<PathBuf>,
    /// Ready world, world file or `random-line:SEED` (`senda world list` shows the names)
    #[arg(long, value_name = "WORLD")]
    pub(crate) world: Option<String>,
    /// Ready vehicle or vehicle file [usual: the one that `senda world list` names for --world]
    #[arg(long, value_name = "VEHICLE")]
    pub(crate) vehicle: Option<String>,
    /// line, lane, hough, neural, mission, expert or human [usual: the one that follows what --world has]
    #[arg(long, value_name = "DRIVER")]
    pub(crate) driver: Option<String>,
    /// Trained network for the driver `neural`
    #[arg(long, value_name = "FILE")]
    pub(crate) model: Option<String>,
    /// Laps to drive
    #[arg(long, value_name = "N")]
    pub(crate) laps: Option<u32>,
    /// Seed of every random number
    #[arg(long, value_name = "S")]
    pub(crate) seed: Option<u64>,
    /// Light instead of the world's own (daylight, lamp, …)
    #[arg(long, value_name = "LIGHT")]
    pub(crate) light: Option<String>,
    /// Floor instead of the world's own (plain, speckled, glossy, …)
    #[arg(long, value_name = "FLOOR")]
    pub(crate) floor: Option<String>,
    /// Cruising speed in m/s
    #[arg(long, value_name = "MPS", allow_negative_numbers = true)]
    pub(crate) speed: Option<f64>,
    /// Drive the other way round
    #[arg(long)]
    pub(crate) reverse: bool,
    /// Image size, such as 160x120
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub(crate) image: Option<[u32; 2]>,
    /// Further delay from the camera to the driver, in s
    #[arg(long, value_name = "S")]
    pub(crate) latency: Option<f64>,
    /// Part of the frames that get lost on the way, 0 to 1
    #[arg(long, value_name = "PART")]
    pub(crate) lost_frames: Option<f64>,
    /// Start this much further along the path, in m
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub(crate) start_station: Option<f64>,
    /// Start this far to the left of the path, in m
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub(crate) start_offset: Option<f64>,
    /// Start turned to the left of the path's direction, in rad
    #[arg(long, value_name = "RAD", allow_negative_numbers = true)]
    pub(crate) start_heading: Option<f64>,
    /// Start rolling already, in m/s
    #[arg(long, value_name = "MPS", allow_negative_numbers = true)]
    pub(crate) start_speed: Option<f64>,
    /// The heading in degrees
    #[arg(
        long,
        value_name = "DEG",
        allow_negative_numbers = true,
        conflicts_with = "start_heading"
    )]
    pub(crate) start_heading_deg: Option<f64>,
    /// Calibration file: the driver believes its camera instead of the vehicle file's
    #[arg(long, value_name = "FILE")]
    pub(crate) calibration: Option<String>,
    /// In a warehouse: what the package's code says (I0, I1, …)
    #[arg(long, value_name = "CODE")]
    pub(crate) package: Option<String>,
    /// End the run after this time, in s
    #[arg(long, value_name = "S")]
    pub(crate) time_limit: Option<f64>,
    /// Option of the driver, as `key=value` (value in TOML); may be repeated
    #[arg(long = "option", value_name = "KEY=VALUE")]
    pub(crate) options: Vec<String>,
}

impl ScenarioFlags {
    /// The scenario file with the flags laid over it.
    pub(crate) fn scenario(&self) -> Result<Scenario> {
        let scenario = match &self.scenario {
            Some(path) => Scenario::load(path)?,
            None => {
                let world = self.world.as_deref().unwrap_or("oval");
                let driver = self.driver.as_deref().unwrap_or_else(|| usual_driver(world));
                Scenario::new(world, usual_vehicle(world), driver)
            }
        };
        self.over(scenario)
    }

    /// The flags laid over a scenario.
    pub(crate) fn over(&self, mut scenario: Scenario) -> Result<Scenario> {
        let given = scenario.clone();
        let set = |into: &mut String, from: &Option<String>| {
            if let Some(from) = from {
                into.clone_from(from);
            }
        };
        set(&mut scenario.world, &self.world);
        set(&mut scenario.vehicle, &self.vehicle);
        set(&mut scenario.driver, &self.driver);
        scenario.laps = self.laps.unwrap_or(scenario.laps);
        scenario.seed = self.seed.unwrap_or(scenario.seed);
        scenario.light = self.light.clone().or(scenario.light);
        scenario.floor = self.floor.clone().or(scenario.floor);
        scenario.speed_mps = self.speed.or(scenario.speed_mps);
        scenario.reverse |= self.reverse;
        scenario.image_px = self.image.or(scenario.image_px);
        scenario.latency_s = self.latency.unwrap_or(scenario.latency_s);
        scenario.lost_frames = self.lost_frames.unwrap_or(scenario.lost_frames);
        scenario.start.offset_m = self.start_offset.unwrap_or(scenario.start.offset_m);
        scenario.start.station_m = self.start_station.unwrap_or(scenario.start.station_m);
        let heading = self.start_heading.or(self.start_heading_deg.map(f64::to_radians));
        scenario.start.heading_rad = heading.unwrap_or(scenario.start.heading_rad);
        scenario.start.speed_mps = self.start_speed.unwrap_or(scenario.start.speed_mps);
        scenario.calibration = self.calibration.clone().or(scenario.calibration);
        scenario.package = self.package.clone().or(scenario.package);
        scenario.time_limit_s = self.time_limit.or(scenario.time_limit_s);
        if let Some(model) = &self.model {
            scenario
                .driver_options
                .insert("model".to_owned(), model.as_str().into());
        }
        merge(&mut scenario.driver_options, parse_option_list(&self.options)?);
        scenario.keep_recorded_world(&given);
        scenario.check()?;
        Ok(scenario)
    }
}

/// Every `KEY=VALUE` in one table.
pub(crate) fn parse_option_list(options: &[String]) -> Result<toml::Table> {
    let mut table = toml::Table::new();
    for option in options {
        merge(&mut table, parse_option(option)?);
    }
    Ok(table)
}

/// `follow.kp=1.2` sets the key `kp` of the table `follow`.
fn parse_option(option: &str) -> Result<toml::Table> {
    let Some((key, value)) = option.split_once('=') else {
        bail!("--option {option}: expected KEY=VALUE, such as form=document");
    };
    toml::from_str(&format!("{key} = {value}"))
        // A bare word is a string.
        .or_else(|_| toml::from_str(&format!("{key} = \"{value}\"")))
        .with_context(|| format!("--option {option}: the value is not TOML"))
}

/// Lays one table over another, key by key.
pub(crate) fn merge(into: &mut toml::Table, from: toml::Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(old)), toml::Value::Table(new)) => merge(old, new),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

pub(crate) fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let sizes = text
        .split_once('x')
        .and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    sizes.ok_or_else(|| format!("expected WIDTHxHEIGHT such as 160x120, but found `{text}`"))
}

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    flags: ScenarioFlags,
    /// manual, auto, training-manual or training-auto: who drives, and whether every frame is kept for training
    #[arg(long, value_name = "MODE", default_value = "auto")]
    mode: String,
    #[command(flatten)]
    hands: HandFlags,
    /// Keep the run as a recording (MCAP) in this folder (training modes: `recordings`)
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// Write a report (one HTML file)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Show in the report's player what the network at the wheel looks at (VisualBackProp)
    #[arg(long, requires = "report")]
    look: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let mode = Mode::named(&arguments.mode)?;
    let mut scenario = arguments.flags.scenario()?;
    let hands = arguments.hands.prepare(mode, &arguments.flags, &mut scenario)?;
    scenario.check_driver_options(arguments.flags.scenario.as_deref())?;
    let scenario = scenario.at_cruising_speed()?;
    super::warn_of(&scenario)?;
    let record = match (&arguments.record, mode.is_training()) {
        (None, true) => Some(PathBuf::from("recordings")),
        (folder, _) => folder.clone(),
    };
    let model = match (arguments.look, scenario.driver_options.get("model")) {
        (false, _) => None,
        (true, Some(toml::Value::String(model))) if scenario.driver == "neural" => Some(PathBuf::from(model)),
        (true, _) => bail!("--look: expected a network at the wheel: --driver neural --model FILE"),
    };
    let summary = drive_and_keep(
        &scenario,
        hands,
        record.as_deref(),
        arguments.report.as_deref(),
        model.as_deref(),
    )?;
    if arguments.json {
        terminal::print(&serde_json::to_string_pretty(&summary)?)?;
    } else {
        terminal::print(summary.text().to_string())?;
    }
    Ok(())
}

/// Drives a scenario behind a progress bar, with its recording and report where they are asked for; the report's player shows what
/// the model in `look` looks at.
pub(crate) fn drive_and_keep(
    scenario: &Scenario,
    hands: Option<Prepared>,
    record: Option<&Path>,
    report: Option<&Path>,
    look: Option<&Path>,
) -> Result<Summary> {
    let began_ns = terminal::clock_ns();
    let is_watched = matches!(hands, Some(Prepared::Person(_)));
    let bar = if is_watched {
        indicatif::ProgressBar::hidden()
    } else {
        terminal::bar(&format!(
            "{} {} {}",
            scenario.driver, scenario.world, scenario.vehicle
        ))
    };
    let mut ears = terminal::ears(&bar);
    let seat = seat(hands, scenario, record.is_some(), &mut ears)?;
    let (mut outcome, recording) = if let Some(folder) = record {
        let path = recording_path(folder, scenario);
        let sink = LateFile::new(&path);
        let (outcome, _) = drive::run_by(scenario, seat, Some(sink), &mut ears).map_err(|error| {
            let error = anyhow::Error::from(error);
            // A scenario that cannot be driven is no fault of the recording, which was not begun.
            if path.exists() {
                error.context(format!("while recording to {}", path.display()))
            } else {
                error
            }
        })?;
        terminal::tell(format!("recording: {}", path.display()));
        let recording = report
            .is_some()
            .then(|| senda_data::Recording::read(&path))
            .transpose()?;
        (outcome, recording)
    } else {
        let sink = report.is_some().then(|| Cursor::new(Vec::new()));
        let (outcome, sink) = drive::run_by(scenario, seat, sink, &mut ears)?;
        let recording = sink
            .map(|sink| senda_data::Recording::from_bytes(sink.get_ref()))
            .transpose()?;
        (outcome, recording)
    };
    drop(ears);
    bar.finish_and_clear();
    outcome.summary.wall_s = terminal::seconds_since(began_ns);
    if outcome.ending == Ending::Interrupted {
        let driven_s = outcome.summary.duration_s;
        terminal::tell(format!(
            "interrupted: all figures are of the {driven_s:.1} s until then"
        ));
    }
    if let (Some(path), Some(recording)) = (report, recording) {
        let title = format!(
            "{} drives {} on {}",
            scenario.driver, scenario.vehicle, scenario.world
        );
        let (summary, frame_times_ns) = (outcome.summary.clone(), outcome.frame_times_ns);
        let look = look
            .map(|model| super::look::for_player(model, &recording))
            .transpose()?;
        let run = PageRun {
            look,
            recording,
            summary,
            frame_times_ns,
        };
        write_file(path, page(&title, &command_line(), &[run])?.as_bytes())?;
        terminal::tell(format!("report: {}", path.display()));
    }
    Ok(outcome.summary)
}

/// `DIR/oval-gopigo-line-1.mcap`; an existing file is never overwritten.
fn recording_path(folder: &Path, scenario: &Scenario) -> PathBuf {
    let stem = |name: &str| -> String {
        let last = Path::new(name)
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        last.chars()
            .map(|c| if c.is_alphanumeric() || c == '-' { c } else { '-' })
            .collect()
    };
    let name = format!(
        "{}-{}-{}-{}",
        stem(&scenario.world),
        stem(&scenario.vehicle),
        scenario.driver,
        scenario.seed
    );
    let mut path = folder.join(format!("{name}.mcap"));
    let mut number = 2;
    while path.exists() {
        path = folder.join(format!("{name}-{number}.mcap"));
        number += 1;
    }
    path
}

/// A file that is made, with its folder, when the first byte is written: a run that is refused leaves none.
struct LateFile {
    path: PathBuf,
    file: Option<BufWriter<File>>,
}

impl LateFile {
    fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            file: None,
        }
    }

    fn file(&mut self) -> io::Result<&mut BufWriter<File>> {
        let file = match self.file.take() {
            Some(file) => file,
            None => BufWriter::new(self.create().map_err(|error| {
                io::Error::new(
                    error.kind(),
                    format!("cannot write {}: {error}", self.path.display()),
                )
            })?),
        };
        Ok(self.file.insert(file))
    }

    fn create(&self) -> io::Result<File> {
        if let Some(folder) = self.path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        File::create(&self.path)
    }
}

impl Write for LateFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file()?.flush()
    }
}

impl Seek for LateFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file()?.seek(to)
    }
}
