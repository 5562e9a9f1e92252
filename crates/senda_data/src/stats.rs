//! What a data set would teach, and which of its frames somebody should look at (A6 in SPEC).

use crate::edits::{Edits, no_parts, parts};
use crate::info::{SteeringHistogram, limit_rad};
use crate::open::{Format, open_runs};
use crate::{DataError, Recording, Step};
use senda_core::{Body, Image, Steering};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Steering below this part of full lock counts as straight on (2.5 of A2's 50 servo degrees).
const STRAIGHT_PART: f64 = 0.05;
/// Steering may be this much beyond full lock before it is suspicious: rounding in other people's files.
const BEYOND_LOCK: f64 = 1.01;

/// Why a frame is suspicious.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Suspicion {
    /// The picture cannot be decoded.
    BrokenImage,
    /// There is no picture.
    NoImage,
    /// The picture is the one before, byte for byte: the camera hung.
    RepeatedImage,
    /// The picture has another size than the first one.
    OtherSize,
    /// Steering or speed is not a number.
    NoNumber,
    /// Steering is beyond the vehicle's full lock.
    BeyondLock,
}

impl Suspicion {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::BrokenImage,
        Self::NoImage,
        Self::RepeatedImage,
        Self::OtherSize,
        Self::NoNumber,
        Self::BeyondLock,
    ];

    /// In words, as a plural.
    pub fn words(self) -> &'static str {
        match self {
            Self::BrokenImage => "broken pictures",
            Self::NoImage => "steps without a picture",
            Self::RepeatedImage => "repeated pictures",
            Self::OtherSize => "pictures of another size",
            Self::NoNumber => "labels that are no number",
            Self::BeyondLock => "labels beyond full lock",
        }
    }
}

/// A frame that somebody should look at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Suspicious {
    /// The recording or data set: what `senda data clean` is given.
    pub data: PathBuf,
    /// Its run, from 0.
    pub run: usize,
    /// The step in it, from 0.
    pub step: usize,
    /// Why.
    pub why: Suspicion,
}

/// One run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunStats {
    /// The recording or data set it belongs to.
    pub data: PathBuf,
    /// Its number there, from 0.
    pub run: usize,
    /// Steps as recorded.
    pub recorded: usize,
    /// Steps that the edits keep.
    pub kept: usize,
    /// Labels that the edits correct, among the kept.
    pub corrected: usize,
    /// Time that the kept steps cover (s).
    pub duration_s: f64,
}

/// Speeds that were asked for, over the kept steps (m/s).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Speeds {
    /// Slowest.
    pub min_mps: f64,
    /// Mean.
    pub mean_mps: f64,
    /// Fastest.
    pub max_mps: f64,
}

/// What is in a data set after its edits.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stats {
    /// Where it lies.
    pub path: PathBuf,
    /// Its format.
    pub format: Format,
    /// Its runs.
    pub runs: Vec<RunStats>,
    /// Steps as recorded.
    pub recorded: usize,
    /// Steps that the edits keep: what all figures below are about.
    pub kept: usize,
    /// Labels that the edits correct.
    pub corrected: usize,
    /// Time that the kept steps cover (s).
    pub duration_s: f64,
    /// Speeds.
    pub speeds: Speeds,
    /// Part of the steps that go straight on: steering within a twentieth of full lock.
    pub straight_share: f64,
    /// How often which steering was commanded.
    pub steering: SteeringHistogram,
    /// Frames that somebody should look at, in order.
    pub suspicious: Vec<Suspicious>,
    /// What was wrong with the data or the edits.
    pub warnings: Vec<String>,
}

/// Looks through any data set with the edits beside it applied. `body` is the vehicle that recorded foreign data. Decodes every
/// kept picture.
pub fn stats(path: &Path, body: &Body) -> Result<Stats, DataError> {
    let mut stats = Stats {
        path: path.to_owned(),
        format: Format::detect(path)?,
        runs: Vec::new(),
        recorded: 0,
        kept: 0,
        corrected: 0,
        duration_s: 0.0,
        speeds: Speeds::default(),
        straight_share: 0.0,
        steering: SteeringHistogram::new(limit_rad(body)),
        suspicious: Vec::new(),
        warnings: no_parts(path)?,
    };
    let mut straight = 0;
    for part in parts(path)? {
        let edits = Edits::of(&part)?;
        for (run, recording) in open_runs(&part, body)?.into_iter().enumerate() {
            if stats.runs.is_empty() {
                stats.steering = SteeringHistogram::new(limit_rad(&recording.header.body));
            }
            straight += stats.run(&part, run, &edits, recording);
        }
    }
    stats.straight_share = straight as f64 / (stats.kept as f64).max(1.0);
    Ok(stats)
}

impl Stats {
    /// How many frames are suspicious for this reason.
    pub fn count(&self, why: Suspicion) -> usize {
        self.suspicious.iter().filter(|found| found.why == why).count()
    }

