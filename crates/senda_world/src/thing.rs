//! Upright things on the floor: boxes and boards with pictures on them.

use crate::Warning;
use crate::colour::{Colour, ReadColour};
use crate::error::WorldError;
use crate::path::FAR_M;
use crate::reader::Table;
use crate::texture::{Texture, read_texture};
use crate::writer::Document;
use senda_geom::{Curve, Pose2, Vec2, Vec3, trig};
use std::f64::consts::PI;

/// A box or a board that stands on the floor (or hangs above it).
#[derive(Debug, Clone, PartialEq)]
pub struct Thing {
    /// What it is called in drawings and messages; may be empty.
    pub name: String,
    /// Its shape.
    pub shape: ThingShape,
    /// Middle of its footprint; it faces along the heading.
    pub pose: Pose2,
    /// Height of its lower edge above the floor (m).
    pub bottom_m: f64,
    /// Height from its lower to its upper edge (m).
    pub height_m: f64,
    /// What is on its front (all sides of a box).
    pub texture: Texture,
    /// Colour of the back of a board and of the top of a box.
    pub back: Colour,
}

/// Footprint of a thing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ThingShape {
    /// An upright rectangle across its heading, without thickness.
    Board {
        /// Width across the heading (m).
        width_m: f64,
    },
    /// A cuboid.
    Box {
        /// Extent along the heading (m).
        length_m: f64,
        /// Extent across the heading (m).
        width_m: f64,
    },
}

/// One flat face of a thing, for renderers.
#[derive(Debug, Clone, PartialEq)]
pub struct Face {
    /// Upper left corner as seen from in front (world, m).
    pub corner: Vec3,
    /// Unit vector to the right as seen from in front.
    pub right: Vec3,
    /// Unit vector down the face.
    pub down: Vec3,
    /// Unit normal, towards the side from which it is seen.
    pub normal: Vec3,
    /// Extent along `right` (m).
    pub width_m: f64,
    /// Extent along `down` (m).
    pub height_m: f64,
    /// What is on it.
    pub texture: Texture,
}

/// Vehicles drive under what begins higher than this (m; a guess: a model car with its camera).
const DRIVEN_UNDER_M: f64 = 0.3;
/// Boards count as so thick (m): a path is looked at in steps.
const BOARD_M: f64 = 0.01;

impl Thing {
    /// Corners of its footprint on the floor (m), counter-clockwise; a board has two.
    pub fn footprint(&self) -> Vec<Vec2> {
        let corner = |x: f64, y: f64| self.pose.transform(Vec2::new(x, y));
        match self.shape {
            ThingShape::Board { width_m } => vec![corner(0.0, width_m / 2.0), corner(0.0, -width_m / 2.0)],
            ThingShape::Box { length_m, width_m } => {
                let (x, y) = (length_m / 2.0, width_m / 2.0);
                vec![corner(x, -y), corner(x, y), corner(-x, y), corner(-x, -y)]
            }
        }
    }

    /// Its faces, each seen from one side only: two of a board, four sides and the top of a box.
    pub fn faces(&self) -> Vec<Face> {
        let (forward, left) = (self.pose.forward(), self.pose.left());
        let top_m = self.bottom_m + self.height_m;
        let upright = |normal: Vec2, distance_m: f64, width_m: f64, texture: Texture| {
            // Seen from in front, right is the normal turned left (counter-clockwise).
            let right = normal.perp();
            let middle = self.pose.position() + normal * distance_m;
            let corner = middle - right * (width_m / 2.0);
            Face {
                corner: Vec3::new(corner.x, corner.y, top_m),
                right: Vec3::new(right.x, right.y, 0.0),
                down: Vec3::NEG_Z,
                normal: Vec3::new(normal.x, normal.y, 0.0),
                width_m,
                height_m: self.height_m,
                texture,
            }
        };
        let back = Texture::Plain { colour: self.back };
        match self.shape {
            ThingShape::Board { width_m } => vec![
                upright(forward, 0.0, width_m, self.texture.clone()),
                upright(-forward, 0.0, width_m, back),
            ],
            ThingShape::Box { length_m, width_m } => {
                let corner = self.pose.transform(Vec2::new(-length_m / 2.0, width_m / 2.0));
                vec![
                    upright(forward, length_m / 2.0, width_m, self.texture.clone()),
                    upright(left, width_m / 2.0, length_m, self.texture.clone()),
                    upright(-forward, length_m / 2.0, width_m, self.texture.clone()),
                    upright(-left, width_m / 2.0, length_m, self.texture.clone()),
                    Face {
                        corner: Vec3::new(corner.x, corner.y, top_m),
                        right: Vec3::new(forward.x, forward.y, 0.0),
                        down: Vec3::new(-left.x, -left.y, 0.0),
                        normal: Vec3::Z,
                        width_m: length_m,
                        height_m: width_m,
                        texture: back,
                    },
                ]
            }
        }
    }

