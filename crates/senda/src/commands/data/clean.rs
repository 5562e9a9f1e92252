//! `senda data clean`: what is not to be learned from, in a file beside the data (A6 in SPEC).

use anyhow::{Context, Result, bail};
use clap::Args;
use senda_data::{Edits, edits, open_runs};
use senda_run::scenario::find_vehicle;
use std::ops::Range;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Recording or folder of recordings, tub, Udacity folder or named pictures
    data: PathBuf,
    /// Leave out this many steps at the beginning of every run (exposure settles in the first 2 to 5)
    #[arg(long, value_name = "N")]
    drop_first: Option<usize>,
    /// Leave out this many steps at the end of every run
    #[arg(long, value_name = "N")]
    drop_last: Option<usize>,
    /// Leave out steps A to B, B not included; may be repeated
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    drop: Vec<Range<usize>>,
    /// Correct a step's steering: degrees of the front wheels, left positive; may be repeated
    #[arg(long, value_name = "STEP=DEG", value_parser = parse_correction, allow_hyphen_values = true)]
    correct: Vec<(usize, f64)>,
    /// Only this run of the data, from 0
    #[arg(long, value_name = "N")]
    run: Option<usize>,
    /// List the edits (also without any other option)
    #[arg(long)]
    list: bool,
    /// Take back the edit with this number in the list
    #[arg(long, value_name = "NUMBER", conflicts_with_all = ["reset", "drop_first", "drop_last", "drop", "correct"])]
    undo: Option<usize>,
    /// Take back all edits
    #[arg(long, conflicts_with_all = ["drop_first", "drop_last", "drop", "correct"])]
    reset: bool,
    /// Vehicle that foreign data come from
    #[arg(long, default_value = "donkeycar")]
    vehicle: String,
    /// Print the edits as JSON
    #[arg(long)]
    json: bool,
}

fn parse_range(text: &str) -> Result<Range<usize>, String> {
    let range = text
        .split_once("..")
        .and_then(|(from, to)| Some(from.trim().parse().ok()?..to.trim().parse().ok()?));
    match range {
        Some(range) if range.start < range.end => Ok(range),
        _ => Err(format!(
            "expected A..B with A below B, such as 100..120, but found `{text}`"
        )),
    }
}

fn parse_correction(text: &str) -> Result<(usize, f64), String> {
    let correction = text
        .split_once('=')
        .and_then(|(step, angle)| Some((step.trim().parse().ok()?, angle.trim().parse::<f64>().ok()?)));
    match correction {
        Some((step, angle)) if (-90.0..=90.0).contains(&angle) => Ok((step, angle)),
        _ => Err(format!(
            "expected STEP=DEG with -90 to 90 degrees, such as 17=-12.5, but found `{text}`"
        )),
    }
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let body = find_vehicle(&arguments.vehicle)?.body();
    let parts = edits::parts(&arguments.data)?;
    let names_steps = !arguments.drop.is_empty()
        || !arguments.correct.is_empty()
        || arguments.undo.is_some()
        || arguments.run.is_some();
    if let (true, [first, _, ..]) = (names_steps, parts.as_slice()) {
        bail!(
            "{}: expected one recording, but found {}; give the one that is meant, such as {}",
            arguments.data.display(),
            parts.len(),
            first.display()
        );
    }
    // All are read and edited before any is written: a mistake in the last one changes nothing.
    let mut edited = Vec::new();
    for part in &parts {
        let mut edits = Edits::of(part)?;
        let steps: Vec<usize> = open_runs(part, &body)?
            .iter()
            .map(|run| run.steps.len())
            .collect();
        let changed = arguments
            .edit(&mut edits, &steps)
            .with_context(|| part.display().to_string())?;
        edited.push((part, edits, steps, changed));
    }
    for (part, edits, _, changed) in &edited {
        if *changed {
            edits.save(part)?;
        }
    }
    if arguments.json {
        let all: Vec<_> = edited
            .iter()
            .map(|(part, edits, steps, _)| {
                serde_json::json!({
                    "data": part,
                    "file": Edits::path_of(part),
                    "steps": steps,
                    "drop": edits.dropped,
                    "angle": edits.angles,
                })
            })
            .collect();
        say!("{}", serde_json::to_string_pretty(&all)?)?;
    } else {
        for (part, edits, steps, _) in &edited {
            show(part, edits, steps)?;
        }
    }
    Ok(())
}

impl Arguments {
    /// Whether anything was asked to change.
    fn edit(&self, edits: &mut Edits, steps: &[usize]) -> Result<bool> {
        if let Some(run) = self.run.filter(|run| *run >= steps.len()) {
            bail!("--run {run}: expected 0 to {}", steps.len().saturating_sub(1));
        }
        if let Some(number) = self.undo {
            if !edits.undo(number) {
                bail!(
                    "--undo {number}: expected the number of one of the {} edits (--list shows them)",
                    edits.len()
                );
            }
            return Ok(true);
        }
        if self.reset {
            *edits = Edits::default();
            return Ok(true);
        }
        let runs: Vec<usize> = match self.run {
            Some(run) => vec![run],
            None => (0..steps.len()).collect(),
        };
        for run in runs.iter().copied() {
            if let Some(count) = self.drop_first {
                edits.drop_steps(run, 0, count.min(steps[run]));
            }
            if let Some(count) = self.drop_last {
                edits.drop_steps(run, steps[run].saturating_sub(count), steps[run]);
            }
        }
        if !self.drop.is_empty() || !self.correct.is_empty() {
            let [run] = runs[..] else {
                bail!(
                    "expected one run to name steps of, but found {}; say which with --run",
                    steps.len()
                );
            };
            for range in &self.drop {
                within(range.end, steps[run], "--drop")?;
                edits.drop_steps(run, range.start, range.end);
            }
            for (step, angle_deg) in &self.correct {
                within(step + 1, steps[run], "--correct")?;
                edits.correct(run, *step, *angle_deg);
            }
        }
        let changed = self.drop_first.is_some()
            || self.drop_last.is_some()
            || !self.drop.is_empty()
            || !self.correct.is_empty();
        if changed {
            edits.steps = steps.to_vec();
        }
        Ok(changed)
    }
}

fn within(end: usize, steps: usize, flag: &str) -> Result<()> {
    if end > steps {
        bail!(
            "{flag}: expected steps below {steps}, as many as the run has, but found {}",
            end - 1
        );
    }
    Ok(())
}

fn show(part: &Path, edits: &Edits, steps: &[usize]) -> Result<()> {
    if edits.is_empty() {
        return say!("{}: no edits", part.display());
    }
    say!(
        "{}: {} edits in {}",
        part.display(),
        edits.len(),
        Edits::path_of(part).display()
    )?;
    let run = |number: usize| {
        if steps.len() > 1 {
            format!("run {number}, ")
        } else {
            String::new()
        }
    };
    for (number, dropped) in edits.dropped.iter().enumerate() {
        say!(
            "  {:>3}  {}steps {}..{} are left out",
            number + 1,
            run(dropped.run),
            dropped.from,
            dropped.to
        )?;
    }
    for (number, angle) in edits.angles.iter().enumerate() {
        say!(
            "  {:>3}  {}step {}: steering {:.2}°",
            edits.dropped.len() + number + 1,
            run(angle.run),
            angle.step,
            angle.steering_deg
        )?;
    }
    Ok(())
}
