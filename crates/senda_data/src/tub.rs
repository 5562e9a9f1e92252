//! Donkeycar tubs, version 2 (FORMATS 1): read tolerantly, written exactly.
//!
//! A tub is a folder with `manifest.json`, catalogs of 1,000 records each, and `images/`. Angle -1 is full left and +1 full
//! right; [`convert`] is the only place that knows.

pub mod convert;
pub mod line;
mod manifest;
mod read;
mod write;

pub use line::{TubLine, TubRecord, parse_line};
pub use read::{read, read_runs};
pub use write::{TubOptions, Written, write};

/// Frames a second of a Donkeycar unless configured otherwise (its `DRIVE_LOOP_HZ`).
pub const NOMINAL_HZ: f64 = 20.0;

/// The key of the camera's picture.
pub(crate) const IMAGE_KEY: &str = "cam/image_array";
/// The key of the driven angle.
pub(crate) const ANGLE_KEY: &str = "user/angle";
/// The key of the driven throttle.
pub(crate) const THROTTLE_KEY: &str = "user/throttle";

pub(crate) fn is_tub_file(name: &str) -> bool {
    name == "manifest.json" || catalog_number(name).is_some()
}

/// N of `catalog_N.catalog`.
pub(crate) fn catalog_number(name: &str) -> Option<u64> {
    name.strip_prefix("catalog_")?
        .strip_suffix(".catalog")?
        .parse()
        .ok()
}
