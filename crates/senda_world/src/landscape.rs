//! Open land around a road: areas of water, sand and grass, woods beside the path, walls along it (B1 in SPEC).

use crate::colour::{Colour, ReadColour};
use crate::error::WorldError;
use crate::path::FAR_M;
use crate::reader::Table;
use crate::texture::Texture;
use crate::thing::Face;
use crate::writer::{self, Document};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use senda_geom::{Curve, Vec2, Vec3};

/// What lies and stands around a road. Worlds on floors of rooms have none of it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Landscape {
    /// Patches of ground, later ones over earlier ones; the path's markings are painted over all of them.
    pub areas: Vec<Area>,
    /// Trees, planted from a seed.
    pub woods: Vec<Wood>,
    /// Walls that follow the path: the parapets of a bridge.
    pub walls: Vec<Wall>,
}

/// A patch of ground with a smooth, uneven shore.
#[derive(Debug, Clone, PartialEq)]
pub struct Area {
    /// What it is called in messages; may be empty.
    pub name: String,
    /// Corners of the closed spline around it (m), at least three.
    pub points: Vec<Vec2>,
    /// Main colour.
    pub colour: Colour,
    /// Colour of its clouds and ripples.
    pub second_colour: Colour,
    /// Size of those (m).
    pub scale_m: f64,
    /// How far the shore strays from the spline to either side (m).
    pub ragged_m: f64,
    /// Whether trees do not grow in it.
    pub bare: bool,
}

/// Trees beside a stretch of the path. The seed says where each of them stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Wood {
    /// How many are planted; those that would stand too near to the path, or in a bare area, are left out.
    pub count: u32,
    /// Seed of their places and shapes.
    pub seed: u64,
    /// Stations between which they stand (m).
    pub from_m: f64,
    /// Stations between which they stand (m).
    pub to_m: f64,
    /// Nearest offset from the path (m): the same sign as `far_m`, left positive.
    pub near_m: f64,
    /// Farthest offset from the path (m).
    pub far_m: f64,
    /// Lowest and highest tree (m).
    pub height_m: [f64; 2],
    /// Colour of the leaves in full light.
    pub colour: Colour,
}

/// A wall along the path.
#[derive(Debug, Clone, PartialEq)]
pub struct Wall {
    /// Station of its beginning (m).
    pub from_m: f64,
    /// Station of its end (m).
    pub to_m: f64,
    /// Offset of its middle from the path (m), left positive.
    pub offset_m: f64,
    /// Thickness (m).
    pub width_m: f64,
    /// Height (m).
    pub height_m: f64,
    /// Colour of its sides.
    pub colour: Colour,
    /// Colour of its top and of the joints between its blocks.
    pub second_colour: Colour,
}

/// A tree as renderers draw it: always turned towards the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tree {
    /// Where it stands (m).
    pub position: Vec2,
    /// Height (m).
    pub height_m: f64,
    /// Width of its crown (m).
    pub width_m: f64,
    /// Colour of its leaves in full light.
    pub colour: Colour,
    /// Seed of its shape.
    pub seed: u32,
}

/// Length of a wall's block (m): short enough that curves look like curves.
const BLOCK_M: f64 = 5.0;
/// Blocks of a wall at most: longer walls have longer blocks.
const MOST_BLOCKS: f64 = 200.0;
/// Joint between blocks (m).
const JOINT_M: f64 = 0.08;

impl Landscape {
    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.areas.is_empty() && self.woods.is_empty() && self.walls.is_empty()
    }

    /// All trees, in the order of the woods that they belong to.
    pub fn trees(&self, path: &Curve) -> Vec<Tree> {
        let shores: Vec<Vec<Vec2>> = self
            .areas
            .iter()
            .filter(|area| area.bare)
            .map(Area::shore)
            .collect();
        let mut trees = Vec::new();
        for wood in &self.woods {
            wood.plant(path, &shores, &mut trees);
        }
        trees
    }

    /// The faces of all walls: both sides, the top, and the two ends.
    pub fn wall_faces(&self, path: &Curve) -> Vec<Face> {
        self.walls.iter().flat_map(|wall| wall.faces(path)).collect()
    }

    pub(crate) fn read(table: &mut Table, path: &Curve) -> Result<Self, WorldError> {
        let mut landscape = Self::default();
        for item in table.tables_at_most("areas", 64)? {
            landscape.areas.push(Area::read(item)?);
        }
        for item in table.tables_at_most("woods", 16)? {
            landscape.woods.push(Wood::read(item, path.length_m())?);
        }
        for item in table.tables_at_most("walls", 16)? {
            landscape.walls.push(Wall::read(item, path.length_m())?);
        }
        Ok(landscape)
    }

    pub(crate) fn write(&self, document: &mut Document) {
        for area in &self.areas {
            area.write(document);
        }
        for wood in &self.woods {
            wood.write(document);
        }
        for wall in &self.walls {
            wall.write(document);
        }
    }

    pub(crate) fn reversed(self, length_m: f64) -> Self {
        let turn = |from_m: f64, to_m: f64| ((length_m - to_m).max(0.0), length_m - from_m);
        let woods = self.woods.into_iter().map(|wood| {
            let (from_m, to_m) = turn(wood.from_m, wood.to_m);
            Wood {
                from_m,
                to_m,
                near_m: 0.0 - wood.near_m,
                far_m: 0.0 - wood.far_m,
                ..wood
            }
        });
        let walls = self.walls.into_iter().map(|wall| {
            let (from_m, to_m) = turn(wall.from_m, wall.to_m);
            Wall {
                from_m,
                to_m,
                offset_m: 0.0 - wall.offset_m,
                ..wall
            }
        });
        Self {
            woods: woods.collect(),
            walls: walls.collect(),
            areas: self.areas,
        }
    }
}

