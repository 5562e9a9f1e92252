//! A delivery in a report: what became of it, its stops, and the steps of the mission along time (document D).

use super::page::{Card, Figure, Row, Table};
use super::plots::Group;
use crate::Delivery;
use crate::plot::{Timeline, WalkedChart};
use crate::text;

/// The delivery in large type.
pub(super) fn cards(delivery: &Delivery) -> Vec<Card> {
    let depot = |number: Option<u8>| number.map_or_else(|| "none".to_owned(), |number| number.to_string());
    let tone = |good: bool| if good { "good" } else { "bad" };
    let count = |count: u32| {
        if count == 0 {
            "none".to_owned()
        } else {
            count.to_string()
        }
    };
    let mut cards = vec![
        Card::new(
            "Delivered to depot",
            depot(delivery.delivered_to),
            format!("goal {}", depot(delivery.goal)),
            "The depot before whose crossing it stood long enough to be unloaded",
            tone(delivery.correct),
        ),
        Card::new(
            "Returned",
            if delivery.returned { "yes" } else { "no" }.into(),
            format!("after {} s", text::fixed(delivery.time_s, 1)),
            "Whether it stands before the start's crossing at the end",
            tone(delivery.returned),
        ),
        Card::new(
            "Red lights passed",
            count(delivery.red_light_violations),
            String::new(),
            "How often it drove onto a crossing while the light was red",
            if delivery.red_light_violations > 0 {
                "bad"
            } else {
                ""
            },
        ),
        Card::new(
            "Off the streets",
            if delivery.departures == 0 {
                "never".into()
            } else {
                count(delivery.departures)
            },
            String::new(),
            "How often its origin left the streets",
            if delivery.departures > 0 { "bad" } else { "" },
        ),
    ];
    if !delivery.stops.is_empty() {
        let mean = |value: fn(&crate::delivery::Stop) -> f64| {
            delivery.stops.iter().map(|stop| value(stop).abs()).sum::<f64>() / delivery.stops.len() as f64
        };
        cards.push(Card::new(
            "Stops, mean error",
            text::length(mean(|stop| stop.distance_error_m)),
            text::angle(mean(|stop| stop.angle_error_rad)),
            "Distance to the crossing and angle to the street at each stop",
            "",
        ));
    }
    cards
}

/// The steps along time, the stops, and what led from step to step.
pub(super) fn group(delivery: &Delivery) -> Group {
    let stops = delivery.stops.iter().map(|stop| Row {
        cells: vec![
            stop.place.clone(),
            format!("{} s", text::fixed(stop.time_s, 1)),
            text::length(stop.distance_m),
            text::length(stop.distance_error_m),
            text::angle(stop.angle_error_rad),
            format!("{} s", text::fixed(stop.stood_s, 1)),
        ],
        tone: "",
    });
    let events = delivery.events.iter().map(|event| Row {
        cells: vec![
            format!("{} s", text::fixed(event.time_s, 2)),
            text::printable(&event.text),
        ],
        tone: "",
    });
    let columns = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    Group {
        title: "Mission".into(),
        intro: "The state chart as it was walked, and along time; what it saw and decided at each transition is below.".into(),
        figures: vec![
            Figure {
                title: "State chart".into(),
                svg: chart(delivery).svg(),
                caption: "Steps in the order in which they were entered first, and the time spent in each; the present one of the player lights up. Whole arrows lead on, \
broken ones lead back or past others."
                    .into(),
            },
            Figure {
                title: "Steps".into(),
                svg: timeline(delivery).svg(),
                caption: "Which step of the state chart the mission was in.".into(),
            },
        ],
        tables: vec![
            Table {
                caption: "Stops before crossings, as the vehicle truly stood: from its origin to the crossing's near edge, and that minus what was asked for.".into(),
                columns: columns(&["place", "at", "distance", "error", "angle", "stood"]),
                words: 1,
                rows: stops.collect(),
            },
            Table {
                caption: "Transitions as the driver reported them.".into(),
                columns: columns(&["at", "transition"]),
                words: 2,
                rows: events.collect(),
            },
        ],
    }
}

/// The steps that the events name (`from -> to: why`), with when each began and ended, in order.
fn steps(delivery: &Delivery) -> Vec<(&str, [f64; 2])> {
    let mut steps = Vec::new();
    let (mut since_s, mut last) = (0.0, None);
    for event in &delivery.events {
        let Some((from, to)) = event.text.split_once(" -> ") else {
            continue;
        };
        steps.push((from, [since_s, event.time_s]));
        since_s = event.time_s;
        last = Some(to.split(':').next().unwrap_or(to).trim());
    }
    steps.extend(last.map(|step| (step, [since_s, delivery.time_s])));
    steps
}

fn timeline(delivery: &Delivery) -> Timeline {
    Timeline {
        name: "Steps of the mission against time".into(),
        rows: chart(delivery).steps,
        end_s: delivery.time_s,
        width_px: 560.0,
    }
}

fn chart(delivery: &Delivery) -> WalkedChart {
    let mut chart = WalkedChart {
        name: "State chart of the mission as it was walked".into(),
        width_px: 560.0,
        ..WalkedChart::default()
    };
    let mut before = None;
    for (name, span) in steps(delivery) {
        let known = chart.steps.iter().position(|(known, _)| known == name);
        let place = known.unwrap_or(chart.steps.len());
        if known.is_none() {
            chart.steps.push((name.to_owned(), Vec::new()));
        }
        chart.steps[place].1.push(span);
        if let Some(before) = before.replace(place)
            && !chart.transitions.contains(&[before, place])
        {
            chart.transitions.push([before, place]);
        }
    }
    chart
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delivery::Event;

    #[test]
    fn steps_follow_the_reported_transitions() {
        let event = |time_s, text: &str| Event {
            time_s,
            text: text.into(),
        };
        let delivery = Delivery {
            time_s: 9.0,
            events: vec![
                event(1.0, "wait -> drive: package read, I2"),
                event(3.0, "a remark"),
                event(4.0, "drive -> stop: crossing"),
                event(6.0, "stop -> drive: green"),
            ],
            ..Delivery::default()
        };
        let chart = chart(&delivery);
        assert_eq!(chart.transitions, [[0, 1], [1, 2], [2, 1]]);
        assert_eq!(
            chart.steps,
            [
                ("wait".to_owned(), vec![[0.0, 1.0]]),
                ("drive".to_owned(), vec![[1.0, 4.0], [6.0, 9.0]]),
                ("stop".to_owned(), vec![[4.0, 6.0]]),
            ]
        );
    }
}
