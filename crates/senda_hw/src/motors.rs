//! Motor control on a thread of its own (D11 in SPEC): its rate does not depend on how long pictures take.
//!
//! Vision hands commands to a mailbox of one place ([`Mailbox`]): the newest replaces one that was not fetched, and neither side
//! ever waits for the other. The thread turns to it at its own rate, and stops the motors when commands grow old, when nobody
//! can send any more, or when it ends. What is decided in each turn is [`Watch`], which knows no threads; time comes from a
//! [`Pace`] that the caller brings.

use senda_core::{Command, Stamp};
use std::io;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// What turns motors.
pub trait Motors: Send {
    /// Carries a command out; called at the motors' rate, also with the same command as before.
    ///
    /// # Errors
    /// Words for people: what the device said and what to do.
    fn set(&mut self, command: &Command) -> Result<(), String>;
}

/// A monotonic clock that can be waited for.
pub trait Pace: Send {
    /// Now.
    fn now(&mut self) -> Stamp;
    /// Comes back at a time, or at once when it is over.
    fn wait_until(&mut self, stamp: Stamp);
}

/// How motors are driven.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorOptions {
    /// Turns a second (Hz), 1 ..= 10000. Guess: a PCA9685 makes 50 pulses a second for servos and more for motors.
    pub rate_hz: f64,
    /// A command that is older stops the motors (s): at 0.2 m/s that is 6 cm driven on an old one. Guess.
    pub old_s: f64,
}

impl Default for MotorOptions {
    fn default() -> Self {
        Self {
            rate_hz: 100.0,
            old_s: 0.3,
        }
    }
}

/// One place between two threads: the newest command and when it was sent.
#[derive(Debug, Clone, Default)]
pub struct Mailbox {
    place: Arc<Mutex<Letter>>,
}

#[derive(Debug, Default)]
struct Letter {
    command: Option<(Command, Stamp)>,
    ends: bool,
    problem: Option<String>,
}

impl Mailbox {
    /// Leaves a command in the place of one that was not fetched yet.
    ///
    /// # Errors
    /// What the motors said when they failed: they stand, and the thread has ended.
    pub fn send(&self, command: Command, now: Stamp) -> Result<(), String> {
        let mut letter = self.place.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(problem) = &letter.problem {
            return Err(problem.clone());
        }
        letter.command = Some((command, now));
        Ok(())
    }

    /// Takes what is there; `None`: the thread is to end.
    fn fetch(&self) -> Option<Option<(Command, Stamp)>> {
        let mut letter = self.place.lock().unwrap_or_else(PoisonError::into_inner);
        if letter.ends {
            None
        } else {
            Some(letter.command.take())
        }
    }

    fn end(&self, problem: Option<String>) {
        let mut letter = self.place.lock().unwrap_or_else(PoisonError::into_inner);
        letter.ends = true;
        if problem.is_some() {
            letter.problem = problem;
        }
    }
}

/// Decides in every turn what the motors do.
#[derive(Debug, Clone)]
pub struct Watch {
    old_s: f64,
    last: Option<(Command, Stamp)>,
    stops: u64,
}

impl Watch {
    /// Stops what is older than this (s).
    pub fn new(old_s: f64) -> Self {
        Self {
            old_s,
            last: None,
            stops: 0,
        }
    }

    /// What the motors are to do now. A command that is no number, from the future, or too old is a stop.
    pub fn turn(&mut self, now: Stamp, arrived: Option<(Command, Stamp)>) -> Command {
        if arrived.is_some() {
            self.last = arrived;
        }
        match self.last {
            Some((command, sent)) if command.is_finite() && now.since_s(sent).abs() <= self.old_s => command,
            Some(_) => {
                self.stops += 1;
                Command::STOP
            }
            None => Command::STOP,
        }
    }

    /// Turns in which an old or broken command was replaced by a stop.
    pub fn stops(&self) -> u64 {
        self.stops
    }
}

/// How punctual the thread was.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotorLog {
    /// Turns.
    pub turns: u64,
    /// By how much each turn was late (s); of long runs the first [`MotorLog::KEPT`].
    pub late_s: Vec<f32>,
    /// Turns that were left out since the one before took too long.
    pub missed: u64,
    /// Turns in which the watch stopped the motors.
    pub stops: u64,
}

