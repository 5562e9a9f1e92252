//! What to run: one TOML file or the flags of the command line, resolved to plain data.

pub use crate::start::StartOffset;
use crate::{RunError, error::wrong, random, start::is_zero};
use senda_toml::nearest_names;
use senda_world::{VehicleSpec, World, WorldError};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// One run. Every field has a flag of `senda drive` and a key in scenario files; the resolved copy is saved with the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Ready world (`oval`), world file (`my.toml`) or random one (`random-line:17`).
    pub world: String,
    /// Ready vehicle (`gopigo`) or vehicle file.
    pub vehicle: String,
    /// `line`, `lane`, `hough`, `neural`, `expert` or `human`.
    pub driver: String,
    /// Laps to drive; on an open world, the way to its end counts as one. At least 1.
    #[serde(default = "one")]
    pub laps: u32,
    /// Seed of every random number in the run.
    #[serde(default = "one_u64")]
    pub seed: u64,
    /// Light that replaces the world's own: `daylight`, `lamp`, …
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<String>,
    /// Floor that replaces the world's own: `plain`, `speckled`, `glossy`, …
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<String>,
    /// Cruising speed (m/s) that replaces the vehicle's and the driver's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_mps: Option<f64>,
    /// Drive the other way round.
    #[serde(default)]
    pub reverse: bool,
    /// Image width and height (px) that replace the vehicle's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image_px: Option<[u32; 2]>,
    /// Further delay (s) from the exposure to the driver, on top of the camera's own: a slow link or a slow processor.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub latency_s: f64,
    /// Part of the frames that get lost on the way, 0..=1; the driver keeps its command meanwhile.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lost_frames: f64,
    /// Where the run begins, relative to the world's start.
    #[serde(default)]
    pub start: StartOffset,
    /// The run ends after this time (s); without it, after four times the time that the way takes plus 20 s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_limit_s: Option<f64>,
    /// Calibration file: the driver believes its camera instead of the vehicle file's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<String>,
    /// In a warehouse: what the package's code says (`I2`) instead of the world's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub package: Option<String>,
    /// Options of the driver, as its documentation names them.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub driver_options: toml::Table,
    /// The world as a recording holds it, with light, floor and direction applied; no file has it.
    #[serde(skip)]
    pub recorded_world: Option<String>,
}

fn one() -> u32 {
    1
}

fn one_u64() -> u64 {
    1
}

impl Scenario {
    /// One lap with everything else as the files say.
    pub fn new(world: &str, vehicle: &str, driver: &str) -> Self {
        Self {
            world: world.to_owned(),
            vehicle: vehicle.to_owned(),
            driver: driver.to_owned(),
            laps: 1,
            seed: 1,
            light: None,
            floor: None,
            speed_mps: None,
            reverse: false,
            image_px: None,
            latency_s: 0.0,
            lost_frames: 0.0,
            start: StartOffset::default(),
            time_limit_s: None,
            calibration: None,
            package: None,
            driver_options: toml::Table::new(),
            recorded_world: None,
        }
    }

    /// The same with the vehicle's own cruising speed where none is given: a car does not creep as a toy does.
    pub fn at_cruising_speed(&self) -> Result<Self, RunError> {
        let mut scenario = self.clone();
        if scenario.speed_mps.is_none() {
            scenario.speed_mps = find_vehicle(&self.vehicle)?.cruise_mps;
        }
        Ok(scenario)
    }

    /// As TOML, all keys written.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// Checks ranges that need no other file.
    pub fn check(&self) -> Result<(), RunError> {
        if self.laps == 0 {
            return wrong("laps", "0", "at least 1");
        }
        if let Some(speed) = self.speed_mps.filter(|speed| !(*speed > 0.0 && *speed <= 60.0)) {
            return wrong("speed_mps", speed, "above 0 and at most 60");
        }
        if let Some(limit) = self
            .time_limit_s
            .filter(|limit| !(*limit > 0.0 && limit.is_finite()))
        {
            return wrong("time_limit_s", limit, "above 0");
        }
        if let Some([width, height]) = self
            .image_px
            .filter(|size| size.iter().any(|side| !(8..=4096).contains(side)))
        {
            return wrong(
                "image_px",
                format!("[{width}, {height}]"),
                "two sizes from 8 to 4096",
            );
        }
        if !(0.0..=5.0).contains(&self.latency_s) {
            return wrong("latency_s", self.latency_s, "0 to 5");
        }
        if !(0.0..=1.0).contains(&self.lost_frames) {
            return wrong("lost_frames", self.lost_frames, "0 to 1");
        }
        self.start.check()
    }

