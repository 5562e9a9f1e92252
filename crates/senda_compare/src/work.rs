//! Doing the jobs: in parallel, interruptible, each result a file that is there whole or not at all.

use crate::CompareError;
use crate::job::{Jobs, Judgement, Lesson, Preparation, Task, Work};
use crate::plan::Plan;
use senda_core::whole_file;
use senda_eval::Summary;
use senda_learn::beginning::begin;
use senda_learn::train::{self, News};
use senda_learn::{Answers, Samples};
use senda_learn::{gather, offline};
use senda_nets::{Model, Provenance};
use senda_run::scenario::find_vehicle;
use senda_run::{Ears, Scenario, drive};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// How jobs are done.
pub struct Crew<'a> {
    /// Jobs at once; each takes one core. Changes no result.
    pub threads: usize,
    /// Hears how far the work is.
    pub progress: &'a (dyn Fn(&Progress) + Sync),
    /// Whether to stop; what is done is kept.
    pub interrupted: &'a (dyn Fn() -> bool + Sync),
    /// A monotonic clock in nanoseconds.
    pub clock_ns: &'a (dyn Fn() -> u64 + Sync),
}

/// How far the work is.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Progress {
    /// Jobs done.
    pub done: usize,
    /// Of how many.
    pub total: usize,
    /// Part of the work, 0..=1: jobs count as much as they take about.
    pub part: f64,
    /// What was begun last.
    pub title: String,
}

/// What jobs of a kind took.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cost {
    /// How many were done.
    pub count: usize,
    /// How long they took in all (s of wall time).
    pub wall_s: f64,
}

/// What a call did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Done {
    /// Jobs that had been done before.
    pub before: usize,
    /// What was done now, by kind. Wall times: no second call repeats them, and no result holds them.
    pub costs: BTreeMap<&'static str, Cost>,
    /// Whether somebody interrupted.
    pub interrupted: bool,
}

/// The offline error of a row trained with a seed: frame by frame against the human (B6 in SPEC).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Offline {
    /// Of each answer in order: its name, and
    pub answers: Vec<OfflineAnswer>,
}

/// The error of one answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OfflineAnswer {
    /// `steering`, `throttle`.
    pub name: String,
    /// RMSE on the laps that were learned from: as the document's authors measured it.
    pub training: f64,
    /// RMSE on laps that nothing was learned from or chosen by.
    pub held_out: f64,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Status {
    Waiting,
    Running,
    Done,
    Failed,
}

struct State {
    status: Vec<Status>,
    /// Part of each job that is done.
    parts: Vec<f64>,
    costs: BTreeMap<&'static str, Cost>,
    error: Option<CompareError>,
}

/// A comparison's folder.
pub(crate) struct Shop<'a> {
    pub(crate) plan: &'a Plan,
    pub(crate) jobs: &'a Jobs,
    pub(crate) folder: &'a Path,
}

impl Shop<'_> {
    pub(crate) fn path(&self, task: usize) -> PathBuf {
        self.folder.join(self.jobs.tasks[task].file())
    }

    pub(crate) fn is_done(&self, task: usize) -> bool {
        self.path(task).is_file()
    }

    /// Jobs that must be done so that all of `wanted` are: what is there is not asked what it came from.
    pub(crate) fn missing(&self, wanted: &[usize]) -> Vec<usize> {
        let mut marks = vec![false; self.jobs.tasks.len()];
        let mut stack: Vec<usize> = wanted.to_vec();
        while let Some(task) = stack.pop() {
            if !marks[task] && !self.is_done(task) {
                marks[task] = true;
                stack.extend(&self.jobs.tasks[task].needs);
            }
        }
        (0..marks.len()).filter(|task| marks[*task]).collect()
    }

    /// Does what is missing of the wanted jobs.
    pub(crate) fn work(&self, wanted: &[usize], crew: &Crew) -> Result<Done, CompareError> {
        for folder in ["recordings", "samples", "models", "offline", "laps"] {
            let folder = self.folder.join(folder);
            std::fs::create_dir_all(&folder).map_err(|source| CompareError::io(&folder, source))?;
        }
        let todo = self.missing(wanted);
        let mut status = vec![Status::Done; self.jobs.tasks.len()];
        for task in &todo {
            status[*task] = Status::Waiting;
        }
        let state = Mutex::new(State {
            status,
            parts: vec![0.0; self.jobs.tasks.len()],
            costs: BTreeMap::new(),
            error: None,
        });
        let changed = Condvar::new();
        let hand = Hand {
            shop: self,
            todo: &todo,
            state: &state,
            changed: &changed,
            crew,
        };
        std::thread::scope(|scope| {
            for number in 1..crew.threads.max(1).min(todo.len().max(1)) {
                let name = format!("compare-{number}");
                // Where no further thread starts, this one does everything.
                let _ = std::thread::Builder::new()
                    .name(name)
                    .spawn_scoped(scope, || hand.work());
            }
            hand.work();
        });
        let state = state.into_inner().unwrap_or_else(PoisonError::into_inner);
        match state.error {
            Some(error) if !(crew.interrupted)() => Err(error),
            _ => Ok(Done {
                before: wanted.iter().filter(|task| !todo.contains(task)).count(),
                costs: state.costs,
                interrupted: todo.iter().any(|task| state.status[*task] != Status::Done),
            }),
        }
    }
}

