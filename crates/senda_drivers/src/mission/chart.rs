//! The mission as a state chart (the GRAFCET of document D, D9 in SPEC): steps, transitions, actions, as data.
//!
//! The driver walks through [`CHART`] and nothing else: in each step the transitions are tried in the order in which they stand
//! here, and the first whose condition holds is taken. [`mermaid`] draws it for the documentation.

/// Where a mission is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// Stands at the start until a package is shown.
    WaitPackage,
    /// Follows the line to the next crossing: an area, or the last depot.
    ToArea,
    /// Stops square before an area's crossing.
    StopAtArea,
    /// Turns in place until sign and light are found.
    Search,
    /// Waits until the light turns green.
    WaitGreen,
    /// Turns back to the street.
    FaceStreet,
    /// Follows the line to the junction that it will cross.
    ToJunction,
    /// Goes straight across, towards the line on the other side (D6).
    CrossJunction,
    /// Follows the line into the street that the sign promises.
    TakeStreet,
    /// Has read the goal's code: the next crossing is the depot's.
    ToDepot,
    /// Stops square before the depot's crossing.
    StopAtDepot,
    /// Waits while it is unloaded.
    Unload,
    /// Follows the line back, looking for the start's code.
    Return,
    /// Crosses a junction on the way back.
    CrossBack,
    /// Has read the start's code: the next crossing is the start's.
    ToStart,
    /// Stops square before the start's crossing.
    StopAtStart,
    /// Back at the start: the mission is over.
    Home,
    /// Has lost the line: stands, then looks around for it.
    FindLine,
    /// Cannot go on: stands for good and says why.
    Failed,
}

impl Step {
    /// All steps, in the order of the numbers in recordings.
    pub const ALL: [Step; 19] = [
        Step::WaitPackage,
        Step::ToArea,
        Step::StopAtArea,
        Step::Search,
        Step::WaitGreen,
        Step::FaceStreet,
        Step::ToJunction,
        Step::CrossJunction,
        Step::TakeStreet,
        Step::ToDepot,
        Step::StopAtDepot,
        Step::Unload,
        Step::Return,
        Step::CrossBack,
        Step::ToStart,
        Step::StopAtStart,
        Step::Home,
        Step::FindLine,
        Step::Failed,
    ];

    /// Its number in recordings (signal `step`).
    pub fn number(self) -> usize {
        Self::ALL.iter().position(|step| *step == self).unwrap_or(0)
    }

    /// Its name: `wait_package`.
    pub fn name(self) -> &'static str {
        match self {
            Self::WaitPackage => "wait_package",
            Self::ToArea => "to_area",
            Self::StopAtArea => "stop_at_area",
            Self::Search => "search",
            Self::WaitGreen => "wait_green",
            Self::FaceStreet => "face_street",
            Self::ToJunction => "to_junction",
            Self::CrossJunction => "cross_junction",
            Self::TakeStreet => "take_street",
            Self::ToDepot => "to_depot",
            Self::StopAtDepot => "stop_at_depot",
            Self::Unload => "unload",
            Self::Return => "return",
            Self::CrossBack => "cross_back",
            Self::ToStart => "to_start",
            Self::StopAtStart => "stop_at_start",
            Self::Home => "home",
            Self::FindLine => "find_line",
            Self::Failed => "failed",
        }
    }

    /// What is done in it.
    pub fn action(self) -> &'static str {
        match self {
            Self::WaitPackage => "stand, read codes",
            Self::ToArea => "follow the line, read codes",
            Self::StopAtArea | Self::StopAtDepot | Self::StopAtStart => "stop square before the crossing",
            Self::Search => "turn in place, detect",
            Self::WaitGreen => "stand, watch the light",
            Self::FaceStreet => "turn to the street",
            Self::ToJunction => "follow the line",
            Self::CrossJunction | Self::CrossBack => "steer to the line beyond",
            Self::TakeStreet => "follow the line, read codes",
            Self::ToDepot | Self::ToStart => "follow the line",
            Self::Unload => "stand",
            Self::Return => "follow the line, read codes",
            Self::Home | Self::Failed => "stand for good",
            Self::FindLine => "stand, then look around",
        }
    }
}