    /// The world with light, floor and direction applied.
    pub fn resolve_world(&self) -> Result<World, RunError> {
        if let Some(text) = &self.recorded_world {
            return Ok(World::parse("the recording's world", text)?.0);
        }
        let mut world = find_world(&self.world)?;
        if let Some(light) = &self.light {
            world = world.with_light(light)?;
        }
        if let Some(floor) = &self.floor {
            world = world.with_floor(floor)?;
        }
        if world.warehouse.is_some() {
            // Where lights are in their programs is a part of the run's chance.
            world = world.with_lights_later(part_of(self.seed));
        }
        if let Some(package) = &self.package {
            world = world.with_package(package).ok_or_else(|| RunError::Scenario {
                key: "package",
                found: format!("{package:?}"),
                expected: "1 to 64 printable ASCII characters, such as I2".to_owned(),
            })?;
        }
        Ok(if self.reverse { world.reversed() } else { world })
    }

    /// The driver's options with what follows from the rest: a person at the wheel is another one in every run.
    pub fn resolve_driver_options(&self) -> toml::Table {
        let mut options = self.driver_options.clone();
        if self.driver == "human" && !options.contains_key("seed") {
            // Files hold signed numbers.
            options.insert(
                "seed".to_owned(),
                toml::Value::Integer((self.seed & i64::MAX as u64) as i64),
            );
        }
        // A mission gives up at the voltage of the battery that it has.
        if self.driver == "mission"
            && !options.contains_key("empty_v")
            && let Some(battery) = find_vehicle(&self.vehicle)
                .ok()
                .and_then(|vehicle| vehicle.battery)
        {
            options.insert("empty_v".to_owned(), battery.empty_v.into());
        }
        options
    }

    /// The vehicle with its image size applied.
    pub fn resolve_vehicle(&self) -> Result<VehicleSpec, RunError> {
        let vehicle = find_vehicle(&self.vehicle)?;
        Ok(match self.image_px {
            Some([width, height]) => vehicle.with_camera_size(width, height),
            None => vehicle,
        })
    }
}

/// A number 0..1 that a seed stands for (SplitMix64, Steele 2014).
fn part_of(seed: u64) -> f64 {
    let mut bits = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A world by file (`….toml`), seed (`random-line:17`) or name.
pub fn find_world(name: &str) -> Result<World, RunError> {
    if let Some(random) = crate::random::world(name)? {
        return Ok(random);
    }
    if looks_like_file(name) {
        return Ok(World::load(Path::new(name))?.0);
    }
    World::named(name).map_err(|error| match error {
        WorldError::UnknownName { .. } => unknown_world(name).into(),
        other => other.into(),
    })
}

/// Beginnings of worlds' names, and the ready vehicle that such a world is laid out for.
const MADE_FOR: [(&str, &str); 12] = [
    ("circuit-", "picar"),
    ("unseen-", "picar"),
    ("random-circuit", "picar"),
    ("random-track", "donkeycar"),
    ("random-race", "donkeycar"),
    ("lake", "sedan"),
    ("meadow", "sedan"),
    ("heath", "sedan"),
    ("forest", "sedan"),
    ("random-road", "sedan"),
    ("warehouse", "warehouse-cart"),
    ("random-warehouse", "warehouse-cart"),
];

/// The vehicle that a ready or random world is laid out for: a GoPiGo sees too little of a kit car's lane, and a road is no
/// place for either. Of a file nothing is known; there it is the GoPiGo too.
pub fn usual_vehicle(world: &str) -> &'static str {
    let made_for = MADE_FOR
        .iter()
        .find(|(beginning, _)| world.starts_with(beginning));
    match made_for {
        Some((_, vehicle)) if !looks_like_file(world) => vehicle,
        _ => "gopigo",
    }
}

/// The driver for a world, where none is named: the follower of the line or of the lane that it has, in warehouses the mission; on
/// roads, whose lanes no hand-coded follower keeps, the expert. Of a world that cannot be read nothing is known: `line`.
pub fn usual_driver(name: &str) -> &'static str {
    match find_world(name) {
        Ok(world) if world.warehouse.is_some() => "mission",
        Ok(world) if world.lane_width_m.is_some() && usual_vehicle(name) == "sedan" => "expert",
        Ok(world) if world.lane_width_m.is_some() => "lane",
        _ => "line",
    }
}

/// The library knows its own names only; here random families and files are possible too.
fn unknown_world(name: &str) -> WorldError {
    let families = random::FAMILIES.map(|(family, _)| family);
    let nearest: Vec<String> = match name.split_once(':') {
        Some((family, seed)) => nearest_names(family, &families)
            .into_iter()
            .map(|family| format!("{family}:{seed}"))
            .collect(),
        None => nearest_names(name, &World::names().collect::<Vec<_>>()),
    };
    let guess = match nearest.first() {
        Some(nearest) => format!("did you mean {nearest:?}? "),
        None => String::new(),
    };
    let ready: Vec<&str> = World::names().collect();
    WorldError::UnknownName {
        what: "world",
        found: name.to_owned(),
        nearest,
        help: format!(
            "{guess}Known: {}; from a seed, such as random-line:17: {}; or a file whose name ends in .toml",
            ready.join(", "),
            families.join(", ")
        ),
    }
}

