//! A tiny comparison as a whole: interrupted, spread, joined, and always the same tables.

use senda_compare::{Comparison, Crew, PartOf, Plan, Verdict, merge};
use senda_eval::report::parts_markdown;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

const NETWORK: &str = r#"
[input]
height = 6
width = 12
channels = 1

[[layer]]
kind = "flatten"

[[layer]]
kind = "dense"
units = 1
"#;

/// Two rows, two seeds, short laps of the kit car.
fn plan(folder: &Path) -> Plan {
    let network = folder.join("own.toml");
    std::fs::write(&network, NETWORK).unwrap();
    let text = format!(
        r#"
name = "tiny"
vehicle = "picar"
speed_mps = 0.3
seeds = 2
baseline = "grey"

[data]
driver = "expert"
training = ["oval-lane"]
held_out = ["s-curves-lane"]
side_camera_shift = 0.0
time_limit_s = 2.0

[training]
epochs = 2
batch = 8

[judging]
worlds = ["s-curves-lane"]
time_limit_s = 1.0

[[condition]]
name = "as it is"

[[condition]]
name = "late"
latency_s = 0.1
rows = ["grey/steering"]

[[row]]
name = "grey"
network = {network:?}
colour = "grey"

[[row]]
name = "saturation"
network = {network:?}
crop = {{ top = 0.3 }}

[[claim]]
says = "colour helps"

[[claim.part]]
says = "saturation is nearer"
figure = "lane"
relation = "less"
rows = ["saturation/steering"]
than = ["grey/steering"]
"#
    );
    Plan::parse("tiny.toml", &text).unwrap()
}

fn crew<'a>(threads: usize, interrupted: &'a (dyn Fn() -> bool + Sync)) -> Crew<'a> {
    Crew {
        threads,
        progress: &|progress| assert!((0.0..=1.0).contains(&progress.part)),
        interrupted,
        clock_ns: &|| 0,
    }
}

fn work(
    comparison: &Comparison,
    part: PartOf,
    threads: usize,
    interrupted: &(dyn Fn() -> bool + Sync),
) -> bool {
    let crew = crew(threads, interrupted);
    !comparison.work(part, &crew).unwrap().interrupted
}

fn text(comparison: &Comparison) -> String {
    let results = comparison.results().unwrap();
    parts_markdown(&comparison.tables(&results), "plots").0
}

/// Names and content of all results.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files = Vec::new();
    for kind in ["models", "offline", "laps"] {
        for entry in std::fs::read_dir(folder.join(kind)).unwrap() {
            let path = entry.unwrap().path();
            files.push((
                path.strip_prefix(folder).unwrap().to_owned(),
                std::fs::read(&path).unwrap(),
            ));
        }
    }
    files.sort();
    files
}

#[test]
fn interrupted_spread_and_joined_it_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let plan = plan(folder.path());
    let whole = Comparison::open(plan.clone(), &at("whole")).unwrap();
    // Two rows with two seeds: a network, its offline error and a lap each; the first row drives a second, late lap.
    assert_eq!(whole.amount(PartOf::WHOLE).jobs, 2 * 2 * 3 + 2);
    assert!(whole.results().unwrap_err().to_string().contains("senda compare"));
    assert!(work(&whole, PartOf::WHOLE, 1, &|| false));
    let (tables, results) = (text(&whole), files(&at("whole")));
    assert_eq!(results.len(), 14);
    assert!(
        tables.contains("| grey | steering only |") && tables.contains("colour helps"),
        "{tables}"
    );

    // Ctrl-C again and again, each time a little later, with more threads.
    let resumed = Comparison::open(plan.clone(), &at("resumed")).unwrap();
    let mut attempts = 0;
    for patience in [20, 60, 150, 400, usize::MAX] {
        attempts += 1;
        let asked = AtomicUsize::new(0);
        if work(&resumed, PartOf::WHOLE, 2, &|| {
            asked.fetch_add(1, Ordering::Relaxed) > patience
        }) {
            break;
        }
    }
    assert!(attempts > 2, "{attempts}");
    assert_eq!(text(&resumed), tables);
    assert!(files(&at("resumed")) == results);
    // Nothing is left to do.
    assert!(work(&resumed, PartOf::WHOLE, 2, &|| false));

    // Spread over two machines, of which one is forgotten at first. Which rows a part gets is decided by a hash.
    let parts: Vec<PartOf> = (1..=3).map(|number| PartOf { number, count: 3 }).collect();
    let mut folders = Vec::new();
    for part in &parts {
        let folder = at(&format!("part-{}", part.number));
        let comparison = Comparison::open(plan.clone(), &folder).unwrap();
        if comparison.amount(*part).jobs > 0 {
            assert!(work(&comparison, *part, 1, &|| false));
            folders.push((*part, folder));
        }
    }
    assert!(folders.len() > 1);
    let (forgotten, others) = folders.split_last().unwrap();
    let others: Vec<PathBuf> = others.iter().map(|(_, folder)| folder.clone()).collect();
    let error = merge(&others, &at("joined")).unwrap_err().to_string();
    assert!(error.contains(&format!("--shard {}", forgotten.0)), "{error}");
    // All of them, and one twice.
    let mut all = others.clone();
    all.push(forgotten.1.clone());
    all.push(others[0].clone());
    let joined = merge(&all, &at("joined")).unwrap();
    assert_eq!(text(&joined), tables);
    assert!(files(&at("joined")) == results);
    let again = merge(&all, &at("joined")).unwrap();
    assert_eq!(text(&again), tables);

    // The same job with another result is no part of this comparison.
    let (name, _) = &results[0];
    let own = folders
        .iter()
        .map(|(_, folder)| folder.join(name))
        .find(|path| path.is_file())
        .unwrap();
    std::fs::write(own, "other").unwrap();
    assert!(
        merge(&all, &at("joined"))
            .unwrap_err()
            .to_string()
            .contains("another result")
    );

    // One seed less is a part of what is there.
    let fewer = Plan {
        seeds: 1,
        ..plan.clone()
    };
    let fewer = Comparison::open(fewer, &at("whole")).unwrap();
    assert_eq!(fewer.amount(PartOf::WHOLE).left_s, 0.0);
    let judged = fewer.results().unwrap().judge(fewer.plan(), &plan.claims[0]);
    assert_eq!(judged.verdict, Verdict::Undecided);
    // A folder holds the plan that was worked on last.
    assert!(work(&fewer, PartOf::WHOLE, 1, &|| false));
    let error = merge(&[at("whole"), at("resumed")], &at("mixed"))
        .unwrap_err()
        .to_string();
    assert!(error.contains("another one"), "{error}");
}

