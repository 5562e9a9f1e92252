//! Donkeycar tubs, version 2 (FORMATS 1).

use crate::{DataError, Recording};
use senda_core::Body;
use std::path::Path;

/// Reads a tub: a folder, or a `.tar.gz` of one.
pub fn read(path: &Path, _body: &Body) -> Result<Recording, DataError> {
    Err(DataError::NotThat {
        path: path.to_owned(),
        expected: "a Donkeycar tub".into(),
        found: "a reader that is still being written".into(),
        advice: "update senda".into(),
    })
}
