//! Deliveries in a sweep: what became of the packages instead of lane errors, which say nothing on streets that branch.

use super::page::{Card, Row, Table};
use super::sweep::{RESAMPLES, SweepRow, SweepTable, percent_range};
use crate::delivery::Stop;
use crate::statistics::{Interval, Rate, bootstrap_mean, mean, rate};
use crate::{Delivery, text};
use serde::{Deserialize, Serialize};

/// Rates and means of deliveries that share a property. A run counts as completed when its delivery was whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DeliveryRow {
    /// Packages brought to the depot that their code names.
    pub correct: Rate,
    /// Vehicles that came back to the start.
    pub returned: Rate,
    /// Red lights passed, over all deliveries.
    pub red_light_violations: u64,
    /// How often a vehicle left the streets.
    pub departures: u64,
    /// Stops before crossings.
    pub stops: u64,
    /// Mean distance error of the stops, without sign (m), with its bootstrap interval.
    pub stop_distance_error_m: Option<Interval>,
    /// The largest one (m).
    pub stop_distance_error_max_m: Option<f64>,
    /// Mean angle error of the stops, without sign (rad), with its bootstrap interval.
    pub stop_angle_error_rad: Option<Interval>,
    /// The largest one (rad).
    pub stop_angle_error_max_rad: Option<f64>,
    /// Mean time of a run (s).
    pub time_s: Option<f64>,
}

impl DeliveryRow {
    /// `None` without deliveries.
    pub(super) fn of(deliveries: &[&Delivery]) -> Option<Self> {
        if deliveries.is_empty() {
            return None;
        }
        let count = deliveries.len() as u64;
        let hits = |good: fn(&Delivery) -> bool| deliveries.iter().filter(|one| good(one)).count() as u64;
        let errors = |of: fn(&Stop) -> f64| -> Vec<f64> {
            let stops = deliveries.iter().flat_map(|one| &one.stops);
            stops
                .map(|stop| of(stop).abs())
                .filter(|error| error.is_finite())
                .collect()
        };
        let (distances, angles) = (
            errors(|stop| stop.distance_error_m),
            errors(|stop| stop.angle_error_rad),
        );
        let largest = |errors: &[f64]| errors.iter().copied().max_by(f64::total_cmp);
        let times: Vec<f64> = deliveries.iter().map(|one| one.time_s).collect();
        Some(Self {
            correct: rate(hits(|one| one.correct), count),
            returned: rate(hits(|one| one.returned), count),
            red_light_violations: deliveries
                .iter()
                .map(|one| u64::from(one.red_light_violations))
                .sum(),
            departures: deliveries.iter().map(|one| u64::from(one.departures)).sum(),
            stops: deliveries.iter().map(|one| one.stops.len() as u64).sum(),
            stop_distance_error_m: bootstrap_mean(&distances, RESAMPLES, 1),
            stop_distance_error_max_m: largest(&distances),
            stop_angle_error_rad: bootstrap_mean(&angles, RESAMPLES, 1),
            stop_angle_error_max_rad: largest(&angles),
            time_s: mean(&times),
        })
    }

    /// In one line, for terminals.
    pub fn words(&self) -> String {
        let error = |mean: Option<Interval>, largest: Option<f64>, show: fn(f64) -> String| {
            mean.zip(largest).map_or("-".to_owned(), |(mean, largest)| {
                format!("{} (largest {})", show(mean.value), show(largest))
            })
        };
        format!(
            "correct {} of {} (95 %: {}), returned {}, red lights passed {}, off the streets {}; {} stops: distance error {}, angle {}",
            self.correct.hits,
            self.correct.count,
            percent_range(&self.correct),
            self.returned.hits,
            self.red_light_violations,
            self.departures,
            self.stops,
            error(
                self.stop_distance_error_m,
                self.stop_distance_error_max_m,
                text::length
            ),
            error(
                self.stop_angle_error_rad,
                self.stop_angle_error_max_rad,
                text::angle
            ),
        )
    }
}

