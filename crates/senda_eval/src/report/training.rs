//! How a network was trained: losses over the epochs, success over the frames, and what the data asked for.

use super::page::{Card, Figure, Page, Row, Section, Table, render};
use crate::plot::{Axis, LinePlot, Rule, Series, Stroke};
use crate::statistics::rate;
use crate::text;

/// Bars of the steering histogram: an odd number, so that straight on has one of its own.
const BINS: usize = 21;

/// One pass over the data.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrainingEpoch {
    /// Its number, from 1.
    pub number: u32,
    /// Mean loss over the training batches (weighted as they were trained).
    pub training_loss: f64,
    /// Mean squared error on what judges.
    pub validation_loss: Option<f64>,
    /// Mean absolute error of the first output on what judges, in its unit.
    pub validation_error: Option<f64>,
    /// The same of always answering the median: the figure to beat.
    pub constant_error: Option<f64>,
    /// Correlation of answers and labels on what judges.
    pub correlation: Option<f64>,
}

/// One round of learning by correction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrainingRound {
    /// Its number; 0 is the expert's.
    pub number: u32,
    /// Frames learned from, all rounds together.
    pub frames: usize,
    /// Drives that gathered this round's frames.
    pub drives: usize,
    /// How many of them strayed.
    pub strayed: usize,
    /// Training loss at its end.
    pub loss: f64,
    /// Runs of the trial that were completed, of how many.
    pub trial: Option<[usize; 2]>,
    /// Mean lane error of the trial (m).
    pub lane_error_m: Option<f64>,
}

/// What a report of a training shows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrainingReport {
    /// The network's name.
    pub network: String,
    /// All epochs (of the last training, where there were several).
    pub epochs: Vec<TrainingEpoch>,
    /// The epoch that was kept; 0: none judged, the last one.
    pub best_epoch: u32,
    /// First output, with its unit: `steering (part of full lock, left positive)`.
    pub answer: String,
    /// Labels of the first output, around -1 to 1, of what was learned from and what judges.
    pub labels: Vec<(String, Vec<f64>)>,
    /// Rounds of learning by correction; empty where there were none.
    pub rounds: Vec<TrainingRound>,
}

/// A report of a training.
pub fn training_html(page: &Page, training: &TrainingReport) -> String {
    let mut sections = vec![Section {
        title: "Training".into(),
        cards: cards(training),
        figures: losses(training).into_iter().chain(histogram(training)).collect(),
        ..Section::default()
    }];
    if !training.rounds.is_empty() {
        sections.push(Section {
            title: "Learning by correction".into(),
            intro: "Round 0 is the expert's; in the others the network drives and the expert corrects. After each round a \
                    trial in worlds that nobody learns from."
                .into(),
            figures: success(&training.rounds).into_iter().collect(),
            tables: vec![round_table(&training.rounds)],
            ..Section::default()
        });
    }
    if !training.epochs.is_empty() {
        sections.push(Section {
            title: "Epochs".into(),
            tables: vec![epoch_table(training)],
            ..Section::default()
        });
    }
    render(page, Vec::new(), sections)
}

fn kept(training: &TrainingReport) -> Option<&TrainingEpoch> {
    let best = training
        .epochs
        .iter()
        .find(|epoch| epoch.number == training.best_epoch);
    best.or(training.epochs.last())
}

fn cards(training: &TrainingReport) -> Vec<Card> {
    let mut cards = Vec::new();
    for (what, labels) in &training.labels {
        let hint = format!("Frames of {what}");
        cards.push(Card::new(
            what,
            labels.len().to_string(),
            "frames".into(),
            &hint,
            "",
        ));
    }
    let Some(epoch) = kept(training) else {
        return cards;
    };
    cards.push(Card::new(
        "Epoch kept",
        epoch.number.to_string(),
        format!("of {}", training.epochs.len()),
        "The epoch with the least error on what judges; without that, the last",
        "",
    ));
    if let Some(error) = epoch.validation_error {
        let constant = epoch.constant_error;
        let detail = constant.map_or(String::new(), |constant| {
            format!("always the median: {}", text::short(constant))
        });
        let tone = match constant {
            Some(constant) if error < constant => "good",
            Some(_) => "bad",
            None => "",
        };
        cards.push(Card::new(
            "Mean error",
            text::short(error),
            detail,
            "Mean absolute error of the first output on what judges, at the epoch kept",
            tone,
        ));
    }
    if let Some(correlation) = epoch.correlation {
        cards.push(Card::new(
            "Correlation",
            text::fixed(correlation, 2),
            "1 is full agreement".into(),
            "Pearson's correlation of answers and labels on what judges, at the epoch kept",
            "",
        ));
    }
    let trial = training.rounds.iter().rev().find_map(|round| round.trial);
    if let Some([done, of]) = trial {
        let rate = rate(done as u64, of as u64);
        cards.push(Card::new(
            "Last trial",
            text::percent(rate.interval.value),
            format!("{done} of {of} runs"),
            "Runs completed in worlds that nobody learned from",
            "",
        ));
    }
    cards
}

