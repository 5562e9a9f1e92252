//! What a sweep varies, and the runs that come of it.

use crate::own_file::{self, Kind};
use crate::{RunError, Scenario, error::wrong, random, scenario::StartOffset, scenario_file::seek_beside};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeSet, f64::consts::PI, path::Path};

const PLAN_FILE: Kind = Kind {
    name: "sweep plan",
    help: "it holds a scenario as [base] and lists of what to vary, such as lights = [\"daylight\", \"lamp\"]",
};

/// What to vary. Empty lists keep the base scenario's value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The scenario that everything else is varied around.
    pub base: Scenario,
    /// Worlds; `random-line:100..200` stands for a hundred.
    #[serde(default)]
    pub worlds: Vec<String>,
    /// Drivers.
    #[serde(default)]
    pub drivers: Vec<String>,
    /// Lights.
    #[serde(default)]
    pub lights: Vec<String>,
    /// Floors.
    #[serde(default)]
    pub floors: Vec<String>,
    /// Speeds (m/s).
    #[serde(default)]
    pub speeds_mps: Vec<f64>,
    /// Further delays from the exposure to the driver (s).
    #[serde(default)]
    pub latencies_s: Vec<f64>,
    /// Image sizes (px).
    #[serde(default)]
    pub images_px: Vec<[u32; 2]>,
    /// Also drive the other way round.
    #[serde(default)]
    pub both_directions: bool,
    /// Starting places are drawn from this spread.
    #[serde(default)]
    pub start_spread: StartSpread,
    /// Seeds a combination: 1 runs each once.
    #[serde(default = "one")]
    pub seeds: u64,
    /// Draws this many runs at random from all combinations instead of running every one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample: Option<usize>,
}

/// Half widths of the uniform distributions that starting places are drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartSpread {
    /// To either side of the path (m).
    #[serde(default)]
    pub offset_m: f64,
    /// Turned to either side (rad).
    #[serde(default)]
    pub heading_rad: f64,
    /// Further along the path, 0 to this (m); on open paths what lies beyond their way goes on from its beginning.
    #[serde(default)]
    pub station_m: f64,
}

fn one() -> u64 {
    1
}

impl Plan {
    /// A plan that runs its base once.
    pub fn once(base: Scenario) -> Self {
        Self {
            base,
            worlds: vec![],
            drivers: vec![],
            lights: vec![],
            floors: vec![],
            speeds_mps: vec![],
            latencies_s: vec![],
            images_px: vec![],
            both_directions: false,
            start_spread: StartSpread::default(),
            seeds: 1,
            sample: None,
        }
    }

    /// Reads a sweep file. Errors name the line.
    pub fn load(path: &Path) -> Result<Self, RunError> {
        let mut plan: Self = own_file::load(path, &PLAN_FILE)?;
        plan.base.seek_beside(path);
        for world in &mut plan.worlds {
            seek_beside(path, world);
        }
        Ok(plan)
    }

    /// Checks ranges that no single run shows.
    pub fn check(&self) -> Result<(), RunError> {
        if self.seeds == 0 {
            return wrong("seeds", "0", "at least 1");
        }
        if self.sample == Some(0) {
            return wrong("sample", "0", "at least 1; left out, every combination is run");
        }
        let spread = &self.start_spread;
        for (key, half, most, words) in [
            ("start_spread.offset_m", spread.offset_m, 1e3, "0 to 1000"),
            (
                "start_spread.heading_rad",
                spread.heading_rad,
                PI,
                "0 to π (180°)",
            ),
            ("start_spread.station_m", spread.station_m, 1e6, "0 to 1000000"),
        ] {
            if !(0.0..=most).contains(&half) {
                return wrong(key, half, words);
            }
        }
        Ok(())
    }

    /// Every run of the plan once, in a fixed order.
    pub fn runs(&self) -> Result<Vec<Scenario>, RunError> {
        Ok(self.distinct()?.0)
    }

    /// How many of the plan's runs are left out because they equal an earlier one in everything: nothing is learned from them.
    pub fn repeated(&self) -> Result<usize, RunError> {
        Ok(self.distinct()?.1)
    }

    /// The runs, and how many equal ones there were besides.
    fn distinct(&self) -> Result<(Vec<Scenario>, usize), RunError> {
        let mut seen = BTreeSet::new();
        let mut runs = self.combinations()?;
        let all = runs.len();
        runs.retain(|run| seen.insert(run.to_toml()));
        let repeated = all - runs.len();
        Ok((runs, repeated))
    }