impl Area {
    /// Its outline as a polygon (m), before it strays: the closed spline through its points in steps of about a metre.
    pub fn shore(&self) -> Vec<Vec2> {
        match Curve::from_points(&self.points, true) {
            Ok(curve) => curve.polyline((curve.length_m() / 1000.0).max(1.0)),
            Err(_) => self.points.clone(),
        }
    }

    fn read(mut table: Table) -> Result<Self, WorldError> {
        let name = table.optional_string("name")?.unwrap_or_default();
        let points = table.optional_pairs("points", -FAR_M, FAR_M)?;
        let points: Vec<Vec2> = points
            .ok_or_else(|| table.missing("points", "at least three pairs [x, y]"))?
            .into_iter()
            .map(|[x, y]| Vec2::new(x, y))
            .collect();
        if points.len() < 3 || Curve::from_points(&points, true).is_err() {
            return Err(table.problem(
                "points",
                "at least three different points around an area",
                format!("{}", points.len()),
                "write its corners in order, without repeating the first",
            ));
        }
        let colour = table.optional_colour("colour")?;
        let colour = colour.ok_or_else(|| table.missing("colour", "a colour such as \"#6f9fc4\""))?;
        let area = Self {
            name,
            points,
            colour,
            second_colour: table.colour("second_colour", colour)?,
            scale_m: table.f64("scale_m", 0.05, 1000.0, 4.0)?,
            ragged_m: table.f64("ragged_m", 0.0, 50.0, 0.5)?,
            bare: table.bool("bare", true)?,
        };
        table.finish()?;
        Ok(area)
    }

    fn write(&self, document: &mut Document) {
        document.item("areas");
        if !self.name.is_empty() {
            document.text("name", &self.name);
        }
        document.line("points", writer::pairs(&self.points));
        document.text("colour", &self.colour.to_string());
        document.text("second_colour", &self.second_colour.to_string());
        document.number("scale_m", self.scale_m);
        document.number("ragged_m", self.ragged_m);
        document.line("bare", self.bare);
    }
}

/// Whether a point lies inside a polygon.
pub(crate) fn is_inside(polygon: &[Vec2], at: Vec2) -> bool {
    let mut inside = false;
    for (i, a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        if (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x) {
            inside = !inside;
        }
    }
    inside
}

impl Wood {
    fn plant(&self, path: &Curve, bare: &[Vec<Vec2>], trees: &mut Vec<Tree>) {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut part = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let clear_m = self.near_m.abs().min(self.far_m.abs());
        for _ in 0..self.count {
            // Every tree draws the same number of values, so that leaving one out moves no other.
            let station_m = self.from_m + (self.to_m - self.from_m) * part();
            let offset_m = self.near_m + (self.far_m - self.near_m) * part();
            let height_m = self.height_m[0] + (self.height_m[1] - self.height_m[0]) * part();
            let width_m = height_m * (0.35 + 0.35 * part());
            let shade = 0.75 + 0.4 * part();
            let seed = (part() * f64::from(1u32 << 31)) as u32;
            let at = path.pose_at(station_m);
            let position = at.position() + at.left() * offset_m;
            // Another stretch of the path may pass here.
            if path.project(position).offset_m.abs() < clear_m - 1e-6
                || bare.iter().any(|shore| is_inside(shore, position))
            {
                continue;
            }
            let [r, g, b] = self
                .colour
                .rgb
                .map(|c| (f64::from(c) * shade).round().min(255.0) as u8);
            trees.push(Tree {
                position,
                height_m,
                width_m,
                colour: Colour::new(r, g, b),
                seed,
            });
        }
    }

