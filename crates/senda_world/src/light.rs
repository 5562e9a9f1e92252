//! Light on the floor.

use crate::colour::{Colour, ReadColour};
use crate::error::WorldError;
use crate::path::FAR_M;
use crate::reader::Table;
use crate::writer::Document;
use senda_geom::Vec2;
use std::f64::consts::PI;

/// How the floor is lit.
///
/// The static pattern (colour, gradient, shadows, lamps' pools of light) is baked into the painting, scaled so that
/// its brightest place is 1. `level` and `along_lap` are not baked: they act on the whole frame, through the camera's
/// exposure and noise, and are the simulator's.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Overall level: 1 is a well-lit room, 0.1 a dim evening, 2 beside a sunny window.
    pub level: f64,
    /// Colour of the ambient light (white = neutral).
    pub colour: Colour,
    /// Share of ambient light at a place without lamps or shadows, relative to lamps' strengths, 0 ..= 1.
    pub ambient: f64,
    /// Direction from which most light comes (rad in the world, as a heading that points to its source).
    pub direction_rad: f64,
    /// How high above the floor that source stands (rad): low makes long shadows of things.
    pub elevation_rad: f64,
    /// How much darker the side of the floor away from the source is, 0 (even) ..= 1.
    pub gradient: f64,
    /// Soft shadows from outside the world: window frames, people, trees.
    pub shadows: Option<Shadows>,
    /// How dark the shadows of the world's own upright things are, 0 ..= 1.
    pub thing_shadows: f64,
    /// Lamps above the floor: pools of light here, highlights on glossy floors in the simulator.
    pub lamps: Vec<Lamp>,
    /// Change along the lap, sorted by place; empty: none.
    pub along_lap: Vec<LightChange>,
}

/// Soft shadows of unseen things.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shadows {
    /// How dark the darkest place is, 0 ..= 1.
    pub strength: f64,
    /// Typical size (m).
    pub scale_m: f64,
    /// Softness of the edges, 0 (hard) ..= 1.
    pub softness: f64,
    /// Seed of their places.
    pub seed: u64,
}

/// A lamp above the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Place (m).
    pub x_m: f64,
    /// Place (m).
    pub y_m: f64,
    /// Height above the floor (m).
    pub height_m: f64,
    /// Radius of its luminous disc (m): the size of its mirror image.
    pub radius_m: f64,
    /// Light that it gives to the floor right below it, relative to full ambient light 1.
    pub strength: f64,
    /// Its colour.
    pub colour: Colour,
}

impl Lamp {
    /// Place on the floor plane (m).
    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x_m, self.y_m)
    }
}

/// Light at a place of the lap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightChange {
    /// Place, as a part of the path's length, 0 ..= 1.
    pub lap_part: f64,
    /// Factor on [`Light::level`] there; linear in between, around the joint of a closed path too.
    pub level: f64,
}

/// Names of the ready lights, for `World::with_light`.
pub const LIGHT_PRESETS: [&str; 9] = [
    "even", "daylight", "lamp", "dim", "bright", "sunset", "shadows", "mixed", "spots",
];

const WARM: Colour = Colour::new(255, 214, 160);
const COOL: Colour = Colour::new(226, 238, 255);

impl Default for Light {
    /// Even neutral light of level 1.
    fn default() -> Self {
        Self {
            level: 1.0,
            colour: Colour::new(255, 255, 255),
            ambient: 1.0,
            direction_rad: PI / 3.0,
            elevation_rad: PI / 4.0,
            gradient: 0.0,
            shadows: None,
            thing_shadows: 0.5,
            lamps: Vec::new(),
            along_lap: Vec::new(),
        }
    }
}

