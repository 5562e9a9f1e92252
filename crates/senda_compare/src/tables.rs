//! Tables of what came out, for pages and for Markdown.

use crate::figure::Figure;
use crate::plan::{Control, Plan};
use crate::results::{MATTERS, Results};
use senda_eval::report::{Part, PartTable};
use senda_eval::statistics::Interval;
use senda_eval::text::fixed;

/// All tables.
pub(crate) fn parts(plan: &Plan, results: &Results) -> Vec<Part> {
    let mut parts = vec![claims(plan, results), best(plan, results)];
    for (_, control) in Control::ALL {
        let rows: Vec<usize> = (0..plan.rows.len())
            .filter(|row| plan.rows[*row].control == control)
            .collect();
        if !rows.is_empty() {
            parts.push(figures(plan, results, control, &rows));
        }
    }
    parts.extend(whole(plan, results));
    parts.extend(published(plan, results));
    parts.extend(conditions(plan, results));
    parts
}

fn words(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|cell| (*cell).to_owned()).collect()
}

/// `0.54 (0.50 to 0.58)`; one seed has no interval.
fn with_interval(interval: &Interval, decimals: usize) -> String {
    let value = fixed(interval.value, decimals);
    if interval.low.is_finite() {
        format!(
            "{value} ({} to {})",
            fixed(interval.low, decimals),
            fixed(interval.high, decimals)
        )
    } else {
        value
    }
}

fn cell(results: &Results, row: usize, condition: usize, figure: Figure) -> String {
    match results.spread(row, condition, figure) {
        Some(spread) => with_interval(&spread.interval, figure.decimals()),
        None => "–".into(),
    }
}

fn claims(plan: &Plan, results: &Results) -> Part {
    let mut rows = Vec::new();
    for claim in &plan.claims {
        let judged = results.judge(plan, claim);
        let mut first = true;
        for part in &judged.parts {
            let difference = part.difference.map_or("–".into(), |interval| {
                format!("{} %", with_interval(&interval.scaled(100.0), 0))
            });
            rows.push(vec![
                if first { judged.says.clone() } else { String::new() },
                if first {
                    judged.verdict.word().to_owned()
                } else {
                    String::new()
                },
                part.says.clone(),
                part.verdict.word().to_owned(),
                difference,
            ]);
            first = false;
        }
    }
    Part {
        title: "Claims".into(),
        intro: format!(
            "Each claim is taken apart into figures of rows against figures of others, the same seeds against each other. A part is confirmed when the 95 % \
interval (Student's t over the training seeds) of the mean difference lies wholly on the claimed side, refuted when it lies wholly on the other \
side, else undecided; \"does not help\" is confirmed when a gain of {} % or more is ruled out. A claim is refuted as soon as one of its parts \
is, and confirmed when all are.",
            fixed(100.0 * MATTERS, 0)
        ),
        tables: vec![PartTable {
            caption: "Differences in per cent of what is compared with; negative is less.".into(),
            columns: words(&["claim", "verdict", "part", "of the part", "difference"]),
            words: 4,
            rows,
        }],
        ..Part::default()
    }
}

/// Which rows stay near the middle on every lap.
fn best(plan: &Plan, results: &Results) -> Part {
    let mut order: Vec<(f64, usize)> = (0..plan.rows.len())
        .filter_map(|row| Some((results.spread(row, 0, Figure::Lane)?.interval.value, row)))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let figures = [
        Figure::Lane,
        Figure::Heading,
        Figure::Smoothness,
        Figure::Clean,
        Figure::Rmse,
    ];
    let rows = order.iter().map(|(_, row)| {
        let mut cells = vec![
            plan.rows[*row].name.clone(),
            plan.rows[*row].control.title().to_owned(),
        ];
        cells.extend(figures.iter().map(|figure| cell(results, *row, 0, *figure)));
        cells
    });
    let mut columns = words(&["network", "control"]);
    columns.extend(figures.iter().map(|figure| figure.title().to_owned()));
    Part {
        title: "In order of what counts".into(),
        intro: "Mean distance to the middle of the road, every metre counted once; road outside, and road that was not driven because the run had \
ended, counts as outside."
            .into(),
        tables: vec![PartTable {
            caption: seeds_words(plan),
            columns,
            words: 2,
            rows: rows.collect(),
        }],
        ..Part::default()
    }
}

