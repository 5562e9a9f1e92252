//! Closed circuits that keep their limits: splines, and polygons with rounded corners and chicanes.

use super::dice::Dice;
use crate::path::{self, PathShape, PathSpec, Piece};
use senda_geom::{Curve, Pose2, Vec2, angle, trig};
use std::f64::consts::PI;

/// What kind of shape to try. It stays for several tries: if every failure drew anew, only easy shapes would get through.
struct Style {
    spline: bool,
    corners: usize,
    /// How far corners may lie inside the circle, as a part of its radius.
    roughness: f64,
    /// Probability that a straight piece becomes a chicane.
    chicanes: f64,
    /// Wanted place in the range of lengths, 0..=1.
    size: f64,
}

impl Style {
    fn draw(dice: &mut Dice) -> Self {
        Self {
            spline: dice.chance(0.25),
            corners: 3 + dice.below(8),
            roughness: dice.between([0.05, 0.8]),
            chicanes: if dice.chance(0.75) {
                dice.between([0.3, 1.0])
            } else {
                0.0
            },
            size: dice.part(),
        }
    }
}

/// What a length may miss its limits by, as a part of them, where nobody asked for them: worlds that were made up with this slack
/// stay as they are.
pub(super) const SLACK: f64 = 0.001;

/// A closed circuit that keeps its limits, the length up to a part `slack` of them. Tries shapes until one does; a circle always does.
pub(super) fn circuit(
    dice: &mut Dice,
    min_radius_m: f64,
    length_m: [f64; 2],
    clearance_m: f64,
    slack: f64,
) -> (PathSpec, Curve) {
    let least_m = length_m[0].max(2.0 * PI * min_radius_m * 1.02);
    let most_m = length_m[1].max(least_m);
    let mut style = Style::draw(dice);
    for attempt in 1..=400 {
        if attempt % 40 == 0 {
            style = Style::draw(dice);
        }
        // Long circuits have more room for curves: look there when shapes keep failing.
        let part = style.size + (1.0 - style.size) * f64::from(attempt % 40) / 40.0;
        let wanted_m = least_m + (most_m - least_m) * part;
        let shape = if style.spline {
            spline(dice, &style, wanted_m)
        } else {
            rounded_polygon(dice, &style, wanted_m, min_radius_m)
        };
        let Some(shape) = shape else { continue };
        let spec = PathSpec {
            shape,
            closed: true,
            reversed: dice.chance(0.5),
        };
        let Ok(curve) = spec.curve() else { continue };
        let long_enough =
            curve.length_m() >= least_m * (1.0 - slack) && curve.length_m() <= most_m * (1.0 + slack);
        if long_enough
            && path::smallest_radius_m(&curve) >= min_radius_m * 0.999
            && path::self_overlap(&curve, clearance_m).is_none()
        {
            return (spec, curve);
        }
    }
    let spec = PathSpec {
        shape: PathShape::Pieces {
            start: Pose2::default(),
            pieces: vec![Piece::Arc {
                radius_m: 0.5 * (least_m + most_m) / (2.0 * PI),
                turn_rad: 2.0 * PI,
            }],
        },
        closed: true,
        reversed: false,
    };
    let curve = spec.curve().expect("a circle of positive radius is a curve");
    (spec, curve)
}

/// Corners around a centre at random distances, so that no edge crosses another.
fn star(dice: &mut Dice, count: usize, roughness: f64) -> Vec<Vec2> {
    let stretch = dice.between([0.55, 1.0]);
    let turn_rad = dice.between([0.0, 2.0 * PI]);
    let tilt = Pose2::new(0.0, 0.0, dice.between([0.0, 2.0 * PI]));
    (0..count)
        .map(|i| {
            let jitter = dice.between([-0.35, 0.35]);
            let (sin, cos) = trig::sincos(turn_rad + 2.0 * PI * (i as f64 + jitter) / count as f64);
            let distance = 1.0 - roughness * dice.part();
            tilt.transform(Vec2::new(distance * cos, distance * sin * stretch))
        })
        .collect()
}

fn perimeter(points: &[Vec2]) -> f64 {
    (0..points.len())
        .map(|i| (points[(i + 1) % points.len()] - points[i]).length())
        .sum()
}

fn spline(dice: &mut Dice, style: &Style, wanted_m: f64) -> Option<PathShape> {
    let corners = star(dice, style.corners + 2, style.roughness);
    let rough = Curve::from_points(&corners, true).ok()?;
    let scale = wanted_m / rough.length_m();
    // Whole millimetres: a file that a person can read.
    let points = corners
        .iter()
        .map(|p| {
            Vec2::new(
                (p.x * scale * 1e3).round() / 1e3,
                (p.y * scale * 1e3).round() / 1e3,
            )
        })
        .collect();
    Some(PathShape::Points(points))
}