/// Why a step is left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// The package's code `I<n>` has been read.
    PackageRead,
    /// A crossing is close ahead.
    CrossingAhead,
    /// The code `F<n>` of the goal has been read since the last stop.
    GoalsCode,
    /// The code of another depot has been read since the last stop.
    OthersCode,
    /// A crossing is close ahead and the code that belongs before it has not been read.
    CrossingWithoutCode,
    /// It stands square before the crossing.
    Aligned,
    /// It has nudged for long and stands nearly so.
    NearlyAligned,
    /// The crossing before which it was to stop has not been seen for some time, not even from further back: it was none.
    NoCrossingThere,
    /// Sign and light are known.
    SignAndLight,
    /// The sign is known and all around there is no light.
    SignAndNoLight,
    /// The light has just turned green, or has been green for very long.
    TurnedGreen,
    /// It faces the street and the sign names the goal.
    FacingGoalsStreet,
    /// It faces the street and the sign names another depot.
    FacingOthersStreet,
    /// The light that is waited for has not been seen for some time.
    NoLightThere,
    /// A junction is close ahead.
    JunctionAhead,
    /// The line beyond the junction is under the vehicle.
    LineBelow,
    /// The start's code `P` has been read.
    StartsCode,
    /// No line has been seen for some time.
    LineLost,
    /// The line is there again.
    LineFound,
    /// The step's time is over.
    TimeOver,
    /// The battery is empty (D13).
    BatteryEmpty,
    /// No picture has come for long.
    Blind,
}

impl When {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::PackageRead => "package read",
            Self::CrossingAhead => "crossing ahead",
            Self::GoalsCode => "code of the goal",
            Self::OthersCode => "code of another depot",
            Self::CrossingWithoutCode => "crossing without code",
            Self::Aligned => "stands square",
            Self::NearlyAligned => "stands nearly square",
            Self::NoCrossingThere => "no crossing to be seen",
            Self::SignAndLight => "sign and light known",
            Self::SignAndNoLight => "sign known, no light",
            Self::TurnedGreen => "turned green",
            Self::FacingGoalsStreet => "faces the street, sign is the goal",
            Self::FacingOthersStreet => "faces the street, sign is another",
            Self::NoLightThere => "no light to be seen",
            Self::JunctionAhead => "junction ahead",
            Self::LineBelow => "line below again",
            Self::StartsCode => "code of the start",
            Self::LineLost => "line lost",
            Self::LineFound => "line found",
            Self::TimeOver => "time over",
            Self::BatteryEmpty => "battery empty",
            Self::Blind => "no pictures",
        }
    }
}

/// Where a transition leads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum To {
    /// To a step.
    Step(Step),
    /// Back to the step that was left when the line was lost.
    Back,
}

/// One transition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transition {
    /// The step that it leaves.
    pub from: Step,
    /// Its condition.
    pub when: When,
    /// Where it leads.
    pub to: To,
}

const fn go(from: Step, when: When, to: Step) -> Transition {
    Transition {
        from,
        when,
        to: To::Step(to),
    }
}

/// What leads from every step but [`Step::Home`] to [`Step::Failed`].
pub const ALWAYS: [When; 2] = [When::BatteryEmpty, When::Blind];

