//! A plan as jobs: each makes one file, named by a hash of everything that it depends on.

use crate::CompareError;
use crate::plan::{Condition, Control, Plan, Purpose, Row};
use senda_drivers::Answer;
use senda_learn::Training;
use senda_learn::beginning::frozen_layers;
use senda_learn::gather::Selection;
use senda_nets::{Edges, InputSpec, Network, View};
use senda_run::Scenario;
use senda_run::scenario::{StartOffset, find_vehicle, find_world};
use senda_world::{VehicleSpec, World};
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, btree_map::Entry};
use std::path::PathBuf;

/// What is to be done.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Work {
    /// Record a lap.
    Record(Box<Scenario>),
    /// Prepare the frames of recordings for one kind of input.
    Prepare(Box<Preparation>),
    /// Train a network.
    Train(Box<Lesson>),
    /// Compare a network's answers with the human's.
    Judge(Box<Judgement>),
    /// Drive a lap.
    Drive(Box<Scenario>),
}

/// Frames to be prepared.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Preparation {
    pub(crate) input: InputSpec,
    pub(crate) answers: Vec<Answer>,
    pub(crate) selection: Selection,
    pub(crate) vehicle: String,
}

/// A network to be trained on the samples of the first needed preparation and chosen by those of the second one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lesson {
    pub(crate) network: Network,
    pub(crate) input: InputSpec,
    pub(crate) answers: Vec<Answer>,
    pub(crate) training: Training,
    pub(crate) worlds: Vec<String>,
    /// Weights to begin with.
    pub(crate) from: Option<PathBuf>,
}

/// Models (the first needs) and for each the preparations of training and held-out laps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Judgement {
    pub(crate) models: usize,
}

/// A job.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Task {
    /// Hash of everything that its result depends on.
    pub(crate) key: String,
    pub(crate) work: Work,
    /// Numbers of the jobs whose results it needs.
    pub(crate) needs: Vec<usize>,
    /// How long it takes about (s of one core): for the progress bar alone.
    pub(crate) cost_s: f64,
    /// What it is, for people.
    pub(crate) title: String,
}

impl Task {
    /// Where its result lies within a comparison's folder.
    pub(crate) fn file(&self) -> String {
        let (folder, ending) = match self.work {
            Work::Record(_) => ("recordings", "mcap"),
            Work::Prepare(_) => ("samples", "bin"),
            Work::Train(_) => ("models", "senda"),
            Work::Judge(_) => ("offline", "json"),
            Work::Drive(_) => ("laps", "json"),
        };
        format!("{folder}/{}.{ending}", self.key)
    }

    /// Whether tables need its result: recordings and prepared frames are only on the way to one.
    pub(crate) fn is_result(&self) -> bool {
        matches!(self.work, Work::Train(_) | Work::Judge(_) | Work::Drive(_))
    }
}

/// One row trained with one seed: what a shard takes as a whole.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Unit {
    /// Number of the row.
    pub(crate) row: usize,
    /// Seed of the training.
    pub(crate) seed: u64,
    /// Jobs that train its networks.
    pub(crate) models: Vec<usize>,
    /// Job that measures its offline error.
    pub(crate) offline: usize,
    /// Laps by condition (those that the row drives under), in the plan's order.
    pub(crate) laps: Vec<(usize, Vec<usize>)>,
}

/// All jobs of a plan, in an order in which they can be done, and what belongs together.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Jobs {
    pub(crate) tasks: Vec<Task>,
    pub(crate) units: Vec<Unit>,
}

/// Prepares a row's networks: layers, input and answers of each.
pub(crate) fn prepared(row: &Row) -> Result<Vec<(Network, InputSpec, Vec<Answer>)>, String> {
    row.control
        .answers()
        .iter()
        .map(|answers| {
            let network =
                senda_learn::learn::network_for(&row.network, answers).map_err(|error| error.to_string())?;
            let input = input_of(row, &network)?;
            Ok((network, input, answers.to_vec()))
        })
        .collect()
}

fn input_of(row: &Row, network: &Network) -> Result<InputSpec, String> {
    let view = View {
        colour: row.colour,
        crop: row.crop,
        edges: row.edges.then(Edges::default),
        stack: row.stack,
    };
    InputSpec::for_network(network, &view)
}