/// What every thread knows.
struct Hand<'a> {
    shop: &'a Shop<'a>,
    todo: &'a [usize],
    state: &'a Mutex<State>,
    changed: &'a Condvar,
    crew: &'a Crew<'a>,
}

impl Hand<'_> {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the first job that can be done, until there is none.
    fn work(&self) {
        while let Some(task) = self.next() {
            let began_ns = (self.crew.clock_ns)();
            let outcome = self.shop.attempt(task, self.crew, &|part| self.tell(task, part));
            let wall_s = (self.crew.clock_ns)().saturating_sub(began_ns) as f64 * 1e-9;
            let mut state = self.lock();
            match outcome {
                Ok(true) => {
                    state.status[task] = Status::Done;
                    let cost = state.costs.entry(kind(&self.shop.jobs.tasks[task])).or_default();
                    cost.count += 1;
                    cost.wall_s += wall_s;
                }
                // Interrupted.
                Ok(false) => state.status[task] = Status::Failed,
                Err(error) => {
                    state.status[task] = Status::Failed;
                    // The others go on; the first failure is told at the end.
                    state.error.get_or_insert(CompareError::Job {
                        job: self.shop.jobs.tasks[task].title.clone(),
                        source: Box::new(error),
                    });
                }
            }
            drop(state);
            self.changed.notify_all();
            self.tell(task, 1.0);
        }
        self.changed.notify_all();
    }

    fn next(&self) -> Option<usize> {
        let mut state = self.lock();
        loop {
            if (self.crew.interrupted)() {
                return None;
            }
            let is_ready = |task: &&usize| {
                let needs = &self.shop.jobs.tasks[**task].needs;
                state.status[**task] == Status::Waiting
                    && needs.iter().all(|need| state.status[*need] == Status::Done)
            };
            if let Some(task) = self.todo.iter().find(is_ready).copied() {
                state.status[task] = Status::Running;
                return Some(task);
            }
            if !state.status.contains(&Status::Running) {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn tell(&self, task: usize, part: f64) {
        let mut state = self.lock();
        state.parts[task] = part.clamp(0.0, 1.0);
        let cost = |task: &usize| self.shop.jobs.tasks[*task].cost_s;
        let total: f64 = self.todo.iter().map(cost).sum();
        let done: f64 = self.todo.iter().map(|task| cost(task) * state.parts[*task]).sum();
        let progress = Progress {
            done: self
                .todo
                .iter()
                .filter(|task| state.status[**task] == Status::Done)
                .count(),
            total: self.todo.len(),
            part: if total > 0.0 { done / total } else { 1.0 },
            title: self.shop.jobs.tasks[task].title.clone(),
        };
        drop(state);
        (self.crew.progress)(&progress);
    }
}

fn kind(task: &Task) -> &'static str {
    match task.work {
        Work::Record(_) => "laps recorded",
        Work::Prepare(_) => "sets of frames prepared",
        Work::Train(_) => "networks trained",
        Work::Judge(_) => "offline errors",
        Work::Drive(_) => "laps driven",
    }
}

impl Shop<'_> {
    /// Does a job; `false` when somebody interrupted.
    fn attempt(&self, number: usize, crew: &Crew, tell: &dyn Fn(f64)) -> Result<bool, CompareError> {
        let task = &self.jobs.tasks[number];
        let path = self.path(number);
        let mut ears = Ears {
            progress: Box::new(tell),
            interrupted: Box::new(|| (crew.interrupted)()),
            // Wall times reach no result.
            clock_ns: Box::new(|| 0),
        };
        match &task.work {
            Work::Record(scenario) => record(scenario, &path, &mut ears),
            Work::Prepare(preparation) => {
                self.prepare(preparation, &task.needs, &path)?;
                Ok(true)
            }
            Work::Train(lesson) => self.train(lesson, &task.needs, &path, &mut ears),
            Work::Judge(judgement) => {
                let offline = self.judge(judgement, &task.needs)?;
                write_json(&path, &offline)?;
                Ok(true)
            }
            Work::Drive(scenario) => {
                for model in &task.needs {
                    self.model(*model)?;
                }
                let scenario = self.with_models(scenario, &task.needs);
                let outcome = drive::in_memory(&scenario, &mut ears)?;
                if outcome.ending == drive::Ending::Interrupted {
                    return Ok(false);
                }
                write_json(&path, &outcome.summary)?;
                Ok(true)
            }
        }
    }

    /// A lap with the models that drive it.
    pub(crate) fn with_models(&self, scenario: &Scenario, models: &[usize]) -> Scenario {
        let mut scenario = scenario.clone();
        for (key, model) in ["model", "throttle_model"].iter().zip(models) {
            let path = self.path(*model).display().to_string();
            scenario.driver_options.insert((*key).to_owned(), path.into());
        }
        scenario
    }

    fn prepare(&self, preparation: &Preparation, needs: &[usize], path: &Path) -> Result<(), CompareError> {
        let recordings: Vec<PathBuf> = needs.iter().map(|need| self.path(*need)).collect();
        let body = find_vehicle(&preparation.vehicle)?.body();
        let data = gather::recordings(
            &recordings,
            &body,
            &preparation.input,
            &preparation.answers,
            &preparation.selection,
            &mut |_, _| {},
        )?;
        if let Some(reason) = data.damage {
            // Laps were written whole: what is damaged now would give other tables.
            let damaged = recordings
                .iter()
                .find(|path| reason.starts_with(&path.display().to_string()));
            return Err(CompareError::Result {
                path: damaged.unwrap_or(&recordings[0]).clone(),
                reason: format!("it was damaged since ({reason})"),
            });
        }
        Ok(data.samples.save(path)?)
    }

    fn model(&self, task: usize) -> Result<Model, CompareError> {
        let path = self.path(task);
        Model::load(&path).map_err(|error| CompareError::Result {
            reason: format!("the model cannot be read: {error}"),
            path,
        })
    }

    pub(crate) fn samples(&self, task: usize) -> Result<Samples, CompareError> {
        let path = self.path(task);
        Samples::load(&path)?.ok_or_else(|| CompareError::Result {
            path,
            reason: "it is missing or damaged".into(),
        })
    }

    fn train(
        &self,
        lesson: &Lesson,
        needs: &[usize],
        path: &Path,
        ears: &mut Ears,
    ) -> Result<bool, CompareError> {
        let training = self.samples(needs[0])?;
        let tuning = self.samples(needs[1])?;
        let answers = Answers::of(&lesson.answers);
        let options = &lesson.training;
        let checkpoint = path.with_extension("checkpoint");
        let from = lesson.from.as_deref();
        let (weights, _) = begin(&lesson.network, options, options.seed, from)?;
        let lesson_of = train::Lesson {
            network: &lesson.network,
            input: &lesson.input,
            answers: &answers,
            training: &training,
            validation: &tuning,
            options,
            checkpoint: Some(&checkpoint),
        };
        let trained = train::train(&lesson_of, weights, ears, &mut |_: News| {})?;
        if trained.interrupted {
            return Ok(false);
        }
        let mut provenance = Provenance {
            senda: env!("CARGO_PKG_VERSION").to_owned(),
            commit: senda_run::COMMIT.to_owned(),
            worlds: lesson.worlds.clone(),
            seed: options.seed,
            command: format!("senda compare: {}", self.plan.name),
            ..Provenance::default()
        };
        let best = trained
            .history
            .iter()
            .find(|epoch| epoch.number == trained.best_epoch);
        if let Some(best) = best {
            let best = serde_json::to_value(best).unwrap_or_default();
            provenance.metrics.insert("best_epoch".into(), best);
        }
        let camera = find_vehicle(&self.plan.vehicle)?.body().cameras.first().cloned();
        let model = Model {
            outputs: lesson.answers.iter().map(|answer| answer.output()).collect(),
            network: lesson.network.clone(),
            weights: trained.weights,
            input: senda_nets::InputSpec {
                camera,
                ..lesson.input.clone()
            },
            provenance,
            grids: vec![],
            detection: None,
            forgets: options.forgets(&lesson.network),
        };
        model.save(path)?;
        // Of no more use; a file that stays does no harm.
        let _ = std::fs::remove_file(&checkpoint);
        Ok(true)
    }

    fn judge(&self, judgement: &Judgement, needs: &[usize]) -> Result<Offline, CompareError> {
        let (models, sets) = needs.split_at(judgement.models);
        let mut answers = Vec::new();
        for (model, sets) in models.iter().zip(sets.chunks(2)) {
            let model = self.model(*model)?;
            let learned = self.samples(sets[0])?;
            let training = offline::against_samples(&model, &centre(&learned));
            let held_out = offline::against_samples(&model, &self.samples(sets[1])?);
            for (training, held_out) in training.into_iter().zip(held_out) {
                answers.push(OfflineAnswer {
                    name: training.output,
                    training: training.root_mean_square,
                    held_out: held_out.root_mean_square,
                });
            }
        }
        Ok(Offline { answers })
    }
}

