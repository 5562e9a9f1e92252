//! What stands on the floor, drawn over a painting as seen from straight above.

use crate::colour::Colour;
use crate::paint::FloorPainting;
use crate::thing::ThingShape;
use crate::world::World;
use senda_geom::Vec2;

/// Boards have no thickness; they are drawn this thick (m), or as thick as [`LEAST_TEXELS`].
const BOARD_M: f64 = 0.012;
/// Thinnest board that still shows in a picture (texels).
const LEAST_TEXELS: f64 = 4.0;
/// Outlines around tops, so that they differ from a floor of their colour (texels).
const OUTLINE_TEXELS: f64 = 1.5;

/// Draws walls, trees and things over a painted floor: boxes by their tops, boards by their upper edges in the colour of
/// their fronts, each with an outline.
pub fn add_upright(painting: &mut FloorPainting, world: &World) {
    let texel_m = painting.metres_per_texel;
    for wall in &world.landscape.walls {
        let length_m = wall.to_m - wall.from_m;
        let steps = length_m.ceil().clamp(1.0, 1000.0) as usize;
        let place = |i: usize| {
            let at = world
                .path
                .pose_at(wall.from_m + length_m * i as f64 / steps as f64);
            at.position() + at.left() * wall.offset_m
        };
        for i in 0..steps {
            let bar = bar(place(i), place(i + 1), wall.width_m.max(LEAST_TEXELS * texel_m));
            fill(painting, &bar, wall.second_colour);
        }
    }
    for tree in world.landscape.trees(&world.path) {
        disc(painting, tree.position, 0.5 * tree.width_m, tree.colour);
    }
    for thing in &world.things {
        let corners = thing.footprint();
        let (top, colour) = match thing.shape {
            ThingShape::Box { .. } => (corners, thing.back),
            ThingShape::Board { .. } => (
                bar(corners[0], corners[1], BOARD_M.max(LEAST_TEXELS * texel_m)),
                thing.texture.colour_at(1e-6, 1e-6, 1.0, 1.0),
            ),
        };
        let outline = if colour.luminance() > 118.0 {
            Colour::new(30, 32, 36)
        } else {
            Colour::new(236, 238, 242)
        };
        fill(painting, &top, colour);
        for i in 0..top.len() {
            let side = bar(top[i], top[(i + 1) % top.len()], OUTLINE_TEXELS * texel_m);
            fill(painting, &side, outline);
        }
    }
}

/// A straight bar from one point to another, counter-clockwise.
fn bar(from: Vec2, to: Vec2, width_m: f64) -> Vec<Vec2> {
    let across = (to - from).normalize_or_zero().perp() * (0.5 * width_m);
    vec![from - across, to - across, to + across, from + across]
}

/// Texels whose middles may lie between two corners (m).
fn window(painting: &FloorPainting, low: Vec2, high: Vec2) -> [std::ops::Range<usize>; 2] {
    let texels = |from_m: f64, to_m: f64, origin_m: f64, count: usize| {
        let texel =
            |place_m: f64| ((place_m - origin_m) / painting.metres_per_texel).clamp(0.0, count as f64);
        texel(from_m).floor() as usize..texel(to_m).ceil() as usize
    };
    [
        texels(low.x, high.x, painting.origin.x, painting.width),
        texels(low.y, high.y, painting.origin.y, painting.height),
    ]
}

fn cover(painting: &mut FloorPainting, low: Vec2, high: Vec2, colour: Colour, covers: impl Fn(Vec2) -> bool) {
    let [columns, rows] = window(painting, low, high);
    for row in rows {
        for column in columns.clone() {
            let middle = Vec2::new(column as f64 + 0.5, row as f64 + 0.5) * painting.metres_per_texel;
            if covers(painting.origin + middle) {
                let [red, green, blue] = colour.rgb;
                painting.texels[row * painting.width + column] = [red, green, blue, 0];
            }
        }
    }
}

/// Fills a convex polygon (m), counter-clockwise.
fn fill(painting: &mut FloorPainting, polygon: &[Vec2], colour: Colour) {
    let (low, high) = polygon.iter().fold((polygon[0], polygon[0]), |(low, high), p| {
        (low.min(*p), high.max(*p))
    });
    cover(painting, low, high, colour, |point| {
        (0..polygon.len()).all(|i| {
            let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            (b - a).perp_dot(point - a) >= 0.0
        })
    });
}

fn disc(painting: &mut FloorPainting, centre: Vec2, radius_m: f64, colour: Colour) {
    let reach = Vec2::splat(radius_m);
    cover(painting, centre - reach, centre + reach, colour, |point| {
        (point - centre).length_squared() <= radius_m * radius_m
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paint;

    /// A painting shows only the shadow of what stands on the floor; a drawing shows the thing.
    #[test]
    fn tops_of_boxes_and_edges_of_boards_are_seen_from_above() {
        let text = "[path]\npieces = [{ kind = \"straight\", length_m = 2.0 }]\n[[markings]]\nwidth_m = 0.02\ncolour = \"black\"\n\
            [[things]]\nkind = \"box\"\nx_m = 1.0\ny_m = 0.4\nlength_m = 0.3\nwidth_m = 0.2\nheight_m = 0.2\ncolour = \"red\"\nback = \"#0a14c8\"\n\
            [[things]]\nkind = \"board\"\nx_m = 0.5\ny_m = -0.4\nwidth_m = 0.2\nheight_m = 0.2\ncolour = \"#c80a14\"\n\
            [[things]]\nkind = \"box\"\nx_m = 90.0\ny_m = 90.0\nlength_m = 0.3\nwidth_m = 0.2\nheight_m = 0.2\ncolour = \"red\"\n";
        let (world, _) = World::parse("things.toml", text).unwrap();
        let mut painting = paint::paint(&world, 0.005);
        let floor = painting.clone();
        add_upright(&mut painting, &world);
        let at = |x_m: f64, y_m: f64| {
            let texel = (Vec2::new(x_m, y_m) - painting.origin) / painting.metres_per_texel;
            texel.y as usize * painting.width + texel.x as usize
        };
        assert_eq!(painting.texels[at(1.0, 0.4)], [10, 20, 200, 0]);
        assert_eq!(painting.texels[at(1.14, 0.49)], [10, 20, 200, 0]);
        assert_eq!(painting.texels[at(0.5, -0.35)], [200, 10, 20, 0]);
        // What is not covered stays as it was painted.
        for place in [(1.2, 0.4), (1.0, 0.55), (0.55, -0.35), (0.5, 0.0)] {
            let place = at(place.0, place.1);
            assert_eq!(painting.texels[place], floor.texels[place]);
        }
    }
}