/// A hash of texts, as a name.
pub(crate) fn key_of(parts: &[&str]) -> String {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part.as_bytes());
    }
    hash.finalize()[..10]
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

/// The part of `count` (from 0) that a row with a seed belongs to: a hash, so that it stays where it is when rows are added.
pub(crate) fn part_of(identity: &str, seed: u64, count: u64) -> u64 {
    let hash = Sha256::digest(format!("{identity}\n{seed}").as_bytes());
    let mut first = [0; 8];
    first.copy_from_slice(&hash[..8]);
    u64::from_le_bytes(first) % count.max(1)
}

/// Puts jobs together; equal ones are there once.
struct Builder {
    tasks: Vec<Task>,
    by_key: BTreeMap<String, usize>,
    worlds: BTreeMap<String, KnownWorld>,
    vehicle: String,
}

/// What jobs need of a world.
struct KnownWorld {
    length_m: f64,
    toml: String,
    /// As TOML without name and description: equal for the same world under another name.
    content: String,
}

impl KnownWorld {
    fn of(mut world: World) -> Self {
        let toml = world.to_toml();
        world.name.clear();
        world.description.clear();
        Self {
            length_m: world.path.length_m(),
            toml,
            content: world.to_toml(),
        }
    }
}

impl Builder {
    fn add(
        &mut self,
        kind: &str,
        what: &str,
        needs: Vec<usize>,
        cost_s: f64,
        title: String,
        work: Work,
    ) -> usize {
        let mut parts = vec![env!("CARGO_PKG_VERSION"), kind, what];
        let needed: Vec<String> = needs.iter().map(|need| self.tasks[*need].key.clone()).collect();
        parts.extend(needed.iter().map(String::as_str));
        let key = key_of(&parts);
        let next = self.tasks.len();
        let index = *self.by_key.entry(key.clone()).or_insert(next);
        if index == next {
            self.tasks.push(Task {
                key,
                work,
                needs,
                cost_s,
                title,
            });
        }
        index
    }

    fn world(&mut self, name: &str) -> Result<&KnownWorld, CompareError> {
        match self.worlds.entry(name.to_owned()) {
            Entry::Occupied(known) => Ok(known.into_mut()),
            Entry::Vacant(place) => Ok(place.insert(KnownWorld::of(find_world(name)?))),
        }
    }

    /// Refuses worlds that judge and were learned from or tuned on, whatever they are called.
    fn refuse_seen(&mut self, plan: &Plan) -> Result<(), CompareError> {
        let judges = [
            ("[data] held_out", &plan.data.held_out),
            ("[judging] worlds", &plan.judging.worlds),
        ];
        let mut seen = BTreeMap::new();
        for learned in plan.data.training.iter().chain(&plan.data.tuning) {
            seen.insert(self.world(learned)?.content.clone(), learned);
        }
        for (key, worlds) in judges {
            for world in worlds {
                if let Some(learned) = seen.get(&self.world(world)?.content) {
                    return Err(CompareError::Seen {
                        key,
                        world: world.clone(),
                        learned: (*learned).clone(),
                    });
                }
            }
        }
        Ok(())
    }

    /// A lap's key holds the content of world and vehicle, not their names.
    fn lap(
        &mut self,
        scenario: &Scenario,
        kind: &str,
        needs: Vec<usize>,
        cost_s: f64,
        title: String,
    ) -> Result<usize, CompareError> {
        let mut what = format!("{}\n{}\n", scenario.to_toml(), self.vehicle);
        what += &self.world(&scenario.world)?.toml;
        let work = Box::new(scenario.clone());
        let work = match kind {
            "record" => Work::Record(work),
            _ => Work::Drive(work),
        };
        Ok(self.add(kind, &what, needs, cost_s, title, work))
    }
}

