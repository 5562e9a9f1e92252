//! Judges a delivery in a warehouse by where the vehicle really was: stops, red lights, the depot reached, the return.
//!
//! What the driver believes (its events) is kept beside the figures and counts for none of them.

use senda_core::Truth;
use senda_geom::{Pose2, angle};
use senda_world::{Place, PlaceKind, Texture, World};
use serde::{Deserialize, Serialize};

/// Slower than this it stands (m/s, rad/s).
const STANDS_MPS: f64 = 0.004;
const STANDS_RADPS: f64 = 0.03;
/// A halt shorter than this is a moment of a manoeuvre (s).
const STOP_S: f64 = 0.4;
/// Unloading takes at least so long (s).
const UNLOAD_S: f64 = 2.0;
/// A vehicle that stands has stopped at a place when the crossing begins at most this far ahead of its origin (m), and it
/// stands on that street, looking along it within 45°.
const REACH_M: f64 = 0.6;
/// Driving begins when it has come this far from where it was put (m).
const SET_OFF_M: f64 = 0.1;

/// One stop before a crossing.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Stop {
    /// `start`, `area 0`, `depot 2`.
    pub place: String,
    /// When it stood there first (s).
    pub time_s: f64,
    /// From the vehicle's origin to the crossing's near edge along the street, when it first stood (m).
    pub distance_m: f64,
    /// That minus the distance at which it was to stop (m).
    pub distance_error_m: f64,
    /// Heading against the street, left positive (rad).
    pub angle_error_rad: f64,
    /// How long it stayed, turns in place included (s).
    pub stood_s: f64,
}

/// What became of a delivery.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Delivery {
    /// The depot that the package's code names; `None`: the world shows no readable package.
    pub goal: Option<u8>,
    /// The depot before whose crossing it stood long enough to be unloaded.
    pub delivered_to: Option<u8>,
    /// Whether that is the goal.
    pub correct: bool,
    /// Whether it stands before the start's crossing at the end, having been away.
    pub returned: bool,
    /// How often it drove onto an area's crossing while the light was red.
    pub red_light_violations: u32,
    /// How often its origin left the streets.
    pub departures: u32,
    /// Every stop before a crossing.
    pub stops: Vec<Stop>,
    /// Time of the whole run (s).
    pub time_s: f64,
    /// What the driver reported, with its time (s): the transitions of its state chart.
    pub events: Vec<Event>,
}

/// Something that the driver reported.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Event {
    /// When (s).
    pub time_s: f64,
    /// What.
    pub text: String,
}

impl Delivery {
    /// Delivered to the goal, returned, no red light passed, never off the streets.
    pub fn is_whole(&self) -> bool {
        self.correct && self.returned && self.red_light_violations == 0 && self.departures == 0
    }

    /// Whether it succeeded, and if not, why.
    pub fn headline(&self) -> String {
        if self.is_whole() {
            return "delivered and returned".to_owned();
        }
        let why = if self.red_light_violations > 0 {
            "a red light was passed"
        } else if self.departures > 0 {
            "the vehicle left the streets"
        } else if self.delivered_to.is_some() && !self.correct {
            "the package was brought to another depot"
        } else if self.correct {
            "delivered, but not returned"
        } else {
            "the package was not delivered"
        };
        match self.reason() {
            Some(event) => format!("FAILED: {why}; at {:.1} s {}", event.time_s, event.text),
            None => format!("FAILED: {why}"),
        }
    }

    /// Where the mission gave up or turned back with its package, in its own words. `None` of a whole delivery, and where the run
    /// ended without either.
    pub fn reason(&self) -> Option<&Event> {
        let turned = |event: &&Event| {
            event.text.split_once(" -> ").is_some_and(|(from, to)| {
                to.starts_with("failed")
                    || (to.starts_with("return") && ["to_area", "take_street"].contains(&from))
            })
        };
        let whole = self.is_whole();
        self.events.iter().find(turned).filter(|_| !whole)
    }

