//! Made-up worlds: every seed another circuit, floor and light, always drivable.

mod circuit;
mod dice;
mod road;
mod scenery;

use crate::colour::Colour;
use crate::floor::FLOOR_PRESETS;
use crate::landscape::Landscape;
use crate::light::{LIGHT_PRESETS, Light};
use crate::path::{self_overlap, smallest_radius_m};
use crate::world::{Backdrop, World};
use circuit::{SLACK, circuit};
pub(crate) use dice::Dice;
pub(crate) use road::signed_area_m2;
use scenery::{choose_floor, choose_light, choose_markings, choose_thing};
use serde::{Deserialize, Serialize};

/// Limits of made-up worlds. Every field has a default; ranges are `[least, most]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Difficulty {
    /// One line or a lane of two.
    pub kind: Kind,
    /// Tightest curve of the path (m). Outranks `length_m` where both cannot be had.
    pub min_radius_m: f64,
    /// Length of the path (m).
    pub length_m: [f64; 2],
    /// Distance between the lane's lines (m).
    pub lane_width_m: [f64; 2],
    /// Width of the lines (m).
    pub line_width_m: [f64; 2],
    /// Distance that other parts of the path keep (m); 0: lane width + 0.3 m, at least 0.45 m.
    pub clearance_m: f64,
    /// Names of floors to choose from ([`FLOOR_PRESETS`]); unknown ones are passed over.
    pub floors: Vec<String>,
    /// Whether colours, scale and seed of the floor vary around its preset.
    pub vary_floor: bool,
    /// Names of lights to choose from ([`LIGHT_PRESETS`]); unknown ones are passed over.
    pub lights: Vec<String>,
    /// Whether level, direction and lamps vary around the preset.
    pub vary_light: bool,
    /// Colours of the lines to choose from; those too near to the floor's lightness are passed over.
    pub colours: Vec<Colour>,
    /// Darker or lighter than the floor.
    pub tone: Tone,
    /// Probability that lines are dashed.
    pub dashes: f64,
    /// Probability that a lane has a dashed line in its middle too, of another colour where one fits.
    pub centre: f64,
    /// Colours of that line to choose from; empty: any of `colours` that the others do not have.
    pub centre_colours: Vec<Colour>,
    /// Length of its dashes with their gaps, as parts of the lane's width.
    pub centre_period: [f64; 2],
    /// Most wear of the paint, 0..=1.
    pub wear: f64,
    /// Most stain of the paint, 0..=1.
    pub stain: f64,
    /// Probability of added soft shadows.
    pub shadows: f64,
    /// Probability of an added lamp.
    pub lamps: f64,
    /// Probability that light changes along the lap.
    pub light_changes: f64,
    /// Most upright things beside the path.
    pub things: u32,
}

/// What there is to follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// One line.
    #[default]
    Line,
    /// A lane of two lines.
    Lane,
}

/// Lightness of the lines against the floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tone {
    /// Either.
    #[default]
    Any,
    /// Lines darker than the floor.
    Dark,
    /// Lines lighter than the floor.
    Light,
}

impl Default for Difficulty {
    /// One line as in document C: radius 0.3 m or more, any floor and light, clean paint.
    fn default() -> Self {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Self {
            kind: Kind::Line,
            min_radius_m: 0.3,
            length_m: [4.0, 9.0],
            lane_width_m: [0.22, 0.30],
            line_width_m: [0.015, 0.02],
            clearance_m: 0.0,
            floors: names(&FLOOR_PRESETS),
            vary_floor: true,
            lights: names(&LIGHT_PRESETS),
            vary_light: true,
            colours: [
                "black", "white", "pink", "blue", "red", "green", "yellow", "orange",
            ]
            .iter()
            .filter_map(|name| Colour::parse(name))
            .collect(),
            tone: Tone::Any,
            dashes: 0.0,
            centre: 0.0,
            centre_colours: Vec::new(),
            centre_period: [0.15, 0.5],
            wear: 0.15,
            stain: 0.15,
            shadows: 0.2,
            lamps: 0.2,
            light_changes: 0.2,
            things: 0,
        }
    }
}

