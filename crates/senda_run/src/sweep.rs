//! Many runs: worlds x lights x floors x starts x speeds x seeds, in parallel, resumable.
//!
//! Every run is a [`Scenario`] of its own, so any failure can be repeated alone. Results go to a file of one JSON object a
//! line, in the order in which runs end; a second start reads that file and does only what is missing. Nothing depends
//! on the number of threads but the order of the lines.

use crate::own_file::{self, Kind};
use crate::{Ears, RunError, Scenario, drive, pilot, random, scenario::StartOffset};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use senda_eval::Summary;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::{BufRead, BufReader, Read, Seek, SeekFrom, Write},
    path::Path,
    sync::Mutex,
    sync::atomic::{AtomicUsize, Ordering},
};

const PLAN_FILE: Kind = Kind {
    name: "sweep plan",
    help: "it holds a scenario as [base] and lists of what to vary, such as lights = [\"daylight\", \"lamp\"]",
};

/// What to vary. Empty lists keep the base scenario's value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The scenario that everything else is varied around.
    pub base: Scenario,
    /// Worlds; `random-line:100..200` stands for a hundred.
    #[serde(default)]
    pub worlds: Vec<String>,
    /// Drivers.
    #[serde(default)]
    pub drivers: Vec<String>,
    /// Lights.
    #[serde(default)]
    pub lights: Vec<String>,
    /// Floors.
    #[serde(default)]
    pub floors: Vec<String>,
    /// Speeds (m/s).
    #[serde(default)]
    pub speeds_mps: Vec<f64>,
    /// Further delays from the exposure to the driver (s).
    #[serde(default)]
    pub latencies_s: Vec<f64>,
    /// Image sizes (px).
    #[serde(default)]
    pub images_px: Vec<[u32; 2]>,
    /// Also drive the other way round.
    #[serde(default)]
    pub both_directions: bool,
    /// Starting places are drawn from this spread.
    #[serde(default)]
    pub start_spread: StartSpread,
    /// Seeds a combination: 1 runs each once.
    #[serde(default = "one")]
    pub seeds: u64,
    /// Draws this many runs at random from all combinations instead of running every one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample: Option<usize>,
}

/// Half widths of the uniform distributions that starting places are drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartSpread {
    /// To either side of the path (m).
    #[serde(default)]
    pub offset_m: f64,
    /// Turned to either side (rad).
    #[serde(default)]
    pub heading_rad: f64,
    /// Further along the path, 0 to this (m); on open paths what lies beyond their way goes on from its beginning.
    #[serde(default)]
    pub station_m: f64,
}

fn one() -> u64 {
    1
}

/// One run's line in the results file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Line {
    /// Identifies the run: a hash of its scenario and of senda's version.
    pub key: String,
    /// What was run.
    pub scenario: Scenario,
    /// What came out, or
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub summary: Option<Summary>,
    /// why nothing did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

impl Plan {
    /// A plan that runs its base once.
    pub fn once(base: Scenario) -> Self {
        Self {
            base,
            worlds: vec![],
            drivers: vec![],
            lights: vec![],
            floors: vec![],
            speeds_mps: vec![],
            latencies_s: vec![],
            images_px: vec![],
            both_directions: false,
            start_spread: StartSpread::default(),
            seeds: 1,
            sample: None,
        }
    }

    /// Reads a sweep file. Errors name the line.
    pub fn load(path: &Path) -> Result<Self, RunError> {
        own_file::load(path, &PLAN_FILE)
    }