/// The chart, beside [`ALWAYS`].
#[rustfmt::skip]
pub const CHART: &[Transition] = &[
    go(Step::WaitPackage,   When::PackageRead,         Step::ToArea),
    go(Step::WaitPackage,   When::TimeOver,            Step::Failed),
    go(Step::ToArea,        When::GoalsCode,           Step::ToDepot),
    go(Step::ToArea,        When::OthersCode,          Step::Return),
    go(Step::ToArea,        When::CrossingAhead,       Step::StopAtArea),
    go(Step::ToArea,        When::LineLost,            Step::FindLine),
    go(Step::ToArea,        When::TimeOver,            Step::Failed),
    go(Step::StopAtArea,    When::Aligned,             Step::Search),
    go(Step::StopAtArea,    When::NearlyAligned,       Step::Search),
    go(Step::StopAtArea,    When::NoCrossingThere,     Step::ToArea),
    go(Step::StopAtArea,    When::TimeOver,            Step::Failed),
    go(Step::Search,        When::SignAndLight,        Step::WaitGreen),
    go(Step::Search,        When::SignAndNoLight,      Step::FaceStreet),
    go(Step::Search,        When::TimeOver,            Step::Failed),
    go(Step::WaitGreen,     When::TurnedGreen,         Step::FaceStreet),
    go(Step::WaitGreen,     When::TimeOver,            Step::Failed),
    go(Step::WaitGreen,     When::NoLightThere,        Step::Search),
    go(Step::FaceStreet,    When::FacingGoalsStreet,   Step::TakeStreet),
    go(Step::FaceStreet,    When::FacingOthersStreet,  Step::ToJunction),
    go(Step::FaceStreet,    When::TimeOver,            Step::Failed),
    go(Step::ToJunction,    When::JunctionAhead,       Step::CrossJunction),
    go(Step::ToJunction,    When::LineLost,            Step::FindLine),
    go(Step::ToJunction,    When::TimeOver,            Step::Failed),
    go(Step::CrossJunction, When::LineBelow,           Step::ToArea),
    go(Step::CrossJunction, When::TimeOver,            Step::Failed),
    go(Step::TakeStreet,    When::GoalsCode,           Step::ToDepot),
    go(Step::TakeStreet,    When::OthersCode,          Step::Return),
    go(Step::TakeStreet,    When::CrossingWithoutCode, Step::Failed),
    go(Step::TakeStreet,    When::LineLost,            Step::FindLine),
    go(Step::TakeStreet,    When::TimeOver,            Step::Failed),
    go(Step::ToDepot,       When::CrossingAhead,       Step::StopAtDepot),
    go(Step::ToDepot,       When::LineLost,            Step::FindLine),
    go(Step::ToDepot,       When::TimeOver,            Step::Failed),
    go(Step::StopAtDepot,   When::Aligned,             Step::Unload),
    go(Step::StopAtDepot,   When::NearlyAligned,       Step::Unload),
    go(Step::StopAtDepot,   When::NoCrossingThere,     Step::ToDepot),
    go(Step::StopAtDepot,   When::TimeOver,            Step::Failed),
    go(Step::Unload,        When::TimeOver,            Step::Return),
    go(Step::Return,        When::StartsCode,          Step::ToStart),
    go(Step::Return,        When::CrossingWithoutCode, Step::Failed),
    go(Step::Return,        When::JunctionAhead,       Step::CrossBack),
    go(Step::Return,        When::LineLost,            Step::FindLine),
    go(Step::Return,        When::TimeOver,            Step::Failed),
    go(Step::CrossBack,     When::LineBelow,           Step::Return),
    go(Step::CrossBack,     When::TimeOver,            Step::Failed),
    go(Step::ToStart,       When::CrossingAhead,       Step::StopAtStart),
    go(Step::ToStart,       When::LineLost,            Step::FindLine),
    go(Step::ToStart,       When::TimeOver,            Step::Failed),
    go(Step::StopAtStart,   When::Aligned,             Step::Home),
    go(Step::StopAtStart,   When::NearlyAligned,       Step::Home),
    go(Step::StopAtStart,   When::NoCrossingThere,     Step::ToStart),
    go(Step::StopAtStart,   When::TimeOver,            Step::Failed),
    Transition { from: Step::FindLine, when: When::LineFound, to: To::Back },
    go(Step::FindLine,      When::TimeOver,            Step::Failed),
];

/// The chart as a mermaid state diagram. Drawings in the documentation are compared with it.
pub fn mermaid() -> String {
    let mut text = String::from("stateDiagram-v2\n    [*] --> wait_package\n");
    for step in Step::ALL {
        text += &format!("    {0}: {0}<br/>{1}\n", step.name(), step.action());
    }
    for transition in CHART {
        let to = match transition.to {
            To::Step(step) => step.name(),
            To::Back => "before",
        };
        let (from, words) = (transition.from.name(), transition.when.words());
        text += &format!("    {from} --> {to}: {words}\n");
    }
    text += "    before: the step before\n    any: any step but home\n";
    for when in ALWAYS {
        text += &format!("    any --> failed: {}\n", when.words());
    }
    text += "    home --> [*]\n    failed --> [*]\n";
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every step can be reached, and every step but the two last can be left by a time-out or, while driving, ends.
    #[test]
    fn no_step_is_lost_and_none_waits_for_ever() {
        for step in Step::ALL {
            let reached = step == Step::WaitPackage || CHART.iter().any(|t| t.to == To::Step(step));
            assert!(reached, "{}", step.name());
            if !matches!(step, Step::Home | Step::Failed) {
                let leaves = CHART.iter().any(|t| t.from == step && t.when == When::TimeOver);
                assert!(leaves, "{}", step.name());
            }
            assert_eq!(Step::ALL[step.number()], step);
        }
    }

    /// The drawing in the documentation is this chart. To renew it: write what the failure shows into the page.
    #[test]
    fn the_documentation_shows_this_chart() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/warehouse.md");
        let page = std::fs::read_to_string(path).unwrap();
        assert!(
            page.contains(&mermaid()),
            "put this into docs/warehouse.md:\n{}",
            mermaid()
        );
    }
}