impl Jobs {
    /// The jobs of a plan.
    pub(crate) fn of(plan: &Plan) -> Result<Self, CompareError> {
        let vehicle = find_vehicle(&plan.vehicle)?;
        check_speeds(plan, vehicle.speed_limit_mps)?;
        let mut builder = Builder {
            tasks: Vec::new(),
            by_key: BTreeMap::new(),
            worlds: BTreeMap::new(),
            // Plans say how fast; what a vehicle does without a word is no part of a lap.
            vehicle: VehicleSpec {
                cruise_mps: None,
                ..vehicle
            }
            .to_toml(),
        };
        builder.refuse_seen(plan)?;
        let mut recordings: BTreeMap<Purpose, Vec<usize>> = BTreeMap::new();
        for purpose in [Purpose::Training, Purpose::Tuning, Purpose::HeldOut] {
            for (world, seed) in plan.data.takes(purpose) {
                let scenario = Scenario {
                    seed,
                    speed_mps: Some(plan.speed_mps),
                    time_limit_s: plan.data.time_limit_s,
                    ..Scenario::new(&world, &plan.vehicle, &plan.data.driver)
                };
                let title = format!("recording {world} by {} {seed}", plan.data.driver);
                let task = builder.lap(&scenario, "record", vec![], RECORD_S, title)?;
                recordings.entry(purpose).or_default().push(task);
            }
        }
        let mut units = Vec::new();
        // Seed by seed: what an interruption leaves is a whole comparison with fewer seeds.
        for seed in 1..=plan.seeds {
            for (number, row) in plan.rows.iter().enumerate() {
                units.push(unit(plan, row, number, seed, &recordings, &mut builder)?);
            }
        }
        Ok(Self {
            tasks: builder.tasks,
            units,
        })
    }

    /// Numbers of the jobs that part `index` of `count` needs, in order.
    pub(crate) fn part(&self, plan: &Plan, index: u64, count: u64) -> Vec<usize> {
        let mut wanted = vec![false; self.tasks.len()];
        for unit in &self.units {
            if part_of(&plan.rows[unit.row].identity(), unit.seed, count) != index {
                continue;
            }
            for task in unit.all() {
                self.want(task, &mut wanted);
            }
        }
        (0..self.tasks.len()).filter(|task| wanted[*task]).collect()
    }

    fn want(&self, task: usize, wanted: &mut [bool]) {
        if !std::mem::replace(&mut wanted[task], true) {
            for need in &self.tasks[task].needs {
                self.want(*need, wanted);
            }
        }
    }
}

impl Unit {
    /// All its jobs.
    pub(crate) fn all(&self) -> Vec<usize> {
        let mut all = self.models.clone();
        all.push(self.offline);
        all.extend(self.laps.iter().flat_map(|(_, laps)| laps));
        all
    }
}

/// Refuses speeds that the vehicle cannot drive, before anything is recorded.
fn check_speeds(plan: &Plan, most_mps: f64) -> Result<(), CompareError> {
    let of_conditions = plan.conditions.iter().filter_map(|condition| {
        let key = format!("speed_mps of condition {:?}", condition.name);
        Some((key, condition.speed_mps?))
    });
    let mut speeds = std::iter::once(("speed_mps".to_owned(), plan.speed_mps)).chain(of_conditions);
    match speeds.find(|(_, speed_mps)| *speed_mps > most_mps) {
        None => Ok(()),
        Some((key, found_mps)) => Err(CompareError::Speed {
            key,
            found_mps,
            vehicle: plan.vehicle.clone(),
            most_mps,
        }),
    }
}

/// What jobs take on one core of a machine like that of the results page (s), measured once; only the progress bar and the
/// estimate depend on them.
const RECORD_S: f64 = 20.0;
const LAP_S: f64 = 7.0;
const PREPARE_S_PER_LAP: f64 = 1.0;
const TRAIN_S_PER_MULTIPLY_ADD: f64 = 1.3e-10;
const TRAIN_S_PER_FRAME: f64 = 2.5e-5;
/// Frames of a lap, about.
const LAP_FRAMES: f64 = 2200.0;