#[test]
fn a_plan_is_written_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path());
    assert_eq!(Plan::parse("tiny.toml", &plan.to_toml()).unwrap(), plan);
    let document = Plan::preset("document-b").unwrap();
    assert_eq!(Plan::parse("b.toml", &document.to_toml()).unwrap(), document);
    assert!(
        Plan::preset("document-z")
            .unwrap_err()
            .to_string()
            .contains("document-b")
    );
}

#[test]
fn the_document_s_plan_holds_its_rows_and_claims() {
    let mut plan = Plan::preset("document-b").unwrap();
    assert_eq!((plan.seeds, plan.claims.len()), (5, 6));
    let published = plan.rows.iter().filter(|row| row.published.is_some()).count();
    assert_eq!(published, 18);
    assert!(plan.rows.iter().any(|row| row.sequence == Some(1)));
    plan.quick(&[]);
    assert!(plan.seeds == 2 && plan.rows.len() >= 4 && !plan.claims.is_empty());
    // A quick plan is a plan.
    assert_eq!(Plan::parse("quick.toml", &plan.to_toml()).unwrap(), plan);
}

#[test]
fn a_quick_plan_keeps_marked_rows_and_drops_conditions_without_rows() {
    let mut plan = Plan::preset("document-b").unwrap();
    let baseline = plan.baseline.clone();
    for row in &mut plan.rows {
        row.quick = row.identity() == "RGB/steering";
    }
    plan.conditions.truncate(2);
    plan.conditions[1].rows = vec!["LSTM/steering".into()];
    plan.quick(&["HD/steering".into()]);
    let names: Vec<&str> = plan.rows.iter().map(|row| row.name.as_str()).collect();
    assert_eq!(names, [baseline.as_str(), "HD", "RGB"]);
    assert_eq!(plan.conditions.len(), 1);
    assert_eq!(Plan::parse("quick.toml", &plan.to_toml()).unwrap(), plan);

    let mut plan = Plan::preset("document-b").unwrap();
    for row in &mut plan.rows {
        row.quick = false;
    }
    plan.quick(&[]);
    assert_eq!(plan.rows.len(), 22);
}

