//! Which plots a run has, and what each caption says.

use super::columns::Columns;
use super::page::{Figure, Table};
use super::signals::Column;
use crate::plot::{self, Axis, LinePlot, Rule, Series, Span, Stroke};
use crate::text;
use serde::Serialize;

/// Plots under a common heading.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Group {
    pub(super) title: String,
    pub(super) intro: String,
    pub(super) figures: Vec<Figure>,
    pub(super) tables: Vec<Table>,
}

/// What a plot shows.
struct Plan {
    title: &'static str,
    /// Keys of the columns; those that a run lacks or that hold no number are left out, and the plot with them if none is left.
    keys: &'static [&'static str],
    label: &'static str,
    caption: &'static str,
}

const PER_CENT: [Plan; 5] = [
    Plan {
        title: "Lane error",
        keys: &["offset"],
        label: "lane error",
        caption: "Distance of the axle's centre from the middle of the line or lane; left is positive.",
    },
    Plan {
        title: "Heading error",
        keys: &["heading"],
        label: "heading error",
        caption: "Direction in which the vehicle moved since the frame before, against the direction of the road.",
    },
    Plan {
        title: "Steering",
        keys: &["true_steering", "steering"],
        label: "steering",
        caption: "What the driver commanded and what the vehicle did; left is positive.",
    },
    Plan {
        title: "Throttle",
        keys: &["throttle"],
        label: "throttle",
        caption: "Commanded pedal: 1 is full throttle, negative brakes.",
    },
    Plan {
        title: "Speed",
        keys: &["true_speed", "speed"],
        label: "speed",
        caption: "Commanded and driven speed.",
    },
];

const TIME: [Plan; 9] = [
    Plan {
        title: "Human and driver",
        keys: &["human", "driver"],
        label: "steering",
        caption: "The recorded human's steering and what the driver would have done on the same frames; left is positive. Gaps: the driver found nothing to follow.",
    },
    Plan {
        title: "Distance d",
        keys: &["true_d", "signal d_m"],
        label: "d",
        caption: "Where the driver believes the line or lane centre to be, left of the axle positive, and where it truly is (C9).",
    },
    Plan {
        title: "Angles",
        keys: &["true_theta", "signal theta_rad", "signal desired_angle_rad"],
        label: "angle",
        caption: "Direction θ of the line or lane as the driver sees it, its true value, and the angle that the controller wants (C10).",
    },
    Plan {
        title: "Yaw rate ω",
        keys: &["signal omega_radps"],
        label: "ω",
        caption: "Yaw rate that the controller asks for, left positive.",
    },
    Plan {
        title: "Curvature",
        keys: &["signal curvature_per_m"],
        label: "curvature",
        caption: "Curvature of the road ahead as the driver sees it, left positive; 1/m is one over the radius.",
    },
    Plan {
        title: "Wheel speeds",
        keys: &["signal left_mps", "signal right_mps"],
        label: "wheel speed",
        caption: "Speed that the controller asks of each wheel.",
    },
    Plan {
        title: "Line filter",
        keys: &["signal mean", "signal max", "signal threshold"],
        label: "residue",
        caption: "Mean and maximum of what the row-adapted filter leaves of a frame, and the threshold above which a pixel counts as line (C3). A weak line shows as a maximum near the threshold.",
    },
    Plan {
        title: "Found",
        keys: &["signal found"],
        label: "found",
        caption: "Whether the driver found the line or lane: 1 yes, 0 no.",
    },
    Plan {
        title: "Time spent",
        keys: &["frame_time"],
        label: "time a frame",
        caption: "Wall time that the driver needed for each frame. The only plot that differs between repetitions.",
    },
];

/// Instead of those against per cent, where the road is unknown.
const WITHOUT_ROAD: [Plan; 3] = [
    Plan {
        title: "Steering",
        keys: &["steering"],
        label: "steering",
        caption: "What was commanded; left is positive.",
    },
    Plan {
        title: "Throttle",
        keys: &["throttle"],
        label: "throttle",
        caption: "Commanded pedal: 1 is full throttle, negative brakes.",
    },
    Plan {
        title: "Speed",
        keys: &["true_speed", "speed"],
        label: "speed",
        caption: "Measured and commanded speed.",
    },
];