    /// For people: one line a fact.
    pub fn text(&self) -> String {
        let depot =
            |number: Option<u8>| number.map_or_else(|| "none".to_owned(), |number| number.to_string());
        let mut text = format!(
            "{}\ndelivered to depot   {} (goal {}){}\nreturned             {}\nred lights passed    {}\noff the streets      {}\n\
             time                 {:.1} s\n",
            self.headline(),
            depot(self.delivered_to),
            depot(self.goal),
            if self.correct { ", correct" } else { "" },
            if self.returned { "yes" } else { "no" },
            self.red_light_violations,
            self.departures,
            self.time_s
        );
        for stop in &self.stops {
            text += &format!(
                "stop {:10}      at {:5.1} s, {:+.1} mm, {:+.1}°, stood {:.1} s\n",
                stop.place,
                stop.time_s,
                stop.distance_error_m * 1e3,
                stop.angle_error_rad.to_degrees(),
                stop.stood_s
            );
        }
        for event in &self.events {
            text += &format!("{:7.2} s  {}\n", event.time_s, event.text);
        }
        text
    }
}

/// What the vehicle was to do, as far as the world does not say it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeliveryRules {
    /// Crossings' near edges are to be this far ahead of the vehicle's origin when it stops (m).
    pub stop_m: f64,
    /// From its origin to its front (m): the front must not pass a red light.
    pub front_m: f64,
}

/// Judges the true poses of a run. `None`: the world is no warehouse.
pub fn judge(world: &World, truths: &[Truth], rules: DeliveryRules, events: Vec<Event>) -> Option<Delivery> {
    let warehouse = world.warehouse.as_ref()?;
    let mut delivery = Delivery {
        goal: goal(world),
        events,
        time_s: truths.last().map_or(0.0, |truth| truth.stamp.as_s()),
        ..Delivery::default()
    };
    let places: Vec<(&Place, Pose2)> = warehouse
        .places
        .iter()
        .map(|place| (place, warehouse.edge_of(&world.path, place)))
        .collect();
    let mut halts = Halts::default();
    let mut fronts: Vec<f64> = vec![f64::INFINITY; places.len()];
    let mut off = false;
    for truth in truths {
        let here = truth.world_from_vehicle;
        halts.step(truth, &places, rules.stop_m, &mut delivery.stops);
        let (_, nearest) = warehouse.nearest_street(&world.path, here.position());
        let is_off = nearest.offset_m.abs() > warehouse.street_width_m / 2.0;
        delivery.departures += u32::from(is_off && !off);
        off = is_off;
        for ((place, edge), last_m) in places.iter().zip(&mut fronts) {
            // Negative before the crossing; only what comes along its street counts.
            let seen = edge.inverse().transform(here.position());
            let along = here.forward().dot(edge.forward()) > 0.5 && seen.y.abs() < warehouse.street_width_m;
            let front_m = if along {
                seen.x + rules.front_m
            } else {
                f64::INFINITY
            };
            if *last_m < 0.0 && (0.0..0.3).contains(&front_m) && shows_red(world, place, truth.stamp.as_s()) {
                delivery.red_light_violations += 1;
            }
            *last_m = front_m;
        }
    }
    halts.finish(truths, &mut delivery.stops);
    let unloaded = delivery.stops.iter().find_map(|stop| {
        let number = stop.place.strip_prefix("depot ")?.parse::<u8>().ok()?;
        (stop.stood_s >= UNLOAD_S).then_some(number)
    });
    delivery.delivered_to = unloaded;
    delivery.correct = unloaded.is_some() && unloaded == delivery.goal;
    let ends_at_start = delivery
        .stops
        .last()
        .is_some_and(|stop| stop.place == "start" && stop.time_s + stop.stood_s >= delivery.time_s - 0.1);
    delivery.returned = ends_at_start;
    Some(delivery)
}

/// The depot of the package's code `I<n>`.
fn goal(world: &World) -> Option<u8> {
    world
        .things
        .iter()
        .find(|thing| thing.name == "package")
        .and_then(|thing| match &thing.texture {
            Texture::Qr { text, .. } => text.strip_prefix('I')?.parse().ok(),
            _ => None,
        })
}