pub(super) fn cards(row: &DeliveryRow) -> Vec<Card> {
    let part = |title, rate: &Rate, explained| {
        Card::new(
            title,
            text::percent(rate.interval.value),
            format!("95 % interval {}", percent_range(rate)),
            explained,
            "",
        )
    };
    let count = |title, count: u64, explained| {
        Card::new(
            title,
            if count == 0 {
                "none".to_owned()
            } else {
                count.to_string()
            },
            String::new(),
            explained,
            if count > 0 { "bad" } else { "good" },
        )
    };
    let mut cards = vec![
        part(
            "Correct",
            &row.correct,
            "Brought to the depot that the package names",
        ),
        part("Returned", &row.returned, "Came back to the start"),
        count(
            "Red lights passed",
            row.red_light_violations,
            "Crossings driven onto while their light was red, over all runs",
        ),
        count("Off the streets", row.departures, "Departures over all runs"),
    ];
    let errors = [
        (
            "Stop distance, mean error",
            row.stop_distance_error_m,
            row.stop_distance_error_max_m,
            text::length as fn(f64) -> String,
        ),
        (
            "Stop angle, mean error",
            row.stop_angle_error_rad,
            row.stop_angle_error_max_rad,
            text::angle,
        ),
    ];
    for (title, mean, largest, show) in errors {
        if let Some((mean, largest)) = mean.zip(largest) {
            cards.push(Card::new(
                title,
                show(mean.value),
                format!(
                    "95 % interval {} – {}, largest {}",
                    show(mean.low),
                    show(mean.high),
                    show(largest)
                ),
                "Without sign, over all stops before crossings",
                "",
            ));
        }
    }
    cards
}

/// Deliveries by property; `None` where no row has any.
pub(super) fn table(table: &SweepTable) -> Option<Table> {
    let columns = [
        "by",
        "value",
        "runs",
        "whole",
        "95 % interval",
        "correct",
        "returned",
        "red lights passed",
        "off the streets",
        "stops",
        "distance error, mean",
        "largest",
        "angle error, mean",
        "largest",
        "time, mean",
    ];
    let mut before = "";
    let rows: Vec<Row> = table
        .rows
        .iter()
        .filter_map(|row| Some((row, row.delivery.as_ref()?)))
        .map(|(row, delivery)| {
            let first = row.by != before;
            before = &row.by;
            Row {
                cells: cells(row, delivery, first),
                tone: if first { "first" } else { "" },
            }
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        caption: "Whole: delivered to the right depot, returned, no red light passed, never off the streets. Stops before crossings as the vehicles truly stood, \
errors without sign. Rates with Wilson's intervals."
            .into(),
        columns: columns.map(String::from).to_vec(),
        words: 2,
        rows,
    })
}

fn cells(row: &SweepRow, delivery: &DeliveryRow, first: bool) -> Vec<String> {
    let dash = || "–".to_owned();
    vec![
        if first { row.by.clone() } else { String::new() },
        row.value.clone(),
        row.completed.count.to_string(),
        format!(
            "{} ({})",
            row.completed.hits,
            text::percent(row.completed.interval.value)
        ),
        percent_range(&row.completed),
        delivery.correct.hits.to_string(),
        delivery.returned.hits.to_string(),
        delivery.red_light_violations.to_string(),
        delivery.departures.to_string(),
        delivery.stops.to_string(),
        delivery
            .stop_distance_error_m
            .map_or_else(dash, |error| text::length(error.value)),
        delivery.stop_distance_error_max_m.map_or_else(dash, text::length),
        delivery
            .stop_angle_error_rad
            .map_or_else(dash, |error| text::angle(error.value)),
        delivery.stop_angle_error_max_rad.map_or_else(dash, text::angle),
        delivery
            .time_s
            .map_or_else(dash, |time_s| format!("{} s", text::fixed(time_s, 1))),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_and_errors_come_from_all_stops() {
        let stop = |distance_error_m, angle_error_rad| Stop {
            distance_error_m,
            angle_error_rad,
            ..Stop::default()
        };
        let good = Delivery {
            correct: true,
            returned: true,
            stops: vec![stop(-0.002, 0.01), stop(0.004, -0.03)],
            time_s: 50.0,
            ..Delivery::default()
        };
        let bad = Delivery {
            correct: true,
            red_light_violations: 2,
            stops: vec![stop(0.0, 0.0)],
            time_s: 70.0,
            ..Delivery::default()
        };
        let row = DeliveryRow::of(&[&good, &bad]).unwrap();
        assert_eq!(
            (row.correct.hits, row.returned.hits, row.correct.count),
            (2, 1, 2)
        );
        assert_eq!((row.red_light_violations, row.departures, row.stops), (2, 0, 3));
        assert!((row.stop_distance_error_m.unwrap().value - 0.002).abs() < 1e-12);
        assert_eq!(row.stop_distance_error_max_m, Some(0.004));
        assert_eq!(row.stop_angle_error_max_rad, Some(0.03));
        assert_eq!(row.time_s, Some(60.0));
        let words = row.words();
        assert!(
            words.starts_with("correct 2 of 2 (95 %: 34.2 – 100.0 %), returned 1, red lights passed 2"),
            "{words}"
        );
        assert_eq!(DeliveryRow::of(&[]), None);
    }
}
