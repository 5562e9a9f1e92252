//! Paint and tape along the path, with wear and dirt.

use super::material::blend;
use super::noise::{clouds, hash, smooth, unit, value};
use super::{Canvas, Place, within};
use crate::marking::Marking;
use crate::world::{Layer, World};
use senda_geom::Vec2;

/// Nodes along the path stand this far apart (m), or two texels where texels are large.
const NODE_M: f64 = 0.01;

/// Pieces whose bounds are looked at together.
const STRETCH: usize = 16;

/// All markings, what lies below first.
#[derive(Debug)]
pub(super) struct Lines {
    layers: Vec<Line>,
    floor_seed: u64,
}

/// The markings along one path.
#[derive(Debug)]
struct Line {
    markings: Vec<Marking>,
    nodes: Vec<Node>,
    /// Corners of rectangles around all markings between [`STRETCH`] + 1 nodes.
    stretches: Vec<(Vec2, Vec2)>,
}

/// A point of the path with its directions.
#[derive(Debug)]
struct Node {
    station_m: f64,
    position: Vec2,
    forward: Vec2,
    left: Vec2,
}

impl Lines {
    pub(super) fn new(world: &World, place: &Place) -> Self {
        Self {
            layers: world
                .layers()
                .iter()
                .filter(|layer| !layer.markings.is_empty())
                .map(|layer| Line::new(layer, place.metres_per_texel))
                .collect(),
            floor_seed: world.floor.seed,
        }
    }

    /// Whether any of the paint is glossy.
    pub(super) fn are_glossy(&self) -> bool {
        self.layers
            .iter()
            .flat_map(|line| &line.markings)
            .any(|marking| gloss(marking) > 0)
    }

    /// Paints onto a floor that has no light on it yet.
    pub(super) fn paint(&self, canvas: &mut Canvas<'_>) {
        let (place, window) = (canvas.place, canvas.window);
        let around = Vec2::splat(3.0 * place.metres_per_texel);
        let corner = |column: usize, row: usize| {
            place.origin + Vec2::new(column as f64, row as f64) * place.metres_per_texel
        };
        let low = corner(window.columns.start, window.rows.start) - around;
        let high = corner(window.columns.end, window.rows.end) + around;
        for line in &self.layers {
            let near = |(from, to): &(Vec2, Vec2)| from.cmple(high).all() && to.cmpge(low).all();
            if !line.stretches.iter().any(near) {
                continue;
            }
            for (number, marking) in line.markings.iter().enumerate() {
                let seed = hash(number as i32, 0, self.floor_seed as u32 ^ 0x5EED);
                for (i, _) in line
                    .stretches
                    .iter()
                    .enumerate()
                    .filter(|(_, bounds)| near(bounds))
                {
                    let nodes = &line.nodes[i * STRETCH..];
                    for pair in nodes.windows(2).take(STRETCH) {
                        paint_piece(marking, seed, &pair[0], &pair[1], canvas);
                    }
                }
            }
        }
    }
}

impl Line {
    fn new(layer: &Layer<'_>, texel_m: f64) -> Self {
        let path = layer.path;
        let length_m = path.length_m();
        let spacing_m = NODE_M.max(2.0 * texel_m);
        let steps = (length_m / spacing_m).ceil().max(1.0) as usize;
        let node = |i: usize| {
            let station_m = length_m * i as f64 / steps as f64;
            let pose = path.pose_at(station_m);
            Node {
                station_m,
                position: pose.position(),
                forward: pose.forward(),
                left: pose.left(),
            }
        };
        let mut nodes: Vec<Node> = (0..steps).map(node).collect();
        // The last node closes the loop exactly; its station is the length, not 0.
        nodes.push(Node {
            station_m: length_m,
            ..node(if path.is_closed() { 0 } else { steps })
        });
        let (low_m, high_m) =
            layer
                .markings
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), marking| {
                    let half_m = marking.width_m / 2.0;
                    (
                        low.min(marking.offset_m - half_m),
                        high.max(marking.offset_m + half_m),
                    )
                });
        let stretch = |from: usize| {
            nodes[from..nodes.len().min(from + STRETCH + 1)]
                .iter()
                .flat_map(|node| [low_m, high_m].map(|offset_m| node.position + node.left * offset_m))
                .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), point| {
                    (low.min(point), high.max(point))
                })
        };
        Self {
            stretches: (0..nodes.len() - 1).step_by(STRETCH).map(stretch).collect(),
            markings: layer.markings.to_vec(),
            nodes,
        }
    }
}