/// A vehicle by file (`….toml`) or name.
pub fn find_vehicle(name: &str) -> Result<VehicleSpec, RunError> {
    if looks_like_file(name) {
        return Ok(VehicleSpec::load(Path::new(name))?.0);
    }
    VehicleSpec::named(name).map_err(|error| match error {
        WorldError::UnknownName {
            what,
            found,
            nearest,
            help,
        } => RunError::World(WorldError::UnknownName {
            what,
            found,
            nearest,
            help: format!("{help}; or a file whose name ends in .toml"),
        }),
        other => other.into(),
    })
}

/// Whether a world or vehicle is named by its file.
pub(crate) fn looks_like_file(name: &str) -> bool {
    name.ends_with(".toml") || name.contains(['/', '\\'])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The GoPiGo was put on every world: it left the kit car's circuit-2 after 14 to 19 %.
    #[test]
    fn worlds_have_a_vehicle_that_they_are_for() {
        assert_eq!(usual_vehicle("circuit-2"), "picar");
        assert_eq!(usual_vehicle("random-road:17"), "sedan");
        assert_eq!(usual_vehicle("oval-lane"), "gopigo");
        assert_eq!(usual_vehicle("lake.toml"), "gopigo");
        for (world, driver) in [
            ("oval", "line"),
            ("random-line:3", "line"),
            ("s-curves-lane", "lane"),
            ("circuit-2", "lane"),
            ("random-race:3", "lane"),
            ("warehouse", "mission"),
            ("lake", "expert"),
            ("nowhere", "line"),
        ] {
            assert_eq!(usual_driver(world), driver, "{world}");
        }
        for (beginning, vehicle) in MADE_FOR {
            let known = World::names().chain(random::FAMILIES.map(|(name, _)| name));
            assert!(
                known.into_iter().any(|name| name.starts_with(beginning)),
                "{beginning}"
            );
            assert!(find_vehicle(vehicle).is_ok(), "{vehicle}");
        }
    }

    /// Without --speed the car crept at a line follower's 0.16 m/s.
    #[test]
    fn a_car_cruises_at_its_own_speed_unless_another_is_asked_for() {
        let mut scenario = Scenario::new("lake", "sedan", "expert");
        assert_eq!(scenario.at_cruising_speed().unwrap().speed_mps, Some(8.0));
        scenario.speed_mps = Some(5.0);
        assert_eq!(scenario.at_cruising_speed().unwrap().speed_mps, Some(5.0));
        let toy = Scenario::new("oval", "gopigo", "line");
        assert_eq!(
            toy.at_cruising_speed().unwrap().speed_mps,
            None,
            "the driver's own"
        );
    }

    #[test]
    fn the_resolved_copy_reads_back() {
        let mut scenario = Scenario::new("oval", "gopigo", "line");
        scenario.speed_mps = Some(0.13);
        scenario.start.offset_m = -0.215;
        scenario.driver_options.insert("form".into(), "document".into());
        let back: Scenario = toml::from_str(&scenario.to_toml()).unwrap();
        assert_eq!(back, scenario);
    }

    #[test]
    fn a_mission_gives_up_at_its_own_vehicles_voltage() {
        let empty_v = |scenario: &Scenario| {
            let options = scenario.resolve_driver_options();
            options.get("empty_v").and_then(toml::Value::as_float)
        };
        let mut scenario = Scenario::new("warehouse", "warehouse-cart", "mission");
        assert_eq!(empty_v(&scenario), Some(13.2));
        scenario.vehicle = "gopigo".to_owned();
        assert_eq!(empty_v(&scenario), Some(7.2));
        scenario.driver_options.insert("empty_v".into(), 6.0.into());
        assert_eq!(empty_v(&scenario), Some(6.0));
        let other = Scenario::new("oval", "gopigo", "line");
        assert_eq!(empty_v(&other), None);
    }

    #[test]
    fn unknown_worlds_are_answered_with_families_and_files() {
        let error = find_world("random-lime:3").unwrap_err().to_string();
        for word in [
            "did you mean \"random-line:3\"?",
            "oval",
            "random-race",
            "ends in .toml",
        ] {
            assert!(error.contains(word), "{word:?} in {error}");
        }
        assert!(
            find_world("ovall")
                .unwrap_err()
                .to_string()
                .contains("did you mean \"oval\"?")
        );
        assert!(
            find_vehicle("gopiga")
                .unwrap_err()
                .to_string()
                .contains("ends in .toml")
        );
    }

    #[test]
    fn nonsense_is_refused_with_the_key() {
        let mut scenario = Scenario::new("oval", "gopigo", "line");
        scenario.speed_mps = Some(f64::NAN);
        assert!(scenario.check().unwrap_err().to_string().contains("speed_mps"));
        assert!(toml::from_str::<Scenario>("world = 'a'\nvehicle = 'b'\ndriver = 'c'\nlapps = 2").is_err());
        assert!(
            Scenario {
                laps: 0,
                ..Scenario::new("a", "b", "c")
            }
            .check()
            .is_err()
        );
    }
}