    /// Every combination, in a fixed order, repeated ones too. Run number i depends on the plan and i alone.
    fn combinations(&self) -> Result<Vec<Scenario>, RunError> {
        let or_base = |list: &[String], base: &str| {
            if list.is_empty() {
                vec![base.to_owned()]
            } else {
                list.to_vec()
            }
        };
        let worlds = random::expand(&or_base(&self.worlds, &self.base.world))?;
        let drivers = or_base(&self.drivers, &self.base.driver);
        let some = |list: &[String], base: &Option<String>| -> Vec<Option<String>> {
            if list.is_empty() {
                vec![base.clone()]
            } else {
                list.iter().cloned().map(Some).collect()
            }
        };
        let lights = some(&self.lights, &self.base.light);
        let floors = some(&self.floors, &self.base.floor);
        let speeds: Vec<Option<f64>> = if self.speeds_mps.is_empty() {
            vec![self.base.speed_mps]
        } else {
            self.speeds_mps.iter().copied().map(Some).collect()
        };
        let latencies = if self.latencies_s.is_empty() {
            vec![self.base.latency_s]
        } else {
            self.latencies_s.clone()
        };
        let images: Vec<Option<[u32; 2]>> = if self.images_px.is_empty() {
            vec![self.base.image_px]
        } else {
            self.images_px.iter().copied().map(Some).collect()
        };
        let directions = if self.both_directions {
            vec![false, true]
        } else {
            vec![self.base.reverse]
        };
        let seeds: Vec<u64> = (0..self.seeds).map(|i| self.base.seed + i).collect();
        let sizes = [
            worlds.len(),
            drivers.len(),
            lights.len(),
            floors.len(),
            speeds.len(),
            images.len(),
            directions.len(),
            seeds.len(),
            latencies.len(),
        ];
        let total: usize = sizes.iter().product();
        let scenario = |places: [usize; 9], number: u64| -> Scenario {
            let mut rng = ChaCha8Rng::seed_from_u64(self.base.seed);
            rng.set_stream(number + 1);
            let mut spread = |half: f64| {
                if half > 0.0 {
                    rng.random_range(-half..=half)
                } else {
                    0.0
                }
            };
            let start = StartOffset {
                offset_m: self.base.start.offset_m + spread(self.start_spread.offset_m),
                heading_rad: self.base.start.heading_rad + spread(self.start_spread.heading_rad),
                station_m: self.base.start.station_m + spread(self.start_spread.station_m).abs(),
                speed_mps: self.base.start.speed_mps,
            };
            let mut run = Scenario {
                world: worlds[places[0]].clone(),
                driver: drivers[places[1]].clone(),
                light: lights[places[2]].clone(),
                floor: floors[places[3]].clone(),
                speed_mps: speeds[places[4]],
                image_px: images[places[5]],
                reverse: directions[places[6]],
                seed: seeds[places[7]],
                latency_s: latencies[places[8]],
                start,
                ..self.base.clone()
            };
            run.keep_recorded_world(&self.base);
            run
        };
        let mut picker = ChaCha8Rng::seed_from_u64(self.base.seed);
        Ok(match self.sample {
            None => (0..total)
                .map(|number| scenario(unravel(number, &sizes), number as u64))
                .collect(),
            Some(count) => (0..count as u64)
                .map(|number| {
                    let mut draw = |size: usize| picker.random_range(0..size);
                    let mut places = [0; 9];
                    for (place, size) in places.iter_mut().zip(sizes).take(8) {
                        *place = draw(size);
                    }
                    // No draw without a choice: sweeps that do not vary it keep their runs.
                    if sizes[8] > 1 {
                        places[8] = draw(sizes[8]);
                    }
                    let drawn = scenario(places, number);
                    Scenario {
                        seed: self.base.seed + number,
                        ..drawn
                    }
                })
                .collect(),
        })
    }
}

impl Plan {
    /// A run whose start was drawn beyond an open path's end, brought back onto the way.
    pub(super) fn on_the_way(&self, run: &Scenario) -> Scenario {
        let mut run = run.clone();
        // A world that does not resolve is complained of by the run itself.
        if self.start_spread.station_m > 0.0
            && let Ok(world) = run.resolve_world()
        {
            run.start = run.start.on_the_way(&world);
        }
        run
    }
}

fn unravel(mut number: usize, sizes: &[usize; 9]) -> [usize; 9] {
    let mut places = [0; 9];
    for i in (0..9).rev() {
        places[i] = number % sizes[i];
        number /= sizes[i];
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same world three times counted as three runs, and narrowed the interval.
    #[test]
    fn equal_runs_are_run_once() {
        let mut plan = Plan::once(Scenario::new("oval", "gopigo", "line"));
        plan.worlds = ["oval", "random-line:3", "random-line:2..5", "oval"]
            .map(str::to_owned)
            .to_vec();
        assert_eq!((plan.runs().unwrap().len(), plan.repeated().unwrap()), (4, 2));
        // Starts that are drawn differ.
        plan.start_spread.offset_m = 0.01;
        assert_eq!((plan.runs().unwrap().len(), plan.repeated().unwrap()), (6, 0));
    }
}