/// All plots of a run.
pub(super) fn groups(columns: &Columns) -> Vec<Group> {
    let mut groups = Vec::new();
    if let Some(percent) = &columns.percent {
        let figures = PER_CENT
            .iter()
            .filter_map(|plan| against_percent(plan, columns, percent))
            .collect();
        groups.push(Group {
            title: "Against per cent of the lap".into(),
            intro: "The same place of the road is at the same place of the axis, lap after lap. Red spans: outside the corridor.".into(),
            figures,
            tables: Vec::new(),
        });
    }
    // Beside a human's, the driver's steering is already shown.
    let more: &[Plan] = match (&columns.percent, columns.get("human")) {
        (Some(_), _) => &[],
        (None, Some(_)) => &WITHOUT_ROAD[1..],
        (None, None) => &WITHOUT_ROAD,
    };
    let mut figures: Vec<Figure> = TIME
        .iter()
        .chain(more)
        .filter_map(|plan| against_time(plan, columns))
        .collect();
    // Signals of drivers that this page does not know.
    let mut constant = Vec::new();
    for column in &columns.list {
        let Some(name) = column.key.strip_prefix("signal ") else {
            continue;
        };
        if TIME.iter().any(|plan| plan.keys.contains(&column.key.as_str())) {
            continue;
        }
        if let Some(value) = column.constant() {
            constant.push(format!(
                "{} {}{}",
                column.name,
                text::short(value),
                unit_suffix(column.unit)
            ));
            continue;
        }
        if !has_values(column) {
            continue;
        }
        let mut title = capitalised(&column.name);
        let mut others = groups.iter().flat_map(|group| &group.figures).chain(&figures);
        if others.any(|other| other.title == title) {
            title += ", as the driver has it";
        }
        let caption = format!("Signal {name} of the driver.");
        figures.push(time_figure(&title, &column.name, &caption, &[column], columns));
    }
    let mut intro =
        "What the driver logs for each frame (C15). Red spans: the line or lane was not found.".to_owned();
    if !constant.is_empty() {
        intro += &format!(" The same in every frame: {}.", constant.join(", "));
    }
    if !figures.is_empty() {
        groups.push(Group {
            title: "Against time".into(),
            intro,
            figures,
            tables: Vec::new(),
        });
    }
    groups
}

fn unit_suffix(unit: &str) -> String {
    match unit {
        "" => String::new(),
        "°" => unit.into(),
        unit => format!(" {unit}"),
    }
}

fn capitalised(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or(String::new(), |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

/// Whether there is anything to plot.
fn has_values(column: &Column) -> bool {
    column.values.iter().any(|value| value.is_finite())
}

fn chosen<'a>(plan: &Plan, columns: &'a Columns) -> Option<Vec<&'a Column>> {
    let chosen: Vec<&Column> = plan
        .keys
        .iter()
        .filter_map(|key| columns.get(key))
        .filter(|column| has_values(column))
        .collect();
    // What is only true, without what the driver believes, belongs to the other plots.
    let has_own = chosen.iter().any(|column| !column.key.starts_with("true_"));
    (has_own || chosen.iter().any(|column| column.key == "true_speed")).then_some(chosen)
}

/// What captions say of the truth.
const OF_TRUTH: [&str; 2] = [", and where it truly is", ", its true value"];

/// A plan's caption, without the truth where nobody knows it.
fn caption(plan: &Plan, chosen: &[&Column]) -> String {
    let mut caption = plan.caption.to_owned();
    if !chosen.iter().any(|column| column.key.starts_with("true_")) {
        for words in OF_TRUTH {
            caption = caption.replacen(words, "", 1);
        }
    }
    caption
}

fn against_percent(plan: &Plan, columns: &Columns, percent: &[f64]) -> Option<Figure> {
    let chosen = chosen(plan, columns)?;
    let series = series(&chosen, |values| plot::against_percent(percent, values));
    let mut plot = LinePlot {
        name: format!("{} against per cent of the lap", plan.title),
        x: Axis::new("lap", "%").ranged(0.0, 100.0),
        y: axis(plan.label, &chosen),
        series,
        spans: spans(&columns.inside, |i| percent[i]),
        x_key: "percent".into(),
        width_px: 480.0,
        height_px: 212.0,
        ..LinePlot::default()
    };
    let mut caption = caption(plan, &chosen);
    if plan.keys[0] == "offset"
        && let Some(half_width_m) = columns.half_width_m
    {
        let half = if chosen[0].unit == "cm" {
            100.0 * half_width_m
        } else {
            half_width_m
        };
        plot.rules = vec![
            Rule {
                y: half,
                name: "left edge of the corridor".into(),
            },
            Rule {
                y: -half,
                name: "right edge".into(),
            },
        ];
        caption += &format!(
            " The corridor ends {} to either side.",
            text::length_short(half_width_m)
        );
    }
    Some(Figure {
        title: plan.title.into(),
        svg: plot.svg(),
        caption,
    })
}

