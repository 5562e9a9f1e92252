//! Many runs: worlds x lights x floors x starts x speeds x seeds, in parallel, resumable.
//!
//! Every run is a [`Scenario`] of its own, so any failure can be repeated alone. Results go to a file of one JSON object a
//! line, in the order in which runs end; a second start reads that file and does only what is missing. Nothing depends
//! on the number of threads but the order of the lines.

mod plan;

pub use plan::{Plan, StartSpread};

use crate::{Ears, RunError, Scenario, drive, pilot, scenario};
use rayon::prelude::*;
use senda_core::bounded_file;
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

/// One run's line in the results file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Line {
    /// Identifies the run: a hash of its scenario, of the files that it names, and of senda's version and commit.
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

/// The keys of runs: the same scenario (with the same content of the files of worlds, vehicles, calibrations and models that it
/// names) under the same senda gives the same result. A file that many runs share is read once.
fn keys(runs: &[Scenario]) -> Vec<String> {
    let hex = |bytes: &[u8]| -> String { bytes.iter().map(|byte| format!("{byte:02x}")).collect() };
    let mut contents: BTreeMap<&str, String> = BTreeMap::new();
    let mut keys = Vec::with_capacity(runs.len());
    for scenario in runs {
        let (version, commit) = (env!("CARGO_PKG_VERSION"), crate::COMMIT);
        let mut text = format!("{version}\n{commit}\n{}", scenario.to_toml());
        text += scenario.recorded_world.as_deref().unwrap_or_default();
        for file in files_of(scenario) {
            text += contents.entry(file).or_insert_with(|| {
                bounded_file::read(Path::new(file), bounded_file::GIBIBYTE)
                    .map_or_else(|_| String::new(), |content| hex(&Sha256::digest(content)))
            });
        }
        keys.push(hex(&Sha256::digest(text)[..8]));
    }
    keys
}

/// The files that a scenario names.
fn files_of(scenario: &Scenario) -> impl Iterator<Item = &str> {
    let named = [&scenario.world, &scenario.vehicle].map(String::as_str);
    let models = pilot::FILE_OPTIONS
        .into_iter()
        .filter_map(|option| scenario.driver_options.get(option)?.as_str());
    let files = named.into_iter().filter(|name| scenario::looks_like_file(name));
    files.chain(scenario.calibration.as_deref()).chain(models)
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
    plan.check()?;
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

    /// Another content of a file is another run, whatever names it: the figures of a world that had been edited since were given as
    /// those of the world.
    #[test]
    fn keys_follow_the_content_of_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file.toml");
        for option in [
            "model",
            "throttle_model",
            "detector",
            "world",
            "vehicle",
            "calibration",
        ] {
            let mut plan = plan();
            let file = path.to_str().unwrap().to_owned();
            match option {
                "world" => plan.base.world = file,
                "vehicle" => plan.base.vehicle = file,
                "calibration" => plan.base.calibration = Some(file),
                _ => drop(plan.base.driver_options.insert(option.to_owned(), file.into())),
            }
            let runs = plan.runs().unwrap();
            std::fs::write(&path, "one").unwrap();
            let one = keys(&runs);
            assert_eq!(keys(&runs), one);
            std::fs::write(&path, "other").unwrap();
            assert_ne!(keys(&runs), one, "{option}");
        }
    }

    /// No seed at all was one run, and a spread below 0 none.
    #[test]
    fn ranges_of_a_plan_are_checked() {
        let refused = |change: &dyn Fn(&mut Plan)| {
            let mut plan = plan();
            change(&mut plan);
            run(&plan, None, &|_, _| {}, &|| true, &|| 0)
                .err()
                .map(|error| error.to_string())
        };
        assert_eq!(refused(&|_| {}), None);
        for (key, change) in [
            ("seeds", &(|plan: &mut Plan| plan.seeds = 0) as &dyn Fn(&mut Plan)),
            ("sample", &|plan| plan.sample = Some(0)),
            ("start_spread.offset_m", &|plan| plan.start_spread.offset_m = -1.0),
            ("start_spread.heading_rad", &|plan| {
                plan.start_spread.heading_rad = 4.0
            }),
            ("start_spread.station_m", &|plan| {
                plan.start_spread.station_m = f64::NAN
            }),
        ] {
            let error = refused(change).unwrap();
            assert!(error.contains(&format!("`{key}` is")), "{error}");
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
