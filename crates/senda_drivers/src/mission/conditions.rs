//! Whether a transition's condition holds.

use super::chart::{Step, When};
use super::{LOST_S, MissionDriver, halt, look};

/// Nudging has taken long (s).
const STOP_S: f64 = 14.0;
/// Without a picture for so long the mission is given up (s).
const BLIND_S: f64 = 10.0;
/// A line that is lost more often than this between two stops is given up.
const LOSSES: u32 = 8;
/// A crossing that was overrun comes into view again when the vehicle has crept back for so long (s): 12 cm.
const GONE_S: f64 = 4.0;

impl MissionDriver {
    pub(super) fn holds(&self, when: When) -> bool {
        let counts = &self.counts;
        let coded = self.codes.depot.is_some();
        match when {
            When::PackageRead => self.codes.package.is_some(),
            When::CrossingAhead => counts.crossing >= 2,
            When::CrossingWithoutCode => {
                counts.crossing >= 2
                    && if self.step == Step::Return {
                        !self.depot_ahead
                    } else {
                        !coded
                    }
            }
            When::GoalsCode => coded && self.codes.depot == self.goal,
            When::OthersCode => coded && self.codes.depot != self.goal,
            When::Aligned => self
                .clock
                .stands
                .is_some_and(|since| self.clock.now.since_s(since) > 0.45),
            When::NearlyAligned => {
                self.in_step_s() > STOP_S
                    && self
                        .view
                        .crossing
                        .is_some_and(|crossing| halt::is_near(&crossing, &self.options))
            }
            When::NoCrossingThere => {
                self.in_step_s() > GONE_S && self.clock.now.since_s(self.clock.crossing) > GONE_S
            }
            When::SignAndLight => self.signs.digit().is_some() && self.light.known(),
            When::SignAndNoLight => {
                self.signs.digit().is_some() && !self.light.known() && counts.leg >= look::LEGS
            }
            When::TurnedGreen => self
                .light
                .turned_green(self.clock.now, self.options.green_patience_s),
            When::NoLightThere => self.light.unseen_s(self.clock.now) > self.options.light_there_s,
            When::FacingGoalsStreet => self.faces_street() && self.signs.digit() == self.goal,
            When::FacingOthersStreet => self.faces_street() && self.signs.digit() != self.goal,
            When::JunctionAhead => counts.junction >= 2,
            When::LineBelow => counts.below >= 3 && self.way.step_m > 0.45,
            When::StartsCode => self.codes.start,
            When::LineLost => self.clock.now.since_s(self.clock.line) > LOST_S && self.in_step_s() > LOST_S,
            When::LineFound => counts.found >= 3,
            When::TimeOver => self.time_over(),
            When::BatteryEmpty => counts.empty >= 10,
            When::Blind => self.blind_s() > BLIND_S,
        }
    }

    pub(super) fn faces_street(&self) -> bool {
        self.street_angle_rad().abs() < 0.035
    }

    /// How far the street lies to the left of the heading (rad): by the crossing where it is seen, else by reckoning.
    pub(super) fn street_angle_rad(&self) -> f64 {
        match self.view.crossing {
            Some(crossing) if self.way.turned_rad.abs() < 0.35 && crossing.distance_m < 0.4 => {
                crossing.angle_rad
            }
            _ => -self.way.turned_rad,
        }
    }

    pub(super) fn time_over(&self) -> bool {
        let options = &self.options;
        let way_s = options.way_limit_m / options.speed_mps;
        match self.step {
            Step::WaitPackage => self.in_step_s() > options.package_limit_s,
            Step::ToArea | Step::TakeStreet | Step::ToDepot | Step::Return | Step::ToStart => {
                self.way.step_m > options.way_limit_m || self.in_step_s() > 2.0 * way_s
            }
            Step::ToJunction | Step::CrossJunction | Step::CrossBack => {
                self.way.step_m > 1.8 || self.in_step_s() > 3.6 / options.speed_mps
            }
            Step::StopAtArea | Step::StopAtDepot | Step::StopAtStart => self.in_step_s() > STOP_S + 1.0,
            // Twice all around.
            Step::Search => self.counts.leg >= 2 * look::LEGS,
            Step::WaitGreen => self.light.waited_s(self.clock.now) > options.light_limit_s,
            Step::FaceStreet => self.in_step_s() > 8.0,
            Step::Unload => self.in_step_s() > options.unload_s,
            Step::FindLine => self.counts.leg >= look::LEGS || self.losses > LOSSES,
            Step::Home | Step::Failed => false,
        }
    }

    /// Why it cannot go on, for people.
    pub(super) fn why(&self, when: When, from: Step) -> String {
        match (when, from) {
            (When::BatteryEmpty, _) => {
                format!("the battery is below {:.1} V; charge it", self.options.empty_v)
            }
            (When::Blind, _) => format!("no picture has come for {BLIND_S:.0} s"),
            (_, Step::WaitPackage) => "no package was shown".to_owned(),
            (_, Step::Search) => "no sign was found before the junction".to_owned(),
            (_, Step::WaitGreen) => match self.light.unseen_s(self.clock.now) {
                unseen_s if unseen_s > 1.0 => {
                    format!("the light was not seen to turn green, and not at all for {unseen_s:.1} s")
                }
                _ => "the light did not turn green".to_owned(),
            },
            (_, Step::FindLine) if self.losses > LOSSES => format!("the line was lost {} times", self.losses),
            (_, Step::FindLine) => "the line was lost and not found again".to_owned(),
            (When::CrossingWithoutCode, Step::Return) => {
                "a crossing without the start's code before it".to_owned()
            }
            (When::CrossingWithoutCode, _) => "a crossing without a depot's code before it".to_owned(),
            (_, Step::ToJunction) => "no junction came after the area".to_owned(),
            (_, Step::CrossJunction | Step::CrossBack) => "no line was found beyond the junction".to_owned(),
            (_, Step::StopAtArea | Step::StopAtDepot | Step::StopAtStart) => {
                "it did not come to stand square before the crossing".to_owned()
            }
            (_, step) => format!("what {} looks for did not come", step.name()),
        }
    }
}
