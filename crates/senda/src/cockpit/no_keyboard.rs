//! Where terminals do not give single keys in a way that senda knows.

use anyhow::{Result, bail};
use senda_drivers::manual::Key;

/// A keyboard that there is none of.
pub(super) enum Keyboard {}

impl Keyboard {
    /// Says so.
    pub(super) fn open() -> Result<Self> {
        bail!("driving by keyboard needs a Unix terminal; give keys with their times with --keys FILE")
    }

    /// Never called.
    pub(super) fn wait(&mut self, _timeout_ns: u64, _keys: &mut Vec<Key>) -> bool {
        match *self {}
    }
}

/// Never called: without keyboard and gamepad there is no cockpit.
pub(super) fn pause(_timeout_ns: u64) {}

/// No pictures.
pub(super) fn view_size() -> Option<[usize; 2]> {
    None
}
