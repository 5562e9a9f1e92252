//! The floor's material.

use crate::colour::{Colour, ReadColour};
use crate::error::WorldError;
use crate::reader::Table;
use crate::writer::Document;

/// What the floor is made of and how it shines.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// The material's pattern.
    pub kind: FloorKind,
    /// Main colour.
    pub colour: Colour,
    /// Second colour: specks, gaps between planks, grout, loops. Unused on a plain floor.
    pub second_colour: Colour,
    /// Size of the pattern (m): diameter of a speck, width of a plank, side of a tile, width of a loop.
    pub scale_m: f64,
    /// Strength of the pattern, 0 ..= 1.
    pub contrast: f64,
    /// How mirror-like it is: 0 (carpet) ..= 1 (polished stone). Stored in the painting's fourth channel.
    pub gloss: f64,
    /// Seed of everything irregular in it.
    pub seed: u64,
}

/// Kinds of floor pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FloorKind {
    /// One colour with the slight clouds of real paint, linoleum or concrete.
    Plain,
    /// Specks of several sizes, as terrazzo or speckled linoleum ("moteado" in document C).
    Speckled,
    /// Planks with grain, along x.
    Wood,
    /// Square tiles with grout.
    Tiles,
    /// Loops of yarn.
    Carpet,
    /// Open ground with tufts and bald places, seen from a road.
    Grass,
}

pub(crate) const KINDS: [&str; 6] = ["plain", "speckled", "wood", "tiles", "carpet", "grass"];

impl FloorKind {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Speckled => "speckled",
            Self::Wood => "wood",
            Self::Tiles => "tiles",
            Self::Carpet => "carpet",
            Self::Grass => "grass",
        }
    }

    fn from_name(name: &str) -> Self {
        match name {
            "speckled" => Self::Speckled,
            "wood" => Self::Wood,
            "tiles" => Self::Tiles,
            "carpet" => Self::Carpet,
            "grass" => Self::Grass,
            _ => Self::Plain,
        }
    }
}

/// Names of the ready floors, for [`Floor::preset`].
pub const FLOOR_PRESETS: [&str; 14] = [
    "plain",
    "dark",
    "speckled",
    "dark-speckled",
    "wood",
    "dark-wood",
    "tiles",
    "carpet",
    "glossy",
    "glossy-dark",
    "glossy-speckled",
    "glossy-dark-speckled",
    "glossy-wood",
    "glossy-tiles",
];

impl Floor {
    /// A floor without particulars of its kind.
    pub fn of_kind(kind: FloorKind) -> Self {
        let (colour, second_colour, scale_m, contrast, gloss) = match kind {
            FloorKind::Plain => (
                Colour::new(186, 182, 172),
                Colour::new(150, 146, 138),
                0.25,
                0.25,
                0.04,
            ),
            FloorKind::Speckled => (
                Colour::new(188, 184, 174),
                Colour::new(96, 90, 84),
                0.004,
                0.6,
                0.05,
            ),
            FloorKind::Wood => (
                Colour::new(188, 146, 98),
                Colour::new(98, 66, 38),
                0.09,
                0.5,
                0.08,
            ),
            FloorKind::Tiles => (
                Colour::new(204, 200, 190),
                Colour::new(132, 126, 116),
                0.30,
                0.4,
                0.10,
            ),
            FloorKind::Carpet => (
                Colour::new(112, 116, 126),
                Colour::new(72, 76, 86),
                0.004,
                0.6,
                0.0,
            ),
            FloorKind::Grass => (
                Colour::new(118, 128, 74),
                Colour::new(164, 152, 96),
                9.0,
                0.6,
                0.0,
            ),
        };
        Self {
            kind,
            colour,
            second_colour,
            scale_m,
            contrast,
            gloss,
            seed: 1,
        }
    }

    /// A ready floor by name ([`FLOOR_PRESETS`]).
    pub fn preset(name: &str) -> Result<Self, WorldError> {
        let (glossy, rest) = match name.strip_prefix("glossy-") {
            Some(rest) => (true, rest),
            None if name == "glossy" => (true, "plain"),
            None => (false, name),
        };
        let mut floor = match rest {
            "plain" => Self::of_kind(FloorKind::Plain),
            "dark" => Self {
                colour: Colour::new(66, 66, 70),
                second_colour: Colour::new(48, 48, 52),
                ..Self::of_kind(FloorKind::Plain)
            },
            "speckled" => Self::of_kind(FloorKind::Speckled),
            "dark-speckled" => Self {
                colour: Colour::new(72, 70, 70),
                second_colour: Colour::new(150, 146, 140),
                ..Self::of_kind(FloorKind::Speckled)
            },
            "wood" => Self::of_kind(FloorKind::Wood),
            "dark-wood" => Self {
                colour: Colour::new(104, 68, 44),
                second_colour: Colour::new(48, 30, 20),
                ..Self::of_kind(FloorKind::Wood)
            },
            "tiles" => Self::of_kind(FloorKind::Tiles),
            "carpet" if !glossy => Self::of_kind(FloorKind::Carpet),
            _ => return Err(WorldError::unknown_name("floor", name, FLOOR_PRESETS.into_iter())),
        };
        if glossy {
            floor.gloss = 0.6;
        }
        Ok(floor)
    }

    pub(crate) fn read(mut table: Table) -> Result<Self, WorldError> {
        let base = match table.optional_string("preset")? {
            Some(name) => Some(Self::preset(&name).map_err(|error| {
                table.problem(
                    "preset",
                    "the name of a floor",
                    format!("{name:?}"),
                    match error {
                        WorldError::UnknownName { help, .. } => help,
                        _ => String::new(),
                    },
                )
            })?),
            None => None,
        };
        let base = match (table.optional_word("kind", &KINDS)?, base) {
            (Some(kind), None) => Self::of_kind(FloorKind::from_name(kind)),
            (None, Some(base)) => base,
            (Some(_), Some(_)) => {
                return Err(table.problem("kind", "either preset or kind", "both", "remove one"));
            }
            (None, None) => return Err(table.missing("kind", &format!("one of {}", KINDS.join(", ")))),
        };
        let floor = Self {
            kind: base.kind,
            colour: table.colour("colour", base.colour)?,
            second_colour: table.colour("second_colour", base.second_colour)?,
            scale_m: table.f64("scale_m", 5e-4, 10.0, base.scale_m)?,
            contrast: table.f64("contrast", 0.0, 1.0, base.contrast)?,
            gloss: table.f64("gloss", 0.0, 1.0, base.gloss)?,
            seed: table
                .optional_u64("seed", 0, i64::MAX as u64)?
                .unwrap_or(base.seed),
        };
        table.finish()?;
        Ok(floor)
    }

    pub(crate) fn write(&self, document: &mut Document) {
        document.header("floor");
        document.text("kind", self.kind.name());
        document.text("colour", &self.colour.to_string());
        document.text("second_colour", &self.second_colour.to_string());
        document.number("scale_m", self.scale_m);
        document.number("contrast", self.contrast);
        document.number("gloss", self.gloss);
        document.line("seed", self.seed);
    }
}