#[test]
fn bad_plans_are_refused_at_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let good = plan(folder.path()).to_toml();
    for (from, to, says) in [
        ("seeds = 2", "seed = 2", "did you mean \"seeds\"?"),
        ("seeds = 2", "seeds = 0", "1 to 1000"),
        ("epochs = 2", "epoch = 2", "did you mean \"epochs\"?"),
        (
            "baseline = \"grey\"",
            "baseline = \"gray\"",
            "did you mean \"grey\"?",
        ),
        (
            "held_out = [\"s-curves-lane\"]",
            "held_out = [\"oval-lane\"]",
            "neither learned from nor tuned on",
        ),
        (
            "training = [\"oval-lane\"]",
            "training = []",
            "at least one world",
        ),
        ("colour = \"grey\"", "colour = \"rgb\"", "network that fits"),
        (
            "control = \"steering\"",
            "control = \"stering\"",
            "did you mean \"steering\"?",
        ),
        ("figure = \"lane\"", "figure = \"lanes\"", "did you mean"),
        (
            "than = [\"grey/steering\"]",
            "than = [\"grey/stering\"]",
            "did you mean \"grey/steering\"?",
        ),
        ("name = \"saturation\"", "name = \"grey\"", "a second time"),
        ("latency_s = 0.1", "latency_s = -1", "latency_s"),
        ("name = \"late\"", "name = \"as it is\"", "no other condition"),
        (
            "name = \"as it is\"",
            "name = \"as it is\"\nrows = [\"grey/steering\"]",
            "makes the tables",
        ),
        (
            "worlds = [\"s-curves-lane\"]",
            "worlds = [\"oval-lane\"]",
            "neither learned from nor tuned on",
        ),
        (
            "name = \"saturation\"",
            "name = \"saturation\"\nfrom = \"nowhere.senda\"",
            "no such file",
        ),
    ] {
        assert!(good.contains(from), "{from} is not in\n{good}");
        let text = good.replacen(from, to, 1);
        let error = Plan::parse("bad.toml", &text).unwrap_err();
        let shown = error.to_string();
        let senda_compare::CompareError::Plan(problem) = &error else {
            panic!("{shown}");
        };
        assert!(
            problem.line > 0 && format!("{shown} {}", problem.help).contains(says),
            "{to}: {shown}"
        );
    }
    let rows = folder.path().join("rows.toml");
    let mut plan = plan(folder.path());
    std::fs::write(&rows, "[[row]]\nname = \"mine\"\nnetwork = \"tinypilotnett\"\n").unwrap();
    assert!(
        plan.add_rows(&rows)
            .unwrap_err()
            .to_string()
            .contains("rows.toml:3")
    );
    std::fs::write(&rows, "[[row]]\nname = \"mine\"\nnetwork = \"tinypilotnet\"\n").unwrap();
    plan.add_rows(&rows).unwrap();
    assert!(
        plan.add_rows(&rows)
            .unwrap_err()
            .to_string()
            .contains("a second time")
    );
    assert_eq!(plan.rows.len(), 3);
}

/// What is wrong with a plan whose file looks right.
fn refusal(plan: Plan, folder: &Path) -> String {
    Comparison::open(plan, folder).unwrap_err().to_string()
}

#[test]
fn plans_are_refused_before_anything_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("there");

    // The same road under another name.
    let copy = folder.path().join("mine.toml");
    let mut world = senda_world::World::named("oval-lane").unwrap();
    world.name = "mine".into();
    std::fs::write(&copy, world.to_toml()).unwrap();
    let mut seen = plan(folder.path());
    seen.judging.worlds = vec![copy.display().to_string()];
    let error = refusal(seen, &there);
    assert!(
        error.contains("mine.toml") && error.contains("oval-lane"),
        "{error}"
    );

    let mut fast = plan(folder.path());
    fast.conditions[1].speed_mps = Some(50.0);
    let error = refusal(fast, &there);
    assert!(error.contains("\"late\"") && error.contains("50"), "{error}");

    // A layer that is not trained needs weights from somewhere.
    let mut frozen = plan(folder.path());
    let network = folder.path().join("frozen.toml");
    std::fs::write(&network, format!("{NETWORK}trainable = false\n")).unwrap();
    frozen.rows[0].network = network.display().to_string();
    let error = refusal(frozen.clone(), &there);
    assert!(
        error.contains("grey/steering") && error.contains("from ="),
        "{error}"
    );
    let layers = senda_nets::Network::load(&network).unwrap();
    let weights = folder.path().join("weights.onnx");
    let random = senda_nets::Weights::initialised(&layers, senda_nets::Initialisation::default(), 1);
    std::fs::write(&weights, layers.to_onnx(&random)).unwrap();
    frozen.rows[0].from = Some(weights);
    Comparison::open(frozen, &there).unwrap();
    assert!(!there.exists());
}

#[test]
fn a_damaged_recording_is_not_learned_from() {
    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("there");
    let comparison = Comparison::open(plan(folder.path()), &there).unwrap();
    assert!(work(&comparison, PartOf::WHOLE, 1, &|| false));
    for kind in ["samples", "models", "offline", "laps"] {
        std::fs::remove_dir_all(there.join(kind)).unwrap();
    }
    for entry in std::fs::read_dir(there.join("recordings")).unwrap() {
        let path = entry.unwrap().path();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    }
    let crew = crew(1, &|| false);
    let error = comparison.work(PartOf::WHOLE, &crew).unwrap_err().to_string();
    assert!(
        error.contains(".mcap") && error.contains("delete the file and run the comparison again"),
        "{error}"
    );
}

#[test]
fn a_folder_serves_one_process_at_a_time_and_only_comparisons_are_joined() {
    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("there");
    let comparison = Comparison::open(plan(folder.path()), &there).unwrap();
    std::fs::create_dir(&there).unwrap();
    let other = std::fs::File::create(there.join(".lock")).unwrap();
    other.lock().unwrap();
    let crew = crew(1, &|| true);
    let error = comparison.work(PartOf::WHOLE, &crew).unwrap_err().to_string();
    assert!(error.contains("another `senda compare`"), "{error}");
    drop(other);
    assert!(comparison.work(PartOf::WHOLE, &crew).unwrap().interrupted);

    let error = merge(&[folder.path().join("none")], &there)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("none: expected the folder of a comparison"),
        "{error}"
    );
}