fn shows_red(world: &World, place: &Place, time_s: f64) -> bool {
    let PlaceKind::Area {
        light: Some(name), ..
    } = &place.kind
    else {
        return false;
    };
    world
        .things
        .iter()
        .filter(|thing| thing.name == *name)
        .any(|thing| match &thing.texture {
            Texture::Light { program, .. } => !program.is_green(time_s),
            _ => false,
        })
}

/// Halts in the making.
#[derive(Default)]
struct Halts {
    began: Option<Pose2>,
    away: bool,
    /// Since when it stands (s), and whether that is counted already.
    since_s: Option<(f64, bool)>,
    /// The stop at which it still is: it ends when it drives on.
    open: Option<Pose2>,
}

impl Halts {
    fn step(&mut self, truth: &Truth, places: &[(&Place, Pose2)], stop_m: f64, stops: &mut Vec<Stop>) {
        let (here, now_s) = (truth.world_from_vehicle, truth.stamp.as_s());
        let began = *self.began.get_or_insert(here);
        self.away |= (here.position() - began.position()).length() > SET_OFF_M;
        if let Some(at) = self.open {
            if (here.position() - at.position()).length() < 0.05 {
                return;
            }
            // It drove on.
            if let Some(stop) = stops.last_mut() {
                stop.stood_s = now_s - stop.time_s;
            }
            (self.open, self.since_s) = (None, None);
        }
        let stands = truth.speed_mps.abs() < STANDS_MPS && truth.yaw_rate_radps.abs() < STANDS_RADPS;
        if !stands || !self.away {
            self.since_s = None;
            return;
        }
        let (since_s, counted) = *self.since_s.get_or_insert((now_s, false));
        if counted || now_s - since_s < STOP_S {
            return;
        }
        self.since_s = Some((since_s, true));
        let at = places.iter().find_map(|(place, edge)| {
            let seen = edge.inverse().transform(here.position());
            let turned_rad = angle::difference(here.heading_rad, edge.heading_rad);
            let before = (-REACH_M..0.1).contains(&seen.x) && seen.y.abs() < 0.1 && turned_rad.abs() < 0.8;
            before.then(|| (place.name(), -seen.x, turned_rad))
        });
        if let Some((place, distance_m, angle_error_rad)) = at {
            stops.push(Stop {
                place,
                time_s: since_s,
                distance_m,
                distance_error_m: distance_m - stop_m,
                angle_error_rad,
                stood_s: 0.0,
            });
            self.open = Some(here);
        }
    }

