//! A person's place in a terminal: keyboard or gamepad, a small picture, and real time.

mod keys;
mod view;

#[cfg(unix)]
mod keyboard;
#[cfg(not(unix))]
#[path = "no_keyboard.rs"]
mod keyboard;

use crate::terminal;
use anyhow::Result;
use keyboard::Keyboard;
use senda_core::Observation;
use senda_drivers::Hands;
use senda_drivers::manual::{Input, Key, Wheel};
use senda_hw::{Gamepad, Motion};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use view::View;

/// Behind real time by more than this (ns) time is not caught up: a vehicle that races through the missed seconds is undrivable.
const CATCH_UP_NS: u64 = 250_000_000;

/// The hands of whoever sits at the terminal.
pub(crate) struct Cockpit {
    keyboard: Option<Keyboard>,
    gamepad: Option<Gamepad>,
    view: Option<View>,
    /// Hundredths of laps.
    progress: Arc<AtomicU64>,
    is_recording: bool,
    /// When the run began by the clock (ns).
    began_ns: Option<u64>,
    motions: Vec<Motion>,
    keys: Vec<Key>,
    steps: u64,
}

impl Cockpit {
    /// Takes the terminal's keyboard. With a gamepad a keyboard is welcome but not needed. `gamepad`: `Some(None)` is the first one.
    pub(crate) fn open(
        gamepad: Option<Option<&Path>>,
        progress: Arc<AtomicU64>,
        is_recording: bool,
    ) -> Result<Self> {
        let gamepad = gamepad.map(Gamepad::open).transpose()?;
        if let Some(gamepad) = &gamepad {
            tell!("gamepad: {}", gamepad.name());
        }
        let keyboard = match Keyboard::open() {
            Ok(keyboard) => Some(keyboard),
            Err(_) if gamepad.is_some() => None,
            Err(error) => return Err(error),
        };
        let view = keyboard
            .is_some()
            .then(keyboard::view_size)
            .flatten()
            .map(|[columns, rows]| View::open(columns, rows));
        Ok(Self {
            keyboard,
            gamepad,
            view,
            progress,
            is_recording,
            began_ns: None,
            motions: Vec::new(),
            keys: Vec::new(),
            steps: 0,
        })
    }

    /// Waits until `due_ns` while keys are pressed; at least one look at each device.
    fn listen(&mut self, due_ns: u64, inputs: &mut Vec<Input>) {
        loop {
            let left_ns = due_ns.saturating_sub(terminal::clock_ns());
            let is_there = match &mut self.keyboard {
                Some(keyboard) => {
                    let is_there = keyboard.wait(left_ns, &mut self.keys);
                    inputs.extend(self.keys.drain(..).map(Input::Key));
                    is_there
                }
                None => {
                    keyboard::pause(left_ns);
                    true
                }
            };
            if !is_there || terminal::interrupted() {
                inputs.push(Input::Lost);
                break;
            }
            if terminal::clock_ns() >= due_ns {
                break;
            }
        }
        if let Some(gamepad) = &mut self.gamepad {
            gamepad.motions(&mut self.motions);
            inputs.extend(self.motions.drain(..).map(input));
        }
    }
}

impl Hands for Cockpit {
    fn step(&mut self, observation: &Observation, wheel: &Wheel, inputs: &mut Vec<Input>) {
        self.steps += 1;
        let now_ns = terminal::clock_ns();
        let began_ns = *self.began_ns.get_or_insert(now_ns);
        let mut due_ns = began_ns + observation.stamp.ns;
        if now_ns > due_ns + CATCH_UP_NS {
            self.began_ns = Some(now_ns.saturating_sub(observation.stamp.ns));
            due_ns = now_ns;
        }
        if let Some(view) = &mut self.view {
            let recorded = self.is_recording.then_some(self.steps);
            view.draw(
                observation,
                wheel,
                self.progress.load(Ordering::Relaxed),
                recorded,
            );
        }
        // After the person has left, the rest of the run need not be waited for.
        if wheel.end().is_none() {
            self.listen(due_ns, inputs);
        }
    }
}

/// What a gamepad's movement means.
fn input(motion: Motion) -> Input {
    match motion {
        Motion::Steering(part) => Input::Steering(part),
        Motion::Pedal(part) => Input::Pedal(part),
        Motion::Left => Input::Key(Key::Left),
        Motion::Right => Input::Key(Key::Right),
        Motion::Go => Input::Key(Key::Go),
        Motion::Stop => Input::Key(Key::Stop),
        Motion::Quit => Input::Key(Key::Quit),
        Motion::Gone => Input::Lost,
    }
}
