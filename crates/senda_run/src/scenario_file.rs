//! Where scenarios come from: a file that a person wrote, or a recording.

use crate::own_file::{self, Kind};
use crate::{RunError, Scenario, pilot};
use std::path::Path;

const SCENARIO_FILE: Kind = Kind {
    name: "scenario file",
    help: "the least that one says is world = \"oval\", vehicle = \"gopigo\" and driver = \"line\", a line each",
};

impl Scenario {
    /// Reads a scenario file, or the scenario of a recording. Errors name the line. Files that a scenario file names are sought beside
    /// it first, then where senda runs.
    pub fn load(path: &Path) -> Result<Self, RunError> {
        if path
            .extension()
            .is_some_and(|end| end.eq_ignore_ascii_case("mcap"))
        {
            return Self::of_recording(path);
        }
        let mut scenario: Self = own_file::load(path, &SCENARIO_FILE)?;
        scenario.seek_beside(path);
        Ok(scenario)
    }

    /// What a recording of senda was driven by, in the world that it holds.
    fn of_recording(path: &Path) -> Result<Self, RunError> {
        let header = senda_data::Recording::read(path)?.header;
        let wrong = |found: String| RunError::File {
            path: path.to_owned(),
            reason: format!(
                "expected a recording of a run in the simulator, whose scenario can be repeated, but {found}"
            ),
        };
        if let Some(origin) = header.origin() {
            return Err(wrong(format!("it was imported from {}", origin.format)));
        }
        let mut scenario: Self = toml::from_str(&header.scenario)
            .map_err(|error| wrong(format!("its scenario cannot be read: {}", error.message())))?;
        if scenario.driver == pilot::MANUAL {
            return Err(wrong("a person drove".to_owned()));
        }
        scenario.recorded_world = header.world;
        Ok(scenario)
    }

    /// Whether another scenario is driven in the same world with the same light, floor, direction and package.
    fn has_world_of(&self, other: &Self) -> bool {
        let world = |scenario: &Self| {
            let Self {
                world,
                light,
                floor,
                reverse,
                package,
                seed,
                ..
            } = scenario.clone();
            (world, light, floor, reverse, package, seed)
        };
        world(self) == world(other)
    }

    /// Drops a recorded world that other settings than those of `recorded` no longer describe.
    pub fn keep_recorded_world(&mut self, recorded: &Self) {
        if !self.has_world_of(recorded) {
            self.recorded_world = None;
        }
    }

    /// Puts a scenario file's folder before the names of files that lie beside it.
    pub(crate) fn seek_beside(&mut self, file: &Path) {
        let worlds = [&mut self.world, &mut self.vehicle].into_iter();
        for name in worlds.chain(&mut self.calibration) {
            seek_beside(file, name);
        }
        for option in pilot::FILE_OPTIONS {
            if let Some(toml::Value::String(name)) = self.driver_options.get_mut(option) {
                seek_beside(file, name);
            }
        }
    }

    /// Refuses options that the driver does not know. Where they stand in the scenario's file, its line is named.
    pub fn check_driver_options(&self, file: Option<&Path>) -> Result<(), RunError> {
        let Err(refused) = pilot::check_options(&self.driver, &self.driver_options) else {
            return Ok(());
        };
        let line = file
            .and_then(|path| std::fs::read_to_string(path).ok())
            .and_then(|text| line_of_option(&text, &refused.key));
        Err(match (file, line) {
            (Some(path), Some(line)) => RunError::File {
                path: format!("{}:{line}", path.display()).into(),
                reason: format!("driver_options of `{}`: {}", self.driver, refused.reason),
            },
            _ => RunError::DriverOptions {
                driver: self.driver.clone(),
                reason: refused.reason,
            },
        })
    }
}

/// Puts the folder of `file` before a name that is relative and lies there.
pub(crate) fn seek_beside(file: &Path, name: &mut String) {
    let Some(path) = file.parent().map(|folder| folder.join(&*name)) else {
        return;
    };
    if Path::new(name).is_relative() && path.is_file() {
        *name = path.display().to_string();
    }
}

