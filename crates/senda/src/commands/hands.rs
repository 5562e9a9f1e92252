//! The four modes of driving (A1 in SPEC) and a person's hands.

use super::drive::ScenarioFlags;
use crate::{cockpit::Cockpit, terminal};
use anyhow::{Context, Result, bail};
use clap::Args;
use senda_core::Body;
use senda_drivers::manual::Wheel;
use senda_drivers::{Hands, KeyScript, ManualDriver, ManualOptions};
use senda_run::{Ears, Pilot, RunError, Scenario, drive::named, pilot::MANUAL};
use senda_world::World;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Laps of a person who does not say how many: until they quit.
const LAPS_UNTIL_QUIT: u32 = 1_000_000;

/// Who drives, and whether it is kept for training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    Manual,
    Auto,
    TrainingManual,
    TrainingAuto,
}

const GUIDE: &str = "
  manual            you drive: arrows or wasd, q to quit; --gamepad for a gamepad or steering wheel
  auto              a driver drives (--driver); what happens without --mode
  training-manual   you drive, and every frame is recorded with the angle of that instant
  training-auto     a driver drives, and every frame is recorded with the angle of that instant

Recordings lie in `recordings` or --record DIR; `senda data export RECORDING --format named-frames` writes pictures with
the angle in their name, `senda train recordings` trains a network.";

impl Mode {
    /// By its name; a wrong word is answered with a guide, and nothing starts.
    pub(crate) fn named(word: &str) -> Result<Self> {
        Ok(match word {
            "manual" => Self::Manual,
            "auto" => Self::Auto,
            "training-manual" => Self::TrainingManual,
            "training-auto" => Self::TrainingAuto,
            _ => bail!("--mode {word}: expected one of these modes:\n{GUIDE}"),
        })
    }

    pub(crate) fn is_training(self) -> bool {
        matches!(self, Self::TrainingManual | Self::TrainingAuto)
    }

    fn is_manual(self) -> bool {
        matches!(self, Self::Manual | Self::TrainingManual)
    }
}

/// The flags of a person's driving.
#[derive(Args)]
pub(crate) struct HandFlags {
    /// Manual: change of the angle by one press, 1 to 5 servo degrees [usual: 3]
    #[arg(long, value_name = "DEG")]
    step: Option<f64>,
    /// Manual: drive by gamepad or steering wheel (Linux): the first one, or this device
    #[arg(long, value_name = "DEVICE", num_args = 0..=1)]
    gamepad: Option<Option<PathBuf>>,
    /// Manual: keys with their times from a file, as `1.25 left` (left, right, straight, go, stop, faster, slower, quit)
    #[arg(long, value_name = "FILE", conflicts_with = "gamepad")]
    keys: Option<PathBuf>,
}

/// Whose hands, before they take the wheel.
pub(crate) enum Prepared {
    /// Somebody at the terminal, with what is to be opened.
    Person(Option<Option<PathBuf>>),
    /// A file of keys.
    Script(KeyScript),
}

impl HandFlags {
    /// Checks the flags and makes the scenario a person's, where a person drives.
    pub(crate) fn prepare(
        &self,
        mode: Mode,
        flags: &ScenarioFlags,
        scenario: &mut Scenario,
    ) -> Result<Option<Prepared>> {
        // A scenario of a person's drive says so itself.
        if !mode.is_manual() && scenario.driver != MANUAL {
            if self.step.is_some() || self.gamepad.is_some() || self.keys.is_some() {
                bail!("--step, --gamepad and --keys are for --mode manual and training-manual");
            }
            return Ok(None);
        }
        if let Some(driver) = flags.driver.as_deref().filter(|driver| *driver != MANUAL) {
            bail!(
                "--driver {driver}: in this mode you drive; leave it out, or choose --mode auto or training-auto"
            );
        }
        if scenario.driver != MANUAL {
            scenario.driver = MANUAL.to_owned();
            if flags.laps.is_none() {
                scenario.laps = LAPS_UNTIL_QUIT;
            }
        }
        if let Some(step) = self.step {
            scenario.driver_options.insert("step_deg".to_owned(), step.into());
        }
        Ok(Some(match &self.keys {
            None => Prepared::Person(self.gamepad.clone()),
            Some(path) => {
                let text = std::fs::read_to_string(path)
                    .with_context(|| format!("cannot read {}", path.display()))?;
                Prepared::Script(KeyScript::parse(&path.display().to_string(), &text)?)
            }
        }))
    }
}

type Seat = Box<dyn FnOnce(&Body, &World) -> Result<Pilot, RunError>>;

/// What puts a pilot into the vehicle: a person's hands, or the driver that the scenario names.
pub(crate) fn seat(
    hands: Option<Prepared>,
    scenario: &Scenario,
    is_recording: bool,
    ears: &mut Ears<'_>,
) -> Result<Seat> {
    let Some(prepared) = hands else {
        return Ok(Box::new(named(scenario)));
    };
    let mut options: ManualOptions = scenario
        .driver_options
        .clone()
        .try_into()
        .map_err(|error: toml::de::Error| anyhow::anyhow!("--option: {}", error.message()))?;
    options.set_speed(scenario.speed_mps);
    // Refused before a keyboard is taken or a file made.
    Wheel::new(options.clone())?;
    let hands: Box<dyn Hands> = match prepared {
        Prepared::Script(script) => Box::new(script),
        Prepared::Person(gamepad) => {
            let progress = Arc::new(AtomicU64::new(0));
            let gamepad = gamepad.as_ref().map(Option::as_deref);
            let cockpit = Cockpit::open(gamepad, Arc::clone(&progress), is_recording)?;
            ears.progress = Box::new(move |part| progress.store((part * 1000.0) as u64, Ordering::Relaxed));
            // The cockpit hears interrupts itself: the vehicle stops first.
            ears.interrupted = Box::new(|| false);
            terminal::take_interrupts();
            Box::new(cockpit)
        }
    };
    Ok(Box::new(move |body, _| {
        Ok(Pilot::Person(ManualDriver::new(body, options, hands)?))
    }))
}
