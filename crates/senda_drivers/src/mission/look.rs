//! Signs and lights over several frames: votes on a digit, a light's colour and where it stands.

use senda_core::Stamp;
use senda_geom::{Camera, Vec2};
use senda_vision::{Detection, ObjectClass};

/// A board or light of 10 cm or more that is 0.4 m away hides the floor for at least so far (m): its top is half as high as the
/// camera or higher.
const HIDES_M: f64 = 0.8;

/// Whether what was found may stand upright: bars of a crossing and pieces of a line lie on the floor, where the upper edge
/// of their boxes meets it close by.
pub(super) fn stands(camera: &Camera, detection: &Detection) -> bool {
    let [left, top, right, _] = detection.box_px;
    let upper_edge = Vec2::new(0.5 * f64::from(left + right), f64::from(top));
    let meets = camera.floor_from_pixel(upper_edge);
    meets.is_none_or(|floor| floor.length_squared() > HIDES_M * HIDES_M)
}

/// Parts of a turn in place in search of something: to the left, to the right, back to the middle.
pub(super) const LEGS: u32 = 3;

/// Where a part of the turn ends (rad).
pub(super) fn leg_rad(leg: u32, reach_rad: f64) -> f64 {
    match leg % LEGS {
        0 => reach_rad,
        1 => -reach_rad,
        _ => 0.0,
    }
}

/// Votes for digits.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Signs {
    votes: [u32; 10],
}

impl Signs {
    /// Counts a detection that is a sign.
    pub(super) fn take(&mut self, detection: &Detection) {
        if let ObjectClass::Sign(digit) = detection.class
            && let Some(votes) = self.votes.get_mut(usize::from(digit))
        {
            *votes += 1;
        }
    }

    /// The digit that leads by at least two votes.
    pub(super) fn digit(&self) -> Option<u8> {
        let best = (0..10u8).max_by_key(|digit| (self.votes[usize::from(*digit)], 10 - digit))?;
        let second = (0..10u8)
            .filter(|digit| *digit != best)
            .map(|digit| self.votes[usize::from(digit)])
            .max()?;
        (self.votes[usize::from(best)] >= second + 2).then_some(best)
    }
}

/// A light: where it is and what it has shown.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LightSeen {
    sightings: u32,
    bearing_rad: f64,
    /// Detections in a row of the same colour.
    green_run: u32,
    red_run: u32,
    last_red: Option<Stamp>,
    green_since: Option<Stamp>,
    /// Since when it has been waited for at this area, over all of its searches.
    waiting_since: Option<Stamp>,
    last_seen: Stamp,
    /// Where something was taken for a light that was not there when it was waited for.
    refuted_rad: Option<f64>,
}

/// A light that was red not longer ago than this has just turned green (s): a detection every fifth frame, two in a row.
const FRESH_S: f64 = 1.2;

/// So near to where no light was there is none (rad).
const REFUTED_RAD: f64 = 0.15;

impl LightSeen {
    /// Takes a detection at a bearing (rad, left positive, from where the street leads).
    pub(super) fn take(&mut self, detection: &Detection, bearing_rad: f64, now: Stamp) {
        if self
            .refuted_rad
            .is_some_and(|refuted_rad| (bearing_rad - refuted_rad).abs() < REFUTED_RAD)
        {
            return;
        }
        match detection.class {
            ObjectClass::RedLight => {
                (self.red_run, self.green_run) = (self.red_run + 1, 0);
                (self.last_red, self.green_since) = (Some(now), None);
            }
            ObjectClass::GreenLight => {
                (self.green_run, self.red_run) = (self.green_run + 1, 0);
                self.green_since.get_or_insert(now);
            }
            ObjectClass::Sign(_) => return,
        }
        self.sightings += 1;
        self.last_seen = now;
        self.bearing_rad = bearing_rad;
    }

    /// Whether there is one: seen twice.
    pub(super) fn known(&self) -> bool {
        self.sightings >= 2
    }

    pub(super) fn begin_waiting(&mut self, now: Stamp) {
        self.green_run = 0;
        self.waiting_since.get_or_insert(now);
    }

    /// How long it has been waited for at this area (s).
    pub(super) fn waited_s(&self, now: Stamp) -> f64 {
        self.waiting_since.map_or(0.0, |since| now.since_s(since))
    }

    /// How long it has not been seen, red or green (s).
    pub(super) fn unseen_s(&self, now: Stamp) -> f64 {
        now.since_s(self.last_seen)
    }

