//! What is compared: data, networks, laps and claims, as plain data read from a TOML file.

use crate::CompareError;
use crate::read;
use senda_drivers::Answer;
use senda_learn::Training;
use senda_nets::{Colour, Crop};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// A whole comparison. The resolved copy lies in its folder.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// Its name.
    pub name: String,
    /// One sentence about it.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// The vehicle that records and drives.
    pub vehicle: String,
    /// Speed at which laps are recorded and driven (m/s); networks that answer a throttle choose their own.
    pub speed_mps: f64,
    /// Every row is trained with the seeds 1 to this.
    pub seeds: u64,
    /// Name of the row that the others of the same control are measured against.
    pub baseline: String,
    /// What is learned from.
    pub data: Data,
    /// How, unless a row says otherwise.
    #[serde(rename = "training")]
    pub lesson: LessonPlan,
    /// Laps that judge.
    pub judging: Judging,
    /// Circumstances under which laps are driven; the first one makes the tables.
    #[serde(rename = "condition")]
    pub conditions: Vec<Condition>,
    /// The networks.
    #[serde(rename = "row")]
    pub rows: Vec<Row>,
    /// What somebody says about them.
    #[serde(rename = "claim", skip_serializing_if = "Vec::is_empty")]
    pub claims: Vec<Claim>,
}

/// Laps that are recorded: one lap for each entry, each by another person ([`Data::takes`]).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Data {
    /// Driver that records.
    pub driver: String,
    /// Worlds to learn from.
    pub training: Vec<String>,
    /// Worlds that choose the best epoch.
    pub tuning: Vec<String>,
    /// Worlds for the offline error; nothing is learned or chosen by them.
    pub held_out: Vec<String>,
    /// Steering added for the left camera and taken away for the right one (part of full lock, B5 in SPEC).
    pub side_camera_shift: f64,
    /// Every lap ends after this time (s); left out: when it is driven.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_limit_s: Option<f64>,
}

/// What a recorded lap is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Purpose {
    /// To be learned from, with all three cameras.
    Training,
    /// To choose the best epoch.
    Tuning,
    /// To measure the offline error.
    HeldOut,
}

impl Data {
    /// World and driver's seed of each lap. The n-th lap is driven by person n; other purposes have other people.
    pub fn takes(&self, purpose: Purpose) -> Vec<(String, u64)> {
        let (worlds, first) = match purpose {
            Purpose::Training => (&self.training, 1),
            Purpose::Tuning => (&self.tuning, 1001),
            Purpose::HeldOut => (&self.held_out, 2001),
        };
        worlds.iter().cloned().zip(first..).collect()
    }
}

/// How networks are trained.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LessonPlan {
    /// Passes over the data.
    pub epochs: u32,
    /// Frames a step.
    pub batch: usize,
    /// Runs side by side, for networks with a memory.
    pub streams: usize,
    /// Consecutive frames that a network with a memory learns from at once.
    pub sequence: usize,
    /// Adam's step.
    pub learning_rate: f64,
    /// Whether it shrinks towards the end.
    pub smooth: bool,
    /// Part of the frames that are mirrored.
    pub mirror: f64,
}

/// How a row controls the car (B4 in SPEC).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Control {
    /// The network steers; the speed is held.
    Steering,
    /// One network steers, another one gives the throttle.
    TwoNetworks,
    /// One network does both.
    OneNetwork,
}

impl Control {
    /// All, with their words in plans.
    pub const ALL: [(&'static str, Self); 3] = [
        ("steering", Self::Steering),
        ("two-networks", Self::TwoNetworks),
        ("one-network", Self::OneNetwork),
    ];

    /// Its word in plans.
    pub fn word(self) -> &'static str {
        Self::ALL
            .iter()
            .find(|(_, own)| *own == self)
            .map_or("", |(word, _)| word)
    }

    /// As people read it.
    pub fn title(self) -> &'static str {
        match self {
            Self::Steering => "steering only",
            Self::TwoNetworks => "two networks",
            Self::OneNetwork => "one network",
        }
    }

    /// What each network that a row trains answers.
    pub fn answers(self) -> &'static [&'static [Answer]] {
        match self {
            Self::Steering => &[&[Answer::Steering]],
            Self::TwoNetworks => &[&[Answer::Steering], &[Answer::Throttle]],
            Self::OneNetwork => &[&[Answer::Steering, Answer::Throttle]],
        }
    }
}