impl MotorLog {
    /// Most delays that are kept: ten minutes at 100 Hz.
    pub const KEPT: usize = 60_000;
}

/// The motors' thread. Dropping it stops the motors and waits for the thread.
#[derive(Debug)]
pub struct MotorThread {
    mailbox: Mailbox,
    thread: Option<JoinHandle<MotorLog>>,
}

impl MotorThread {
    /// Starts it.
    ///
    /// # Errors
    /// When the options are out of range or the system gives no thread.
    pub fn start(
        motors: impl Motors + 'static,
        pace: impl Pace + 'static,
        options: MotorOptions,
    ) -> io::Result<Self> {
        let in_range =
            (1.0..=10_000.0).contains(&options.rate_hz) && options.old_s > 0.0 && options.old_s.is_finite();
        if !in_range {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!(
                    "expected a rate of 1 to 10000 Hz and an age of more than 0 s, but found {options:?}"
                ),
            ));
        }
        let mailbox = Mailbox::default();
        let own = mailbox.clone();
        let thread = std::thread::Builder::new()
            .name("motors".into())
            .spawn(move || run(motors, pace, options, &own))?;
        Ok(Self {
            mailbox,
            thread: Some(thread),
        })
    }

    /// Where commands are left. Copies may go to other threads.
    pub fn mailbox(&self) -> &Mailbox {
        &self.mailbox
    }

    /// Stops the motors, ends the thread and says how punctual it was.
    pub fn stop(mut self) -> MotorLog {
        self.end()
    }

    fn end(&mut self) -> MotorLog {
        self.mailbox.end(None);
        // A thread that panicked has stopped the motors while it unwound ([`Stops`]).
        self.thread
            .take()
            .and_then(|thread| thread.join().ok())
            .unwrap_or_default()
    }
}

impl Drop for MotorThread {
    fn drop(&mut self) {
        self.end();
    }
}

/// Stops the motors however the thread ends.
struct Stops<M: Motors>(M);

impl<M: Motors> Drop for Stops<M> {
    fn drop(&mut self) {
        // Nobody is left to be told; the command to stop has been tried.
        let _ = self.0.set(&Command::STOP);
    }
}

