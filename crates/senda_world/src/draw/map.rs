//! A drawing of a world: its floor, markings, path with stations and direction, things, lamps, and a scale.

use super::lines::marking_lines;
use super::shape::{Anchor, Shape, to_svg};
use crate::colour::Colour;
use crate::thing::ThingShape;
use crate::world::World;
use senda_geom::Vec2;

const INK: Colour = Colour::new(40, 44, 52);
const PATH: Colour = Colour::new(226, 61, 84);
const START: Colour = Colour::new(18, 140, 90);
const LAMP: Colour = Colour::new(255, 196, 60);

/// Paper that a drawing may fill (mm): worlds are scaled down to it.
const LONGEST_MM: f64 = 240.0;
/// Points of a line stand no nearer than this on the drawing (mm).
const FINEST_MM: f64 = 0.3;

/// From the floor (m) to the sheet (mm).
struct Place {
    low: Vec2,
    mm_per_m: f64,
    shift: Vec2,
}

impl Place {
    fn of(&self, floor: Vec2) -> Vec2 {
        (floor - self.low) * self.mm_per_m + self.shift
    }
}

/// Draws a world as SVG: floor and lines in their colours, the path (dashed, with arrows and stations), the start,
/// things, lamps and a scale bar. North (large y) is at the top.
pub fn svg(world: &World) -> String {
    // Less floor around the drawing than a camera needs.
    let spare_m = (world.margin_m - 0.22).max(0.0);
    let (low, high) = world.bounds();
    let (low, high) = (low + Vec2::splat(spare_m), high - Vec2::splat(spare_m));
    let size = high - low;
    let mm_per_m = LONGEST_MM / size.max_element();
    let place = Place {
        low,
        mm_per_m,
        shift: Vec2::new(6.0, 16.0),
    };
    let (width_mm, height_mm) = (size.x * mm_per_m + 12.0, size.y * mm_per_m + 36.0);
    let (floor_low, floor_high) = (place.of(low), place.of(high));
    let mut shapes = vec![
        rectangle(
            Vec2::ZERO,
            Vec2::new(width_mm, height_mm),
            Colour::new(255, 255, 255),
        ),
        rectangle(floor_low, floor_high, world.floor.colour),
    ];
    let mut inside = Vec::new();
    draw_areas(world, &place, &mut inside);
    draw_lamps(world, &place, &mut inside);
    draw_markings(world, &place, &mut inside);
    draw_path(world, &place, &mut inside);
    draw_things(world, &place, &mut inside);
    draw_trees_and_walls(world, &place, &mut inside);
    shapes.push(Shape::Clipped {
        low: floor_low,
        high: floor_high,
        shapes: inside,
    });
    shapes.push(Shape::text(Vec2::new(6.0, height_mm - 9.0), 6.5, INK, world.name.as_str()).bold());
    shapes.push(Shape::text(
        Vec2::new(6.0, height_mm - 15.5),
        3.6,
        INK,
        summary(world),
    ));
    draw_scale(mm_per_m, width_mm, &mut shapes);
    to_svg(&shapes, width_mm, height_mm, &world.name)
}

fn summary(world: &World) -> String {
    let kind = match world.lane_width_m {
        Some(width_m) => format!("lane {:.0} cm wide", width_m * 100.0),
        None => "one line".to_owned(),
    };
    let radius_m = crate::path::smallest_radius_m(&world.path);
    let curve = if radius_m > 50.0 {
        "straight".to_owned()
    } else {
        format!("tightest curve {:.0} cm", radius_m * 100.0)
    };
    let closed = if world.path.is_closed() { "closed" } else { "open" };
    format!(
        "{:.2} m, {closed}, {kind}, {curve}, floor {}",
        world.path.length_m(),
        world.floor.kind.name()
    )
}

fn rectangle(low: Vec2, high: Vec2, colour: Colour) -> Shape {
    Shape::Area {
        points: vec![low, Vec2::new(high.x, low.y), high, Vec2::new(low.x, high.y)],
        colour,
    }
}

fn draw_markings(world: &World, place: &Place, shapes: &mut Vec<Shape>) {
    for layer in world.layers() {
        for marking in layer.markings.iter() {
            for run in marking_lines(layer.path, marking, FINEST_MM / place.mm_per_m) {
                shapes.push(Shape::line(
                    run.into_iter().map(|p| place.of(p)).collect(),
                    (marking.width_m * place.mm_per_m).max(0.25),
                    marking.colour,
                ));
            }
        }
    }
}

fn draw_areas(world: &World, place: &Place, shapes: &mut Vec<Shape>) {
    for area in &world.landscape.areas {
        shapes.push(Shape::Area {
            points: area.shore().into_iter().map(|p| place.of(p)).collect(),
            colour: area.colour,
        });
    }
}

fn draw_trees_and_walls(world: &World, place: &Place, shapes: &mut Vec<Shape>) {
    for tree in world.landscape.trees(&world.path) {
        shapes.push(Shape::Disc {
            centre: place.of(tree.position),
            radius_mm: (0.5 * tree.width_m * place.mm_per_m).max(0.3),
            colour: tree.colour,
            opacity: 0.8,
        });
    }
    for wall in &world.landscape.walls {
        let steps = ((wall.to_m - wall.from_m) * place.mm_per_m)
            .ceil()
            .clamp(1.0, 1000.0) as usize;
        let points = (0..=steps).map(|i| {
            let part = i as f64 / steps as f64;
            let at = world.path.pose_at(wall.from_m + (wall.to_m - wall.from_m) * part);
            place.of(at.position() + at.left() * wall.offset_m)
        });
        let width_mm = (wall.width_m * place.mm_per_m).max(0.3);
        shapes.push(Shape::line(points.collect(), width_mm, wall.colour));
    }
}

