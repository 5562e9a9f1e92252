//! The whole path in one: the expert drives, a network learns, drives itself, is corrected, learns again.

use crate::augment::Answers;
use crate::beginning::begin;
use crate::correct::{self, Brief, Gathered, Gathering};
use crate::train::{Epoch, Lesson, News, Training, train};
use crate::trial::{Trial, drive_trial};
use crate::{LearnError, Samples, store};
use senda_drivers::Answer;
use senda_nets::{Colour, Crop, Edges, InputSpec, Model, Network, Provenance, View};
use senda_run::Ears;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A whole experiment. The resolved copy lies in its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Learning {
    /// Ready network or network file.
    pub network: String,
    /// Weights to begin with, for the layers that fit; left out: fresh ones.
    pub from: Option<PathBuf>,
    /// Colour space; left out: as many channels as the network has.
    pub colour: Option<Colour>,
    /// What is cut off the camera's frame.
    pub crop: Crop,
    /// Edges that are added to what the network sees.
    pub edges: Option<Edges>,
    /// Frames that it is shown at once; left out: what its file says.
    pub stack: Option<usize>,
    /// What the network answers.
    pub answers: Vec<Answer>,
    /// Frames that the expert drives.
    pub expert_frames: usize,
    /// Rounds in which the network drives and the expert corrects.
    pub rounds: u32,
    /// Frames of each round.
    pub round_frames: usize,
    /// Passes over all frames after each round but the last.
    pub round_epochs: u32,
    /// Seed of everything.
    pub seed: u64,
    /// How frames are gathered.
    pub gathering: Gathering,
    /// How it is trained at the end, on everything.
    pub training: Training,
    /// Drives that judge each round: worlds that are not learned from.
    pub trial: Trial,
}

impl Default for Learning {
    fn default() -> Self {
        Self {
            network: "lane-small".into(),
            from: None,
            colour: None,
            crop: Crop {
                top: 0.25,
                ..Crop::default()
            },
            edges: None,
            stack: None,
            answers: vec![Answer::Steering],
            expert_frames: 4000,
            rounds: 4,
            round_frames: 4000,
            round_epochs: 4,
            seed: 1,
            gathering: Gathering::default(),
            training: Training {
                epochs: 8,
                schedule: crate::train::Schedule::Smooth,
                ..Training::default()
            },
            trial: Trial::default(),
        }
    }
}

impl Learning {
    /// Reads an experiment file. Errors name the line.
    pub fn load(path: &Path) -> Result<Self, LearnError> {
        let text = std::fs::read_to_string(path).map_err(|source| LearnError::io(path, source))?;
        toml::from_str(&text).map_err(|error| LearnError::File {
            path: path.to_owned(),
            reason: error.to_string().trim_end().to_owned(),
        })
    }

    /// The experiment as a file.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// The network, with as many outputs as there are answers.
    pub fn resolve_network(&self) -> Result<Network, LearnError> {
        network_for(&self.network, &self.answers)
    }

    /// How frames are prepared for it.
    pub fn resolve_input(&self, network: &Network) -> Result<InputSpec, LearnError> {
        let mut spec = senda_run::scenario::find_vehicle(&self.gathering.vehicle)?;
        if let Some([width, height]) = self.gathering.image_px {
            spec = spec.with_camera_size(width, height);
        }
        let view = View {
            colour: self.colour,
            crop: self.crop,
            edges: self.edges,
            stack: self.stack,
        };
        let input = InputSpec::for_network(network, &view).map_err(|fault| LearnError::Option {
            key: "colour, crop, edges or stack",
            expected: "an input that fits the network".into(),
            found: fault,
        })?;
        Ok(InputSpec {
            camera: spec
                .body()
                .cameras
                .first()
                .filter(|_| self.gathering.cameras.is_none())
                .cloned(),
            ..input
        })
    }

    fn check(&self) -> Result<(), LearnError> {
        self.training.check()?;
        if self.answers.is_empty() || !self.answers.iter().any(|answer| answer.is_turn()) {
            return Err(LearnError::Option {
                key: "answers",
                expected: "steering or curvature among them".into(),
                found: format!("{:?}", self.answers),
            });
        }
        if self.expert_frames == 0 {
            return Err(LearnError::Option {
                key: "expert_frames",
                expected: "at least 1".into(),
                found: "0".into(),
            });
        }
        if let Some((key, expected, found)) = self.gathering.fault() {
            return Err(LearnError::Option {
                key,
                expected: expected.to_owned(),
                found,
            });
        }
        self.trial.check(&self.gathering)
    }
}