/// Straight edges joined by arcs, some with clothoids before and after them.
fn rounded_polygon(dice: &mut Dice, style: &Style, wanted_m: f64, min_radius_m: f64) -> Option<PathShape> {
    let count = style.corners;
    let unit = star(dice, count, style.roughness);
    // Rounding shortens; the caller checks what came out.
    let scale = wanted_m * dice.between([1.0, 1.25]) / perimeter(&unit);
    let corners: Vec<Vec2> = unit.iter().map(|p| *p * scale).collect();
    let edges: Vec<Vec2> = (0..count)
        .map(|i| corners[(i + 1) % count] - corners[i])
        .collect();
    let smooth = dice.chance(0.4);
    let sharpness = dice.part();
    let mut bends = Vec::with_capacity(count);
    for i in 0..count {
        let (before, after) = (edges[(i + count - 1) % count], edges[i]);
        let turn_rad = angle::difference(trig::atan2(after.y, after.x), trig::atan2(before.y, before.x));
        let room_m = 0.49 * before.length().min(after.length());
        let lead = if smooth { dice.between([0.1, 0.6]) } else { 0.0 };
        let tangent_of_one = bend_tangent_m(1.0, turn_rad, lead)?;
        let largest_m = (room_m / tangent_of_one).min(2.5);
        if largest_m < min_radius_m {
            return None;
        }
        let part = dice.part();
        let radius_m =
            min_radius_m + (largest_m - min_radius_m) * if sharpness < 0.4 { part * part } else { part };
        bends.push((turn_rad, radius_m, lead, tangent_of_one * radius_m));
    }
    let mut pieces = Vec::new();
    for i in 0..count {
        let (turn_rad, radius_m, lead, _) = bends[i];
        if i > 0 {
            let length_m = edges[i - 1].length() - bends[i - 1].3 - bends[i].3;
            if dice.chance(style.chicanes) {
                push_chicane(dice, &mut pieces, length_m, min_radius_m);
            } else {
                push_straight(&mut pieces, length_m);
            }
        }
        pieces.extend(bend(radius_m, turn_rad, lead));
    }
    let closing_m = edges[count - 1].length() - bends[count - 1].3 - bends[0].3;
    // The path begins on the straight line that leads into the first bend.
    let begin = corners[0] - edges[count - 1].normalize() * (bends[0].3 + closing_m * 0.5);
    let mut all = Vec::new();
    push_straight(&mut all, closing_m * 0.5);
    all.extend(pieces);
    push_straight(&mut all, closing_m * 0.5);
    let heading_rad = trig::atan2(edges[count - 1].y, edges[count - 1].x);
    Some(PathShape::Pieces {
        start: Pose2::new(begin.x, begin.y, heading_rad),
        pieces: all,
    })
}

fn push_straight(pieces: &mut Vec<Piece>, length_m: f64) {
    if length_m > 1e-6 {
        pieces.push(Piece::Straight { length_m });
    }
}

/// Instead of a straight piece: aside and back again, or as much of it as has room.
fn push_chicane(dice: &mut Dice, pieces: &mut Vec<Piece>, length_m: f64, min_radius_m: f64) {
    let radius_m = min_radius_m * dice.between([1.0, 1.8]);
    let side = if dice.chance(0.5) { 1.0 } else { -1.0 };
    // Four arcs of an angle a reach 4·r·sin(a) ahead.
    let sine = (length_m * dice.between([0.6, 0.98]) / (4.0 * radius_m)).min(0.92);
    if sine < 0.3 {
        push_straight(pieces, length_m);
        return;
    }
    let turn_rad = trig::asin(sine) * side;
    let spare_m = length_m - 4.0 * radius_m * sine;
    let before = dice.part();
    push_straight(pieces, spare_m * before);
    for turn_rad in [turn_rad, -2.0 * turn_rad, turn_rad] {
        pieces.push(Piece::Arc { radius_m, turn_rad });
    }
    push_straight(pieces, spare_m * (1.0 - before));
}

/// A bend: an arc, between two clothoids that make up the share `lead` of its turning.
fn bend(radius_m: f64, turn_rad: f64, lead: f64) -> Vec<Piece> {
    if lead == 0.0 {
        return vec![Piece::Arc { radius_m, turn_rad }];
    }
    let curvature = turn_rad.signum() / radius_m;
    // A clothoid from 0 to k turns by k·length/2; two of them turn by lead·turn.
    let length_m = lead * turn_rad.abs() * radius_m;
    let clothoid = |start_curvature_per_m: f64, end_curvature_per_m: f64| Piece::Clothoid {
        length_m,
        start_curvature_per_m,
        end_curvature_per_m,
    };
    vec![
        clothoid(0.0, curvature),
        Piece::Arc {
            radius_m,
            turn_rad: turn_rad * (1.0 - lead),
        },
        clothoid(curvature, 0.0),
    ]
}

/// Distance from the corner at which a bend begins (m); `None`: too little or too much turning for a corner.
fn bend_tangent_m(radius_m: f64, turn_rad: f64, lead: f64) -> Option<f64> {
    if !(0.03..2.6).contains(&turn_rad.abs()) {
        return None;
    }
    let mut pose = Pose2::default();
    for piece in bend(radius_m, turn_rad, lead) {
        let segment = piece.segment();
        pose = segment.pose_at(pose, segment.length_m);
    }
    let (sin, cos) = trig::sincos(turn_rad);
    Some(pose.x_m - pose.y_m * cos / sin)
}