fn seeds_words(plan: &Plan) -> String {
    let laps = match plan.judging.worlds.len() * plan.judging.starts.len() {
        1 => "one lap".to_owned(),
        several => format!("{several} laps"),
    };
    format!(
        "Means over {} training seeds of the mean over {laps} ({}, from {} of the lap), with Student's 95 % interval over the seeds; laps on the \
road: Wilson's interval over all laps, which takes laps of one network as independent. A car that stands still leaves no road and turns no wheel: \
autonomy, unsteadiness and first departure are to be read beside the part of the lap that was driven. A lap without a departure counts with its \
own length, so a fast car that never leaves has less of it than a slow one. Intervals end where a figure does.",
        plan.seeds,
        plan.judging.worlds.join(" and "),
        plan.judging
            .starts
            .iter()
            .map(|start| format!("{} %", fixed(100.0 * start, 0)))
            .collect::<Vec<_>>()
            .join(" and ")
    )
}

fn figures(plan: &Plan, results: &Results, control: Control, rows: &[usize]) -> Part {
    let table = |figures: &[Figure], caption: String| {
        let mut columns = words(&["network"]);
        columns.extend(figures.iter().map(|figure| figure.title().to_owned()));
        let rows = rows.iter().map(|row| {
            let mut cells = vec![plan.rows[*row].name.clone()];
            cells.extend(figures.iter().map(|figure| cell(results, *row, 0, *figure)));
            cells
        });
        PartTable {
            caption,
            columns,
            words: 1,
            rows: rows.collect(),
        }
    };
    let mut tables = vec![
        table(
            &[
                Figure::LaneMean,
                Figure::LaneMax,
                Figure::HeadingMean,
                Figure::HeadingMax,
                Figure::RmseTraining,
                Figure::Rmse,
            ],
            "As document B defines them (B6 to B8): means over frames, nothing punished.".into(),
        ),
        table(
            &[
                Figure::Lane,
                Figure::Heading,
                Figure::Smoothness,
                Figure::Autonomy,
                Figure::Clean,
                Figure::Driven,
                Figure::FirstDeparture,
                Figure::RmseThrottleTraining,
                Figure::RmseThrottle,
            ],
            seeds_words(plan),
        ),
    ];
    let baseline = rows
        .iter()
        .copied()
        .find(|row| plan.rows[*row].name == plan.baseline);
    if let Some(baseline) = baseline {
        let others: Vec<usize> = rows.iter().copied().filter(|row| *row != baseline).collect();
        tables.extend(beside(plan, results, &others, baseline, false));
    }
    Part {
        title: format!("Control: {}", control.title()),
        tables,
        ..Part::default()
    }
}

/// Per cent better or worse than a row (B10).
fn beside(
    plan: &Plan,
    results: &Results,
    others: &[usize],
    than: usize,
    with_control: bool,
) -> Option<PartTable> {
    if others.is_empty() {
        return None;
    }
    let figures = [
        Figure::LaneMean,
        Figure::LaneMax,
        Figure::HeadingMean,
        Figure::HeadingMax,
        Figure::RmseTraining,
        Figure::Rmse,
        Figure::Smoothness,
        Figure::Lane,
    ];
    let tests = results.beside(plan, others, than);
    let rows = others.iter().zip(&tests).map(|(row, test)| {
        let mut cells = vec![plan.rows[*row].name.clone()];
        if with_control {
            cells.push(plan.rows[*row].control.title().to_owned());
        }
        cells.extend(figures.iter().map(|figure| {
            let value = |row: usize| {
                results
                    .spread(row, 0, *figure)
                    .map(|spread| spread.interval.value)
            };
            match value(*row).zip(value(than)) {
                Some((own, other)) => format!("{} %", fixed(100.0 * (1.0 - own / other), 0)),
                None => "–".into(),
            }
        }));
        cells.push(test.test.map_or("–".into(), |test| p_words(test.p)));
        cells.push(test.test.map_or("–".into(), |_| p_words(test.corrected_p)));
        cells
    });
    let mut columns = words(if with_control {
        &["network", "control"]
    } else {
        &["network"]
    });
    let word_count = columns.len();
    columns.extend(
        figures
            .iter()
            .map(|figure| figure.title().split(" (").next().unwrap_or_default().to_owned()),
    );
    columns.extend(words(&["p", "p, Holm"]));
    Some(PartTable {
        caption: format!(
            "Per cent better (positive) or worse (negative) than {}. p: Wilcoxon's signed rank test of the lane error with leaving punished over the same \
seeds and laps, exact and two-sided; laps of one network are not independent, so p is too small rather than too large. Holm: corrected for the \
rows of this table.",
            plan.rows[than].identity()
        ),
        columns,
        words: word_count,
        rows: rows.collect(),
    })
}

fn p_words(p: f64) -> String {
    if p < 0.001 { "< 0.001".into() } else { fixed(p, 3) }
}

