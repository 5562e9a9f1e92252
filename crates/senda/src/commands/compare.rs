//! `senda compare` and `senda merge`: networks compared by how they really drive (document B).

use super::{report::command_line, write_file};
use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::Args;
use indicatif::ProgressBar;
use senda_compare::{Comparison, Cost, Crew, Done, Figure, Laps, PartOf, Plan, Progress, Results, merge};
use senda_eval::report::{Look, Page, Part, ReportRun, parts_html, parts_markdown};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Plan (TOML); docs/compare.md says what it holds
    #[arg(required_unless_present = "preset", conflicts_with = "preset")]
    plan: Option<PathBuf>,
    /// Ready plan: document-b
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// File with further rows (`[[row]]`), such as one for your own network; may be given several times
    #[arg(long, value_name = "FILE")]
    add: Vec<PathBuf>,
    /// Train every row with the seeds 1 to N
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: Option<u64>,
    /// A few rows, two seeds, one lap, fewer epochs: minutes instead of hours
    #[arg(long)]
    quick: bool,
    /// Where results are kept, and gone on from; without it a folder named after the plan and the part
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Do only part I of N, to be joined by `senda merge`: 1/4
    #[arg(long, value_name = "I/N")]
    shard: Option<PartOf>,
    /// Jobs at once; without it one for each core. Changes no result
    #[arg(long, value_name = "N", value_parser = super::parse_jobs)]
    jobs: Option<usize>,
    /// Only say what there is to do and what it takes
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    outputs: Outputs,
}

#[derive(Args)]
pub(crate) struct MergeArguments {
    /// Folders of all parts
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// Folder for the whole
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    #[command(flatten)]
    outputs: Outputs,
}

/// What is told of the results.
#[derive(Args)]
struct Outputs {
    /// Write a report (one HTML file) with tables, plots and laps to play
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the tables as Markdown, with plots in a folder beside it when there is a --report
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Print all figures as JSON
    #[arg(long)]
    json: bool,
}

/// Works a bar and hears Ctrl-C.
fn with_crew<T>(jobs: usize, label: &str, work: impl FnOnce(&Crew) -> T) -> T {
    let bar = terminal::bar(label);
    let progress = |progress: &Progress| show(&bar, progress);
    let outcome = work(&Crew {
        threads: jobs,
        progress: &progress,
        interrupted: &terminal::interrupted,
        clock_ns: &terminal::clock_ns,
    });
    bar.finish_and_clear();
    outcome
}

fn show(bar: &ProgressBar, progress: &Progress) {
    bar.set_position((1000.0 * progress.part) as u64);
    bar.set_message(format!("{}/{} {}", progress.done, progress.total, progress.title));
}

fn cores(jobs: Option<usize>) -> usize {
    jobs.filter(|jobs| *jobs > 0)
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let mut plan = match (&arguments.plan, &arguments.preset) {
        (Some(path), _) => Plan::load(path)?,
        (None, name) => Plan::preset(name.as_deref().unwrap_or_default())?,
    };
    let own = plan.rows.len();
    for path in &arguments.add {
        plan.add_rows(path)?;
    }
    if arguments.quick {
        let added: Vec<String> = plan.rows[own..].iter().map(|row| row.identity()).collect();
        plan.quick(&added);
    }
    plan.seeds = arguments.seeds.unwrap_or(plan.seeds);
    let part = arguments.shard.unwrap_or(PartOf::WHOLE);
    let own = if part == PartOf::WHOLE {
        String::new()
    } else {
        format!("-part-{}-of-{}", part.number, part.count)
    };
    let folder = arguments
        .folder
        .clone()
        .unwrap_or_else(|| PathBuf::from(format!("compare-{}{own}", plan.name)));
    let jobs = cores(arguments.jobs);
    let comparison = Comparison::open(plan, &folder)?;
    let amount = comparison.amount(part);
    tell!(
        "{}: {} rows x {} seeds, {} of {} results there; the others take about {} of one core, {} of {jobs}",
        comparison.plan().name,
        comparison.plan().rows.len(),
        comparison.plan().seeds,
        amount.done,
        amount.jobs,
        duration(amount.left_s),
        duration(amount.left_s / jobs as f64),
    );
    if arguments.dry_run {
        return Ok(());
    }
    let began_ns = terminal::clock_ns();
    let done = with_crew(jobs, "compare", |crew| comparison.work(part, crew))?;
    tell_costs(&done, terminal::seconds_since(began_ns));
    if done.interrupted {
        bail!(terminal::Interrupted(format!(
            "; what is done is kept in {}: run the same command again to go on",
            folder.display()
        )));
    }
    if part.count > 1 {
        say!(
            "part {part} is done; join the folders of all parts with: senda merge FOLDER... --out {}",
            comparison.plan().name
        )?;
        return Ok(());
    }
    tell(&comparison, &arguments.outputs, jobs)
}