    /// The station (m) at which it stands in the middle of a path, where it does: what drives there runs into it.
    fn stands_in(&self, path: &Curve) -> Option<f64> {
        if self.bottom_m > DRIVEN_UNDER_M {
            return None;
        }
        let (length_m, width_m) = match self.shape {
            ThingShape::Board { width_m } => (BOARD_M, width_m),
            ThingShape::Box { length_m, width_m } => (length_m, width_m),
        };
        let reach_m = 0.5 * trig::hypot(length_m, width_m);
        let place = path.project(self.pose.position());
        if place.offset_m.abs() > reach_m {
            return None;
        }
        let step_m = (0.4 * length_m.min(width_m)).max(reach_m / 500.0);
        let thing_from_world = self.pose.inverse();
        let steps = (2.0 * reach_m / step_m).ceil() as usize;
        (0..=steps)
            .map(|step| path.normalise_station(place.station_m - reach_m + step as f64 * step_m))
            .find(|station_m| {
                let at = thing_from_world.transform(path.pose_at(*station_m).position());
                at.x.abs() <= 0.5 * length_m && at.y.abs() <= 0.5 * width_m
            })
    }

    pub(crate) fn read(
        mut table: Table,
        path: &Curve,
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, WorldError> {
        let name = table.optional_string("name")?.unwrap_or_default();
        let kind = table.required_word("kind", &["board", "box"])?;
        let width_m = table.required_f64("width_m", 1e-3, FAR_M)?;
        let shape = match kind {
            "board" => ThingShape::Board { width_m },
            _ => ThingShape::Box {
                length_m: table.required_f64("length_m", 1e-3, FAR_M)?,
                width_m,
            },
        };
        let pose = read_place(&mut table, path)?;
        let bottom_m = table.f64("bottom_m", 0.0, 100.0, 0.0)?;
        let height_m = table.required_f64("height_m", 1e-3, 100.0)?;
        let texture = match table.optional_table("texture")? {
            Some(texture) => read_texture(texture)?,
            None => Texture::Plain {
                colour: table
                    .optional_colour("colour")?
                    .ok_or_else(|| table.missing("colour", "a colour, or a texture"))?,
            },
        };
        let back = table.colour("back", Colour::new(120, 110, 100))?;
        let thing = Self {
            name,
            shape,
            pose,
            bottom_m,
            height_m,
            texture,
            back,
        };
        if let Some(station_m) = thing.stands_in(path) {
            warnings.push(table.warning(
                "kind",
                format!(
                    "this {kind} stands in the middle of the path, at {station_m:.2} m: move it aside (offset_m), or lift it \
                     above what drives there (bottom_m)"
                ),
            ));
        }
        table.finish()?;
        Ok(thing)
    }

    pub(crate) fn write(&self, document: &mut Document) {
        document.item("things");
        if !self.name.is_empty() {
            document.text("name", &self.name);
        }
        match self.shape {
            ThingShape::Board { width_m } => {
                document.text("kind", "board");
                document.number("width_m", width_m);
            }
            ThingShape::Box { length_m, width_m } => {
                document.text("kind", "box");
                document.number("length_m", length_m);
                document.number("width_m", width_m);
            }
        }
        document.number("x_m", self.pose.x_m);
        document.number("y_m", self.pose.y_m);
        document.number("heading_rad", self.pose.heading_rad);
        document.number("bottom_m", self.bottom_m);
        document.number("height_m", self.height_m);
        document.text("back", &self.back.to_string());
        document.header("things.texture");
        self.texture.write(document);
    }
}

fn read_place(table: &mut Table, path: &Curve) -> Result<Pose2, WorldError> {
    let heading_rad = table.optional_angle("heading_rad", "heading_deg", -2.0 * PI, 2.0 * PI)?;
    if let Some(station_m) = table.optional_f64("station_m", -FAR_M, FAR_M)? {
        if !path.is_closed() && !(0.0..=path.length_m()).contains(&station_m) {
            return Err(table.problem(
                "station_m",
                format!("a station on the path (0 to {:.3} m)", path.length_m()),
                format!("{station_m}"),
                "write x_m and y_m for a place beyond its ends",
            ));
        }
        // Beside the path; without a heading it faces the vehicles that come along.
        let offset_m = table.f64("offset_m", -FAR_M, FAR_M, 0.0)?;
        let at = path.pose_at(station_m);
        let position = at.position() + at.left() * offset_m;
        let facing = heading_rad.unwrap_or(PI) + at.heading_rad;
        return Ok(Pose2::new(
            position.x,
            position.y,
            senda_geom::angle::wrap(facing),
        ));
    }
    Ok(Pose2::new(
        table.required_f64("x_m", -FAR_M, FAR_M)?,
        table.required_f64("y_m", -FAR_M, FAR_M)?,
        heading_rad.unwrap_or(0.0),
    ))
}