/// Paints what lies between two nodes. Every texel belongs to exactly one pair: it is ahead of the first node and
/// behind the second, seen along the path's direction at each.
fn paint_piece(marking: &Marking, seed: u32, a: &Node, b: &Node, canvas: &mut Canvas<'_>) {
    if let Some((from_m, to_m)) = marking.span_m
        && (b.station_m < from_m - 0.1 || a.station_m > to_m + 0.1)
    {
        return;
    }
    let (place, window) = (canvas.place, canvas.window);
    let texel_m = place.metres_per_texel;
    let half_m = marking.width_m / 2.0;
    let (low_m, high_m) = (
        marking.offset_m - half_m - texel_m,
        marking.offset_m + half_m + texel_m,
    );
    let corners = [
        a.position + a.left * low_m,
        a.position + a.left * high_m,
        b.position + b.left * low_m,
        b.position + b.left * high_m,
    ];
    let low = corners.iter().fold(corners[0], |low, p| low.min(*p)) - place.origin;
    let high = corners.iter().fold(corners[0], |high, p| high.max(*p)) - place.origin;
    let row = |y: f64| (y / texel_m).floor().max(0.0) as usize;
    let rows = within(row(low.y)..row(high.y + texel_m), &window.rows);
    if rows.is_empty() {
        return;
    }
    let step_m = b.station_m - a.station_m;
    // Between the nodes the offset is a mix of both: a point inside may lie this far outside as seen from `a`.
    let slack_m = texel_m
        + step_m * a.forward.perp_dot(b.forward).abs()
        + low_m.abs().max(high_m.abs()) * (1.0 - a.forward.dot(b.forward));
    let sides = [
        (a.forward, a.position),
        (-b.forward, b.position),
        (a.left, a.position + a.left * (low_m - slack_m)),
        (-a.left, a.position + a.left * (high_m + slack_m)),
    ];
    for j in rows {
        let y = place.origin.y + (j as f64 + 0.5) * texel_m;
        let (first, last) = span(&sides, y, low.x + place.origin.x, high.x + place.origin.x);
        for i in place.columns(first - texel_m, last + 2.0 * texel_m, window) {
            let point = Vec2::new(place.origin.x + (i as f64 + 0.5) * texel_m, y);
            let (from_a, from_b) = (point - a.position, point - b.position);
            let (ahead, behind) = (from_a.dot(a.forward), from_b.dot(b.forward));
            if ahead < 0.0 || behind >= 0.0 {
                continue;
            }
            let part = ahead / (ahead - behind);
            let side_a = from_a.dot(a.left);
            let offset_m = side_a + (from_b.dot(b.left) - side_a) * part;
            let across_m = (offset_m - marking.offset_m).abs();
            let mut cover = ((half_m - across_m) / texel_m + 0.5).clamp(0.0, 1.0);
            // A line thinner than a texel covers only part of it.
            cover = cover.min(marking.width_m / texel_m);
            if cover <= 0.0 {
                continue;
            }
            cover *= along_cover(marking, a.station_m + step_m * part, texel_m);
            if cover <= 0.0 {
                continue;
            }
            let texel = canvas.texel(i, j);
            let (paint, cover) = aged(marking, seed, point, across_m / half_m, cover as f32, texel_m);
            *texel = blend(*texel, paint, cover);
        }
    }
}