/// A network with its treatment and control.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Its name; with the control, unlike any other row's.
    pub name: String,
    /// Ready network or network file.
    pub network: String,
    /// How it controls.
    pub control: Control,
    /// Colour space; left out: what the network's file or its channels say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colour: Option<Colour>,
    /// Whether edges are added to what the network sees (prefix Edge- of B3).
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub edges: bool,
    /// Frames that the network is shown at once; left out: what its file says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stack: Option<usize>,
    /// Other passes over the data than the plan's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epochs: Option<u32>,
    /// Another sequence than the plan's; 1: without memory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequence: Option<usize>,
    /// Whether a quick comparison keeps it; all rows are kept where none is marked.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub quick: bool,
    /// File with weights that the training begins with: layers that are not trained must find theirs in it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<PathBuf>,
    /// What is cut off the frame.
    #[serde(skip_serializing_if = "is_whole")]
    pub crop: Crop,
    /// What somebody published about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub published: Option<Published>,
}

fn is_whole(crop: &Crop) -> bool {
    *crop == Crop::default()
}

impl Row {
    /// `NAME/CONTROL`: how conditions and claims name it.
    pub fn identity(&self) -> String {
        format!("{}/{}", self.name, self.control.word())
    }

    /// How one of its networks is trained.
    pub fn training(&self, plan: &LessonPlan, network: &senda_nets::Network, seed: u64) -> Training {
        let sequence = self.sequence.unwrap_or(plan.sequence);
        let is_ordered = network.is_recurrent() && sequence > 1;
        Training {
            epochs: self.epochs.unwrap_or(plan.epochs),
            batch: if is_ordered { plan.streams } else { plan.batch },
            sequence,
            learning_rate: plan.learning_rate,
            schedule: if plan.smooth {
                senda_learn::train::Schedule::Smooth
            } else {
                senda_learn::train::Schedule::Constant
            },
            augmentation: senda_learn::Augmentation {
                mirror: plan.mirror,
                brightness: 0.0,
                contrast: 0.0,
                colour: 0.0,
                shadow: 0.0,
                ..senda_learn::Augmentation::default()
            },
            seed,
            threads: 1,
            ..Training::default()
        }
    }
}

/// Figures that somebody published for a row.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Published {
    /// Mean distance to the middle of the lane (m).
    pub lane_mean_m: f64,
    /// Largest one (m).
    pub lane_max_m: f64,
    /// Mean heading error (degrees).
    pub heading_mean_deg: f64,
    /// Largest one (degrees).
    pub heading_max_deg: f64,
    /// RMSE of the steering (part of full lock), on training data.
    pub rmse: f64,
    /// RMSE of the throttle, where a network of its own gives it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rmse_throttle: Option<f64>,
    /// Whether it left the road.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub left_road: bool,
}

/// Laps that judge: every world from every start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judging {
    /// Worlds that no network has seen.
    pub worlds: Vec<String>,
    /// Where laps begin, as parts of the lap.
    pub starts: Vec<f64>,
    /// A lap ends after this many times the time that its length takes at the plan's speed, plus 20 s.
    pub patience: f64,
    /// Every lap ends after this time (s); left out: as `patience` says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_limit_s: Option<f64>,
}

/// A circumstance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Condition {
    /// Its name.
    pub name: String,
    /// Further delay from the camera to the driver (s).
    pub latency_s: f64,
    /// Part of the frames that are lost.
    pub lost_frames: f64,
    /// Another speed than the plan's (m/s).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_mps: Option<f64>,
    /// Identities of the rows that drive under it; empty: all, as under the first one, which makes the tables.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rows: Vec<String>,
}

impl Condition {
    /// Whether a row drives under it.
    pub fn includes(&self, row: &Row) -> bool {
        self.rows.is_empty() || self.rows.contains(&row.identity())
    }
}

/// What somebody says: true when all its parts are.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Claim {
    /// In words.
    pub says: String,
    /// What is looked at.
    #[serde(rename = "part")]
    pub parts: Vec<ClaimPart>,
}

