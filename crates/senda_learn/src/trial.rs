//! How each round of learning is judged: drives on worlds that are not learned from.

use crate::correct::Gathering;
use crate::{LearnError, learn::Learning};
use senda_run::{Scenario, scenario::find_world, sweep, sweep::Plan};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeSet, path::Path};

/// How each round is judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Trial {
    /// Worlds, driven both ways; `random-circuit:5000..5040` stands for forty.
    pub worlds: Vec<String>,
    /// How many runs are drawn from them; 0: no trial.
    pub runs: usize,
    /// Speed (m/s).
    pub speed_mps: f64,
}

impl Default for Trial {
    fn default() -> Self {
        Self {
            worlds: vec!["random-circuit:5000..5200".into()],
            runs: 24,
            speed_mps: 0.16,
        }
    }
}

impl Trial {
    /// Refuses what could not be driven, and worlds that are learned from.
    pub(crate) fn check(&self, gathering: &Gathering) -> Result<(), LearnError> {
        if self.runs == 0 {
            return Ok(());
        }
        let wrong = |key, expected: &str, found: String| LearnError::Option {
            key,
            expected: expected.to_owned(),
            found,
        };
        if self.worlds.is_empty() {
            let expected =
                "a world, or a range of them such as random-circuit:5000..5200 (or runs = 0: no trial)";
            return Err(wrong("trial.worlds", expected, "none".into()));
        }
        if !(self.speed_mps > 0.0 && self.speed_mps <= 100.0) {
            return Err(wrong(
                "trial.speed_mps",
                "more than 0 and at most 100",
                self.speed_mps.to_string(),
            ));
        }
        let plan = trial_plan(self, &gathering.vehicle, gathering.image_px, Path::new(""));
        plan.check()?;
        let worlds: BTreeSet<String> = plan.runs()?.into_iter().map(|run| run.world).collect();
        for world in worlds {
            if let Some((family, seed)) = world.split_once(':')
                && gathering.families.iter().any(|learned| learned == family)
                && seed.parse().is_ok_and(|seed: u64| seed >= gathering.first_world)
            {
                let expected = format!(
                    "worlds that are not learned from (those are {family}:{} and on)",
                    gathering.first_world
                );
                return Err(wrong("trial.worlds", &expected, world));
            }
            find_world(&world)?;
        }
        Ok(())
    }
}

/// Drives the trial; `None`: interrupted.
pub(crate) type TrialResult = Option<([usize; 2], Option<f64>)>;

pub(crate) fn drive_trial(
    learning: &Learning,
    model: &Path,
    interrupted: &(dyn Fn() -> bool + Sync),
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<TrialResult, LearnError> {
    let plan = trial_plan(
        &learning.trial,
        &learning.gathering.vehicle,
        learning.gathering.image_px,
        model,
    );
    let lines = sweep::run(&plan, None, progress, interrupted, &|| 0)?;
    if lines.len() < learning.trial.runs {
        return Ok(None);
    }
    // A world that cannot be driven says nothing about the network.
    if let Some((scenario, error)) = lines
        .iter()
        .find_map(|line| Some((&line.scenario, line.error.as_ref()?)))
    {
        return Err(LearnError::Option {
            key: "trial",
            expected: "runs that can be driven".into(),
            found: format!("{} with {}: {error}", scenario.world, scenario.vehicle),
        });
    }
    let summaries: Vec<_> = lines.iter().filter_map(|line| line.summary.as_ref()).collect();
    let completed = summaries.iter().filter(|summary| summary.completed).count();
    let errors: Vec<f64> = summaries
        .iter()
        .filter_map(|summary| summary.lane_error_mean_m)
        .collect();
    let mean = (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64);
    Ok(Some(([completed, lines.len()], mean)))
}

/// The runs of a trial.
pub fn trial_plan(trial: &Trial, vehicle: &str, image_px: Option<[u32; 2]>, model: &Path) -> Plan {
    let mut base = Scenario::new(
        trial.worlds.first().map_or("oval-lane", String::as_str),
        vehicle,
        "neural",
    );
    base.speed_mps = Some(trial.speed_mps);
    base.image_px = image_px;
    base.driver_options
        .insert("model".into(), toml::Value::String(model.display().to_string()));
    Plan {
        worlds: trial.worlds.clone(),
        both_directions: true,
        sample: Some(trial.runs),
        ..Plan::once(base)
    }
}