    /// Counts a run; the number of straight steps is returned.
    fn run(&mut self, part: &Path, run: usize, edits: &Edits, mut recording: Recording) -> usize {
        self.warnings.append(&mut recording.warnings);
        self.warnings.extend(edits.misfits(run, recording.steps.len()));
        let body = &recording.header.body;
        let mut own = RunStats {
            data: part.to_owned(),
            run,
            recorded: recording.steps.len(),
            kept: 0,
            corrected: 0,
            duration_s: 0.0,
        };
        let mut straight = 0;
        let mut look = Look::default();
        let mut last_kept: Option<usize> = None;
        for (number, step) in recording.steps.iter().enumerate() {
            let kept = edits.keeps(run, number);
            let reasons = look.at(step, body, edits.corrected_deg(run, number).is_some(), kept);
            if !kept {
                continue;
            }
            self.suspicious
                .extend(reasons.into_iter().flatten().map(|why| Suspicious {
                    data: part.to_owned(),
                    run,
                    step: number,
                    why,
                }));
            let speed_mps = body.speed_of(&step.command);
            let angle_rad = match edits.corrected_deg(run, number) {
                Some(angle_deg) => {
                    own.corrected += 1;
                    angle_deg.to_radians()
                }
                None => body.steering_of(step.command.turn, speed_mps),
            };
            self.steering.add(angle_rad);
            straight += usize::from(angle_rad.abs() < STRAIGHT_PART * limit_rad(body));
            self.speeds.add(speed_mps, self.kept + own.kept);
            own.kept += 1;
            // Gaps that edits tore are not driven.
            if let Some(before) = last_kept.filter(|before| before + 1 == number) {
                own.duration_s += step.stamp.since_s(recording.steps[before].stamp);
            }
            last_kept = Some(number);
        }
        self.recorded += own.recorded;
        self.kept += own.kept;
        self.corrected += own.corrected;
        self.duration_s += own.duration_s;
        self.runs.push(own);
        straight
    }
}

impl Speeds {
    fn add(&mut self, speed_mps: f64, before: usize) {
        if !speed_mps.is_finite() {
            return;
        }
        if before == 0 {
            (self.min_mps, self.max_mps) = (speed_mps, speed_mps);
        }
        self.min_mps = self.min_mps.min(speed_mps);
        self.max_mps = self.max_mps.max(speed_mps);
        self.mean_mps += (speed_mps - self.mean_mps) / (before + 1) as f64;
    }
}

/// What must be remembered of the steps before.
#[derive(Default)]
struct Look {
    image: Image,
    size: Option<[usize; 2]>,
    before: Vec<u8>,
}

impl Look {
    /// What is suspicious about a step.
    fn at(&mut self, step: &Step, body: &Body, is_corrected: bool, decode: bool) -> [Option<Suspicion>; 2] {
        let picture = match step.frames.first() {
            None => Some(Suspicion::NoImage),
            Some(frame) => {
                let bytes = &frame.encoded.bytes;
                let is_repeated = !bytes.is_empty() && *bytes == self.before;
                self.before.clone_from(bytes);
                if !decode {
                    None
                } else if frame.encoded.decode_into(&mut self.image).is_err() {
                    Some(Suspicion::BrokenImage)
                } else {
                    let size = [self.image.width(), self.image.height()];
                    let is_other = *self.size.get_or_insert(size) != size;
                    if is_repeated {
                        Some(Suspicion::RepeatedImage)
                    } else {
                        is_other.then_some(Suspicion::OtherSize)
                    }
                }
            }
        };
        let label = if is_corrected {
            None
        } else if !step.command.is_finite() {
            Some(Suspicion::NoNumber)
        } else {
            is_beyond_lock(step, body).then_some(Suspicion::BeyondLock)
        };
        [picture, label]
    }
}

fn is_beyond_lock(step: &Step, body: &Body) -> bool {
    let speed_mps = body.speed_of(&step.command);
    let (asked, limit) = match body.steering {
        Steering::Ackermann {
            steering_limit_rad, ..
        } => (body.steering_of(step.command.turn, speed_mps), steering_limit_rad),
        Steering::Differential { .. } => (
            body.yaw_rate_of(step.command.turn, speed_mps),
            body.yaw_rate_limit_radps,
        ),
    };
    asked.abs() > BEYOND_LOCK * limit
}

/// How many suspicious frames of a kind are named.
const NAMED: usize = 8;

impl fmt::Display for Stats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: {}",
            self.path.display(),
            self.format.name().replace('_', " ")
        )?;
        write!(
            f,
            "  {} of {} steps in {} runs, {:.1} s",
            self.kept,
            self.recorded,
            self.runs.len(),
            self.duration_s
        )?;
        writeln!(
            f,
            "; {} left out, {} labels corrected",
            self.recorded - self.kept,
            self.corrected
        )?;
        if self.kept > 0 {
            writeln!(
                f,
                "  speed {:.2} to {:.2} m/s, mean {:.2}; {:.0} % of the steps go straight on",
                self.speeds.min_mps,
                self.speeds.max_mps,
                self.speeds.mean_mps,
                100.0 * self.straight_share
            )?;
        }
        self.steering.fmt(f)?;
        for why in Suspicion::ALL {
            let found: Vec<String> = self
                .suspicious
                .iter()
                .filter(|found| found.why == why)
                .take(NAMED)
                .map(|found| match self.runs.len() {
                    1 => found.step.to_string(),
                    _ => {
                        let name = found.data.file_name().unwrap_or_default().to_string_lossy();
                        format!("{name} run {} step {}", found.run, found.step)
                    }
                })
                .collect();
            let count = self.count(why);
            if count > 0 {
                let more = if count > found.len() { ", …" } else { "" };
                writeln!(f, "  {count} {}: {}{more}", why.words(), found.join(", "))?;
            }
        }
        for warning in &self.warnings {
            writeln!(f, "  warning: {warning}")?;
        }
        Ok(())
    }
}