    fn read(mut table: Table, length_m: f64) -> Result<Self, WorldError> {
        let count = table.optional_u64("count", 1, 300)?;
        let count = count.ok_or_else(|| table.missing("count", "a whole number of trees"))?;
        let (from_m, to_m) = read_span(&mut table, length_m)?;
        let (near_m, far_m) = (
            table.required_f64("near_m", -1000.0, 1000.0)?,
            table.required_f64("far_m", -1000.0, 1000.0)?,
        );
        if near_m * far_m <= 0.0 {
            return Err(table.problem(
                "far_m",
                "the same side of the path as near_m (left positive)",
                format!("{near_m} and {far_m}"),
                "write one wood for each side",
            ));
        }
        let height_m = match table.optional_numbers("height_m", 0.3, 60.0)? {
            None => [6.0, 12.0],
            Some(range) if range.len() == 2 && range[0] <= range[1] => [range[0], range[1]],
            Some(range) => {
                return Err(table.problem(
                    "height_m",
                    "the lowest and the highest tree, such as [6, 12]",
                    format!("{range:?}"),
                    "",
                ));
            }
        };
        let wood = Self {
            count: count as u32,
            seed: table.optional_u64("seed", 0, i64::MAX as u64)?.unwrap_or(1),
            from_m,
            to_m,
            near_m,
            far_m,
            height_m,
            colour: table.colour("colour", Colour::new(62, 88, 48))?,
        };
        table.finish()?;
        Ok(wood)
    }

    fn write(&self, document: &mut Document) {
        document.item("woods");
        document.line("count", self.count);
        document.line("seed", self.seed);
        document.number("from_m", self.from_m);
        document.number("to_m", self.to_m);
        document.number("near_m", self.near_m);
        document.number("far_m", self.far_m);
        document.line("height_m", format!("{:?}", self.height_m));
        document.text("colour", &self.colour.to_string());
    }
}

impl Wall {
    fn faces(&self, path: &Curve) -> Vec<Face> {
        let count = ((self.to_m - self.from_m) / BLOCK_M)
            .ceil()
            .clamp(1.0, MOST_BLOCKS) as usize;
        let step_m = (self.to_m - self.from_m) / count as f64;
        let point = |i: usize, side: f64| {
            let at = path.pose_at(self.from_m + step_m * i as f64);
            at.position() + at.left() * (self.offset_m + side * self.width_m / 2.0)
        };
        let side = Texture::Stripes {
            colour: self.colour,
            second_colour: self.second_colour,
            size_m: (step_m - JOINT_M).max(0.5 * step_m),
        };
        let plain = Texture::Plain {
            colour: self.second_colour,
        };
        let mut faces = Vec::with_capacity(3 * count + 2);
        for i in 0..count {
            let (right, left) = (
                (point(i, -1.0), point(i + 1, -1.0)),
                (point(i, 1.0), point(i + 1, 1.0)),
            );
            // Seen from its right the block runs from left to right as the path does.
            faces.extend(self.upright(right.1, right.0, &side));
            faces.extend(self.upright(left.0, left.1, &side));
            faces.extend(self.top(left.0, left.1, &plain));
        }
        faces.extend(self.upright(point(0, -1.0), point(0, 1.0), &plain));
        faces.extend(self.upright(point(count, 1.0), point(count, -1.0), &plain));
        faces
    }

    /// The face between two places on the floor; seen from in front, `from` is on the right.
    fn upright(&self, from: Vec2, to: Vec2, texture: &Texture) -> Option<Face> {
        let width_m = (to - from).length();
        let right = (from - to) / width_m;
        let normal = -right.perp();
        (width_m > 1e-6).then(|| Face {
            corner: Vec3::new(to.x, to.y, self.height_m),
            right: Vec3::new(right.x, right.y, 0.0),
            down: Vec3::NEG_Z,
            normal: Vec3::new(normal.x, normal.y, 0.0),
            width_m,
            height_m: self.height_m,
            texture: texture.clone(),
        })
    }

    /// The top of a block whose left edge runs from one place to another.
    fn top(&self, from: Vec2, to: Vec2, texture: &Texture) -> Option<Face> {
        let width_m = (to - from).length();
        let right = (to - from) / width_m;
        let down = -right.perp();
        (width_m > 1e-6).then(|| Face {
            corner: Vec3::new(from.x, from.y, self.height_m),
            right: Vec3::new(right.x, right.y, 0.0),
            down: Vec3::new(down.x, down.y, 0.0),
            normal: Vec3::Z,
            width_m,
            height_m: self.width_m,
            texture: texture.clone(),
        })
    }

    fn read(mut table: Table, length_m: f64) -> Result<Self, WorldError> {
        let (from_m, to_m) = read_span(&mut table, length_m)?;
        let wall = Self {
            from_m,
            to_m,
            offset_m: table.required_f64("offset_m", -1000.0, 1000.0)?,
            width_m: table.f64("width_m", 0.01, 10.0, 0.35)?,
            height_m: table.f64("height_m", 0.01, 50.0, 0.9)?,
            colour: table.colour("colour", Colour::new(168, 160, 146))?,
            second_colour: table.colour("second_colour", Colour::new(196, 190, 178))?,
        };
        table.finish()?;
        Ok(wall)
    }