impl Difficulty {
    /// A lane of two lines for the kit car of document A.
    pub fn lane() -> Self {
        Self {
            kind: Kind::Lane,
            min_radius_m: 0.45,
            length_m: [6.0, 13.0],
            ..Self::default()
        }
    }
}

impl Difficulty {
    /// A race track for model cars: wide, often with a dashed line in the middle, things all around it.
    pub fn track() -> Self {
        Self {
            min_radius_m: 0.8,
            length_m: [14.0, 30.0],
            lane_width_m: [0.8, 2.2],
            line_width_m: [0.03, 0.07],
            clearance_m: 0.15,
            centre: 0.75,
            lamps: 0.6,
            things: 24,
            ..Self::lane()
        }
    }
}

impl Difficulty {
    /// A track as clubs of model cars lay it in halls: bright edges, between them a dashed line of a bright colour, floors of
    /// concrete, carpet or polished stone.
    pub fn race() -> Self {
        let named = |names: &[&str]| names.iter().filter_map(|name| Colour::parse(name)).collect();
        Self {
            min_radius_m: 0.6,
            lane_width_m: [0.8, 2.0],
            line_width_m: [0.035, 0.08],
            floors: [
                "plain",
                "dark",
                "speckled",
                "dark-speckled",
                "carpet",
                "tiles",
                "wood",
                "glossy",
                "glossy-dark",
                "glossy-speckled",
                "glossy-dark-speckled",
            ]
            .map(str::to_owned)
            .to_vec(),
            colours: named(&["white", "white", "white", "yellow", "orange"]),
            tone: Tone::Light,
            centre: 0.9,
            centre_colours: named(&["yellow", "yellow", "orange", "white"]),
            centre_period: [0.12, 0.4],
            ..Self::track()
        }
    }
}

/// Curves that a person may ask for (m): tighter ones close in on the line's own width, wider ones need a landscape.
const ASKED_RADIUS_M: [f64; 2] = [0.05, 100.0];
/// Lengths that a person may ask for (m).
const ASKED_LENGTH_M: [f64; 2] = [0.1, 10_000.0];
/// Length of the shortest circuit as a multiple of its tightest curve's radius: a circle, and a little.
const CIRCLE: f64 = 2.0 * std::f64::consts::PI * 1.02;
/// The tightest curve that came out may miss its limit by this part: curves are sampled.
const SAMPLING: f64 = 0.002;

/// Why a world within limits cannot be made up.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LimitsError {
    /// A limit is no number that makes sense.
    #[error("expected {what} from {least} to {most} m, but found {found}")]
    OutOfRange {
        /// Which limit.
        what: &'static str,
        /// Least that is allowed (m).
        least: f64,
        /// Most that is allowed (m).
        most: f64,
        /// What was asked for (m).
        found: f64,
    },
    /// The longest length is below the shortest.
    #[error("expected the shortest length before the longest, but found {} and {} m; did you mean {},{}?", .found_m[0], .found_m[1], .found_m[1], .found_m[0])]
    Reversed {
        /// As asked for (m).
        found_m: [f64; 2],
    },
    /// The limits contradict each other, at least for this seed.
    #[error(
        "no circuit of {} to {} m with curves of {radius_m:.3} m or more and {clearance_m:.2} m between its parts came out of \
         this seed: the nearest is {got_length_m:.2} m long with a tightest curve of {got_radius_m:.3} m; allow {} m or more, \
         curves of {} m, or take another seed",
        .length_m[0], .length_m[1], (.got_length_m * 100.0).ceil() / 100.0, (.length_m[1] / CIRCLE * 100.0).floor() / 100.0
    )]
    Together {
        /// Shortest and longest length asked for (m).
        length_m: [f64; 2],
        /// Tightest curve: what was asked for, or what a lane of this width needs (m).
        radius_m: f64,
        /// Distance that other parts of the path keep (m).
        clearance_m: f64,
        /// What came out (m).
        got_length_m: f64,
        /// Its tightest curve (m).
        got_radius_m: f64,
    },
}

impl Difficulty {
    /// Tightest curve (m) of a lane of this width: inside a curve the inner line must not fold.
    fn least_radius_m(&self, lane_width_m: Option<f64>) -> f64 {
        self.min_radius_m
            .max(lane_width_m.unwrap_or(0.0) * 0.75)
            .max(0.02)
    }