fn losses(training: &TrainingReport) -> Option<Figure> {
    let all = |value: fn(&TrainingEpoch) -> Option<f64>| -> Vec<[f64; 2]> {
        training
            .epochs
            .iter()
            .filter_map(|epoch| Some([f64::from(epoch.number), value(epoch)?]))
            .collect()
    };
    let training_points = all(|epoch| Some(epoch.training_loss));
    if training_points.is_empty() {
        return None;
    }
    let mut series = vec![Series {
        name: "training".into(),
        points: training_points,
        ..Series::default()
    }];
    let judged = all(|epoch| epoch.validation_loss);
    let mut rules = Vec::new();
    if !judged.is_empty() {
        if let Some(loss) = kept(training).and_then(|epoch| epoch.validation_loss) {
            rules.push(Rule {
                y: loss,
                name: format!("epoch {} is kept", training.best_epoch),
            });
        }
        series.push(Series {
            name: "validation".into(),
            points: judged,
            colour: 1,
            ..Series::default()
        });
    }
    let plot = LinePlot {
        name: "Loss over the epochs".into(),
        x: Axis::new("epoch", ""),
        y: Axis::new("mean squared error", "").including(0.0),
        series,
        rules,
        ..LinePlot::default()
    };
    Some(Figure {
        title: "Loss".into(),
        svg: plot.svg(),
        caption: "Training frames are changed and may be weighted; validation frames are neither, so their loss can be the smaller one."
            .into(),
    })
}

fn histogram(training: &TrainingReport) -> Option<Figure> {
    let series: Vec<Series> = training
        .labels
        .iter()
        .enumerate()
        .filter(|(_, (_, labels))| !labels.is_empty())
        .map(|(colour, (name, labels))| Series {
            name: name.clone(),
            points: outline(labels),
            colour,
            ..Series::default()
        })
        .collect();
    if series.is_empty() {
        return None;
    }
    let plot = LinePlot {
        name: format!("How often which {} was asked for", training.answer),
        x: Axis::new(&training.answer, "").ranged(-1.0, 1.0),
        y: Axis::new("frames", "%").including(0.0),
        series,
        ..LinePlot::default()
    };
    Some(Figure {
        title: "What the data ask for".into(),
        svg: plot.svg(),
        caption: "Part of the frames in each twenty-first of the range; what is beyond is in the outer ones."
            .into(),
    })
}

/// The upper edge of a histogram in percent.
fn outline(labels: &[f64]) -> Vec<[f64; 2]> {
    let mut counts = [0usize; BINS];
    for label in labels.iter().filter(|label| label.is_finite()) {
        // A cast limits what is beyond.
        let bin = ((label + 1.0) / 2.0 * BINS as f64) as usize;
        counts[bin.min(BINS - 1)] += 1;
    }
    let edge = |bin: usize| 2.0 * bin as f64 / BINS as f64 - 1.0;
    counts
        .iter()
        .enumerate()
        .flat_map(|(bin, count)| {
            let percent = 100.0 * *count as f64 / labels.len().max(1) as f64;
            [[edge(bin), percent], [edge(bin + 1), percent]]
        })
        .collect()
}

fn success(rounds: &[TrainingRound]) -> Option<Figure> {
    let points = |value: fn(&crate::statistics::Interval) -> f64| -> Vec<[f64; 2]> {
        rounds
            .iter()
            .filter_map(|round| {
                let [done, of] = round.trial?;
                let rate = rate(done as u64, of as u64);
                Some([round.frames as f64, 100.0 * value(&rate.interval)])
            })
            .collect()
    };
    let completed = points(|interval| interval.value);
    if completed.is_empty() {
        return None;
    }
    let limit = |name: &str, points| Series {
        name: name.into(),
        points,
        stroke: Stroke::Dashed,
        ..Series::default()
    };
    let plot = LinePlot {
        name: "Success of the trials against frames learned from".into(),
        x: Axis::new("frames learned from", "").including(0.0),
        y: Axis::new("runs completed", "%").ranged(0.0, 100.0),
        series: vec![
            Series {
                name: "completed".into(),
                points: completed,
                ..Series::default()
            },
            limit("95 % interval", points(|interval| interval.low)),
            limit("", points(|interval| interval.high)),
        ],
        ..LinePlot::default()
    };
    Some(Figure {
        title: "Success against frames".into(),
        svg: plot.svg(),
        caption: "Trial after each round. Wilson's interval: with few runs it is wide.".into(),
    })
}