fn unit(
    plan: &Plan,
    row: &Row,
    number: usize,
    seed: u64,
    recordings: &BTreeMap<Purpose, Vec<usize>>,
    builder: &mut Builder,
) -> Result<Unit, CompareError> {
    let wrong = |reason: String| CompareError::Row {
        row: row.identity(),
        reason,
    };
    let mut models = Vec::new();
    let mut judged = Vec::new();
    for (network, input, answers) in prepared(row).map_err(wrong)? {
        let names: Vec<&str> = answers.iter().map(|answer| answer.name()).collect();
        let names = names.join(" and ");
        let mut prepare = |purpose: Purpose| {
            let cameras = if purpose == Purpose::Training { 3.0 } else { 1.0 };
            let selection = Selection {
                side_camera_shift: if purpose == Purpose::Training {
                    plan.data.side_camera_shift
                } else {
                    0.0
                },
                ..Selection::default()
            };
            let needs = recordings.get(&purpose).cloned().unwrap_or_default();
            let preparation = Preparation {
                input: input.clone(),
                answers: answers.clone(),
                selection,
                vehicle: plan.vehicle.clone(),
            };
            let what = json(&(&preparation.input, &preparation.answers, &preparation.selection));
            let cost_s = PREPARE_S_PER_LAP * cameras * needs.len() as f64;
            let title = format!("preparing {}x{} {names}", input.width, input.height);
            builder.add(
                "prepare",
                &what,
                needs,
                cost_s,
                title,
                Work::Prepare(Box::new(preparation)),
            )
        };
        let (learned, tuned, held_out) = (
            prepare(Purpose::Training),
            prepare(Purpose::Tuning),
            prepare(Purpose::HeldOut),
        );
        let training = row.training(&plan.lesson, &network, seed);
        let frames = 3.0 * LAP_FRAMES * plan.data.training.len() as f64 * f64::from(training.epochs);
        let cost_s = frames * (TRAIN_S_PER_FRAME + TRAIN_S_PER_MULTIPLY_ADD * network.multiply_adds() as f64);
        let mut what = json(&(network.to_toml(), &input, &answers, &training));
        match &row.from {
            Some(from) => {
                let bytes = std::fs::read(from).map_err(|source| CompareError::io(from, source))?;
                let hash = Sha256::digest(&bytes);
                what.extend(hash.iter().map(|byte| format!("{byte:02x}")));
            }
            None if frozen_layers(&network) > 0 => {
                return Err(wrong(format!(
                    "expected weights for the {} layers of {} that are not trained, but found none; name a file that holds them with \
                     `from = \"FILE\"`",
                    frozen_layers(&network),
                    network.name()
                )));
            }
            None => {}
        }
        let lesson = Lesson {
            from: row.from.clone(),
            network,
            input,
            answers,
            training,
            worlds: plan.data.training.clone(),
        };
        let title = format!("training {} ({names}), seed {seed}", row.identity());
        models.push(builder.add(
            "train",
            &what,
            vec![learned, tuned],
            cost_s,
            title,
            Work::Train(Box::new(lesson)),
        ));
        judged.extend([learned, held_out]);
    }
    let mut needs = models.clone();
    needs.extend(judged);
    let offline = builder.add(
        "judge",
        "",
        needs,
        1.0,
        format!("offline error of {}, seed {seed}", row.identity()),
        Work::Judge(Box::new(Judgement { models: models.len() })),
    );
    let mut laps = Vec::new();
    for (index, condition) in plan.conditions.iter().enumerate() {
        if !condition.includes(row) {
            continue;
        }
        let mut driven = Vec::new();
        for mut lap in lap_scenarios(plan, condition, builder)? {
            if row.control != Control::Steering {
                // From rest in the middle of a lap, where nobody ever stood, many would not press the pedal, and a lap
                // that was not driven says nothing about steering.
                lap.start.speed_mps = condition.speed_mps.unwrap_or(plan.speed_mps);
            }
            let title = format!(
                "{} on {}, seed {seed}, {}",
                row.identity(),
                lap.world,
                condition.name
            );
            driven.push(builder.lap(&lap, "drive", models.clone(), LAP_S, title)?);
        }
        laps.push((index, driven));
    }
    Ok(Unit {
        row: number,
        seed,
        models,
        offline,
        laps,
    })
}

fn json<T: serde::Serialize>(value: &T) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