fn draw_lamps(world: &World, place: &Place, shapes: &mut Vec<Shape>) {
    for lamp in &world.light.lamps {
        let centre = place.of(lamp.position());
        for (reach_m, opacity) in [(lamp.height_m * 0.6, 0.10), (lamp.height_m * 0.3, 0.14)] {
            shapes.push(Shape::Disc {
                centre,
                radius_mm: reach_m * place.mm_per_m,
                colour: LAMP,
                opacity,
            });
        }
        shapes.push(Shape::Disc {
            centre,
            radius_mm: 1.6,
            colour: LAMP,
            opacity: 1.0,
        });
    }
}

fn draw_path(world: &World, place: &Place, shapes: &mut Vec<Shape>) {
    let path = &world.path;
    let points: Vec<Vec2> = path
        .polyline(1.0 / place.mm_per_m)
        .into_iter()
        .map(|p| place.of(p))
        .collect();
    shapes.push(Shape::Line {
        points,
        closed: path.is_closed(),
        width_mm: 0.35,
        colour: PATH,
        dash_mm: Some((2.0, 1.4)),
        round: false,
    });
    // A round number of metres between stations, about 25 mm apart on paper at least.
    let step_m = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0]
        .into_iter()
        .find(|step_m| step_m * place.mm_per_m > 25.0)
        .unwrap_or(2000.0);
    let reach_mm = world
        .markings
        .iter()
        .map(|m| m.offset_m.abs() + m.width_m)
        .fold(0.0, f64::max)
        * place.mm_per_m
        + 1.6;
    let count = (path.length_m() / step_m - 0.05).floor() as usize;
    for i in 0..=count {
        let station_m = i as f64 * step_m;
        let pose = path.pose_at(station_m);
        let (at, forward, left) = (place.of(pose.position()), pose.forward(), pose.left());
        if i > 0 {
            // An arrow head on the path, its station beside it.
            shapes.push(Shape::Area {
                points: vec![
                    at + forward * 1.9,
                    at - forward * 1.1 + left * 1.3,
                    at - forward * 1.1 - left * 1.3,
                ],
                colour: PATH,
            });
            let label = at - left * (reach_mm + 1.6) - Vec2::new(0.0, 1.0);
            shapes.push(
                Shape::text(label, 2.9, label_ink(world), format!("{station_m} m")).anchored(Anchor::Middle),
            );
        }
    }
    let pose = path.pose_at(world.start_station_m);
    let (at, left) = (place.of(pose.position()), pose.left());
    shapes.push(Shape::Line {
        points: vec![at - left * reach_mm, at + left * reach_mm],
        closed: false,
        width_mm: 0.9,
        colour: START,
        dash_mm: None,
        round: true,
    });
    let forward = pose.forward();
    shapes.push(Shape::Area {
        points: vec![
            at + forward * 4.2,
            at + forward * 0.9 + left * 1.7,
            at + forward * 0.9 - left * 1.7,
        ],
        colour: START,
    });
    let label = at + left * (reach_mm + 2.2) - Vec2::new(0.0, 1.0);
    shapes.push(
        Shape::text(label, 3.2, label_ink(world), "start")
            .anchored(Anchor::Middle)
            .bold(),
    );
}

/// Letters on the floor: dark on light, light on dark.
fn label_ink(world: &World) -> Colour {
    if world.floor.colour.luminance() > 118.0 {
        INK
    } else {
        Colour::new(236, 238, 242)
    }
}

fn draw_things(world: &World, place: &Place, shapes: &mut Vec<Shape>) {
    for thing in &world.things {
        let points: Vec<Vec2> = thing.footprint().into_iter().map(|p| place.of(p)).collect();
        let colour = thing.texture.colour_at(1e-6, 1e-6, 1.0, 1.0);
        match thing.shape {
            ThingShape::Board { .. } => shapes.push(Shape::line(points.clone(), 1.2, colour)),
            ThingShape::Box { .. } => shapes.push(Shape::Area {
                points: points.clone(),
                colour,
            }),
        }
        shapes.push(Shape::Line {
            points,
            closed: matches!(thing.shape, ThingShape::Box { .. }),
            width_mm: 0.25,
            colour: label_ink(world),
            dash_mm: None,
            round: false,
        });
        if !thing.name.is_empty() {
            let at = place.of(thing.pose.position()) + Vec2::new(0.0, 2.0);
            shapes.push(Shape::text(at, 2.8, label_ink(world), thing.name.as_str()).anchored(Anchor::Middle));
        }
    }
}

fn draw_scale(mm_per_m: f64, width_mm: f64, shapes: &mut Vec<Shape>) {
    let step_m = [
        0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0,
    ]
    .into_iter()
    .rfind(|step_m| step_m * mm_per_m <= 0.3 * width_mm)
    .unwrap_or(0.1);
    let bar_mm = step_m * mm_per_m;
    for k in 0..4 {
        let (low, high) = (
            Vec2::new(6.0 + bar_mm * f64::from(k) / 4.0, 7.0),
            Vec2::new(6.0 + bar_mm * f64::from(k + 1) / 4.0, 8.6),
        );
        let colour = if k % 2 == 0 {
            INK
        } else {
            Colour::new(200, 202, 206)
        };
        shapes.push(rectangle(low, high, colour));
    }
    shapes.push(Shape::text(
        Vec2::new(8.0 + bar_mm, 6.9),
        3.2,
        INK,
        format!("{step_m} m"),
    ));
}