/// The part of the row at `y` that lies inside all half planes (normal, point), within first ..= last (m). Empty where
/// first > last.
fn span(sides: &[(Vec2, Vec2)], y: f64, first: f64, last: f64) -> (f64, f64) {
    let (mut first, mut last) = (first, last);
    for (normal, point) in sides {
        // normal.x·(x - point.x) + normal.y·(y - point.y) >= 0
        let rest = normal.y * (y - point.y);
        if normal.x > 1e-12 {
            first = first.max(point.x - rest / normal.x);
        } else if normal.x < -1e-12 {
            last = last.min(point.x - rest / normal.x);
        }
    }
    (first, last)
}

/// Part of a texel that dashes and span leave painted.
fn along_cover(marking: &Marking, station_m: f64, texel_m: f64) -> f64 {
    let mut cover = 1.0f64;
    if let Some((from_m, to_m)) = marking.span_m {
        cover = (((station_m - from_m).min(to_m - station_m)) / texel_m + 0.5).clamp(0.0, 1.0);
    }
    if let Some(dash) = marking.dash {
        let period_m = dash.length_m + dash.gap_m;
        let within_m = (station_m - dash.phase_m).rem_euclid(period_m);
        let inside_m = if within_m < dash.length_m {
            within_m.min(dash.length_m - within_m)
        } else {
            -(within_m - dash.length_m).min(period_m - within_m)
        };
        cover *= (inside_m / texel_m + 0.5).clamp(0.0, 1.0);
    }
    cover
}

/// Colour and cover of paint at a place after wear and dirt. `across` is 0 in the middle of the line and 1 at its edge.
fn aged(marking: &Marking, seed: u32, at: Vec2, across: f64, cover: f32, texel_m: f64) -> ([u8; 4], f32) {
    let mut cover = cover;
    let gloss = gloss(marking);
    let [r, g, b] = marking.colour.rgb;
    let mut paint = [r, g, b, gloss];
    // A trace of unevenness that every tape and paint has.
    let grain = 1.0 + (value(at.x / 0.004, at.y / 0.004, seed ^ 3) - 0.5) * 0.06;
    for channel in paint.iter_mut().take(3) {
        *channel = (f32::from(*channel) * grain).min(255.0) as u8;
    }
    if marking.wear > 0.0 {
        let wear = marking.wear as f32;
        let coarse = clouds(at.x / 0.06, at.y / 0.06, seed);
        let fine = value(at.x / 0.0035, at.y / 0.0035, seed ^ 9);
        let crack = value(at.x / 0.0016, at.y / 0.0016, seed ^ 21);
        // Tyres and shoes rub the edges first.
        let edge = (across * across) as f32 * 0.12;
        let resistance = 0.62 * coarse + 0.26 * fine + 0.12 * crack - edge;
        let softness = 0.05 + 0.4 * (texel_m / 0.0035).min(1.0) as f32 * 0.2;
        cover *= smooth((resistance - (wear * 0.78 + 0.02)) / softness + 0.5);
        // What remains is thin.
        cover *= 1.0 - 0.35 * wear * fine;
    }
    if marking.stain > 0.0 {
        let stain = marking.stain as f32;
        let blotch = smooth((clouds(at.x / 0.045, at.y / 0.045, seed ^ 77) - 0.62 + 0.35 * stain) * 3.5);
        let smear = 0.35 * unit(hash((at.x / 0.002) as i32, (at.y / 0.002) as i32, seed)) + 0.65;
        let part = stain * 0.75 * blotch * smear;
        paint = blend(paint, [98, 90, 78, gloss / 2], part);
    }
    (paint, cover)
}

/// A marking's gloss as a byte.
fn gloss(marking: &Marking) -> u8 {
    (marking.gloss * 255.0).round() as u8
}
