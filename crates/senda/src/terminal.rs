//! Progress bars, Ctrl-C, error messages and the clock.

use indicatif::{ProgressBar, ProgressStyle};
use senda_run::Ears;
use std::fmt::Display;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

/// As `println!`, with an error instead of a panic where nobody takes the line: a full disk, a terminal that is gone.
macro_rules! say {
    ($($words:tt)*) => { $crate::terminal::print(format_args!($($words)*)) };
}

/// As `eprintln!`, and silent where nobody takes the line.
macro_rules! tell {
    ($($words:tt)*) => { $crate::terminal::tell(format_args!($($words)*)) };
}

/// What the program ends with after Ctrl-C: 128 and the signal's number, as shells count.
pub(crate) const INTERRUPTED_CODE: u8 = 130;

static INTERRUPTED: AtomicBool = AtomicBool::new(false);
static TAKEN: AtomicBool = AtomicBool::new(false);
static PRESSES: AtomicU8 = AtomicU8::new(0);

/// Ctrl-C ends the work in good order; a second one ends the program.
pub(crate) fn listen_for_interrupts() {
    let listening = ctrlc::set_handler(|| {
        INTERRUPTED.store(true, Ordering::SeqCst);
        if PRESSES.fetch_add(1, Ordering::SeqCst) > 0 {
            std::process::exit(INTERRUPTED_CODE.into());
        }
    });
    if let Err(error) = listening {
        tell!("warning: Ctrl-C will end senda at once: {error}");
    }
}

/// `senda … | head` ends quietly when the reader has enough, as other programs do. Rust ignores the signal and would panic on
/// the next line instead.
pub(crate) fn end_with_the_reader() {
    #[cfg(unix)]
    {
        use std::ffi::c_int;
        unsafe extern "C" {
            fn signal(number: c_int, handler: usize) -> usize;
        }
        // SAFETY: 13 is SIGPIPE and 0 its default action on every Unix; no handler of ours runs.
        unsafe { signal(13, 0) };
    }
}

/// Why a command gives nothing: Ctrl-C came first. It is told as it stands, for it is no error.
#[derive(Debug)]
pub(crate) struct Interrupted(pub(crate) String);

impl std::fmt::Display for Interrupted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "interrupted{}", self.0)
    }
}

impl std::error::Error for Interrupted {}

/// Whether Ctrl-C was pressed.
pub(crate) fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::SeqCst)
}

/// From now on Ctrl-C is how a person ends what they do, and what is done until then is the whole.
pub(crate) fn take_interrupts() {
    TAKEN.store(true, Ordering::SeqCst);
}

/// Whether Ctrl-C ended the command before its end.
pub(crate) fn ended_early() -> bool {
    interrupted() && !TAKEN.load(Ordering::SeqCst)
}

/// Nanoseconds of a monotonic clock.
// The edge: figures about speed are made here and nowhere else.
#[allow(clippy::disallowed_types)]
pub(crate) fn clock_ns() -> u64 {
    use std::{sync::OnceLock, time::Instant};
    static BEGIN: OnceLock<Instant> = OnceLock::new();
    let begin = BEGIN.get_or_init(Instant::now);
    u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

/// Seconds since a reading of [`clock_ns`].
pub(crate) fn seconds_since(begin_ns: u64) -> f64 {
    clock_ns().saturating_sub(begin_ns) as f64 * 1e-9
}

/// Per mille of one piece of work, on standard error; hidden when standard error is not a terminal.
pub(crate) fn bar(label: &str) -> ProgressBar {
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{msg:32} {wide_bar} {percent:>3} % {eta:>4} left") {
        bar.set_style(style);
    }
    bar.set_message(label.to_owned());
    bar
}

/// Ears that move a bar, hear Ctrl-C and read the clock.
pub(crate) fn ears(bar: &ProgressBar) -> Ears<'_> {
    Ears {
        progress: Box::new(|part| bar.set_position((part * 1000.0) as u64)),
        interrupted: Box::new(interrupted),
        clock_ns: Box::new(clock_ns),
    }
}

/// Says a line on standard error. A terminal that is gone is told nothing, and the work goes on without it.
pub(crate) fn tell(line: impl Display) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Says the first of many warnings on standard error, and how many more there are.
pub(crate) fn warn(warnings: &[String]) {
    const SHOWN: usize = 10;
    for warning in warnings.iter().take(SHOWN) {
        tell(format!("warning: {warning}"));
    }
    if warnings.len() > SHOWN {
        tell(format!("warning: {} more like these", warnings.len() - SHOWN));
    }
}

/// Prints a line on standard output; an error where nobody takes it, such as a terminal that is gone.
pub(crate) fn print(line: impl Display) -> anyhow::Result<()> {
    use anyhow::Context as _;
    use std::io::Write as _;
    writeln!(std::io::stdout(), "{line}").context("cannot print the result")
}

/// Prints a result: as JSON where that was asked for, else in words.
pub(crate) fn answer(json: bool, value: &serde_json::Value, words: &str) -> anyhow::Result<()> {
    if json {
        print(&serde_json::to_string_pretty(value)?)
    } else {
        print(words)
    }
}

/// Prints an error and its causes, with the source snippet where there is one.
pub(crate) fn complain(error: &anyhow::Error) {
    let mut line = format!("error: {error}");
    let mut last = error.to_string();
    for cause in error.chain().skip(1) {
        let text = cause.to_string();
        // Wrapping errors repeat their cause's words.
        if !last.contains(&text) {
            line = format!("{line}: {text}");
        }
        last = text;
    }
    tell(&line);
}
