//! Random worlds by name: `random-line:17` is the same world everywhere and always.

use crate::RunError;
use senda_world::{Colour, Difficulty, Kind, World};

/// The families of random worlds, with what each is for.
pub const FAMILIES: [(&str, &str); 10] = [
    (
        "random-line",
        "one black or white line on a floor as in document C: plain or speckled, matt or glossy",
    ),
    (
        "random-lane",
        "a lane of two such lines for the GoPiGo (document C)",
    ),
    (
        "random-line-any",
        "one line of any colour on any floor, tiles and wood included",
    ),
    (
        "random-lane-any",
        "a lane of two lines of any colour on any floor",
    ),
    (
        "random-circuit",
        "a lane of two tapes for the kit car (document A)",
    ),
    (
        "random-track",
        "a race track for model cars: wide, often with a dashed line in its middle, things around it",
    ),
    (
        "random-race",
        "such a track as clubs lay it in halls: bright edges, a bright dashed line between them",
    ),
    (
        "random-warehouse",
        "a warehouse as in document D: three depots, signs 0 and 1 in either order, mirrored or not",
    ),
    (
        "random-warehouse-any",
        "a warehouse of three to six depots in any order, with further lights",
    ),
    (
        ROAD,
        "a road lap of about a kilometre in open land, for the car (document B)",
    ),
];

/// The family of roads: made by another generator than the floors of rooms, with no difficulty to choose.
pub const ROAD: &str = "random-road";

/// Floors like those of document C: glossy, speckled, irregular.
const DOCUMENT_C_FLOORS: [&str; 8] = [
    "plain",
    "dark",
    "speckled",
    "dark-speckled",
    "glossy",
    "glossy-dark",
    "glossy-speckled",
    "glossy-dark-speckled",
];

/// The world of a name such as `random-line:17`; `None` for other names.
pub fn world(name: &str) -> Result<Option<World>, RunError> {
    let Some((family, seed)) = name.split_once(':') else {
        return Ok(None);
    };
    if let Some(any) = warehouse(family) {
        return Ok(Some(World::random_warehouse(parse_seed(name, seed)?, any)));
    }
    if family == ROAD {
        return Ok(Some(World::random_road(parse_seed(name, seed)?)));
    }
    let Some(difficulty) = difficulty(family) else {
        return Ok(None);
    };
    let seed = parse_seed(name, seed)?;
    Ok(Some(World::random(seed, &difficulty)))
}

/// Whether a family's warehouses have any depots in any order; `None` for families that are no warehouses.
fn warehouse(family: &str) -> Option<bool> {
    match family {
        "random-warehouse" => Some(false),
        "random-warehouse-any" => Some(true),
        _ => None,
    }
}

/// The difficulty of a family of floors; `None` for the others and unknown names.
pub fn difficulty(family: &str) -> Option<Difficulty> {
    let any_line = Difficulty::default();
    // Narrow enough for a camera 54° wide to see both lines: twice C8's half vehicle's width and a little more.
    let any_lane = Difficulty {
        kind: Kind::Lane,
        lane_width_m: [0.13, 0.18],
        ..Difficulty::default()
    };
    let document_c = |any: Difficulty| Difficulty {
        floors: DOCUMENT_C_FLOORS.map(str::to_owned).to_vec(),
        colours: vec![Colour::new(24, 24, 26), Colour::new(236, 236, 232)],
        ..any
    };
    Some(match family {
        "random-line" => document_c(any_line),
        "random-lane" => document_c(any_lane),
        "random-line-any" => any_line,
        "random-lane-any" => any_lane,
        "random-circuit" => Difficulty::lane(),
        "random-track" => Difficulty::track(),
        "random-race" => Difficulty::race(),
        _ => return None,
    })
}

/// Replaces every range such as `random-line:100..200` (end excluded) by its names.
pub fn expand(names: &[String]) -> Result<Vec<String>, RunError> {
    let mut all = Vec::new();
    for name in names {
        let range = name
            .split_once(':')
            .and_then(|(family, seeds)| Some((family, seeds.split_once("..")?)));
        let Some((family, (first, end))) = range else {
            all.push(name.clone());
            continue;
        };
        let (first, end) = (parse_seed(name, first)?, parse_seed(name, end)?);
        if first >= end || end - first > 1_000_000 {
            return Err(wrong(name));
        }
        all.extend((first..end).map(|seed| format!("{family}:{seed}")));
    }
    Ok(all)
}

fn parse_seed(name: &str, text: &str) -> Result<u64, RunError> {
    text.parse().map_err(|_| wrong(name))
}

fn wrong(name: &str) -> RunError {
    RunError::Scenario {
        key: "world",
        found: name.to_owned(),
        expected: "like `random-line:17` or, in a sweep, `random-line:100..200`".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_expand_and_nonsense_is_refused() {
        let names = expand(&["oval".into(), "random-line:3..5".into()]).unwrap();
        assert_eq!(names, ["oval", "random-line:3", "random-line:4"]);
        assert!(expand(&["random-line:5..3".into()]).is_err());
        assert!(world("random-line:x").is_err());
        assert!(world("oval").unwrap().is_none());
    }
}
