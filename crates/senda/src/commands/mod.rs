//! One module a command.

pub(crate) mod bench;
pub(crate) mod calibrate;
pub(crate) mod data;
pub(crate) mod drive;
pub(crate) mod evaluate;
pub(crate) mod hands;
pub(crate) mod learn;
pub(crate) mod model;
pub(crate) mod net;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod study;
pub(crate) mod sweep;
pub(crate) mod tour;
pub(crate) mod train;
pub(crate) mod training_report;
pub(crate) mod world;

use anyhow::{Context, Result};
use std::path::Path;

/// Writes a file whole or not at all: a full disk must not leave half a report over a good one.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make folder {}", folder.display()))?;
    }
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = path.with_file_name(name);
    let written = std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path));
    if written.is_err() {
        // The half-written file is of no use; failing to remove it changes nothing.
        let _ = std::fs::remove_file(&part);
    }
    written.with_context(|| format!("cannot write {}", path.display()))
}
