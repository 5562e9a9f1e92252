//! Roads in open land: a lap of the kind of document B's simulator (B1 in SPEC), around any path.

use super::circuit::{SLACK, circuit};
use super::dice::Dice;
use crate::colour::Colour;
use crate::floor::{Floor, FloorKind};
use crate::landscape::{Area, Landscape, Wall, Wood};
use crate::light::Light;
use crate::marking::{Dash, Marking};
use crate::path::{PathShape, PathSpec, Piece};
use crate::world::{Backdrop, World};
use senda_geom::{Curve, CurveError, Pose2, Vec2};

/// Width of the road (m): two lanes of 3 m (document B).
const ROAD_M: f64 = 6.0;
/// Length of laps (m): the document's has about 1.1 km.
const LAP_M: [f64; 2] = [950.0, 1250.0];
/// Tightest curve (m): as the hard ones of the document's lap, by the look of its way points.
const TIGHTEST_M: f64 = 20.0;
/// Distance that stretches of a lap keep from each other (m): a road, two shoulders and some trees.
const CLEARANCE_M: f64 = 45.0;
/// Circuits are drawn at this scale: the generator of small circuits knows their usual sizes.
const SCALE: f64 = 50.0;
/// Curves tighter than this have kerbs (m).
const KERB_RADIUS_M: f64 = 60.0;
/// Length of a bridge (m).
const BRIDGE_M: f64 = 64.0;

/// A stretch of the path (m).
type Span = (f64, f64);

impl World {
    /// A road lap made up from a seed, driven anticlockwise: kerbs in its hard curves, a bridge with walls where it is
    /// straight enough, stretches whose edge is only dirt, water, trees, hills and sky.
    pub fn random_road(seed: u64) -> Self {
        let mut dice = Dice::new(seed ^ 0x0420_AD00);
        let length_m = LAP_M.map(|m| m / SCALE);
        let (spec, _) = circuit(
            &mut dice,
            TIGHTEST_M / SCALE,
            length_m,
            CLEARANCE_M / SCALE,
            SLACK,
        );
        let spec = enlarged(spec, SCALE);
        let path = spec.curve().expect("a circuit stays a curve when it is enlarged");
        let (spec, path) = anticlockwise(spec, path);
        dress(&mut dice, format!("random-road-{seed}"), spec, path)
    }

    /// A road along a path that is given. The seed draws everything beside it.
    pub fn road_along(name: &str, spec: PathSpec, seed: u64) -> Result<Self, CurveError> {
        let path = spec.curve()?;
        Ok(dress(
            &mut Dice::new(seed ^ 0x0D0A_D000),
            name.to_owned(),
            spec,
            path,
        ))
    }
}

/// The same path, larger.
fn enlarged(spec: PathSpec, by: f64) -> PathSpec {
    let shape = match spec.shape {
        PathShape::Points(points) => PathShape::Points(points.into_iter().map(|p| p * by).collect()),
        PathShape::Pieces { start, pieces } => PathShape::Pieces {
            start: Pose2::new(start.x_m * by, start.y_m * by, start.heading_rad),
            pieces: pieces
                .into_iter()
                .map(|piece| match piece {
                    Piece::Straight { length_m } => Piece::Straight {
                        length_m: length_m * by,
                    },
                    Piece::Arc { radius_m, turn_rad } => Piece::Arc {
                        radius_m: radius_m * by,
                        turn_rad,
                    },
                    Piece::Clothoid {
                        length_m,
                        start_curvature_per_m,
                        end_curvature_per_m,
                    } => Piece::Clothoid {
                        length_m: length_m * by,
                        start_curvature_per_m: start_curvature_per_m / by,
                        end_curvature_per_m: end_curvature_per_m / by,
                    },
                })
                .collect(),
        },
    };
    PathSpec { shape, ..spec }
}

/// The path turned round if it runs clockwise.
fn anticlockwise(spec: PathSpec, path: Curve) -> (PathSpec, Curve) {
    if signed_area_m2(&path.polyline(2.0)) >= 0.0 {
        return (spec, path);
    }
    let spec = PathSpec {
        reversed: !spec.reversed,
        ..spec
    };
    let path = spec.curve().expect("a path can be driven both ways");
    (spec, path)
}

/// Area inside a polygon (m²), negative if it runs clockwise.
pub(crate) fn signed_area_m2(points: &[Vec2]) -> f64 {
    (0..points.len())
        .map(|i| 0.5 * points[i].perp_dot(points[(i + 1) % points.len()]))
        .sum()
}