fn against_time(plan: &Plan, columns: &Columns) -> Option<Figure> {
    let chosen = chosen(plan, columns)?;
    Some(time_figure(
        plan.title,
        plan.label,
        &caption(plan, &chosen),
        &chosen,
        columns,
    ))
}

fn time_figure(title: &str, label: &str, caption: &str, chosen: &[&Column], columns: &Columns) -> Figure {
    let time_s = &columns.time_s;
    let found: Vec<bool> = match columns.get("signal found") {
        Some(found) => found
            .values
            .iter()
            .map(|value| *value > 0.0 || value.is_nan())
            .collect(),
        None => Vec::new(),
    };
    let mut y = axis(label, chosen);
    if chosen.iter().any(|column| column.key == "signal found") {
        y = y.ranged(-0.1, 1.1);
    }
    let plot = LinePlot {
        name: format!("{title} against time"),
        x: Axis::new("time", "s"),
        y,
        series: series(chosen, |values| {
            time_s.iter().zip(values).map(|(t, v)| [*t, *v]).collect()
        }),
        spans: spans(&found, |i| time_s[i]),
        x_key: "time".into(),
        width_px: 480.0,
        height_px: 212.0,
        ..LinePlot::default()
    };
    Figure {
        title: title.to_owned(),
        svg: plot.svg(),
        caption: caption.to_owned(),
    }
}

/// The columns as series: truth thin and grey beneath, the driver's own in colour.
fn series(chosen: &[&Column], points: impl Fn(&[f64]) -> Vec<[f64; 2]>) -> Vec<Series> {
    let mut colour = 0;
    chosen
        .iter()
        .map(|column| {
            let truth = column.key.starts_with("true_") && chosen.len() > 1;
            let own = if truth { 6 } else { colour };
            colour += usize::from(!truth);
            Series {
                name: series_name(column),
                key: column.key.clone(),
                points: points(&column.values),
                colour: own,
                stroke: if truth { Stroke::Thin } else { Stroke::Line },
            }
        })
        .collect()
}

fn series_name(column: &Column) -> String {
    match column.key.as_str() {
        "signal d_m" => "driver".into(),
        "signal theta_rad" => "θ, driver".into(),
        "true_theta" => "θ, true".into(),
        "signal desired_angle_rad" => "desired".into(),
        "signal left_mps" => "left".into(),
        "signal right_mps" => "right".into(),
        _ => column.name.clone(),
    }
}

/// An axis in the columns' unit. The first column decides; units of one plot agree by construction or are plain numbers.
fn axis(label: &str, chosen: &[&Column]) -> Axis {
    let axis = Axis::new(label, chosen.first().map_or("", |column| column.unit));
    // Wheel speeds are about their difference.
    if label == "wheel speed" {
        axis
    } else {
        axis.including(0.0)
    }
}

/// Where `good` is false, as ranges of `x`.
fn spans(good: &[bool], x: impl Fn(usize) -> f64) -> Vec<Span> {
    let mut spans = Vec::new();
    let mut begin: Option<usize> = None;
    for i in 0..=good.len() {
        let bad = i < good.len() && !good[i];
        // A lap's end or a missing pose ends a span, too.
        let breaks = i > 0 && i < good.len() && {
            let gap = (x(i) - x(i - 1)).abs();
            gap.is_nan() || gap > 50.0
        };
        if let Some(first) = begin
            && (!bad || breaks)
        {
            let (a, b) = (x(first), x(i - 1));
            if a.is_finite() && b.is_finite() {
                spans.push(Span {
                    x: [a.min(b), a.max(b)],
                });
            }
            begin = None;
        }
        if bad && begin.is_none() {
            begin = Some(i);
        }
    }
    spans
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_end_at_the_lap() {
        let percent = [90.0, 95.0, 99.0, 1.0, 5.0, 9.0];
        let found = spans(&[true, false, false, false, false, true], |i| percent[i]);
        let ranges: Vec<[f64; 2]> = found.iter().map(|span| span.x).collect();
        assert_eq!(ranges, [[95.0, 99.0], [1.0, 5.0]]);
        assert_eq!(spans(&[false], |_| 3.0), [Span { x: [3.0, 3.0] }]);
        assert!(spans(&[], |_| 0.0).is_empty());
    }
}