    fn finish(&mut self, truths: &[Truth], stops: &mut [Stop]) {
        if let (Some(_), Some(stop), Some(last)) = (self.open, stops.last_mut(), truths.last()) {
            stop.stood_s = last.stamp.as_s() - stop.time_s;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_core::Stamp;

    const RULES: DeliveryRules = DeliveryRules {
        stop_m: 0.26,
        front_m: 0.12,
    };

    #[test]
    fn a_failure_is_told_with_where_the_mission_turned() {
        let event = |time_s, text: &str| Event {
            time_s,
            text: text.into(),
        };
        let delivery = Delivery {
            events: vec![
                event(1.0, "wait_package -> to_area: package read, I1"),
                event(
                    9.0,
                    "take_street -> return: expected depot 1, but found the code of depot 0",
                ),
                event(30.0, "stop_at_start -> home: stands square"),
            ],
            ..Delivery::default()
        };
        assert!(
            delivery
                .headline()
                .contains("at 9.0 s take_street -> return: expected depot 1")
        );
        let whole = Delivery {
            correct: true,
            returned: true,
            ..delivery
        };
        assert_eq!(whole.reason(), None);
    }

    /// Drives along stations of the ring or a street, standing where asked: (street, from, to, stand for s afterwards).
    fn drive(world: &World, legs: &[(Option<usize>, f64, f64, f64)]) -> Vec<Truth> {
        let warehouse = world.warehouse.as_ref().unwrap();
        let mut truths: Vec<Truth> = Vec::new();
        let mut time_s = 0.0;
        for (street, from_m, to_m, stand_s) in legs {
            let path = street.map_or(&world.path, |index| &warehouse.streets[index].path);
            let mut push = |station_m: f64, speed_mps: f64, time_s: &mut f64| {
                truths.push(Truth {
                    stamp: Stamp::from_s(*time_s),
                    world_from_vehicle: path.pose_at(station_m),
                    speed_mps,
                    ..Truth::default()
                });
                *time_s += 0.05;
            };
            let steps = ((to_m - from_m) / 0.01) as usize;
            for i in 0..=steps {
                push(from_m + 0.01 * i as f64, 0.2, &mut time_s);
            }
            for _ in 0..(stand_s / 0.05) as usize {
                push(*to_m, 0.0, &mut time_s);
            }
        }
        truths
    }

    fn world() -> World {
        World::named("warehouse").unwrap()
    }

    /// Stations where a vehicle stops as it should.
    fn stop_m(world: &World, name: &str) -> f64 {
        let places = &world.warehouse.as_ref().unwrap().places;
        places
            .iter()
            .find(|place| place.name() == name)
            .unwrap()
            .near_edge_m()
            - 0.26
    }

    fn whole(world: &World, wait_s: f64) -> Vec<Truth> {
        let length_m = world.path.length_m();
        let (start_m, area_m) = (stop_m(world, "start"), stop_m(world, "area 0"));
        let warehouse = world.warehouse.as_ref().unwrap();
        let entry = world
            .path
            .project(warehouse.streets[0].path.pose_at(0.0).position())
            .station_m;
        let street_m = warehouse.streets[0].path.length_m();
        let exit = world
            .path
            .project(warehouse.streets[0].path.pose_at(street_m).position())
            .station_m;
        drive(
            world,
            &[
                (None, start_m, area_m, wait_s),
                (None, area_m, entry, 0.0),
                (Some(0), 0.0, stop_m(world, "depot 0") + 0.004, 3.0),
                (Some(0), stop_m(world, "depot 0") + 0.004, street_m, 0.0),
                (None, exit, length_m, 0.0),
                (None, 0.0, start_m, 1.0),
            ],
        )
    }

    #[test]
    fn a_whole_delivery_is_whole() {
        let world = world();
        // The light is green in 0..6 and 13..19 s: the area is reached after about 7 s.
        let delivery = judge(&world, &whole(&world, 7.0), RULES, Vec::new()).unwrap();
        assert!(delivery.is_whole(), "{delivery:?}");
        assert_eq!(delivery.delivered_to, Some(0));
        let places: Vec<&str> = delivery.stops.iter().map(|stop| stop.place.as_str()).collect();
        assert_eq!(places, ["area 0", "depot 0", "start"]);
        assert!((delivery.stops[1].distance_error_m + 0.004).abs() < 1e-6);
        assert!(
            delivery
                .stops
                .iter()
                .all(|stop| stop.angle_error_rad.abs() < 1e-6)
        );
    }

    #[test]
    fn red_lights_wrong_depots_and_missing_returns_are_seen() {
        let shown = world();
        let hasty = judge(&shown, &whole(&shown, 1.0), RULES, Vec::new()).unwrap();
        assert_eq!(hasty.red_light_violations, 1, "{hasty:?}");
        let other = shown.clone().with_package("I2").unwrap();
        let wrong = judge(&other, &whole(&other, 7.0), RULES, Vec::new()).unwrap();
        assert!(!wrong.correct && wrong.delivered_to == Some(0) && wrong.goal == Some(2));
        let mut truths = whole(&shown, 7.0);
        truths.truncate(truths.len() - 30);
        assert!(!judge(&shown, &truths, RULES, Vec::new()).unwrap().returned);
        let mut truths = whole(&shown, 7.0);
        for truth in &mut truths[40..60] {
            truth.world_from_vehicle = truth.world_from_vehicle.compose(Pose2::new(0.0, 0.11, 0.0));
        }
        assert_eq!(judge(&shown, &truths, RULES, Vec::new()).unwrap().departures, 1);
    }

    #[test]
    fn other_worlds_are_not_judged() {
        assert!(judge(&World::named("oval").unwrap(), &[], RULES, Vec::new()).is_none());
        let nothing = judge(&world(), &[], RULES, Vec::new()).unwrap();
        assert!(!nothing.returned && nothing.stops.is_empty());
    }
}