    /// Every run of the plan, in a fixed order. Run number i depends on the plan and i alone.
    pub fn runs(&self) -> Result<Vec<Scenario>, RunError> {
        let or_base = |list: &[String], base: &str| {
            if list.is_empty() {
                vec![base.to_owned()]
            } else {
                list.to_vec()
            }
        };
        let worlds = random::expand(&or_base(&self.worlds, &self.base.world))?;
        let drivers = or_base(&self.drivers, &self.base.driver);
        let some = |list: &[String], base: &Option<String>| -> Vec<Option<String>> {
            if list.is_empty() {
                vec![base.clone()]
            } else {
                list.iter().cloned().map(Some).collect()
            }
        };
        let lights = some(&self.lights, &self.base.light);
        let floors = some(&self.floors, &self.base.floor);
        let speeds: Vec<Option<f64>> = if self.speeds_mps.is_empty() {
            vec![self.base.speed_mps]
        } else {
            self.speeds_mps.iter().copied().map(Some).collect()
        };
        let latencies = if self.latencies_s.is_empty() {
            vec![self.base.latency_s]
        } else {
            self.latencies_s.clone()
        };
        let images: Vec<Option<[u32; 2]>> = if self.images_px.is_empty() {
            vec![self.base.image_px]
        } else {
            self.images_px.iter().copied().map(Some).collect()
        };
        let directions = if self.both_directions {
            vec![false, true]
        } else {
            vec![self.base.reverse]
        };
        let seeds: Vec<u64> = (0..self.seeds.max(1)).map(|i| self.base.seed + i).collect();
        let sizes = [
            worlds.len(),
            drivers.len(),
            lights.len(),
            floors.len(),
            speeds.len(),
            images.len(),
            directions.len(),
            seeds.len(),
            latencies.len(),
        ];
        let total: usize = sizes.iter().product();
        let scenario = |places: [usize; 9], number: u64| -> Scenario {
            let mut rng = ChaCha8Rng::seed_from_u64(self.base.seed);
            rng.set_stream(number + 1);
            let mut spread = |half: f64| {
                if half > 0.0 {
                    rng.random_range(-half..=half)
                } else {
                    0.0
                }
            };
            let start = StartOffset {
                offset_m: self.base.start.offset_m + spread(self.start_spread.offset_m),
                heading_rad: self.base.start.heading_rad + spread(self.start_spread.heading_rad),
                station_m: self.base.start.station_m + spread(self.start_spread.station_m).abs(),
                speed_mps: self.base.start.speed_mps,
            };
            Scenario {
                world: worlds[places[0]].clone(),
                driver: drivers[places[1]].clone(),
                light: lights[places[2]].clone(),
                floor: floors[places[3]].clone(),
                speed_mps: speeds[places[4]],
                image_px: images[places[5]],
                reverse: directions[places[6]],
                seed: seeds[places[7]],
                latency_s: latencies[places[8]],
                start,
                ..self.base.clone()
            }
        };
        let mut picker = ChaCha8Rng::seed_from_u64(self.base.seed);
        Ok(match self.sample {
            None => (0..total)
                .map(|number| scenario(unravel(number, &sizes), number as u64))
                .collect(),
            Some(count) => (0..count as u64)
                .map(|number| {
                    let mut draw = |size: usize| picker.random_range(0..size);
                    let mut places = [0; 9];
                    for (place, size) in places.iter_mut().zip(sizes).take(8) {
                        *place = draw(size);
                    }
                    // No draw without a choice: sweeps that do not vary it keep their runs.
                    if sizes[8] > 1 {
                        places[8] = draw(sizes[8]);
                    }
                    let drawn = scenario(places, number);
                    Scenario {
                        seed: self.base.seed + number,
                        ..drawn
                    }
                })
                .collect(),
        })
    }
}

impl Plan {
    /// A run whose start was drawn beyond an open path's end, brought back onto the way.
    fn on_the_way(&self, run: &Scenario) -> Scenario {
        let mut run = run.clone();
        // A world that does not resolve is complained of by the run itself.
        if self.start_spread.station_m > 0.0
            && let Ok(world) = run.resolve_world()
        {
            run.start = run.start.on_the_way(&world);
        }
        run
    }
}

fn unravel(mut number: usize, sizes: &[usize; 9]) -> [usize; 9] {
    let mut places = [0; 9];
    for i in (0..9).rev() {
        places[i] = number % sizes[i];
        number /= sizes[i];
    }
    places
}