/// A ready network by name, or a network file.
pub fn find_network(name: &str) -> Result<Network, LearnError> {
    Ok(if name.ends_with(".toml") || name.contains(['/', '\\']) {
        Network::load(Path::new(name))?
    } else {
        Network::named(name)?
    })
}

/// The same, with as many outputs as there are answers.
pub fn network_for(name: &str, answers: &[Answer]) -> Result<Network, LearnError> {
    let network = find_network(name)?;
    Ok(if network.output_len() == answers.len() {
        network
    } else {
        network.with_outputs(answers.len())?
    })
}

/// What a round brought.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Its number; 0 is the expert's.
    pub number: u32,
    /// Frames learned from, all rounds together.
    pub frames: usize,
    /// Drives made to gather this round's frames.
    pub drives: usize,
    /// How many of them strayed from the road.
    pub strayed: usize,
    /// Training loss at its end.
    pub loss: f64,
    /// Runs of the trial that were completed, of how many.
    pub trial: Option<[usize; 2]>,
    /// Mean lane error of the trial (m).
    pub lane_error_m: Option<f64>,
}

/// What is said on the way.
#[derive(Debug, Clone, PartialEq)]
pub enum Stage {
    /// Something to know about the first weights.
    Weights(String),
    /// Gathering frames: so many of so many.
    Gathering(u32, usize, usize),
    /// Training: part done, running loss.
    Training(u32, f64, f64),
    /// Driving the trial: so many of so many.
    Trial(u32, usize, usize),
    /// A round is over.
    Round(Round),
}

/// The result of an experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Learned {
    /// The network with all that a driver needs.
    pub model: Model,
    /// Every round.
    pub rounds: Vec<Round>,
    /// The last training.
    pub history: Vec<Epoch>,
    /// All frames so far.
    pub samples: Samples,
    /// Whether somebody interrupted: the same command goes on.
    pub interrupted: bool,
}

/// Runs an experiment in a folder, where everything is kept: started again after an interruption it goes on, to the same end.
pub fn learn(
    learning: &Learning,
    folder: &Path,
    interrupted: &(dyn Fn() -> bool + Sync),
    tell: &(dyn Fn(Stage) + Sync),
) -> Result<Learned, LearnError> {
    learning.check()?;
    let network = learning.resolve_network()?;
    let input = learning.resolve_input(&network)?;
    let answers = Answers::of(&learning.answers);
    std::fs::create_dir_all(folder).map_err(|source| LearnError::io(folder, source))?;
    same_experiment(learning, &folder.join("experiment.toml"))?;

    let forgets = learning.training.forgets(&network);
    let (weights, note) = begin(
        &network,
        &learning.training,
        learning.seed,
        learning.from.as_deref(),
    )?;
    if let Some(note) = note {
        tell(Stage::Weights(note));
    }
    let mut model = Model {
        weights,
        network,
        input,
        outputs: learning.answers.iter().map(|answer| answer.output()).collect(),
        provenance: provenance(learning, &[]),
        grids: vec![],
        detection: None,
        forgets,
    };
    let mut all = Samples::new(model.input.len(), learning.answers.len());
    let mut rounds: Vec<Round> = Vec::new();
    let mut drives = 0usize;
    let mut history = Vec::new();
    for number in 0..=learning.rounds {
        let file = |kind: &str| folder.join(format!("round-{number}.{kind}"));
        // A round that was finished before is read back.
        if let Some((samples, round)) = store::read_round(&file("samples"), &file("json"))? {
            drives += round.drives;
            all.append(&samples);
            if number == learning.rounds {
                model = Model::load(&file("senda"))?;
                history = store::read_history(&folder.join("history.json")).unwrap_or_default();
            } else {
                model.weights = Model::load(&file("senda"))?.weights;
            }
            tell(Stage::Round(round.clone()));
            rounds.push(round);
            continue;
        }
        let frames = if number == 0 {
            learning.expert_frames
        } else {
            learning.round_frames
        };
        let Gathered {
            samples,
            drives: new_drives,
            strayed,
        } = correct::gather(
            &Brief {
                gathering: &learning.gathering,
                input: &model.input,
                answers: &learning.answers,
                seed: learning.seed,
            },
            (number > 0).then_some(&model),
            frames,
            drives as u64,
            &|done| tell(Stage::Gathering(number, done, frames)),
            interrupted,
        )?;
        if interrupted() {
            return Ok(unfinished(model, rounds, history, all));
        }
        drives += new_drives;
        all.append(&samples);

        let last = number == learning.rounds;
        let options = if last {
            learning.training.clone()
        } else {
            Training {
                epochs: learning.round_epochs,
                schedule: crate::train::Schedule::Constant,
                seed: learning.training.seed + 1 + u64::from(number),
                ..learning.training.clone()
            }
        };
        let mut ears = Ears {
            progress: Box::new(|_| {}),
            interrupted: Box::new(interrupted),
            clock_ns: Box::new(|| 0),
        };
        let trained = train(
            &Lesson {
                network: &model.network,
                input: &model.input,
                answers: &answers,
                training: &all,
                validation: &Samples::new(all.frame_len, all.outputs),
                options: &options,
                checkpoint: Some(&file("checkpoint")),
            },
            model.weights.clone(),
            &mut ears,
            &mut |news| {
                if let News::Step { done, of, loss } = news {
                    tell(Stage::Training(number, done as f64 / of.max(1) as f64, loss));
                }
            },
        )?;
        if trained.interrupted {
            return Ok(unfinished(model, rounds, history, all));
        }
        let loss = trained.history.last().map_or(0.0, |epoch| epoch.training_loss);
        model.weights = trained.weights;
        if last {
            history = trained.history;
        }
        model.save(&file("senda"))?;
        let (trial, lane_error_m) = if learning.trial.runs > 0 {
            match drive_trial(learning, &file("senda"), interrupted, &|done, of| {
                tell(Stage::Trial(number, done, of))
            })? {
                Some((rate, error)) => (Some(rate), error),
                None => return Ok(unfinished(model, rounds, history, all)),
            }
        } else {
            (None, None)
        };
        let round = Round {
            number,
            frames: all.len(),
            drives: new_drives,
            strayed,
            loss,
            trial,
            lane_error_m,
        };
        if last {
            store::write_json(&folder.join("history.json"), &history)?;
            let all_rounds: Vec<Round> = rounds.iter().chain([&round]).cloned().collect();
            model.provenance = provenance(learning, &all_rounds);
            model.save(&file("senda"))?;
        }
        store::write_round(&file("samples"), &file("json"), &samples, &round)?;
        // The next rounds do not need it.
        let _ = std::fs::remove_file(file("checkpoint"));
        tell(Stage::Round(round.clone()));
        rounds.push(round);
    }
    Ok(Learned {
        model,
        rounds,
        history,
        samples: all,
        interrupted: false,
    })
}

