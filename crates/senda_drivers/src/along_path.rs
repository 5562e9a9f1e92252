//! Points of several lines put in order along one path.

use crate::candidate::FloorPoint;
use crate::path_memory::PathMemory;
use senda_geom::Vec2;

/// Points with their stations; owns the memory that sorting needs.
#[derive(Debug, Clone, Default)]
pub(crate) struct AlongPath {
    placed: Vec<Placed>,
}

#[derive(Debug, Clone, Copy)]
struct Placed {
    station_m: f64,
    point: FloorPoint,
}

impl AlongPath {
    /// Sorts points along the path, or along the vehicle's axis without one.
    pub(crate) fn sort(&mut self, path: &PathMemory, points: &[FloorPoint]) {
        self.placed.clear();
        self.placed.extend(points.iter().map(|point| Placed {
            station_m: path.locate(point.at).map_or(point.at.x, |place| place.station_m),
            point: *point,
        }));
        // Unstable sorting allocates nothing; equal stations are told apart so that the order is always the same.
        self.placed.sort_unstable_by(|a, b| {
            a.station_m
                .total_cmp(&b.station_m)
                .then(a.point.at.x.total_cmp(&b.point.at.x))
                .then(a.point.at.y.total_cmp(&b.point.at.y))
        });
    }

    /// The sorted points.
    pub(crate) fn put(&self, points: &mut Vec<FloorPoint>) {
        points.clear();
        points.extend(self.placed.iter().map(|placed| placed.point));
    }

    /// The sorted points, those of the same centimetre of the path averaged: where both lines of a lane show the middle,
    /// it is their mean.
    pub(crate) fn average(&self, points: &mut Vec<FloorPoint>) {
        const BIN_M: f64 = 0.01;
        points.clear();
        let mut rest = &self.placed[..];
        while let Some(first) = rest.first() {
            let count = rest.partition_point(|placed| placed.station_m < first.station_m + BIN_M);
            let (group, after) = rest.split_at(count.max(1));
            points.push(mean(group));
            rest = after;
        }
    }
}

fn mean(group: &[Placed]) -> FloorPoint {
    let weight = |placed: &Placed| 1.0 / (placed.point.sigma_m * placed.point.sigma_m).max(1e-8);
    let total: f64 = group.iter().map(weight).sum();
    FloorPoint {
        at: group
            .iter()
            .map(|placed| placed.point.at * weight(placed))
            .sum::<Vec2>()
            / total,
        sigma_m: group
            .iter()
            .fold(f64::INFINITY, |least, placed| least.min(placed.point.sigma_m)),
        step_m: group
            .iter()
            .fold(0.0, |most: f64, placed| most.max(placed.point.step_m)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_both_lines_come_in_order_and_those_of_one_place_are_averaged() {
        let point = |x: f64, y: f64| FloorPoint {
            at: Vec2::new(x, y),
            sigma_m: 0.003,
            step_m: 0.01,
        };
        let mut order = AlongPath::default();
        order.sort(
            &PathMemory::default(),
            &[
                point(0.30, 0.0),
                point(0.12, 0.02),
                point(0.12, -0.02),
                point(0.2, 0.0),
            ],
        );
        let mut points = Vec::new();
        order.put(&mut points);
        assert!(points.windows(2).all(|pair| pair[0].at.x <= pair[1].at.x) && points.len() == 4);
        order.average(&mut points);
        assert_eq!(points.len(), 3);
        assert!(points[0].at.y.abs() < 1e-12 && (points[0].at.x - 0.12).abs() < 1e-12);
    }
}