/// The line (from 1) on which a key of `[driver_options]` stands; dots lead into its tables.
fn line_of_option(text: &str, key: &str) -> Option<usize> {
    let root = toml::de::DeTable::parse(text).ok()?;
    let mut table = root.get_ref();
    let mut byte = None;
    for part in std::iter::once("driver_options").chain(key.split('.')) {
        let (name, value) = table.iter().find(|(name, _)| name.get_ref().as_ref() == part)?;
        byte = Some(name.span().start);
        match value.get_ref() {
            toml::de::DeValue::Table(inner) => table = inner,
            _ => break,
        }
    }
    byte.map(|byte| 1 + text.bytes().take(byte).filter(|byte| *byte == b'\n').count())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{find_vehicle, find_world};
    use senda_world::{VehicleSpec, World};

    /// A world named in a scenario file was sought where senda ran, and the error did not say so.
    #[test]
    fn files_are_sought_beside_the_scenario_file_first() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scenario.toml");
        std::fs::write(&path, "world = 'w.toml'\nvehicle = 'gopigo'\ndriver = 'line'\n").unwrap();
        assert_eq!(Scenario::load(&path).unwrap().world, "w.toml");
        let world = folder.path().join("w.toml");
        std::fs::write(&world, World::named("oval").unwrap().to_toml()).unwrap();
        let scenario = Scenario::load(&path).unwrap();
        assert_eq!(Path::new(&scenario.world), world);
        assert!(scenario.resolve_world().is_ok());
    }

    /// "A run can be repeated from its recording alone" was promised, and no command did it.
    #[test]
    fn a_recording_is_repeated_in_the_world_that_it_holds() {
        let folder = tempfile::tempdir().unwrap();
        let world = folder.path().join("w.toml");
        std::fs::write(&world, World::named("straight").unwrap().to_toml()).unwrap();
        let scenario = Scenario {
            time_limit_s: Some(1.0),
            reverse: true,
            floor: Some("dark".to_owned()),
            ..Scenario::new(world.to_str().unwrap(), "gopigo", "line")
        };
        let run = folder.path().join("run.mcap");
        let drive = |scenario: &Scenario| {
            let sink = Some(std::io::Cursor::new(Vec::new()));
            let (_, sink) = crate::drive::run(scenario, sink, &mut crate::Ears::deaf()).unwrap();
            sink.unwrap().into_inner()
        };
        let first = drive(&scenario);
        std::fs::write(&run, &first).unwrap();
        std::fs::remove_file(&world).unwrap();
        let again = Scenario::load(&run).unwrap();
        assert!(drive(&again) == first, "another run");
        // In another light it is another world, and that one's file is gone.
        let mut other = again.clone();
        other.light = Some("lamp".to_owned());
        other.keep_recorded_world(&again);
        assert!(other.resolve_world().is_err());
    }

    /// A missing file was answered with "No such file or directory (os error 2)", a misspelt key with a list of all.
    #[test]
    fn files_that_cannot_be_used_say_what_was_expected_and_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scenario.toml");
        let refused = |content: &[u8]| {
            std::fs::write(&path, content).unwrap();
            Scenario::load(&path).unwrap_err().to_string()
        };
        for (content, words) in [
            (&b""[..], &["an empty file", "world = \"oval\""][..]),
            (
                b"# nothing yet\n",
                &["missing field `world`", "driver = \"line\""],
            ),
            (b"world = '\xff'", &["no UTF-8 text from byte 9 on"]),
            (b"world = 'oval'\nlpas = 2\n", &["line 2", "did you mean `laps`?"]),
            (
                b"[options]\nform = 'shape'\n",
                &["did you mean `driver_options`?"],
            ),
        ] {
            let error = refused(content);
            for word in words.iter().chain(&["scenario.toml"]) {
                assert!(error.contains(word), "{word:?} in {error}");
            }
        }
        let nowhere = folder.path().join("nope.toml");
        let nowhere = nowhere.to_str().unwrap();
        let scenario = Scenario::load(Path::new(nowhere)).unwrap_err().to_string();
        assert!(
            scenario.contains("expected a scenario file, but found no such file"),
            "{scenario}"
        );
        let world = find_world(nowhere).unwrap_err().to_string();
        assert!(
            world.contains("expected a world file") && world.contains("senda world list"),
            "{world}"
        );
        let vehicle = find_vehicle(nowhere).unwrap_err().to_string();
        assert!(vehicle.contains("expected a vehicle file"), "{vehicle}");
        let body = VehicleSpec::named("gopigo").unwrap().body();
        let calibration = crate::calibration::believed_body(&body, Some(nowhere))
            .unwrap_err()
            .to_string();
        assert!(
            calibration.contains("expected a calibration file"),
            "{calibration}"
        );
        let plan = crate::sweep::Plan::load(Path::new(nowhere))
            .unwrap_err()
            .to_string();
        assert!(plan.contains("expected a sweep plan"), "{plan}");
    }

    #[test]
    fn driver_options_that_nobody_knows_are_named_with_their_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scenario.toml");
        let text =
            "world = 'oval'\nvehicle = 'gopigo'\ndriver = 'line'\n[driver_options]\nfrm = 'document'\n";
        std::fs::write(&path, text).unwrap();
        let mut scenario = Scenario::load(&path).unwrap();
        let error = scenario
            .check_driver_options(Some(&path))
            .unwrap_err()
            .to_string();
        assert!(error.contains("scenario.toml:5: "), "{error}");
        assert!(error.ends_with("did you mean `form`?"), "{error}");
        // Of two keys of one name, the one that is to blame.
        let text = "world = 'oval'\nvehicle = 'gopigo'\ndriver = 'line'\n[driver_options.track]\n[driver_options.follow]\n\
                    settle_m = 1.0\nsetle_s = 2\n";
        std::fs::write(&path, text).unwrap();
        let nested = Scenario::load(&path).unwrap();
        let error = nested.check_driver_options(Some(&path)).unwrap_err().to_string();
        assert!(
            error.contains("scenario.toml:7: ") && error.contains("follow: "),
            "{error}"
        );
        assert!(error.ends_with("did you mean `settle_s`?"), "{error}");
        // From a flag: no line to name.
        let error = scenario.check_driver_options(None).unwrap_err().to_string();
        assert!(error.starts_with("options of driver `line`: "), "{error}");
        scenario.driver_options = toml::from_str("form = 'documnet'").unwrap();
        let error = scenario.check_driver_options(None).unwrap_err().to_string();
        assert!(error.contains("did you mean `document`?"), "{error}");
        // Every ready driver takes its own defaults.
        for (driver, _) in pilot::DRIVERS {
            Scenario::new("oval", "gopigo", driver)
                .check_driver_options(None)
                .unwrap();
        }
    }
}