    /// Distance (m) that other parts of the path keep.
    fn distance_m(&self, lane_width_m: Option<f64>) -> f64 {
        if self.clearance_m > 0.0 {
            self.clearance_m
        } else {
            (lane_width_m.unwrap_or(0.0) + 0.3).max(0.45)
        }
    }
}

impl World {
    /// As [`World::random`], but an error where that would break a limit of the path.
    pub fn random_within(seed: u64, difficulty: &Difficulty) -> Result<Self, LimitsError> {
        let [shortest_m, longest_m] = difficulty.length_m;
        for (what, found, [least, most]) in [
            ("a tightest curve", difficulty.min_radius_m, ASKED_RADIUS_M),
            ("a shortest length", shortest_m, ASKED_LENGTH_M),
            ("a longest length", longest_m, ASKED_LENGTH_M),
        ] {
            if !(least..=most).contains(&found) {
                return Err(LimitsError::OutOfRange {
                    what,
                    least,
                    most,
                    found,
                });
            }
        }
        if longest_m < shortest_m {
            return Err(LimitsError::Reversed {
                found_m: difficulty.length_m,
            });
        }
        let is_as_long = |world: &Self| (shortest_m..=longest_m).contains(&world.path.length_m());
        let mut world = Self::random(seed, difficulty);
        if !is_as_long(&world) {
            world = Self::made_up(seed, difficulty, 0.0);
        }
        let radius_m = difficulty.least_radius_m(world.lane_width_m);
        let clearance_m = difficulty.distance_m(world.lane_width_m);
        let (got_length_m, got_radius_m) = (world.path.length_m(), smallest_radius_m(&world.path));
        let is_within = is_as_long(&world)
            && got_radius_m >= radius_m * (1.0 - SAMPLING)
            && self_overlap(&world.path, clearance_m).is_none();
        if is_within {
            Ok(world)
        } else {
            Err(LimitsError::Together {
                length_m: difficulty.length_m,
                radius_m,
                clearance_m,
                got_length_m,
                got_radius_m,
            })
        }
    }

    /// A closed circuit made up from a seed: always valid, never overlapping itself, different for every seed and the
    /// same for the same seed and difficulty. Where limits contradict each other the radius wins.
    pub fn random(seed: u64, difficulty: &Difficulty) -> Self {
        Self::made_up(seed, difficulty, SLACK)
    }

    fn made_up(seed: u64, difficulty: &Difficulty, slack: f64) -> Self {
        let mut dice = Dice::new(seed);
        let lane_width_m =
            (difficulty.kind == Kind::Lane).then(|| dice.between(difficulty.lane_width_m).max(0.02));
        let clearance_m = difficulty.distance_m(lane_width_m);
        let min_radius_m = difficulty.least_radius_m(lane_width_m);
        let (path_spec, path) = circuit(&mut dice, min_radius_m, difficulty.length_m, clearance_m, slack);
        let floor = choose_floor(&mut dice, difficulty);
        let markings = choose_markings(&mut dice, difficulty, &floor, lane_width_m, &path);
        let mut world = World {
            name: format!("random-{seed}"),
            description: String::new(),
            lane_width_m,
            corridor_half_width_m: lane_width_m.map_or(0.15, |width_m| width_m / 2.0),
            start_station_m: 0.0,
            markings,
            floor,
            light: Light::default(),
            things: Vec::new(),
            backdrop: Backdrop {
                horizon: dice.vary(Colour::new(140, 136, 130), 50.0),
                zenith: dice.vary(Colour::new(205, 203, 200), 30.0),
                hills: None,
            },
            margin_m: 0.8,
            warehouse: None,
            texel_m: 0.0,
            landscape: Landscape::default(),
            path,
            path_spec,
        };
        world.light = choose_light(&mut dice, difficulty, world.bounds());
        let reach_m = world.corridor_half_width_m + 0.08;
        for _ in 0..difficulty.things {
            if dice.chance(0.7) {
                world.things.extend(choose_thing(&mut dice, &world.path, reach_m));
            }
        }
        world
    }
}
