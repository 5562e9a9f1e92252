//! How a candidate lies beside a remembered path: the question by which both drivers match frames.

use crate::candidate::{Candidate, FloorPoint};
use crate::path_memory::{PathMemory, TrackOptions};
use senda_geom::{Pose2, Vec2, angle, trig};

/// A candidate beside a path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Beside {
    /// Median distance to the left of the path (m).
    pub(crate) offset_m: f64,
    /// Median deviation from that (m).
    pub(crate) spread_m: f64,
    /// Direction of the candidate against the path's (rad), left positive, in the candidate's middle.
    pub(crate) turn_rad: f64,
    /// Median distance from the vehicle (m).
    pub(crate) range_m: f64,
}

/// A line turns by less than this against its path (rad): 40°, a guess between tight curves and reflections.
pub(crate) const TURN_LIMIT_RAD: f64 = 0.7;
/// Pieces are at least this long (m): about as long as a line is wide.
const PIECE_LEAST_M: f64 = 0.02;
/// Their points scatter by less than this (m, median).
const PIECE_SPREAD_M: f64 = 0.008;
/// They turn by less than this (rad).
const PIECE_TURN_RAD: f64 = 0.4;
/// They end no further beyond the remembered path than this (m).
const PIECE_BEYOND_M: f64 = 0.15;
/// Points further beyond the remembered piece than this say nothing about the candidate (m).
const BEYOND_LIMIT_M: f64 = 0.5;
/// Fewer points than this are no line.
pub(crate) const POINTS_LEAST: usize = 3;

/// Where a candidate's points (in the frame of their exposure) lie beside a path. `scratch` is working memory.
pub(crate) fn beside(
    path: &PathMemory,
    points: &[FloorPoint],
    now_from_exposure: Pose2,
    scratch: &mut Vec<f64>,
) -> Option<Beside> {
    if points.len() < POINTS_LEAST {
        return None;
    }
    scratch.clear();
    for point in points {
        if let Some(place) = path.locate(now_from_exposure.transform(point.at)) {
            if place.beyond_m < BEYOND_LIMIT_M {
                scratch.push(place.offset_m);
            }
        }
    }
    if scratch.len() < POINTS_LEAST || 2 * scratch.len() < points.len() {
        return None;
    }
    let offset_m = median(scratch);
    for offset in scratch.iter_mut() {
        *offset = (*offset - offset_m).abs();
    }
    let spread_m = median(scratch);
    let middle = points.len() / 2;
    let at = now_from_exposure.transform(points[middle].at);
    let direction = direction_at(points, middle, 0.05);
    let path_left = path.locate(at)?.left;
    let heading = |v: Vec2| trig::atan2(v.y, v.x);
    let turn_rad = angle::wrap(
        heading(direction) + now_from_exposure.heading_rad - heading(path_left) + std::f64::consts::FRAC_PI_2,
    );
    Some(Beside {
        offset_m,
        spread_m,
        turn_rad,
        range_m: at.length(),
    })
}

/// Whether a piece of a line ([`crate::sight::Sight::look_closer`]) lies at an offset from the path and along it: more
/// closely than a whole line must, since specks and reflections are many.
pub(crate) fn is_piece_at(
    path: &PathMemory,
    piece: &Candidate,
    offset_m: f64,
    track: &TrackOptions,
    now_from_exposure: Pose2,
    scratch: &mut Vec<f64>,
) -> bool {
    let (Some(near), Some(far)) = (piece.points.first(), piece.points.last()) else {
        return false;
    };
    let reach_m = path.ahead_of(Vec2::ZERO) + PIECE_BEYOND_M;
    let far_m = now_from_exposure.transform(far.at).length();
    (far.at - near.at).length() >= PIECE_LEAST_M
        && far_m < reach_m
        && beside(path, &piece.points, now_from_exposure, scratch).is_some_and(|beside| {
            (beside.offset_m - offset_m).abs() < 0.5 * track.gate_m + track.gate_slope * beside.range_m
                && beside.spread_m < PIECE_SPREAD_M
                && beside.turn_rad.abs() < PIECE_TURN_RAD
        })
}

/// Direction of a line at one of its points: least squares over `reach_m` to both sides, and over at least five points.
pub(crate) fn direction_at(points: &[FloorPoint], index: usize, reach_m: f64) -> Vec2 {
    let at = points[index].at;
    let near = |point: &FloorPoint| (point.at - at).length() <= reach_m;
    let mut first = index
        - points[..index]
            .iter()
            .rev()
            .take_while(|point| near(point))
            .count();
    let mut last = index + 1 + points[index + 1..].iter().take_while(|point| near(point)).count();
    // At the ends the window reaches further in.
    let wanted = 5.min(points.len());
    if last - first < wanted {
        last = (first + wanted).min(points.len());
        first = last - wanted;
    }
    let window = &points[first..last];
    let count = window.len() as f64;
    let middle = window.iter().map(|point| point.at).sum::<Vec2>() / count;
    // Along the chord, so that steep lines are fitted as well as flat ones.
    let Some(chord) = (window[window.len() - 1].at - window[0].at).try_normalize() else {
        return Vec2::X;
    };
    let (mut along_along, mut along_aside) = (0.0, 0.0);
    for point in window {
        let away = point.at - middle;
        let along = away.dot(chord);
        along_along += along * along;
        along_aside += along * away.dot(chord.perp());
    }
    let slope = if along_along > 0.0 {
        along_aside / along_along
    } else {
        0.0
    };
    (chord + chord.perp() * slope).normalize()
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(from: Vec2, to: Vec2) -> Vec<FloorPoint> {
        (0..=20)
            .map(|i| FloorPoint {
                at: from + (to - from) * (f64::from(i) / 20.0),
                sigma_m: 0.003,
                step_m: 0.01,
            })
            .collect()
    }

    #[test]
    fn a_parallel_line_has_its_distance_and_no_turn() {
        let mut path = PathMemory::default();
        path.update(
            &line(Vec2::new(0.1, 0.0), Vec2::new(0.5, 0.0)),
            &TrackOptions::default(),
            |_| true,
        );
        let left = line(Vec2::new(0.2, 0.1), Vec2::new(0.4, 0.1));
        let found = beside(&path, &left, Pose2::default(), &mut Vec::new()).unwrap();
        assert!((found.offset_m - 0.1).abs() < 1e-9 && found.spread_m < 1e-9 && found.turn_rad.abs() < 1e-9);
        // The same line seen by a vehicle that has turned right by 0.2 since.
        let turned = beside(&path, &left, Pose2::new(0.0, 0.0, 0.2), &mut Vec::new()).unwrap();
        assert!((turned.turn_rad - 0.2).abs() < 1e-9);
    }

    #[test]
    fn a_line_across_the_path_turns() {
        let mut path = PathMemory::default();
        path.update(
            &line(Vec2::new(0.1, 0.0), Vec2::new(0.5, 0.0)),
            &TrackOptions::default(),
            |_| true,
        );
        let across = line(Vec2::new(0.3, -0.05), Vec2::new(0.32, 0.05));
        let found = beside(&path, &across, Pose2::default(), &mut Vec::new()).unwrap();
        assert!(found.turn_rad > TURN_LIMIT_RAD, "{found:?}");
    }
}
