//! What a frame shows: street, codes, signs and lights, and for how long.

use super::chart::Step;
use super::{MissionDriver, PAST_CROSSING_M, look};
use senda_core::Observation;
use senda_geom::trig;
use senda_vision::street::trace::Expected;
use senda_vision::{Detection, ObjectClass, StreetEyes};

impl MissionDriver {
    pub(super) fn look(&mut self, observation: &Observation) {
        let Some(frame) = observation.first_frame() else {
            return;
        };
        self.clock.frame = self.clock.now;
        self.counts.frames = self.counts.frames.wrapping_add(1);
        let image = &frame.image;
        if self.eyes.as_ref().is_none_or(|eyes| !eyes.fits(image)) {
            let (width, height) = (image.width(), image.height());
            self.eyes = Some(StreetEyes::new(
                &self.body.cameras[0],
                width,
                height,
                self.options.colours,
            ));
        }
        let expected = match self.step {
            Step::CrossJunction | Step::CrossBack => Expected {
                left_m: self.beyond.left_at(0.26),
                within_m: 0.06,
            },
            _ => Expected::default(),
        };
        let eyes = self.eyes.as_mut().expect("made above");
        self.view.clone_from(eyes.look(image, expected));
        if self.view.line.points.len() >= 3 {
            self.clock.line = self.clock.now;
        }
        if self.view.crossing.is_some() {
            self.clock.crossing = self.clock.now;
        }
        let reads = matches!(
            self.step,
            Step::WaitPackage | Step::ToArea | Step::TakeStreet | Step::Return
        );
        self.seen_codes.clear();
        if reads && self.counts.frames.is_multiple_of(self.options.read_every) {
            let least_px = self.options.code_part * image.width() as f64;
            self.seen_codes.extend_from_slice(self.reader.read(image));
            let near = self
                .seen_codes
                .iter()
                .map(|code| (code.text.as_str(), code.size_px()));
            let near = near.filter(|(_, size_px)| f64::from(*size_px) >= least_px);
            if let Some([one, other]) = self.codes.take(near)
                && self.step == Step::WaitPackage
            {
                self.events.push(format!(
                    "two packages are shown, I{one} and I{other}: waits until one of them is gone"
                ));
            }
        }
        let detects = matches!(self.step, Step::Search | Step::WaitGreen);
        self.detections.clear();
        if detects && self.counts.frames.is_multiple_of(self.options.detect_every) {
            self.detections.extend_from_slice(self.detector.detect(image));
            let camera = self.body.cameras[0].resized(image.width() as u32, image.height() as u32);
            let least_px = self.options.sign_part * image.width() as f64;
            // What is smaller belongs to other areas; of several lights the tallest is the nearest.
            let near = |detection: &&Detection| {
                f64::from(detection.height_px()) >= least_px && look::stands(&camera, detection)
            };
            for detection in self.detections.iter().filter(near) {
                self.signs.take(detection);
            }
            let is_light = |one: &&Detection| !matches!(one.class, ObjectClass::Sign(_));
            let lights = self.detections.iter().filter(near).filter(is_light);
            if let Some(light) = lights.max_by(|a, b| a.height_px().total_cmp(&b.height_px())) {
                let [u, v] = light.middle_px().map(f64::from);
                let ray =
                    camera.mounting.vehicle_from_camera() * camera.lens.ray(senda_geom::Vec2::new(u, v));
                let bearing_rad = self.way.turned_rad + trig::atan2(ray.y, ray.x);
                self.light.take(light, bearing_rad, self.clock.now);
            }
        }
        self.count();
    }

    /// Counts for how many frames in a row something has been seen.
    fn count(&mut self) {
        let counts = &mut self.counts;
        let run = |count: u32, seen: bool| if seen { count + 1 } else { 0 };
        let near = |limit_m: f64| {
            self.view
                .crossing
                .is_some_and(|crossing| crossing.distance_m < limit_m)
        };
        counts.crossing = run(
            counts.crossing,
            near(self.options.approach_m) && self.way.stop_m > PAST_CROSSING_M,
        );
        if self.step == Step::Return && self.depot_ahead && counts.crossing >= 2 {
            // That of the depot whose code turned it back: driven over, and behind from here on.
            (counts.crossing, self.depot_ahead, self.way.stop_m) = (0, false, 0.0);
        }
        let reach_m = if self.step == Step::Return { 0.45 } else { 0.62 };
        let ahead = self
            .view
            .junction
            .is_some_and(|junction| junction.distance_m < reach_m);
        counts.junction = run(counts.junction, ahead);
        let line = &self.view.line;
        // As it is remembered, or, where a bend of the next street has drawn what is remembered aside, under the vehicle and along it.
        let below = line.points.first().is_some_and(|first| {
            first.x < 0.34
                && line.length_m() > 0.1
                && line.direction_rad(0.05).is_some_and(|direction_rad| {
                    (trig::tan(direction_rad) - self.beyond.slope()).abs() < 0.3
                        || (direction_rad.abs() < 0.2 && first.y.abs() < 0.05)
                })
        });
        counts.below = run(counts.below, below);
        counts.found = run(counts.found, line.length_m() > 0.08);
    }
}
