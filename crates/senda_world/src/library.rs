//! Worlds and vehicles that every build carries: the files of `worlds/` and `vehicles/`.

use crate::error::WorldError;
use crate::vehicle::VehicleSpec;
use crate::world::World;

macro_rules! files {
    ($folder:literal: $($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../", $folder, "/", $name, ".toml")))),*]
    };
}

/// Name and text of every world.
const WORLDS: &[(&str, &str)] = files!(
    "worlds": "straight", "straight-lane", "oval", "oval-lane", "s-curves", "s-curves-lane", "hard-curves",
    "hard-curves-lane", "circuit-1", "circuit-2", "circuit-3", "circuit-4", "circuit-5", "circuit-6", "unseen-1",
    "unseen-2", "unseen-3", "unseen-4", "warehouse", "warehouse-2", "warehouse-3",
    "lake", "meadow", "heath", "forest",
);

/// Name and text of every vehicle.
const VEHICLES: &[(&str, &str)] = files!(
    "vehicles": "gopigo", "picar", "donkeycar", "unicycle", "warehouse-cart", "sedan",
);

fn find(
    what: &'static str,
    files: &[(&'static str, &'static str)],
    name: &str,
) -> Result<(&'static str, &'static str), WorldError> {
    files
        .iter()
        .find(|(known, _)| *known == name)
        .copied()
        .ok_or_else(|| WorldError::unknown_name(what, name, files.iter().map(|(known, _)| *known)))
}

impl World {
    /// A world of the library. The error lists the nearest names.
    pub fn named(name: &str) -> Result<Self, WorldError> {
        let (name, text) = find("world", WORLDS, name)?;
        Ok(Self::parse(&format!("worlds/{name}.toml"), text)?.0)
    }

    /// Names of the library's worlds.
    pub fn names() -> impl Iterator<Item = &'static str> {
        WORLDS.iter().map(|(name, _)| *name)
    }
}

impl VehicleSpec {
    /// A vehicle of the library. The error lists the nearest names.
    pub fn named(name: &str) -> Result<Self, WorldError> {
        let (name, text) = find("vehicle", VEHICLES, name)?;
        Ok(Self::parse(&format!("vehicles/{name}.toml"), text)?.0)
    }

    /// Names of the library's vehicles.
    pub fn names() -> impl Iterator<Item = &'static str> {
        VEHICLES.iter().map(|(name, _)| *name)
    }
}