/// Everything around a path.
fn dress(dice: &mut Dice, name: String, path_spec: PathSpec, path: Curve) -> World {
    let length_m = path.length_m();
    let bridge = bridge(dice, &path);
    let kerbs: Vec<Span> = curves(&path)
        .into_iter()
        .flat_map(|span| without(span, &bridge))
        .filter(|span| span.1 - span.0 > 4.0)
        .collect();
    let dirt: Vec<(f64, Span)> = (0..2 + dice.below(2))
        .filter_map(|_| {
            let from_m = dice.part() * length_m;
            let to_m = from_m + dice.between([45.0, 95.0]);
            let side = if dice.chance(0.5) { 1.0 } else { -1.0 };
            let clear = |span: &Span| span.1 < from_m - 10.0 || span.0 > to_m + 10.0;
            (to_m < length_m && bridge.iter().all(clear)).then_some((side, (from_m, to_m)))
        })
        .collect();
    let mut landscape = Landscape::default();
    for span in &bridge {
        landscape.areas.extend(lake(dice, &path, *span));
        for side in [1.0, -1.0] {
            landscape.walls.push(Wall {
                from_m: span.0,
                to_m: span.1,
                offset_m: side * (0.5 * ROAD_M + 0.55),
                width_m: 0.35,
                height_m: 0.9,
                colour: dice.vary(Colour::new(168, 160, 146), 12.0),
                second_colour: Colour::new(196, 190, 178),
            });
        }
    }
    landscape.woods = woods(dice, length_m);
    let floor = Floor {
        colour: dice.vary(Colour::new(134, 134, 84), 18.0),
        second_colour: dice.vary(Colour::new(176, 164, 112), 18.0),
        contrast: dice.between([0.4, 0.8]),
        seed: dice.seed(),
        ..Floor::of_kind(FloorKind::Grass)
    };
    let light = Light {
        level: 1.0,
        direction_rad: dice.between([-3.1, 3.1]),
        elevation_rad: dice.between([0.5, 1.1]),
        thing_shadows: dice.between([0.3, 0.6]),
        ..Light::default()
    };
    World {
        name,
        description: String::new(),
        lane_width_m: Some(ROAD_M),
        corridor_half_width_m: 0.5 * ROAD_M,
        start_station_m: 0.0,
        markings: markings(dice, length_m, &bridge, &kerbs, &dirt),
        floor,
        light,
        things: Vec::new(),
        landscape,
        backdrop: Backdrop {
            horizon: dice.vary(Colour::new(198, 214, 232), 14.0),
            zenith: dice.vary(Colour::new(98, 144, 206), 18.0),
            hills: Some(dice.vary(Colour::new(124, 134, 86), 16.0)),
        },
        margin_m: 40.0,
        warehouse: None,
        texel_m: 0.12,
        path,
        path_spec,
    }
}

/// Stretches of hard curves, with some metres before and after.
fn curves(path: &Curve) -> Vec<Span> {
    const STEP_M: f64 = 2.0;
    const AROUND_M: f64 = 14.0;
    let length_m = path.length_m();
    let mut spans: Vec<Span> = Vec::new();
    for i in 0..(length_m / STEP_M) as usize {
        let station_m = i as f64 * STEP_M;
        if path.curvature_at(station_m).abs() * KERB_RADIUS_M < 1.0 {
            continue;
        }
        let (from_m, to_m) = (
            (station_m - AROUND_M).max(0.0),
            (station_m + AROUND_M).min(length_m),
        );
        match spans.last_mut() {
            Some(last) if last.1 >= from_m => last.1 = to_m,
            _ => spans.push((from_m, to_m)),
        }
    }
    spans
}

/// What is left of a stretch between others.
fn without(span: Span, holes: &[Span]) -> Vec<Span> {
    let mut left = vec![span];
    for hole in holes {
        left = left
            .into_iter()
            .flat_map(|part| [(part.0, part.1.min(hole.0)), (part.0.max(hole.1), part.1)])
            .filter(|part| part.1 - part.0 > 0.5)
            .collect();
    }
    left
}

/// The straightest stretch that is long enough for a bridge; none on laps without one.
fn bridge(dice: &mut Dice, path: &Curve) -> Vec<Span> {
    let length_m = path.length_m();
    let begin_m = dice.part() * length_m;
    let sharpest = |from_m: f64| {
        (0..=16)
            .map(|i| path.curvature_at(from_m + BRIDGE_M * f64::from(i) / 16.0).abs())
            .fold(0.0, f64::max)
    };
    (0..(length_m / 10.0) as usize)
        .map(|i| (begin_m + 10.0 * i as f64).rem_euclid(length_m))
        .filter(|from_m| from_m + BRIDGE_M < length_m)
        .find(|from_m| sharpest(*from_m) < 1.0 / 200.0)
        .map(|from_m| (from_m, from_m + BRIDGE_M))
        .into_iter()
        .collect()
}