/// The keys of runs: the same scenario (with the same content of the model files that its driver is given) under the same
/// version of senda gives the same result. A model file that many runs share is read once.
fn keys(runs: &[Scenario]) -> Vec<String> {
    let hex = |bytes: &[u8]| -> String { bytes.iter().map(|byte| format!("{byte:02x}")).collect() };
    let mut models: BTreeMap<&str, String> = BTreeMap::new();
    let key = |scenario| {
        let mut text = format!("{}\n{}", env!("CARGO_PKG_VERSION"), Scenario::to_toml(scenario));
        for option in ["model", pilot::DETECTOR] {
            let Some(model) = scenario.driver_options.get(option).and_then(toml::Value::as_str) else {
                continue;
            };
            text += models.entry(model).or_insert_with(|| {
                std::fs::read(model).map_or_else(|_| String::new(), |content| hex(&Sha256::digest(content)))
            });
        }
        hex(&Sha256::digest(text)[..8])
    };
    runs.iter().map(key).collect()
}

/// Runs a plan on all threads of the current rayon pool. Lines of `results` that belong to the plan are kept; missing
/// ones are run and appended. `progress` hears how many of how many are done; `interrupted` ends it between runs.
///
/// Returns the lines in the plan's order. After an interruption some are missing: start again to go on.
pub fn run(
    plan: &Plan,
    results: Option<&Path>,
    progress: &(dyn Fn(usize, usize) + Sync),
    interrupted: &(dyn Fn() -> bool + Sync),
    clock_ns: &(dyn Fn() -> u64 + Sync),
) -> Result<Vec<Line>, RunError> {
    if plan.sample == Some(0) {
        return Err(RunError::Scenario {
            key: "sample",
            found: "0".to_owned(),
            expected: "at least 1; left out, every combination is run".to_owned(),
        });
    }
    let runs = plan.runs()?;
    let keys = keys(&runs);
    let mut done: BTreeMap<String, Line> = BTreeMap::new();
    if let Some(path) = results {
        for line in read_results(path)? {
            done.insert(line.key.clone(), line);
        }
    }
    let sink: Option<Mutex<File>> = match results {
        Some(path) => Some(Mutex::new(
            open_results(path).map_err(|source| RunError::io(path, source))?,
        )),
        None => None,
    };
    let missing: Vec<usize> = (0..runs.len())
        .filter(|i| !done.contains_key(&keys[*i]))
        .collect();
    let finished = AtomicUsize::new(runs.len() - missing.len());
    progress(finished.load(Ordering::Relaxed), runs.len());
    let fresh: Result<Vec<Option<Line>>, RunError> = missing
        .par_iter()
        .map(|&i| {
            if interrupted() {
                return Ok(None);
            }
            let mut ears = Ears {
                progress: Box::new(|_| {}),
                interrupted: Box::new(interrupted),
                clock_ns: Box::new(clock_ns),
            };
            let began_ns = clock_ns();
            let scenario = plan.on_the_way(&runs[i]);
            let line = match drive::in_memory(&scenario, &mut ears) {
                Ok(outcome) if outcome.ending == drive::Ending::Interrupted => return Ok(None),
                Ok(outcome) => {
                    let mut summary = outcome.summary;
                    summary.wall_s = clock_ns().saturating_sub(began_ns) as f64 * 1e-9;
                    Line {
                        key: keys[i].clone(),
                        scenario,
                        summary: Some(summary),
                        error: None,
                    }
                }
                Err(error) => Line {
                    key: keys[i].clone(),
                    scenario,
                    summary: None,
                    error: Some(error.to_string()),
                },
            };
            if let (Some(sink), Some(path)) = (&sink, results) {
                let mut text = serde_json::to_string(&line).unwrap_or_default();
                text.push('\n');
                let mut file = sink.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                file.write_all(text.as_bytes())
                    .map_err(|source| RunError::io(path, source))?;
            }
            progress(finished.fetch_add(1, Ordering::Relaxed) + 1, runs.len());
            Ok(Some(line))
        })
        .collect();
    for line in fresh?.into_iter().flatten() {
        done.insert(line.key.clone(), line);
    }
    Ok(keys.iter().filter_map(|key| done.get(key).cloned()).collect())
}