fn run(motors: impl Motors, mut pace: impl Pace, options: MotorOptions, mailbox: &Mailbox) -> MotorLog {
    let mut motors = Stops(motors);
    let mut watch = Watch::new(options.old_s);
    let mut log = MotorLog {
        late_s: Vec::with_capacity(MotorLog::KEPT),
        ..MotorLog::default()
    };
    let period_s = 1.0 / options.rate_hz;
    let begin_s = pace.now().as_s();
    let mut number = 0u64;
    while let Some(arrived) = mailbox.fetch() {
        let now = pace.now();
        // Counted from the beginning: delays do not add up.
        let due_s = begin_s + number as f64 * period_s;
        if log.late_s.len() < MotorLog::KEPT {
            log.late_s.push((now.as_s() - due_s) as f32);
        }
        log.turns += 1;
        let command = watch.turn(now, arrived);
        if let Err(problem) = motors.0.set(&command) {
            mailbox.end(Some(problem));
            break;
        }
        let after_s = pace.now().as_s() - begin_s;
        let next = ((after_s / period_s) as u64 + 1).max(number + 1);
        log.missed += next - number - 1;
        number = next;
        pace.wait_until(Stamp::from_s(begin_s + number as f64 * period_s));
    }
    log.stops = watch.stops();
    log
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    fn go(speed_mps: f64) -> Command {
        Command::curvature(0.0, speed_mps)
    }

    #[test]
    fn old_broken_and_missing_commands_stop_the_motors() {
        let at = Stamp::from_s;
        let mut watch = Watch::new(0.3);
        assert_eq!(watch.turn(at(0.0), None), Command::STOP);
        assert_eq!(watch.turn(at(1.0), Some((go(0.2), at(0.9)))), go(0.2));
        assert_eq!(watch.turn(at(1.19), None), go(0.2));
        assert_eq!(watch.turn(at(1.21), None), Command::STOP);
        assert_eq!(watch.turn(at(1.3), Some((go(f64::NAN), at(1.3)))), Command::STOP);
        assert_eq!(
            watch.turn(at(1.4), Some((go(0.1), at(9.0)))),
            Command::STOP,
            "from the future"
        );
        assert_eq!(watch.turn(at(1.5), Some((go(0.1), at(1.5)))), go(0.1));
        assert_eq!(watch.stops(), 3);
    }

    #[test]
    fn the_newest_command_replaces_one_that_was_not_fetched() {
        let mailbox = Mailbox::default();
        for speed in [0.1, 0.2, 0.3] {
            mailbox.send(go(speed), Stamp::from_s(speed)).unwrap();
        }
        assert_eq!(mailbox.fetch(), Some(Some((go(0.3), Stamp::from_s(0.3)))));
        assert_eq!(mailbox.fetch(), Some(None));
        mailbox.end(None);
        assert_eq!(mailbox.fetch(), None);
    }

    /// Time that passes only when it is waited for; every turn waits for the test's word.
    struct Steps {
        now: Stamp,
        go: mpsc::Receiver<f64>,
    }

    impl Pace for Steps {
        fn now(&mut self) -> Stamp {
            self.now
        }

        fn wait_until(&mut self, stamp: Stamp) {
            let late_s = self.go.recv().unwrap_or(0.0);
            self.now = Stamp::from_s(stamp.as_s() + late_s);
        }
    }

    struct Told(mpsc::Sender<Command>, Option<u32>);

    impl Motors for Told {
        fn set(&mut self, command: &Command) -> Result<(), String> {
            let _ = self.0.send(*command);
            match &mut self.1 {
                Some(0) => Err("no answer at 0x40; check the cable".into()),
                Some(left) => {
                    *left -= 1;
                    Ok(())
                }
                None => Ok(()),
            }
        }
    }

    fn started(fails_after: Option<u32>) -> (MotorThread, mpsc::Sender<f64>, mpsc::Receiver<Command>) {
        let (go, steps) = mpsc::channel();
        let (tell, told) = mpsc::channel();
        let pace = Steps {
            now: Stamp::from_s(5.0),
            go: steps,
        };
        let thread = MotorThread::start(Told(tell, fails_after), pace, MotorOptions::default()).unwrap();
        (thread, go, told)
    }

    #[test]
    fn the_thread_follows_commands_watches_their_age_and_stops_at_the_end() {
        let (thread, step, told) = started(None);
        assert_eq!(told.recv().unwrap(), Command::STOP);
        thread.mailbox().send(go(0.2), Stamp::from_s(5.0)).unwrap();
        step.send(0.0).unwrap();
        assert_eq!(told.recv().unwrap(), go(0.2));
        // Nobody sends for 0.35 s: 35 turns are left out, and the motors stop.
        step.send(0.35).unwrap();
        assert_eq!(told.recv().unwrap(), Command::STOP);
        drop(step);
        let log = thread.stop();
        assert_eq!(told.iter().last().unwrap(), Command::STOP);
        assert!(log.turns >= 3 && log.stops >= 1 && log.missed >= 34, "{log:?}");
        assert!((log.late_s[2] - 0.35).abs() < 1e-6, "{log:?}");
    }

    #[test]
    fn motors_that_fail_are_told_of_at_the_next_command() {
        let (thread, step, told) = started(Some(1));
        step.send(0.0).unwrap();
        drop(step);
        while told.recv().is_ok() {}
        let error = thread.mailbox().send(go(0.1), Stamp::from_s(5.1)).unwrap_err();
        assert!(error.contains("check the cable"));
    }

    #[test]
    fn nonsense_is_refused() {
        for (rate_hz, old_s) in [(0.0, 0.3), (f64::NAN, 0.3), (1e9, 0.3), (100.0, 0.0)] {
            let (tell, _told) = mpsc::channel();
            let (_go, steps) = mpsc::channel();
            let pace = Steps {
                now: Stamp::default(),
                go: steps,
            };
            let options = MotorOptions { rate_hz, old_s };
            let error = MotorThread::start(Told(tell, None), pace, options).unwrap_err();
            assert!(error.to_string().contains("Hz"), "{error}");
        }
    }
}