/// Water under a bridge, as far to both sides as other stretches of the path allow, and its shore.
fn lake(dice: &mut Dice, path: &Curve, bridge: Span) -> Vec<Area> {
    let middle = path.pose_at(0.5 * (bridge.0 + bridge.1));
    let half_m = 0.5 * (bridge.1 - bridge.0) - 6.0;
    let reach = |side: f64, wanted_m: f64| {
        // Step by step away from the bridge until another stretch comes near.
        let mut reach_m = 12.0;
        while reach_m < wanted_m {
            let next_m = reach_m + 4.0;
            let clear = [-1.5, 0.0, 1.5].iter().all(|across| {
                let at = middle.position()
                    + middle.left() * (side * (next_m + 10.0))
                    + middle.forward() * (across * half_m);
                path.project(at).offset_m.abs() > 14.0
            });
            if !clear {
                break;
            }
            reach_m = next_m;
        }
        reach_m
    };
    let (left_m, right_m) = (
        reach(1.0, dice.between([40.0, 150.0])),
        reach(-1.0, dice.between([40.0, 150.0])),
    );
    let outline = |grow_m: f64, wide: f64| -> Vec<Vec2> {
        // Round the lake: along one bank, round the far end, back along the other.
        let bank = |part: f64| {
            let away_m = if part >= 0.0 {
                part * (left_m + grow_m)
            } else {
                part * (right_m + grow_m)
            };
            let broad = half_m * (1.0 + 0.6 * wide * part.abs() * (1.0 - part.abs()) * 4.0);
            let square = part * part;
            (away_m, (broad + grow_m) * (1.0 - square * square * 0.75))
        };
        let parts = [-1.0, -0.7, -0.35, 0.0, 0.35, 0.7, 1.0];
        let point = |(away_m, along_m): (f64, f64), side: f64| {
            middle.position() + middle.left() * away_m + middle.forward() * (side * along_m)
        };
        let (there, back) = (
            parts.iter().map(|part| point(bank(*part), -1.0)),
            parts.iter().rev().map(|part| point(bank(*part), 1.0)),
        );
        there.chain(back).map(|p| (p * 10.0).round() / 10.0).collect()
    };
    let wide = dice.between([0.0, 1.0]);
    let sand = dice.vary(Colour::new(194, 171, 118), 14.0);
    let water = dice.vary(Colour::new(134, 169, 200), 14.0);
    let area = |name: &str, points: Vec<Vec2>, colour: Colour, scale_m: f64| Area {
        name: name.to_owned(),
        points,
        colour,
        second_colour: Colour::new(
            colour.rgb[0].saturating_sub(24),
            colour.rgb[1].saturating_sub(20),
            colour.rgb[2].saturating_sub(18),
        ),
        scale_m,
        ragged_m: 2.0,
        bare: true,
    };
    vec![
        area("shore", outline(5.0, wide), sand, 3.0),
        area("lake", outline(0.0, wide), water, 7.0),
    ]
}

/// Trees on both sides, thin everywhere and dense along one stretch.
fn woods(dice: &mut Dice, length_m: f64) -> Vec<Wood> {
    let green = dice.vary(Colour::new(62, 88, 48), 12.0);
    let mut wood = |count: usize, span: Span, near_m: f64, far_m: f64| Wood {
        count: count as u32,
        seed: dice.seed(),
        from_m: span.0,
        to_m: span.1,
        near_m,
        far_m,
        height_m: [5.0, 12.0],
        colour: dice.vary(green, 10.0),
    };
    let all = (0.0, length_m);
    let mut woods = vec![wood(70, all, -10.0, -60.0), wood(50, all, 9.0, 45.0)];
    let from_m = dice.part() * 0.7 * length_m;
    let span = (from_m, from_m + 0.25 * length_m);
    let side = if dice.chance(0.5) { 1.0 } else { -1.0 };
    let mut dense = woods[0].clone();
    (dense.count, dense.seed) = (30, dice.seed());
    (dense.from_m, dense.to_m) = span;
    (dense.near_m, dense.far_m) = (side * 8.0, side * 26.0);
    woods.push(dense);
    woods
}