impl Light {
    /// A ready light by name ([`LIGHT_PRESETS`]) for a floor that reaches from `low` to `high` (m).
    pub fn preset(name: &str, low: Vec2, high: Vec2) -> Result<Self, WorldError> {
        let (middle, size) = ((low + high) * 0.5, high - low);
        let lamp = |part_x: f64, part_y: f64, height_m: f64, strength: f64, colour: Colour| Lamp {
            x_m: middle.x + size.x * part_x,
            y_m: middle.y + size.y * part_y,
            height_m,
            radius_m: 0.12,
            strength,
            colour,
        };
        let soft = |strength: f64, scale_m: f64| {
            Some(Shadows {
                strength,
                scale_m,
                softness: 0.5,
                seed: 1,
            })
        };
        let even = Self::default();
        Ok(match name {
            "even" => even,
            // A window: cool, from one side, with a wide bright source in the distance.
            "daylight" => Self {
                colour: COOL,
                gradient: 0.35,
                lamps: vec![Lamp {
                    radius_m: 0.5,
                    ..lamp(0.55, 0.95, 2.0, 0.15, COOL)
                }],
                ..even
            },
            "lamp" => Self {
                level: 0.6,
                colour: WARM,
                ambient: 0.45,
                elevation_rad: 1.2,
                lamps: vec![lamp(0.1, -0.05, 1.9, 0.75, WARM)],
                ..even
            },
            "dim" => Self {
                level: 0.18,
                colour: WARM,
                gradient: 0.2,
                ..even
            },
            "bright" => Self {
                level: 2.2,
                gradient: 0.15,
                ..even
            },
            "sunset" => Self {
                level: 0.8,
                colour: Colour::new(255, 190, 130),
                elevation_rad: 0.25,
                gradient: 0.55,
                shadows: soft(0.35, 0.8),
                ..even
            },
            "shadows" => Self {
                level: 1.2,
                shadows: soft(0.5, 0.5),
                gradient: 0.2,
                ..even
            },
            // Window on one side, lamp on the other, and a lap that passes from light to dark.
            "mixed" => Self {
                colour: COOL,
                ambient: 0.7,
                gradient: 0.4,
                shadows: soft(0.25, 0.7),
                lamps: vec![lamp(-0.35, -0.3, 1.6, 0.5, WARM)],
                along_lap: vec![
                    LightChange {
                        lap_part: 0.0,
                        level: 1.0,
                    },
                    LightChange {
                        lap_part: 0.5,
                        level: 0.45,
                    },
                ],
                ..even
            },
            // Three spotlights: strong pools of light.
            "spots" => Self {
                level: 0.7,
                ambient: 0.3,
                lamps: vec![
                    lamp(-0.3, -0.25, 1.1, 0.8, WARM),
                    lamp(0.3, 0.1, 1.1, 0.8, WARM),
                    lamp(-0.05, 0.35, 1.1, 0.7, COOL),
                ],
                ..even
            },
            _ => return Err(WorldError::unknown_name("light", name, LIGHT_PRESETS.into_iter())),
        })
    }

    /// Factor on the level at a part of the lap (0..=1), before multiplication with [`Light::level`].
    pub fn along(&self, lap_part: f64, closed: bool) -> f64 {
        let (Some(first), Some(last)) = (self.along_lap.first(), self.along_lap.last()) else {
            return 1.0;
        };
        let after = self
            .along_lap
            .partition_point(|change| change.lap_part <= lap_part);
        let (a, b, a_part, b_part) = if after == 0 {
            (last, first, last.lap_part - 1.0, first.lap_part)
        } else if after == self.along_lap.len() {
            (last, first, last.lap_part, first.lap_part + 1.0)
        } else {
            let (a, b) = (&self.along_lap[after - 1], &self.along_lap[after]);
            (a, b, a.lap_part, b.lap_part)
        };
        if !closed && after == 0 {
            return first.level;
        }
        if !closed && after == self.along_lap.len() {
            return last.level;
        }
        let width = b_part - a_part;
        if width <= 0.0 {
            return a.level;
        }
        a.level + (b.level - a.level) * (lap_part - a_part) / width
    }

    pub(crate) fn reversed(mut self) -> Self {
        for change in &mut self.along_lap {
            change.lap_part = 1.0 - change.lap_part;
        }
        self.along_lap.reverse();
        self
    }