fn whole(plan: &Plan, results: &Results) -> Option<Part> {
    let baseline = plan.rows.iter().position(|row| row.name == plan.baseline)?;
    let others: Vec<usize> = (0..plan.rows.len()).filter(|row| *row != baseline).collect();
    Some(Part {
        title: "All of them".into(),
        tables: vec![beside(plan, results, &others, baseline, true)?],
        ..Part::default()
    })
}

fn published(plan: &Plan, results: &Results) -> Option<Part> {
    let mut rows = Vec::new();
    for (index, row) in plan.rows.iter().enumerate() {
        let Some(theirs) = row.published else { continue };
        let ours = |figure: Figure| {
            results.spread(index, 0, figure).map_or("–".into(), |spread| {
                fixed(spread.interval.value, figure.decimals())
            })
        };
        let left = if theirs.left_road { ", left" } else { "" };
        let (clean, laps) = results.clean_laps(index, 0);
        let rmse = match theirs.rmse_throttle {
            Some(throttle) => format!("{} / {}", theirs.rmse, throttle),
            None => theirs.rmse.to_string(),
        };
        let training = match results.spread(index, 0, Figure::RmseThrottleTraining) {
            Some(_) => format!(
                "{} / {}",
                ours(Figure::RmseTraining),
                ours(Figure::RmseThrottleTraining)
            ),
            None => ours(Figure::RmseTraining),
        };
        rows.push(vec![
            row.name.clone(),
            row.control.title().to_owned(),
            theirs.lane_mean_m.to_string(),
            ours(Figure::LaneMean),
            format!("{}{left}", theirs.lane_max_m),
            ours(Figure::LaneMax),
            theirs.heading_mean_deg.to_string(),
            ours(Figure::HeadingMean),
            theirs.heading_max_deg.to_string(),
            ours(Figure::HeadingMax),
            rmse,
            training,
            ours(Figure::Rmse),
            format!("{clean} of {laps}"),
        ]);
    }
    (!rows.is_empty()).then(|| Part {
        title: "Beside what was published".into(),
        intro: "Theirs is one lap of one trained network in their simulator; ours is a mean over training seeds and laps in another one. Numbers of the two are \
not to be subtracted; what can be compared is the order."
            .into(),
        tables: vec![PartTable {
            caption: "Lane in m, heading in degrees, RMSE of the steering in parts of full lock, where there are two of steering and throttle: theirs was measured on training data, ours on training laps and on unseen ones.".into(),
            columns: words(&[
                "network",
                "control",
                "lane mean, theirs",
                "ours",
                "lane max, theirs",
                "ours",
                "heading mean, theirs",
                "ours",
                "heading max, theirs",
                "ours",
                "RMSE, theirs",
                "ours, training",
                "ours, unseen",
                "our laps on the road",
            ]),
            words: 2,
            rows,
        }],
        ..Part::default()
    })
}

/// The same rows under every condition.
fn conditions(plan: &Plan, results: &Results) -> Option<Part> {
    if plan.conditions.len() < 2 {
        return None;
    }
    let chosen: Vec<usize> = (0..plan.rows.len())
        .filter(|row| {
            plan.conditions[1..]
                .iter()
                .any(|condition| condition.includes(&plan.rows[*row]))
        })
        .collect();
    let table = |figure: Figure, caption: &str| {
        let mut columns = words(&["network", "control"]);
        columns.extend(plan.conditions.iter().map(|condition| condition.name.clone()));
        PartTable {
            caption: format!("{}{caption}", figure.title()),
            columns,
            words: 2,
            rows: chosen
                .iter()
                .map(|row| {
                    let mut cells = vec![
                        plan.rows[*row].name.clone(),
                        plan.rows[*row].control.title().to_owned(),
                    ];
                    cells.extend(
                        (0..plan.conditions.len()).map(|condition| cell(results, *row, condition, figure)),
                    );
                    cells
                })
                .collect(),
        }
    };
    let told: Vec<String> = plan
        .conditions
        .iter()
        .map(|condition| {
            format!(
                "{}: at {} m/s, {} s later, {} % of the frames lost",
                condition.name,
                condition.speed_mps.unwrap_or(plan.speed_mps),
                condition.latency_s,
                fixed(100.0 * condition.lost_frames, 0)
            )
        })
        .collect();
    Some(Part {
        title: "Under other conditions".into(),
        intro: format!("{}.", told.join("; ")),
        tables: vec![
            table(Figure::Lane, ", by condition."),
            table(Figure::Heading, ", by condition."),
            table(Figure::Smoothness, ", by condition."),
            table(Figure::Clean, ", by condition."),
        ],
        ..Part::default()
    })
}
