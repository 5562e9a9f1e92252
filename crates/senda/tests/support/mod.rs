//! What tests of the command line share.

use assert_cmd::Command;
use std::path::Path;

/// Runs the real binary.
pub(crate) fn senda(arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("senda").unwrap().args(arguments).assert()
}

/// What a command that succeeds prints, as JSON.
pub(crate) fn json(arguments: &[&str]) -> serde_json::Value {
    let output = senda(arguments).success();
    serde_json::from_slice(&output.get_output().stdout).unwrap()
}

/// A path as an argument.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}
