//! The whole path on a budget of a few frames: the same on any number of threads, after an interruption, and never mixed up
//! with another experiment.

mod support;

use senda_drivers::Answer;
use senda_learn::correct::{Brief, Gathered, gather};
use senda_learn::{LearnError, Samples};
use senda_learn::{
    learn::{Learned, Learning, learn},
    trial::Trial,
};
use senda_nets::{Model, OutputSpec, Provenance, Weights};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

fn learning(folder: &Path) -> Learning {
    let network = folder.join("tiny.toml");
    std::fs::write(&network, support::NETWORK).unwrap();
    let mut learning = Learning {
        network: network.display().to_string(),
        expert_frames: 40,
        rounds: 1,
        round_frames: 40,
        round_epochs: 2,
        trial: Trial {
            runs: 0,
            ..Trial::default()
        },
        ..Learning::default()
    };
    learning.gathering.image_px = Some([24, 18]);
    learning.gathering.drive_frames = 6;
    learning.training.epochs = 2;
    learning.training.threads = 1;
    learning
}

fn gathered(threads: usize, with_model: bool) -> (Samples, usize, usize) {
    let folder = tempfile::tempdir().unwrap();
    let learning = learning(folder.path());
    let network = learning.resolve_network().unwrap();
    let input = learning.resolve_input(&network).unwrap();
    let model = Model {
        weights: Weights::random(&network, 3),
        input: input.clone(),
        outputs: vec![OutputSpec {
            name: "steering".into(),
            unit: String::new(),
        }],
        provenance: Provenance::default(),
        grids: vec![],
        detection: None,
        forgets: false,
        network,
    };
    let brief = Brief {
        gathering: &learning.gathering,
        input: &input,
        answers: &[Answer::Steering],
        seed: 5,
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    let Gathered {
        samples,
        drives,
        strayed,
    } = pool
        .install(|| gather(&brief, with_model.then_some(&model), 40, 0, &|_| {}, &|| false))
        .unwrap();
    (samples, drives, strayed)
}

#[test]
fn drives_are_the_same_on_any_number_of_threads() {
    for with_model in [false, true] {
        let one = gathered(1, with_model);
        assert!(one.0.len() >= 40 && one.1 == 8, "{} frames", one.0.len());
        assert_eq!(one, gathered(2, with_model));
        let targets: Vec<f32> = one.0.targets.clone();
        assert!(targets.iter().any(|target| *target != targets[0]));
    }
}

fn run(
    learning: &Learning,
    folder: &Path,
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Result<Learned, LearnError> {
    learn(learning, folder, interrupted, &|_| {})
}

#[test]
fn interrupted_anywhere_and_started_again_it_ends_with_the_same_model() {
    let files = tempfile::tempdir().unwrap();
    let learning = learning(files.path());
    let whole = tempfile::tempdir().unwrap();
    let asked = AtomicUsize::new(0);
    let expected = run(&learning, whole.path(), &|| {
        asked.fetch_add(1, Ordering::Relaxed);
        false
    })
    .unwrap();
    assert!(!expected.interrupted);
    assert_eq!((expected.rounds.len(), expected.history.len()), (2, 2));
    let asked = asked.into_inner();
    assert!(asked > 8);
    // After any number of questions; each start of the program gets a little further.
    for after in [2, 4, asked / 2, asked - 2] {
        let folder = tempfile::tempdir().unwrap();
        let mut left = after;
        let mut starts = 0;
        let learned = loop {
            starts += 1;
            assert!(starts < 100);
            let so_far = AtomicUsize::new(0);
            let learned = run(&learning, folder.path(), &|| {
                so_far.fetch_add(1, Ordering::Relaxed) >= left
            })
            .unwrap();
            if !learned.interrupted {
                break learned;
            }
            left += 3;
        };
        assert!(starts > 1);
        assert_eq!(learned.rounds, expected.rounds, "interrupted after {after}");
        assert!(learned.model.to_bytes() == expected.model.to_bytes());
    }
}

#[test]
fn a_finished_experiment_is_read_back() {
    let files = tempfile::tempdir().unwrap();
    let learning = learning(files.path());
    let first = run(&learning, files.path(), &|| false).unwrap();
    let again = run(&learning, files.path(), &|| true).unwrap();
    assert_eq!(again, first);
}

#[test]
fn another_experiment_in_the_same_folder_is_refused() {
    let files = tempfile::tempdir().unwrap();
    let learning = learning(files.path());
    run(&learning, files.path(), &|| true).unwrap();
    let other = Learning {
        seed: 2,
        ..learning.clone()
    };
    let message = run(&other, files.path(), &|| false).unwrap_err().to_string();
    assert!(
        message.contains("experiment.toml") && message.contains("another folder"),
        "{message}"
    );
    let mut threads = learning;
    threads.training.threads = 2;
    assert!(run(&threads, files.path(), &|| true).unwrap().interrupted);
}

#[test]
fn impossible_experiments_are_refused_by_key() {
    let files = tempfile::tempdir().unwrap();
    let good = learning(files.path());
    let check = |change: &dyn Fn(&mut Learning), key: &str| {
        let mut learning = good.clone();
        change(&mut learning);
        let message = run(&learning, files.path(), &|| false).unwrap_err().to_string();
        assert!(message.contains(key), "{key}: {message}");
    };
    check(&|l| l.expert_frames = 0, "expert_frames");
    check(&|l| l.gathering.families.clear(), "gathering.families");
    check(&|l| l.answers = vec![Answer::Speed], "answers");
    check(&|l| l.training.batch = 0, "batch");
    check(&|l| l.training.learning_rate = f64::NAN, "learning_rate");
    check(&|l| l.training.augmentation.mirror = 2.0, "mirror");
    check(&|l| l.network = "lane-smal".into(), "lane-small");
    check(&|l| l.gathering.vehicle = "pikar".into(), "picar");
    check(&|l| l.crop.top = 1.5, "crop");
    check(&|l| l.gathering.drive_frames = 0, "drive_frames");
    check(&|l| l.gathering.speed_mps = [f64::NAN, 1.0], "speed_mps");
    check(
        &|l| l.gathering.lateral_acceleration_mps2 = Some(f64::NAN),
        "lateral_acceleration_mps2",
    );
    check(&|l| l.gathering.start_offset = f64::INFINITY, "start_offset");
    check(&|l| l.gathering.families = vec!["randomm".into()], "randomm");
    check(&|l| l.gathering.image_px = Some([0, 0]), "image_px");
    // Trials that could not be driven counted as driven badly.
    let trial = |change: &dyn Fn(&mut Trial), key: &str| {
        let change = |l: &mut Learning| {
            l.trial.runs = 2;
            change(&mut l.trial);
        };
        check(&change, key);
    };
    trial(&|t| t.worlds.clear(), "trial.worlds");
    trial(&|t| t.worlds = vec!["nowhere".into()], "nowhere");
    trial(
        &|t| t.worlds = vec!["random-circuit:1000000..1000100".into()],
        "trial.worlds",
    );
    trial(&|t| t.speed_mps = f64::NAN, "trial.speed_mps");
}
