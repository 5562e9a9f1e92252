//! What to say of a scenario that will be driven otherwise than it asks.

use crate::guard::BLIND_LIMIT_S;
use crate::scenario::find_vehicle;
use crate::{RunError, Scenario, calibration, pilot};

impl Scenario {
    /// What to say to whoever asks for a higher speed than the vehicle's highest, for a camera that it plainly has not, or for what a
    /// mission or an open path does not have.
    pub fn notes(&self) -> Result<Vec<String>, RunError> {
        let vehicle = find_vehicle(&self.vehicle)?;
        let most_mps = vehicle.speed_limit_mps;
        let wanted_mps = self.speed_mps.filter(|wanted_mps| *wanted_mps > most_mps);
        let speed = wanted_mps.map(|wanted_mps| {
            format!(
                "a speed of {wanted_mps} m/s was asked for, but {} goes {most_mps:.2} m/s at most: it drives as for that",
                vehicle.name
            )
        });
        let camera = calibration::note(&vehicle.body(), self.calibration.as_deref())?;
        let age_s = self.latency_s + vehicle.cameras.first().map_or(0.0, |camera| camera.latency_s);
        let late = (age_s > BLIND_LIMIT_S).then(|| {
            format!(
                "pictures reach the driver {age_s:.2} s old, and the guard stops a vehicle whose newest one is older than {BLIND_LIMIT_S} s: \
                 it will not move"
            )
        });
        let is_asked_again = self.laps > 1 && self.driver != pilot::MANUAL && self.driver != "mission";
        let laps = (is_asked_again && !self.resolve_world()?.path.is_closed()).then(|| {
            format!(
                "{} is open: it is driven once, to its end, and not in {} laps",
                self.world, self.laps
            )
        });
        let package = self.package.as_ref().filter(|_| {
            let world = self.resolve_world();
            world.is_ok_and(|world| world.things.iter().all(|thing| thing.name != "package"))
        });
        let package = package.map(|code| {
            format!(
                "{} shows no package, so nothing will say {code}: --package is for warehouses",
                self.world
            )
        });
        let of_mission = self.mission_notes();
        let notes = speed.into_iter().chain(camera).chain(late).chain(laps);
        Ok(notes
            .chain(package)
            .chain(self.road_note())
            .chain(of_mission)
            .collect())
    }

    /// What to say of options of the lane driver's form `road` in another form.
    fn road_note(&self) -> Option<String> {
        let options = &self.driver_options;
        let form = options
            .get("form")
            .and_then(toml::Value::as_str)
            .unwrap_or("curve");
        let road = options.get("road")?.as_table()?;
        let keys: Vec<String> = road.keys().map(|key| format!("road.{key}")).collect();
        (self.driver == "lane" && form != "road" && !keys.is_empty()).then(|| {
            format!(
                "{}: only the form `road` reads this, and the form is `{form}`: it has no effect",
                keys.join(", ")
            )
        })
    }

    /// What a delivery will not do though it is asked to.
    fn mission_notes(&self) -> Vec<String> {
        /// Of narrower frames no code was read in the warehouse (measured: 240 px read, 200 px did not).
        const CODES_WIDTH_PX: u32 = 240;
        /// From this width on the package was read at all of 16 starts; at 320 px at 12.
        const SURE_WIDTH_PX: u32 = 400;
        let mut notes = Vec::new();
        if self.driver != "mission" {
            return notes;
        }
        match self.image_px {
            Some([width_px, _]) if width_px < CODES_WIDTH_PX => notes.push(format!(
                "frames {width_px} px wide are too small for codes to be read, {CODES_WIDTH_PX} px is the least: no package will be seen"
            )),
            Some([width_px, _]) if width_px < SURE_WIDTH_PX => notes.push(format!(
                "in frames {width_px} px wide the package's code may not be read from where the vehicle stands; from {SURE_WIDTH_PX} px on it is"
            )),
            _ => {}
        }
        if self.reverse {
            notes.push("a mission knows one way round, and its signs and codes face it: with reverse it sees their backs".to_owned());
        }
        if self.laps > 1 {
            notes.push(format!(
                "a mission ends when it is back at the start: {} laps are one delivery",
                self.laps
            ));
        }
        notes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_speed_that_the_vehicle_has_not_is_noted() {
        let mut scenario = Scenario::new("oval", "gopigo", "line");
        assert!(scenario.notes().unwrap().is_empty());
        scenario.speed_mps = Some(0.4);
        assert!(scenario.notes().unwrap().is_empty());
        scenario.speed_mps = Some(5.0);
        let note = scenario.notes().unwrap().remove(0);
        assert!(
            note.contains("5 m/s") && note.contains("gopigo goes 0.40 m/s at most"),
            "{note}"
        );
    }

    #[test]
    fn what_a_mission_does_not_do_is_said() {
        let mut scenario = Scenario::new("warehouse", "warehouse-cart", "mission");
        scenario.image_px = Some([400, 300]);
        assert!(scenario.mission_notes().is_empty());
        scenario.image_px = Some([320, 240]);
        assert!(scenario.mission_notes()[0].contains("may not be read"));
        (scenario.image_px, scenario.reverse, scenario.laps) = (Some([160, 120]), true, 3);
        let notes = scenario.mission_notes();
        for (note, words) in notes.iter().zip(["160 px wide", "one way round", "3 laps"]) {
            assert!(note.contains(words), "{notes:?}");
        }
        assert_eq!(notes.len(), 3);
        scenario.driver = "expert".to_owned();
        assert!(scenario.mission_notes().is_empty());
    }

    /// Options and a package that nobody reads were taken without a word.
    #[test]
    fn what_has_no_effect_is_said() {
        let mut scenario = Scenario::new("oval-lane", "gopigo", "lane");
        scenario.driver_options = toml::from_str("road = { centring = 0.5 }").unwrap();
        scenario.package = Some("I1".to_owned());
        let notes = scenario.notes().unwrap();
        assert!(notes[0].contains("oval-lane shows no package"), "{notes:?}");
        assert!(
            notes[1].contains("road.centring: only the form `road`") && notes[1].contains("`curve`"),
            "{notes:?}"
        );
        assert_eq!(notes.len(), 2);
        scenario.driver_options.insert("form".to_owned(), "road".into());
        scenario.world = "warehouse".to_owned();
        assert!(scenario.notes().unwrap().is_empty());
    }

    /// "1 of 3 laps" was completed.
    #[test]
    fn an_open_path_is_driven_once_and_asking_for_more_is_answered() {
        let wanted = |scenario: &Scenario| {
            let world = scenario.resolve_world().unwrap();
            crate::referee::course(scenario, &world).laps
        };
        let mut scenario = Scenario::new("straight", "gopigo", "line");
        assert!(scenario.notes().unwrap().is_empty());
        scenario.laps = 3;
        assert_eq!(wanted(&scenario), Some(1.0));
        assert!(scenario.notes().unwrap()[0].contains("straight is open"));
        scenario.world = "oval".into();
        assert_eq!(wanted(&scenario), Some(3.0));
        assert!(scenario.notes().unwrap().is_empty());
    }
}