    pub(crate) fn read(mut table: Table, low: Vec2, high: Vec2) -> Result<Self, WorldError> {
        let base = match table.optional_string("preset")? {
            Some(name) => Self::preset(&name, low, high).map_err(|error| {
                table.problem(
                    "preset",
                    "the name of a light",
                    format!("{name:?}"),
                    match error {
                        WorldError::UnknownName { help, .. } => help,
                        _ => String::new(),
                    },
                )
            })?,
            None => Self::default(),
        };
        let shadows = match table.optional_table("shadows")? {
            Some(mut shadows) => {
                let read = Shadows {
                    strength: shadows.required_f64("strength", 0.0, 1.0)?,
                    scale_m: shadows.f64("scale_m", 0.01, 1000.0, 0.5)?,
                    softness: shadows.f64("softness", 0.0, 1.0, 0.5)?,
                    seed: shadows.optional_u64("seed", 0, i64::MAX as u64)?.unwrap_or(1),
                };
                shadows.finish()?;
                Some(read)
            }
            None => base.shadows,
        };
        let lamps = read_lamps(&mut table)?.unwrap_or(base.lamps);
        let along_lap = read_changes(&mut table)?.unwrap_or(base.along_lap);
        let light = Self {
            level: table.f64("level", 0.001, 20.0, base.level)?,
            colour: table.colour("colour", base.colour)?,
            ambient: table.f64("ambient", 0.0, 1.0, base.ambient)?,
            direction_rad: table
                .optional_angle("direction_rad", "direction_deg", -2.0 * PI, 2.0 * PI)?
                .unwrap_or(base.direction_rad),
            elevation_rad: table
                .optional_angle("elevation_rad", "elevation_deg", 0.02, PI / 2.0)?
                .unwrap_or(base.elevation_rad),
            gradient: table.f64("gradient", 0.0, 1.0, base.gradient)?,
            thing_shadows: table.f64("thing_shadows", 0.0, 1.0, base.thing_shadows)?,
            shadows,
            lamps,
            along_lap,
        };
        if light.ambient == 0.0 && light.lamps.iter().all(|lamp| lamp.strength == 0.0) {
            return Err(table.problem("ambient", "some light", "none", "raise ambient or add a lamp"));
        }
        table.finish()?;
        Ok(light)
    }

    pub(crate) fn write(&self, document: &mut Document) {
        document.header("light");
        document.number("level", self.level);
        document.text("colour", &self.colour.to_string());
        document.number("ambient", self.ambient);
        document.number("direction_rad", self.direction_rad);
        document.number("elevation_rad", self.elevation_rad);
        document.number("gradient", self.gradient);
        document.number("thing_shadows", self.thing_shadows);
        if let Some(shadows) = self.shadows {
            document.line(
                "shadows",
                format!(
                    "{{ strength = {:?}, scale_m = {:?}, softness = {:?}, seed = {} }}",
                    shadows.strength, shadows.scale_m, shadows.softness, shadows.seed
                ),
            );
        }
        for lamp in &self.lamps {
            document.item("light.lamps");
            document.number("x_m", lamp.x_m);
            document.number("y_m", lamp.y_m);
            document.number("height_m", lamp.height_m);
            document.number("radius_m", lamp.radius_m);
            document.number("strength", lamp.strength);
            document.text("colour", &lamp.colour.to_string());
        }
        for change in &self.along_lap {
            document.item("light.along_lap");
            document.number("lap_part", change.lap_part);
            document.number("level", change.level);
        }
    }
}

fn read_lamps(table: &mut Table) -> Result<Option<Vec<Lamp>>, WorldError> {
    let given = table.has("lamps");
    let mut lamps = Vec::new();
    for mut item in table.tables_at_most("lamps", 64)? {
        lamps.push(Lamp {
            x_m: item.required_f64("x_m", -FAR_M, FAR_M)?,
            y_m: item.required_f64("y_m", -FAR_M, FAR_M)?,
            height_m: item.required_f64("height_m", 0.1, 1000.0)?,
            radius_m: item.f64("radius_m", 0.001, 100.0, 0.12)?,
            strength: item.required_f64("strength", 0.0, 100.0)?,
            colour: item.colour("colour", Colour::new(255, 255, 255))?,
        });
        item.finish()?;
    }
    Ok(given.then_some(lamps))
}

fn read_changes(table: &mut Table) -> Result<Option<Vec<LightChange>>, WorldError> {
    let given = table.has("along_lap");
    let mut changes: Vec<LightChange> = Vec::new();
    for mut item in table.tables("along_lap")? {
        let change = LightChange {
            lap_part: item.required_f64("lap_part", 0.0, 1.0)?,
            level: item.required_f64("level", 0.0, 20.0)?,
        };
        if changes.last().is_some_and(|last| last.lap_part > change.lap_part) {
            return Err(item.problem(
                "lap_part",
                "places in driving order",
                format!("{} after a later one", change.lap_part),
                "sort along_lap by lap_part",
            ));
        }
        changes.push(change);
        item.finish()?;
    }
    Ok(given.then_some(changes))
}