/// Opens for appending, after cutting off a last line that was not written whole.
fn open_results(path: &Path) -> std::io::Result<File> {
    let mut file = OpenOptions::new()
        .create(true)
        .truncate(false)
        .read(true)
        .write(true)
        .open(path)?;
    let mut text = Vec::new();
    file.read_to_end(&mut text)?;
    let whole = text
        .iter()
        .rposition(|byte| *byte == b'\n')
        .map_or(0, |last| last + 1);
    file.set_len(whole as u64)?;
    file.seek(SeekFrom::Start(whole as u64))?;
    Ok(file)
}

/// Reads a results file. A last line that was cut short is left out; any other damage is an error with its line.
pub fn read_results(path: &Path) -> Result<Vec<Line>, RunError> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(source) => return Err(RunError::io(path, source)),
    };
    let texts: Vec<String> = BufReader::new(file)
        .lines()
        .collect::<Result<_, _>>()
        .map_err(|source| RunError::io(path, source))?;
    let mut lines = Vec::with_capacity(texts.len());
    for (index, text) in texts.iter().enumerate() {
        match serde_json::from_str(text) {
            Ok(line) => lines.push(line),
            Err(_) if index + 1 == texts.len() => {}
            Err(error) => {
                return Err(RunError::File {
                    path: path.to_owned(),
                    reason: format!(
                        "line {}: expected a result, but {error}: move the file away to start anew",
                        index + 1
                    ),
                });
            }
        }
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> Plan {
        let mut plan = Plan::once(Scenario {
            time_limit_s: Some(1.0),
            ..Scenario::new("straight", "gopigo", "line")
        });
        plan.speeds_mps = vec![0.1, 0.13];
        plan.both_directions = true;
        plan.start_spread.offset_m = 0.02;
        plan
    }

    #[test]
    fn a_plan_is_the_product_of_its_lists_and_starts_differ() {
        let runs = plan().runs().unwrap();
        assert_eq!(runs.len(), 4);
        assert_eq!(runs, plan().runs().unwrap());
        assert_ne!(runs[0].start, runs[1].start);
        let different: std::collections::BTreeSet<String> = keys(&runs).into_iter().collect();
        assert_eq!(different.len(), 4);
        let sampled = Plan {
            sample: Some(10),
            ..plan()
        }
        .runs()
        .unwrap();
        assert_eq!(sampled.len(), 10);
    }

    /// Another content of a model file, under whichever option, is another run.
    #[test]
    fn keys_follow_the_content_of_models() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.senda");
        for option in ["model", "detector"] {
            let mut plan = plan();
            plan.base
                .driver_options
                .insert(option.to_owned(), path.to_str().unwrap().into());
            let runs = plan.runs().unwrap();
            std::fs::write(&path, "one").unwrap();
            let one = keys(&runs);
            assert_eq!(keys(&runs), one);
            std::fs::write(&path, "other").unwrap();
            assert_ne!(keys(&runs), one, "{option}");
        }
    }

    #[test]
    fn interrupted_and_resumed_equals_uninterrupted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.jsonl");
        let silent: &(dyn Fn(usize, usize) + Sync) = &|_, _| {};
        let whole = run(&plan(), None, silent, &|| false, &|| 0).unwrap();
        let asked = AtomicUsize::new(0);
        let part = run(
            &plan(),
            Some(&path),
            silent,
            &|| asked.fetch_add(1, Ordering::Relaxed) > 40,
            &|| 0,
        )
        .unwrap();
        assert!(part.len() < whole.len());
        // A write that was cut short must not cost the rest.
        OpenOptions::new()
            .append(true)
            .open(&path)
            .unwrap()
            .write_all(b"{\"key\": \"tor")
            .unwrap();
        let resumed = run(&plan(), Some(&path), silent, &|| false, &|| 0).unwrap();
        let digests = |lines: &[Line]| -> Vec<String> {
            lines
                .iter()
                .map(|line| line.summary.as_ref().unwrap().digest.clone())
                .collect()
        };
        assert_eq!(digests(&whole), digests(&resumed));
    }
}
