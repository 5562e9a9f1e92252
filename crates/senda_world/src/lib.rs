//! Worlds and vehicles as files: read, checked, made up, painted, drawn and printed.
//!
//! ```
//! use senda_world::{VehicleSpec, World, paint};
//! let world = World::named("oval").unwrap().with_floor("speckled").unwrap();
//! let painting = paint::paint(&world, 0.01);
//! assert_eq!(painting.texels.len(), painting.width * painting.height);
//!
//! let car = VehicleSpec::named("gopigo").unwrap();
//! assert!(world.check_vehicle(&car).is_empty());
//!
//! let error = World::parse("mine.toml", "[path]\npoints = [[0, 0], [1, 0]]\nclosd = true").unwrap_err();
//! assert!(error.to_string().contains("mine.toml:3"));
//! assert!(error.to_string().contains("did you mean \"closed\"?"));
//! ```
//!
//! Lengths are metres, angles radians (files may write `_deg`), stations run along the path in driving direction,
//! offsets are positive to its left.
//!
//! This crate does not know a camera's pixels, does not move anything, and writes no files.

mod colour;
pub mod draw;
mod error;
mod floor;
mod landscape;
mod library;
mod light;
mod marking;
pub mod paint;
mod path;
mod pictures;
mod random;
mod reader;
mod texture;
mod thing;
mod vehicle;
mod warehouse;
mod waypoints;
mod world;
mod writer;

pub use colour::Colour;
pub use error::{Problem, Warning, WorldError};
pub use floor::{FLOOR_PRESETS, Floor, FloorKind};
pub use landscape::{Area, Landscape, Tree, Wall, Wood};
pub use light::{LIGHT_PRESETS, Lamp, Light, LightChange, Shadows};
pub use marking::{Dash, Marking};
pub use paint::FloorPainting;
pub use path::{PathShape, PathSpec, Piece, closing_pieces, self_overlap, smallest_radius_m};
pub use pictures::LightProgram;
pub use random::{Difficulty, Kind, LimitsError, Tone};
pub use texture::{Cells, Texture};
pub use thing::{Face, Thing, ThingShape};
pub use vehicle::{
    Battery, CameraSpec, DriveTrain, Encoders, Engine, Exposure, ImageNoise, Motor, Tyres, VehicleSpec,
    Wheels,
};
pub use warehouse::{Place, PlaceKind, Street, Warehouse, WarehouseLayout};
pub use world::{Backdrop, Layer, World};
