//! World and vehicle files are read with [`senda_toml`]; its complaints become [`WorldError`]s.

use crate::error::WorldError;

pub(crate) type Source<'a> = senda_toml::Source<'a, WorldError>;
pub(crate) type Table<'a> = senda_toml::Table<'a, WorldError>;
