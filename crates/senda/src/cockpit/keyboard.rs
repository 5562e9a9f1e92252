//! A Unix terminal's keyboard, key by key.

use super::keys::KeyReader;
use anyhow::{Context, Result, bail};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::termios::{self, LocalModes, OptionalActions, OutputModes, Termios};
use senda_drivers::manual::Key;
use std::io;

/// The keyboard; when dropped, the terminal is as before.
pub(super) struct Keyboard {
    before: Termios,
    reader: KeyReader,
    is_there: bool,
}

impl Keyboard {
    /// Takes the keyboard of the terminal that senda runs in.
    pub(super) fn open() -> Result<Self> {
        let stdin = io::stdin();
        if !termios::isatty(&stdin) {
            bail!(
                "manual driving needs a keyboard, but standard input is no terminal; run it in a terminal, \
                 give keys with their times with --keys FILE, or drive with --gamepad"
            );
        }
        let before = termios::tcgetattr(&stdin).context("the terminal does not answer")?;
        let mut raw = before.clone();
        raw.make_raw();
        // Lines still end as programs expect; interrupts come as the key that they are.
        raw.output_modes |= OutputModes::OPOST | OutputModes::ONLCR;
        raw.local_modes &= !LocalModes::ISIG;
        termios::tcsetattr(&stdin, OptionalActions::Now, &raw)
            .context("the terminal does not give single keys")?;
        Ok(Self {
            before,
            reader: KeyReader::default(),
            is_there: true,
        })
    }

    /// Waits for keys for so long (ns) and adds them; `false` when the keyboard is gone.
    pub(super) fn wait(&mut self, timeout_ns: u64, keys: &mut Vec<Key>) -> bool {
        if !self.is_there {
            return false;
        }
        let stdin = io::stdin();
        let mut polled = [PollFd::new(&stdin, PollFlags::IN)];
        match poll(&mut polled, Some(&timespec(timeout_ns))) {
            Ok(0) | Err(rustix::io::Errno::INTR) => return true,
            Ok(_) => {}
            Err(_) => {
                self.is_there = false;
                return false;
            }
        }
        let mut bytes = [0; 64];
        // Past the buffer of standard input: what is read ahead there, `poll` does not see.
        match rustix::io::read(&stdin, &mut bytes) {
            Ok(0) => self.is_there = false,
            Ok(count) => self.reader.read(&bytes[..count], keys),
            Err(rustix::io::Errno::INTR | rustix::io::Errno::AGAIN) => {}
            Err(_) => self.is_there = false,
        }
        self.is_there
    }
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        // A terminal that is gone cannot be put right, and nobody sees it.
        let _ = termios::tcsetattr(io::stdin(), OptionalActions::Flush, &self.before);
    }
}

/// Waits (ns).
pub(super) fn pause(timeout_ns: u64) {
    let _ = poll(&mut [], Some(&timespec(timeout_ns)));
}

/// Columns and rows of the terminal that pictures go to; `None` where there is none.
pub(super) fn view_size() -> Option<[usize; 2]> {
    let stderr = io::stderr();
    if !termios::isatty(&stderr) {
        return None;
    }
    let size = termios::tcgetwinsize(&stderr).ok()?;
    // Terminals that do not tell their size say 0.
    let or = |count: u16, usual: usize| if count == 0 { usual } else { usize::from(count) };
    Some([or(size.ws_col, 80), or(size.ws_row, 24)])
}

fn timespec(ns: u64) -> Timespec {
    Timespec {
        tv_sec: i64::try_from(ns / 1_000_000_000).unwrap_or(i64::MAX),
        tv_nsec: (ns % 1_000_000_000) as _,
    }
}
