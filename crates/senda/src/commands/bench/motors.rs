//! How punctual the motors' thread is, alone and while pictures are looked at on others (D11).

use crate::terminal;
use anyhow::{Context, Result};
use senda_core::{Command, Stamp};
use senda_hw::motors::{MotorLog, MotorOptions, MotorThread, Motors, Pace};
use senda_run::bench::{random_detector, warehouse_frames};
use senda_vision::Detector;
use serde::Serialize;
use std::time::Duration;

/// The machine's clock. A vehicle waits for wall time; nothing that is simulated or learned does.
pub(crate) struct Clock;

impl Clock {
    fn stamp() -> Stamp {
        Stamp::from_ns(terminal::clock_ns())
    }
}

impl Pace for Clock {
    fn now(&mut self) -> Stamp {
        Self::stamp()
    }

    #[allow(
        clippy::disallowed_methods,
        reason = "the edge: real motors turn in real time"
    )]
    fn wait_until(&mut self, stamp: Stamp) {
        let left_s = stamp.since_s(Self::stamp());
        if left_s > 0.0 {
            std::thread::sleep(Duration::from_secs_f64(left_s));
        }
    }
}

/// Motors that nothing hangs on.
struct NoMotors;

impl Motors for NoMotors {
    fn set(&mut self, command: &Command) -> Result<(), String> {
        std::hint::black_box(command);
        Ok(())
    }
}

/// One measurement.
#[derive(Serialize)]
pub(crate) struct MotorRow {
    name: String,
    turns: u64,
    missed: u64,
    late_median_ms: f64,
    late_99_ms: f64,
    late_most_ms: f64,
    /// Frames that were looked at meanwhile.
    frames: u64,
}

/// Measures with nothing else to do, then with one and with two threads that look at pictures as fast as they can.
pub(crate) fn measure(seconds: f64, json: bool) -> Result<Vec<MotorRow>> {
    let options = MotorOptions::default();
    let frames = warehouse_frames()?;
    if !json {
        say!(
            "\nthe motors' thread at {:.0} Hz, {seconds:.1} s each: how late its turns are\n\n{:44} {:>8} {:>8} {:>11} {:>9} {:>9} {:>8}",
            options.rate_hz,
            "",
            "turns",
            "missed",
            "median ms",
            "99 % ms",
            "most ms",
            "frames"
        )?;
    }
    let mut rows = Vec::new();
    for lookers in 0..=2usize {
        let thread = MotorThread::start(NoMotors, Clock, options).context("start the motors' thread")?;
        let begin = terminal::clock_ns();
        let running = || terminal::seconds_since(begin) < seconds && !terminal::interrupted();
        let seen: u64 = std::thread::scope(|scope| -> Result<u64> {
            let mut threads = Vec::new();
            for number in 0..lookers {
                let mut detector = random_detector()?;
                let (frames, mailbox) = (&frames, thread.mailbox().clone());
                let look = move || {
                    let mut seen = 0u64;
                    while running() {
                        let frame = &frames[seen as usize % frames.len()];
                        let found = detector.detect(frame).len();
                        let command = Command::curvature(0.01 * found as f64, 0.2);
                        if mailbox.send(command, Clock::stamp()).is_err() {
                            break;
                        }
                        seen += 1;
                    }
                    seen
                };
                let name = format!("vision {number}");
                threads.push(std::thread::Builder::new().name(name).spawn_scoped(scope, look)?);
            }
            while running() {
                Clock.wait_until(Stamp::from_ns(terminal::clock_ns() + 5_000_000));
            }
            Ok(threads
                .into_iter()
                .map(|thread| thread.join().unwrap_or_default())
                .sum())
        })?;
        let row = MotorRow::new(lookers, seen, thread.stop());
        if !json {
            say!(
                "{:44} {:>8} {:>8} {:>11.3} {:>9.3} {:>9.3} {:>8}",
                row.name,
                row.turns,
                row.missed,
                row.late_median_ms,
                row.late_99_ms,
                row.late_most_ms,
                row.frames
            )?;
        }
        rows.push(row);
    }
    Ok(rows)
}

impl MotorRow {
    fn new(lookers: usize, frames: u64, log: MotorLog) -> Self {
        let name = match lookers {
            0 => "motors alone".to_owned(),
            1 => "motors, detector-small on another thread".to_owned(),
            count => format!("motors, detector-small on {count} threads"),
        };
        let mut late_ms: Vec<f64> = log.late_s.iter().map(|late| 1e3 * f64::from(*late)).collect();
        late_ms.sort_by(f64::total_cmp);
        let at = |part: f64| {
            let last = late_ms.len().saturating_sub(1);
            late_ms
                .get((part * last as f64).round() as usize)
                .copied()
                .unwrap_or(0.0)
        };
        Self {
            name,
            turns: log.turns,
            missed: log.missed,
            late_median_ms: at(0.5),
            late_99_ms: at(0.99),
            late_most_ms: at(1.0),
            frames,
        }
    }
}