/// One figure of some rows against that of others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClaimPart {
    /// In words.
    pub says: String,
    /// Which figure; less is better or worse as the figure says, the claim is about less.
    pub figure: crate::Figure,
    /// What is said.
    pub relation: Relation,
    /// Identities of the rows whose figure is the smaller one, or not.
    pub rows: Vec<String>,
    /// Identities of the rows that they are compared with, one for each.
    pub than: Vec<String>,
    /// Name of the condition; left out: the first one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub condition: Option<String>,
}

/// What a claim says of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Relation {
    /// It is smaller.
    Less,
    /// It is larger.
    More,
    /// It is not smaller, or only by so little that it does not matter ([`crate::MATTERS`]).
    NotLess,
}

/// Ready plans: name and text.
const PRESETS: &[(&str, &str)] = &[(
    "document-b",
    include_str!("../../../scenarios/compare-document-b.toml"),
)];

impl Plan {
    /// Reads a plan. Errors name line and key.
    pub fn parse(source_name: &str, text: &str) -> Result<Self, CompareError> {
        read::plan(source_name, text)
    }

    /// Reads a plan file.
    pub fn load(path: &Path) -> Result<Self, CompareError> {
        let text = std::fs::read_to_string(path).map_err(|source| CompareError::io(path, source))?;
        Self::parse(&path.display().to_string(), &text)
    }

    /// A ready plan.
    pub fn preset(name: &str) -> Result<Self, CompareError> {
        match PRESETS.iter().find(|(known, _)| *known == name) {
            Some((_, text)) => Self::parse(&format!("scenarios/compare-{name}.toml"), text),
            None => Err(CompareError::UnknownPreset {
                found: name.to_owned(),
                known: PRESETS
                    .iter()
                    .map(|(name, _)| *name)
                    .collect::<Vec<_>>()
                    .join(", "),
            }),
        }
    }

    /// Adds the rows of a file that holds nothing else (`[[row]]`).
    pub fn add_rows(&mut self, path: &Path) -> Result<(), CompareError> {
        let text = std::fs::read_to_string(path).map_err(|source| CompareError::io(path, source))?;
        let known: Vec<String> = self.rows.iter().map(Row::identity).collect();
        self.rows
            .extend(read::more_rows(&path.display().to_string(), &text, &known)?);
        Ok(())
    }

    /// As TOML, read back to the same plan.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// A smaller comparison with the same rules, for a first look: the rows that are marked, two seeds, one lap, fewer epochs, less
    /// data. The baseline and rows that were added by hand (`kept`, identities) stay.
    pub fn quick(&mut self, kept: &[String]) {
        if self.rows.iter().any(|row| row.quick) {
            let marked: Vec<Control> = self.rows.iter().filter(|r| r.quick).map(|r| r.control).collect();
            let baseline = &self.baseline;
            self.rows.retain(|row| {
                let measured_against = row.name == *baseline && marked.contains(&row.control);
                row.quick || measured_against || kept.contains(&row.identity())
            });
        }
        self.seeds = self.seeds.min(2);
        self.data.training.truncate(2);
        self.data.tuning.truncate(1);
        self.data.held_out.truncate(1);
        self.judging.worlds.truncate(1);
        self.judging.starts.truncate(1);
        self.conditions.truncate(2);
        self.lesson.epochs = self.lesson.epochs.min(6);
        for row in &mut self.rows {
            row.epochs = row.epochs.map(|epochs| epochs.min(6));
        }
        let there: Vec<String> = self.rows.iter().map(Row::identity).collect();
        let is_there = |names: &[String]| names.iter().all(|name| there.contains(name));
        self.conditions.retain_mut(|condition| {
            let all = condition.rows.is_empty();
            condition.rows.retain(|name| there.contains(name));
            // No rows would mean all of them.
            all || !condition.rows.is_empty()
        });
        let conditions: Vec<&str> = self.conditions.iter().map(|c| c.name.as_str()).collect();
        for claim in &mut self.claims {
            claim.parts.retain(|part| {
                let condition = part.condition.as_deref();
                is_there(&part.rows)
                    && is_there(&part.than)
                    && condition.is_none_or(|name| conditions.contains(&name))
            });
        }
        self.claims.retain(|claim| !claim.parts.is_empty());
    }
}