    fn write(&self, document: &mut Document) {
        document.item("walls");
        document.number("from_m", self.from_m);
        document.number("to_m", self.to_m);
        document.number("offset_m", self.offset_m);
        document.number("width_m", self.width_m);
        document.number("height_m", self.height_m);
        document.text("colour", &self.colour.to_string());
        document.text("second_colour", &self.second_colour.to_string());
    }
}

/// `from_m` and `to_m`: all of the path without them.
fn read_span(table: &mut Table, length_m: f64) -> Result<(f64, f64), WorldError> {
    let from_m = table.f64("from_m", 0.0, FAR_M, 0.0)?;
    let to_m = table.f64("to_m", 0.0, FAR_M, length_m)?.min(length_m);
    if to_m <= from_m {
        return Err(table.problem(
            "to_m",
            "a station after from_m, on the path",
            format!("{from_m} to {to_m}"),
            "",
        ));
    }
    Ok((from_m, to_m))
}

#[cfg(test)]
mod tests {
    use crate::World;
    use senda_geom::Vec2;

    const ROAD: &str = "
[path]
closed = true
pieces = [{ kind = 'arc', radius_m = 100, turn_deg = 360 }]
[[markings]]
width_m = 6
colour = '#707070'
[[areas]]
points = [[-60, -60], [60, -60], [60, -5], [-60, -5]]
colour = '#5f8fb4'
[[woods]]
count = 200
near_m = -8
far_m = -30
[[walls]]
from_m = 20
to_m = 42
offset_m = 3.4
";

    #[test]
    fn a_landscape_survives_its_resolved_copy_and_being_reversed_twice() {
        let world = World::parse("road.toml", ROAD).unwrap().0;
        assert_eq!(World::parse("road.toml", &world.to_toml()).unwrap().0, world);
        let back = world.clone().reversed().reversed();
        assert_eq!(back.landscape.walls[0].offset_m, 3.4);
        assert!((back.landscape.walls[0].from_m - 20.0).abs() < 1e-9);
    }

    /// A box in the way was warned of, a wall through the path was not.
    #[test]
    fn a_wall_on_the_path_is_warned_of() {
        let warned = |offset_m: &str| {
            let text = ROAD.replace("offset_m = 3.4", &format!("offset_m = {offset_m}"));
            let (_, warnings) = World::parse("road.toml", &text).unwrap();
            warnings
                .iter()
                .any(|warning| warning.to_string().contains("wall 0 stands on the path"))
        };
        assert!(warned("0.1") && !warned("3.4"));
    }

    #[test]
    fn trees_keep_their_distance_and_stay_out_of_the_water() {
        let world = World::parse("road.toml", ROAD).unwrap().0;
        let trees = world.landscape.trees(&world.path);
        assert!((100..200).contains(&trees.len()), "{}", trees.len());
        let middle = Vec2::new(0.0, 100.0);
        for tree in &trees {
            let away_m = (tree.position - middle).length();
            assert!((107.9..130.1).contains(&away_m), "outside the circle: {away_m}");
            let wet = tree.position.x.abs() < 40.0 && (-50.0..-15.0).contains(&tree.position.y);
            assert!(!wet);
        }
    }

    #[test]
    fn walls_are_closed_blocks_whose_faces_look_outwards() {
        let world = World::parse("road.toml", ROAD).unwrap().0;
        let faces = world.landscape.wall_faces(&world.path);
        assert_eq!(faces.len(), 5 * 3 + 2);
        for face in &faces {
            assert!(face.right.cross(-face.down).dot(face.normal) > 0.999, "{face:?}");
        }
        // The first block's first face is its right side: it looks away from the circle's middle.
        let outwards = face_middle(&faces[0]) - Vec2::new(0.0, 100.0);
        assert!(outwards.dot(Vec2::new(faces[0].normal.x, faces[0].normal.y)) > 0.0);
    }

    fn face_middle(face: &crate::Face) -> Vec2 {
        let middle = face.corner + face.right * (0.5 * face.width_m);
        Vec2::new(middle.x, middle.y)
    }

    #[test]
    fn what_cannot_be_built_is_named() {
        for (from, to, says) in [
            ("far_m = -30", "far_m = 30", "same side"),
            ("to_m = 42", "to_m = 12", "after from_m"),
            (
                "points = [[-60, -60], [60, -60], [60, -5], [-60, -5]]",
                "points = [[0, 0]]",
                "three different",
            ),
            ("count = 200", "count = 200\ncolor = 'red'", "colour"),
        ] {
            let error = World::parse("road.toml", &ROAD.replace(from, to))
                .unwrap_err()
                .to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