fn unfinished(model: Model, rounds: Vec<Round>, history: Vec<Epoch>, samples: Samples) -> Learned {
    Learned {
        model,
        rounds,
        history,
        samples,
        interrupted: true,
    }
}

/// A folder belongs to one experiment.
fn same_experiment(learning: &Learning, path: &Path) -> Result<(), LearnError> {
    match std::fs::read_to_string(path) {
        Ok(text) => {
            let threads_do_not_count = |learning: &Learning| {
                let mut learning = learning.clone();
                learning.training.threads = 0;
                learning
            };
            let there: Option<Learning> = toml::from_str(&text).ok();
            if there.as_ref().map(threads_do_not_count) != Some(threads_do_not_count(learning)) {
                return Err(LearnError::Checkpoint {
                    path: path.to_owned(),
                    reason: "its options are others".into(),
                });
            }
            Ok(())
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            std::fs::write(path, learning.to_toml()).map_err(|source| LearnError::io(path, source))
        }
        Err(source) => Err(LearnError::io(path, source)),
    }
}

/// What became of the rounds, of which there are none yet at the beginning.
fn provenance(learning: &Learning, rounds: &[Round]) -> Provenance {
    let gathering = &learning.gathering;
    let expert = rounds.first().map_or(0, |round| round.frames);
    let all = rounds.last().map_or(0, |round| round.frames);
    let drives: u64 = rounds.iter().map(|round| round.drives as u64).sum();
    let mut metrics = serde_json::Map::new();
    if !rounds.is_empty() {
        metrics.insert("rounds".to_owned(), serde_json::json!(rounds));
        if learning.trial.runs > 0 {
            metrics.insert(
                "trial_worlds".to_owned(),
                serde_json::json!(learning.trial.worlds),
            );
        }
    }
    Provenance {
        senda: env!("CARGO_PKG_VERSION").to_owned(),
        commit: senda_run::COMMIT.to_owned(),
        data: vec![format!(
            "{expert} frames by the expert, {} frames of {} rounds corrected by it (DAgger)",
            all - expert,
            learning.rounds
        )],
        worlds: gathering
            .families
            .iter()
            .map(|family| {
                format!(
                    "{family}:{}..{}",
                    gathering.first_world,
                    gathering.first_world + drives
                )
            })
            .collect(),
        seed: learning.seed,
        metrics,
        ..Provenance::default()
    }
}