    /// It was none: what is to be known of it before the next search.
    pub(super) fn refuted(&self) -> Self {
        Self {
            waiting_since: self.waiting_since,
            refuted_rad: Some(self.bearing_rad),
            ..Self::default()
        }
    }

    /// Green in two detections in a row, and red a moment before: time enough is left. Or green for so long that it may be
    /// green for ever.
    pub(super) fn turned_green(&self, now: Stamp, patience_s: f64) -> bool {
        let fresh = self.last_red.is_some_and(|red| now.since_s(red) < FRESH_S);
        let patient = self
            .green_since
            .is_some_and(|since| now.since_s(since) > patience_s);
        self.green_run >= 2 && (fresh || patient)
    }

    /// Heading from which to watch it (rad): as little turned from the street as its view allows.
    pub(super) fn watch_from_rad(&self) -> f64 {
        /// Seen comfortably within a view of 60°.
        const VIEW_RAD: f64 = 0.36;
        self.bearing_rad - self.bearing_rad.clamp(-VIEW_RAD, VIEW_RAD)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(class: ObjectClass) -> Detection {
        Detection {
            class,
            box_px: [0.0, 0.0, 10.0, 10.0],
            confidence: 0.9,
        }
    }

    #[test]
    fn what_lies_on_the_floor_is_no_light() {
        let mut camera = crate::test_vehicle::gopigo().cameras[0].clone();
        (camera.mounting.z_m, camera.mounting.tilt_rad) = (0.2, 0.35);
        let over = |bottom_m: f64, top_m: f64| {
            let at = |x_m: f64| {
                let pixel = camera.pixel_from_floor(Vec2::new(x_m, 0.0)).unwrap();
                pixel.y as f32
            };
            Detection {
                box_px: [75.0, at(top_m), 85.0, at(bottom_m)],
                ..seen(ObjectClass::RedLight)
            }
        };
        assert!(!stands(&camera, &over(0.3, 0.45)), "a bar of a crossing");
        assert!(stands(&camera, &over(0.6, 4.0)), "18 cm high");
        let mut above = over(0.6, 4.0);
        above.box_px[1] = 0.0;
        assert!(stands(&camera, &above), "above the horizon");
    }

    #[test]
    fn a_digit_needs_a_lead_of_two() {
        let mut signs = Signs::default();
        signs.take(&seen(ObjectClass::Sign(1)));
        assert_eq!(signs.digit(), None);
        signs.take(&seen(ObjectClass::Sign(1)));
        assert_eq!(signs.digit(), Some(1));
        signs.take(&seen(ObjectClass::Sign(0)));
        assert_eq!(signs.digit(), None, "a sign that contradicts");
        signs.take(&seen(ObjectClass::Sign(1)));
        assert_eq!(signs.digit(), Some(1));
    }

    #[test]
    fn what_was_no_light_is_not_taken_for_one_again() {
        let at = Stamp::from_s;
        let mut light = LightSeen::default();
        let green = seen(ObjectClass::GreenLight);
        light.take(&green, 0.3, at(0.0));
        light.take(&green, 0.3, at(0.2));
        light.begin_waiting(at(1.0));
        assert!(light.known() && light.unseen_s(at(21.2)) > 20.9);
        let mut light = light.refuted();
        light.take(&green, 0.35, at(21.0));
        light.take(&green, 0.35, at(21.2));
        assert!(!light.known());
        light.take(&green, -0.4, at(22.0));
        light.take(&green, -0.4, at(22.2));
        assert!(light.known(), "another one");
        light.begin_waiting(at(23.0));
        light.take(&green, -0.4, at(24.0));
        assert!(light.unseen_s(at(25.0)) < 1.1);
        assert!(light.waited_s(at(31.0)) > 29.9, "over both searches");
    }

    #[test]
    fn only_fresh_green_counts() {
        let at = Stamp::from_s;
        let mut light = LightSeen::default();
        light.take(&seen(ObjectClass::GreenLight), 0.3, at(0.0));
        light.take(&seen(ObjectClass::GreenLight), 0.3, at(0.25));
        assert!(
            light.known() && !light.turned_green(at(0.3), 25.0),
            "it may turn red at once"
        );
        light.take(&seen(ObjectClass::RedLight), 0.3, at(3.0));
        light.take(&seen(ObjectClass::GreenLight), 0.3, at(3.25));
        assert!(!light.turned_green(at(3.25), 25.0));
        light.take(&seen(ObjectClass::GreenLight), 0.3, at(3.5));
        assert!(light.turned_green(at(3.5), 25.0));
        assert!(!light.turned_green(at(6.0), 25.0), "not any more");
        assert!(light.turned_green(at(30.0), 25.0), "for ever green");
    }
}