/// Only the runs of the centre camera: side cameras' labels are made up.
fn centre(samples: &Samples) -> Samples {
    samples.part(|run| {
        let is_side = run.name.ends_with("(left)") || run.name.ends_with("(right)");
        if is_side { 0..0 } else { 0..run.frames.len() }
    })
}

fn record(scenario: &Scenario, path: &Path, ears: &mut Ears) -> Result<bool, CompareError> {
    let partial = path.with_extension("unfinished");
    let file = File::create(&partial).map_err(|source| CompareError::io(&partial, source))?;
    let outcome = drive::run(scenario, Some(file), ears);
    let ended = match &outcome {
        Ok((outcome, _)) => Some(outcome.ending),
        Err(_) => None,
    };
    let is_whole = match ended {
        Some(drive::Ending::Finished) => true,
        // Somebody wanted so much of it.
        Some(drive::Ending::TimeOut) => scenario.time_limit_s.is_some(),
        _ => false,
    };
    if !is_whole {
        // Half a lap is of no use; failing to remove it changes nothing.
        let _ = std::fs::remove_file(&partial);
    }
    match ended {
        None | Some(drive::Ending::Interrupted) => return outcome.map(|_| false).map_err(CompareError::from),
        Some(ending) if !is_whole => {
            return Err(CompareError::Lap {
                world: scenario.world.clone(),
                driver: scenario.driver.clone(),
                ended: ending.words(),
            });
        }
        Some(_) => {}
    }
    // What stands under its name must be whole even after a loss of power.
    let synced = File::open(&partial).and_then(|file| file.sync_all());
    synced.map_err(|source| CompareError::io(&partial, source))?;
    std::fs::rename(&partial, path).map_err(|source| CompareError::io(path, source))?;
    Ok(true)
}

pub(crate) fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), CompareError> {
    let mut text = serde_json::to_string_pretty(value).unwrap_or_default();
    text.push('\n');
    write(path, text.as_bytes())
}

pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), CompareError> {
    whole_file::replace(path, |file| file.write_all(bytes)).map_err(|source| CompareError::io(path, source))
}

pub(crate) fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, CompareError> {
    let text = std::fs::read_to_string(path).map_err(|source| CompareError::io(path, source))?;
    serde_json::from_str(&text).map_err(|error| CompareError::Result {
        path: path.to_owned(),
        reason: error.to_string(),
    })
}

/// A lap's figures.
pub(crate) fn lap(path: &Path) -> Result<Summary, CompareError> {
    read_json(path)
}