fn round_table(rounds: &[TrainingRound]) -> Table {
    let rows = rounds.iter().map(|round| Row {
        cells: vec![
            round.number.to_string(),
            round.frames.to_string(),
            format!("{} of {}", round.strayed, round.drives),
            text::short(round.loss),
            round
                .trial
                .map_or_else(|| "–".into(), |[done, of]| format!("{done} of {of}")),
            round.lane_error_m.map_or_else(|| "–".into(), text::length),
        ],
        tone: "",
    });
    Table {
        caption: "Frames of all rounds so far; drives of the round that left the road; trial: runs completed, and their mean lane error."
            .into(),
        columns: ["round", "frames", "strayed", "loss", "trial", "lane error"]
            .map(String::from)
            .to_vec(),
        words: 0,
        rows: rows.collect(),
    }
}

fn epoch_table(training: &TrainingReport) -> Table {
    let or_none = |value: Option<f64>| value.map_or_else(|| "–".into(), text::short);
    let rows = training.epochs.iter().map(|epoch| Row {
        cells: vec![
            epoch.number.to_string(),
            text::short(epoch.training_loss),
            or_none(epoch.validation_loss),
            or_none(epoch.validation_error),
            epoch
                .correlation
                .map_or_else(|| "–".into(), |value| text::fixed(value, 3)),
            if epoch.number == training.best_epoch {
                "kept".into()
            } else {
                String::new()
            },
        ],
        tone: "",
    });
    Table {
        caption: "Losses are mean squared errors, the mean error that of the first output on what judges."
            .into(),
        columns: [
            "epoch",
            "training loss",
            "validation loss",
            "mean error",
            "correlation",
            "",
        ]
        .map(String::from)
        .to_vec(),
        words: 0,
        rows: rows.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> TrainingReport {
        let epoch = |number: u32, validation_loss: Option<f64>| TrainingEpoch {
            number,
            training_loss: 0.1 / f64::from(number),
            validation_loss,
            validation_error: validation_loss.map(f64::sqrt),
            constant_error: Some(0.4),
            correlation: Some(0.9),
        };
        let round = |number: u32, done: usize| TrainingRound {
            number,
            frames: 4000 * (number as usize + 1),
            drives: 16,
            strayed: 3,
            loss: 0.01,
            trial: Some([done, 24]),
            lane_error_m: Some(0.013),
        };
        TrainingReport {
            network: "tiny".into(),
            epochs: vec![epoch(1, Some(0.09)), epoch(2, Some(0.04)), epoch(3, Some(0.05))],
            best_epoch: 2,
            answer: "steering".into(),
            labels: vec![
                ("training".into(), vec![0.0, 0.0, 0.5, -1.0]),
                ("validation".into(), vec![1.0]),
            ],
            rounds: vec![round(0, 5), round(1, 24)],
        }
    }

    #[test]
    fn everything_asked_for_is_on_the_page() {
        let html = training_html(&Page::new("A training", "senda train"), &report());
        for words in [
            "Loss over the epochs",
            "epoch 2 is kept",
            "validation",
            "How often which steering",
            "Success of the trials against frames",
            "24 of 24",
            "always the median",
            "1.30 cm",
        ] {
            assert!(html.contains(words), "{words}");
        }
        for outside in ["src=\"http", "href=\"http", "@import"] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn a_training_of_nothing_has_a_page() {
        let html = training_html(&Page::default(), &TrainingReport::default());
        assert!(html.contains("</html>"));
        let hostile = TrainingReport {
            answer: "<script>alert(1)</script>".into(),
            labels: vec![("<mark>".into(), vec![f64::NAN, 0.3])],
            epochs: vec![TrainingEpoch {
                training_loss: f64::NAN,
                ..TrainingEpoch::default()
            }],
            ..TrainingReport::default()
        };
        let html = training_html(&Page::default(), &hostile);
        assert!(!html.contains("<script>alert") && !html.contains("<mark>"));
    }

    #[test]
    fn the_histogram_is_in_percent_and_from_right_to_left_as_the_axis_goes() {
        let points = outline(&[0.0, 0.0, 0.0, 1.5]);
        assert_eq!(points.len(), 2 * BINS);
        assert_eq!(points[2 * (BINS / 2)][1], 75.0);
        assert_eq!(points[2 * BINS - 1], [1.0, 25.0]);
    }
}