/// Asphalt and what is painted on it, the lowest layer first.
fn markings(
    dice: &mut Dice,
    length_m: f64,
    bridge: &[Span],
    kerbs: &[Span],
    dirt: &[(f64, Span)],
) -> Vec<Marking> {
    let flat = |offset_m: f64, width_m: f64, colour: Colour, span: Option<Span>| Marking {
        span_m: span,
        gloss: 0.0,
        ..Marking::solid(offset_m, width_m, colour)
    };
    let half_m = 0.5 * ROAD_M;
    let earth = dice.vary(Colour::new(160, 148, 108), 14.0);
    let mud = dice.vary(Colour::new(173, 138, 92), 14.0);
    let grey = dice.between([104.0, 134.0]).round() as u8;
    let asphalt = Colour::new(grey, grey - 2, grey - 7);
    let line = if dice.chance(0.6) {
        dice.vary(Colour::new(207, 169, 62), 14.0)
    } else {
        Colour::new(222, 220, 212)
    };
    let mut all = Vec::new();
    for side in [1.0, -1.0] {
        all.push(Marking {
            wear: 0.25,
            ..flat(side * (half_m + 0.7), 1.8, earth, None)
        });
    }
    for (side, span) in dirt {
        all.push(Marking {
            wear: 0.1,
            ..flat(side * (half_m + 1.2), 4.0, mud, Some(*span))
        });
    }
    all.push(Marking {
        stain: dice.between([0.1, 0.35]),
        ..flat(0.0, ROAD_M, asphalt, None)
    });
    for side in [1.0, -1.0] {
        let holes: Vec<Span> = dirt
            .iter()
            .filter(|(dirty, _)| *dirty == side)
            .map(|(_, span)| (span.0 - 5.0, span.1 + 5.0))
            .collect();
        for span in without((0.0, length_m), &holes) {
            all.push(flat(side * (half_m - 0.25), 0.16, line, Some(span)));
        }
        for span in kerbs.iter().flat_map(|span| without(*span, &holes)) {
            all.push(flat(side * half_m, 0.55, Colour::new(181, 53, 46), Some(span)));
            all.push(Marking {
                dash: Some(Dash {
                    length_m: 1.2,
                    gap_m: 1.2,
                    phase_m: 0.0,
                }),
                ..flat(side * half_m, 0.55, Colour::new(230, 226, 218), Some(span))
            });
        }
    }
    if dice.chance(0.3) {
        all.push(Marking {
            dash: Some(Dash {
                length_m: 3.0,
                gap_m: 6.0,
                phase_m: 0.0,
            }),
            wear: 0.3,
            ..flat(0.0, 0.15, Colour::new(220, 218, 210), None)
        });
    }
    for span in bridge {
        all.push(flat(0.0, ROAD_M + 1.2, Colour::new(144, 140, 134), Some(*span)));
        for side in [1.0, -1.0] {
            all.push(flat(side * half_m, 0.5, Colour::new(185, 179, 168), Some(*span)));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VehicleSpec;

    #[test]
    fn every_seed_gives_a_drivable_anticlockwise_lap_of_its_own() {
        let sedan = VehicleSpec::named("sedan").unwrap();
        let (mut lengths, mut bridges) = (Vec::new(), 0);
        for seed in 0..12 {
            let world = World::random_road(seed);
            assert!(world == World::random_road(seed), "{seed}");
            let length_m = world.path.length_m();
            assert!((900.0..1300.0).contains(&length_m), "{seed}: {length_m}");
            assert!(signed_area_m2(&world.path.polyline(2.0)) > 0.0);
            assert!(world.check_vehicle(&sedan).is_empty());
            assert!(crate::smallest_radius_m(&world.path) > 0.99 * TIGHTEST_M);
            bridges += world.landscape.walls.len() / 2;
            lengths.push(length_m as u64);
            let (again, _) = World::parse("again.toml", &world.to_toml()).unwrap();
            assert!(again.path == world.path, "{seed}");
            assert_eq!(
                again.landscape.trees(&again.path),
                world.landscape.trees(&world.path)
            );
        }
        lengths.sort_unstable();
        lengths.dedup();
        assert!(lengths.len() > 8 && bridges >= 6, "{lengths:?} {bridges}");
    }

    #[test]
    fn water_keeps_off_the_road_except_under_the_bridge() {
        for seed in 0..6 {
            let world = World::random_road(seed);
            let Some(wall) = world.landscape.walls.first() else {
                continue;
            };
            let shore = world.landscape.areas[1].shore();
            for i in 0..world.path.length_m() as usize {
                let station_m = i as f64;
                let at = world.path.pose_at(station_m).position();
                if crate::landscape::is_inside(&shore, at) {
                    assert!(
                        station_m > wall.from_m && station_m < wall.to_m,
                        "{seed}: {station_m}"
                    );
                }
            }
        }
    }
}