pub(crate) fn run_merge(arguments: MergeArguments) -> Result<()> {
    let comparison = merge(&arguments.folders, &arguments.out)?;
    tell(&comparison, &arguments.outputs, cores(None))
}

fn tell_costs(done: &Done, wall_s: f64) {
    let costs: &BTreeMap<&str, Cost> = &done.costs;
    for (kind, cost) in costs {
        let each_s = cost.wall_s / cost.count.max(1) as f64;
        tell!(
            "{:4} {kind}: {each_s:.1} s each, {} in all",
            cost.count,
            duration(cost.wall_s)
        );
    }
    tell!("wall time {}", duration(wall_s));
}

fn duration(seconds: f64) -> String {
    // A sum over nothing may be -0.
    match seconds + 0.0 {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

fn tell(comparison: &Comparison, outputs: &Outputs, jobs: usize) -> Result<()> {
    let results = comparison.results()?;
    let tables = comparison.tables(&results);
    let mut plots: Vec<Part> = Vec::new();
    if let Some(path) = &outputs.report {
        let made = with_crew(jobs, "report", |crew| comparison.plots(&results, crew))?;
        let Some((laps, parts)) = made else {
            bail!(terminal::Interrupted(
                " before the report was written; run the same command again".to_owned()
            ));
        };
        write_report(path, comparison, &results, &tables, &parts, &laps)?;
        tell!("report: {}", path.display());
        plots = parts;
    }
    if let Some(path) = &outputs.markdown {
        write_markdown(path, comparison, &tables, &plots)?;
        tell!("Markdown: {}", path.display());
    }
    if outputs.json {
        say!("{}", serde_json::to_string_pretty(&json(comparison, &results))?)?;
        return Ok(());
    }
    print_short(comparison, &results)
}

/// Laps with a player: the baseline and the best row of each control, as many as a page carries.
fn players(comparison: &Comparison, results: &Results, laps: &Laps) -> Vec<usize> {
    let plan = comparison.plan();
    let error = |row: usize| {
        results
            .spread(row, 0, Figure::Lane)
            .map_or(f64::INFINITY, |spread| spread.interval.value)
    };
    let mut chosen: Vec<usize> = Vec::new();
    let mut controls: Vec<&str> = plan.rows.iter().map(|row| row.control.word()).collect();
    controls.dedup();
    for control in controls {
        let of_control = || (0..plan.rows.len()).filter(|row| plan.rows[*row].control.word() == control);
        chosen.extend(of_control().find(|row| plan.rows[*row].name == plan.baseline));
        chosen.extend(of_control().min_by(|a, b| error(*a).total_cmp(&error(*b))));
    }
    chosen.sort_unstable();
    chosen.dedup();
    (0..laps.laps.len())
        .filter(|lap| chosen.contains(&laps.laps[*lap].row))
        .collect()
}

fn write_report(
    path: &Path,
    comparison: &Comparison,
    results: &Results,
    tables: &[Part],
    plots: &[Part],
    laps: &Laps,
) -> Result<()> {
    let chosen = players(comparison, results, laps);
    let bar = terminal::bar("what networks look at");
    // Networks without convolutions look at nothing that can be shown.
    let looks: Vec<Option<Look>> = chosen
        .iter()
        .enumerate()
        .map(|(number, lap)| {
            bar.set_position((1000 * number / chosen.len()) as u64);
            let lap = &laps.laps[*lap];
            super::look::for_player(&lap.steered_by, &lap.recording).ok()
        })
        .collect();
    bar.finish_and_clear();
    let shown: Vec<ReportRun> = chosen
        .iter()
        .zip(&looks)
        .map(|(lap, look)| (&laps.laps[*lap], look))
        .map(|(lap, look)| ReportRun {
            look: look.as_ref(),
            title: &lap.title,
            summary: &lap.summary,
            recording: &lap.recording,
            world: Some(&laps.world),
            course: None,
            command: "",
            frame_times_s: &[],
        })
        .collect();
    let mut parts = tables.to_vec();
    parts.extend_from_slice(plots);
    let mut page = Page::new(&title(comparison), &command_line());
    page.subtitle.clone_from(&comparison.plan().description);
    write_file(path, parts_html(&page, &parts, &shown).as_bytes())
}

fn title(comparison: &Comparison) -> String {
    format!("Comparison of networks: {}", comparison.plan().name)
}

/// Plots that tell the most, for a page that is kept in a repository: the others are in the report.
fn for_markdown(plots: &[Part]) -> Vec<Part> {
    plots
        .iter()
        .filter(|part| part.title.starts_with("Plots"))
        .map(|part| {
            let kept = |title: &str| title == "Lane error" || title.starts_with("Hard curve");
            let mut part = part.clone();
            part.figures.retain(|figure| kept(&figure.title));
            part
        })
        .collect()
}

fn write_markdown(path: &Path, comparison: &Comparison, tables: &[Part], plots: &[Part]) -> Result<()> {
    let stem = path
        .file_stem()
        .context("expected the name of a Markdown file")?
        .to_string_lossy()
        .into_owned();
    let mut parts = tables.to_vec();
    parts.extend(for_markdown(plots));
    let (text, files) = parts_markdown(&parts, &stem);
    let plan = comparison.plan();
    let worlds = |names: &[String]| match names {
        [] => "none".to_owned(),
        _ => names.join(", "),
    };
    let head = format!(
        "# {}\n\n{}. {} rows, {} training seeds each; laps for training: {}; for tuning: {}; held out: {}; judged on: {}.\n\nMade by `{}`.\n\n",
        title(comparison),
        plan.description,
        plan.rows.len(),
        plan.seeds,
        worlds(&plan.data.training),
        worlds(&plan.data.tuning),
        worlds(&plan.data.held_out),
        worlds(&plan.judging.worlds),
        command_line()
    );
    write_file(path, (head + &text).as_bytes())?;
    let folder = path.with_extension("");
    for (name, svg) in files {
        write_file(&folder.join(name), svg.as_bytes())?;
    }
    Ok(())
}

/// Every figure of every row and condition, tests and verdicts; no wall times, so that equal results give equal bytes.
fn json(comparison: &Comparison, results: &Results) -> serde_json::Value {
    let plan = comparison.plan();
    let mut rows = Vec::new();
    for (index, row) in plan.rows.iter().enumerate() {
        for (number, condition) in plan.conditions.iter().enumerate() {
            let figures: serde_json::Map<String, serde_json::Value> = Figure::ALL
                .into_iter()
                .filter_map(|figure| {
                    let spread = results.spread(index, number, figure)?;
                    Some((figure.word().to_owned(), serde_json::to_value(spread).ok()?))
                })
                .collect();
            if !figures.is_empty() {
                rows.push(serde_json::json!({
                    "row": row.identity(),
                    "condition": condition.name,
                    "figures": figures,
                }));
            }
        }
    }
    let claims: Vec<_> = plan
        .claims
        .iter()
        .map(|claim| results.judge(plan, claim))
        .collect();
    let baseline = plan.rows.iter().position(|row| row.name == plan.baseline);
    let beside = baseline.map(|baseline| {
        let others: Vec<usize> = (0..plan.rows.len()).filter(|row| *row != baseline).collect();
        results.beside(plan, &others, baseline)
    });
    serde_json::json!({ "plan": plan.name, "seeds": plan.seeds, "rows": rows, "beside_baseline": beside, "claims": claims })
}

fn print_short(comparison: &Comparison, results: &Results) -> Result<()> {
    let plan = comparison.plan();
    say!(
        "{:40} {:>14} {:>14} {:>14} {:>10}",
        "",
        "lane error",
        "heading",
        "unsteadiness",
        "laps"
    )?;
    for (index, row) in plan.rows.iter().enumerate() {
        let value = |figure: Figure, unit: &str| {
            results.spread(index, 0, figure).map_or("-".to_owned(), |spread| {
                format!("{:.*}{unit}", figure.decimals(), spread.interval.value)
            })
        };
        let (clean, laps) = results.clean_laps(index, 0);
        say!(
            "{:40} {:>14} {:>14} {:>14} {:>10}",
            row.identity(),
            value(Figure::Lane, " m"),
            value(Figure::Heading, "°"),
            value(Figure::Smoothness, ""),
            format!("{clean} of {laps}")
        )?;
    }
    for claim in &plan.claims {
        let judged = results.judge(plan, claim);
        say!("{:10} {}", judged.verdict.word(), judged.says)?;
    }
    Ok(())
}