/// Every world from every start, without the driver's models.
fn lap_scenarios(
    plan: &Plan,
    condition: &Condition,
    builder: &mut Builder,
) -> Result<Vec<Scenario>, CompareError> {
    let speed_mps = condition.speed_mps.unwrap_or(plan.speed_mps);
    let mut laps = Vec::new();
    for world in &plan.judging.worlds {
        let length_m = builder.world(world)?.length_m;
        for (number, part) in plan.judging.starts.iter().enumerate() {
            let patient_s = plan.judging.patience * length_m / speed_mps + 20.0;
            laps.push(Scenario {
                seed: number as u64 + 1,
                speed_mps: Some(speed_mps),
                latency_s: condition.latency_s,
                lost_frames: condition.lost_frames,
                start: StartOffset {
                    station_m: part * length_m,
                    ..StartOffset::default()
                },
                time_limit_s: Some(plan.judging.time_limit_s.unwrap_or(patient_s)),
                ..Scenario::new(world, &plan.vehicle, "neural")
            });
        }
    }
    Ok(laps)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document() -> Plan {
        let mut plan = Plan::preset("document-b").unwrap();
        // Without made-up roads: they take a moment to lay out.
        plan.data.training = vec!["meadow".into()];
        plan.data.held_out = vec!["forest".into()];
        plan.seeds = 2;
        plan
    }

    fn keys(jobs: &Jobs) -> Vec<&str> {
        jobs.tasks.iter().map(|task| task.key.as_str()).collect()
    }

    #[test]
    fn parts_share_all_the_work_and_nothing_but_preparations() {
        let plan = document();
        let jobs = Jobs::of(&plan).unwrap();
        let mut taken = vec![0; jobs.tasks.len()];
        let mut sizes = Vec::new();
        for index in 0..4 {
            let part = jobs.part(&plan, index, 4);
            sizes.push(part.len());
            for task in part {
                taken[task] += 1;
            }
        }
        assert!(taken.iter().all(|count| *count > 0));
        let driven_twice = jobs
            .tasks
            .iter()
            .zip(&taken)
            .any(|(task, count)| matches!(task.work, Work::Drive(_)) && *count > 1);
        assert!(!driven_twice);
        assert!(sizes.iter().all(|size| *size < jobs.tasks.len()), "{sizes:?}");
        // Needs come before what needs them.
        for (number, task) in jobs.tasks.iter().enumerate() {
            assert!(task.needs.iter().all(|need| *need < number));
        }
    }

    #[test]
    fn a_key_depends_on_what_the_job_depends_on_and_on_nothing_else() {
        let plan = document();
        let before = Jobs::of(&plan).unwrap();
        assert_eq!(keys(&before), keys(&Jobs::of(&plan).unwrap()));
        // Another row, another order: the same jobs and more.
        let mut more = plan.clone();
        more.rows.reverse();
        more.rows.push(Row {
            name: "again".into(),
            sequence: Some(4),
            ..more.rows[0].clone()
        });
        let after = Jobs::of(&more).unwrap();
        assert!(keys(&before).iter().all(|key| keys(&after).contains(key)));
        // Another speed: everything else.
        let faster = Plan {
            speed_mps: 9.0,
            ..plan.clone()
        };
        let faster = Jobs::of(&faster).unwrap();
        assert!(keys(&before).iter().all(|key| !keys(&faster).contains(key)));
        // More epochs: the same recordings and frames, other networks, errors and laps.
        let mut longer = plan.clone();
        longer.lesson.epochs += 1;
        let longer = Jobs::of(&longer).unwrap();
        for (task, key) in before.tasks.iter().zip(keys(&before)) {
            assert_eq!(keys(&longer).contains(&key), !task.is_result(), "{}", task.title);
        }
    }

    #[test]
    fn two_networks_share_the_one_that_steers_with_steering_only() {
        let mut plan = document();
        let row = Row {
            control: crate::Control::TwoNetworks,
            ..plan.rows[0].clone()
        };
        plan.rows.push(row);
        let jobs = Jobs::of(&plan).unwrap();
        let (alone, both) = (&jobs.units[0], &jobs.units[plan.rows.len() - 1]);
        assert_eq!((alone.models.len(), both.models.len()), (1, 2));
        assert_eq!(alone.models[0], both.models[0]);
    }
}
