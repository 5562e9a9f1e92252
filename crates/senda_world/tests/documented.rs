//! The pages of `docs/` know every key of the files.

use senda_world::{Dash, Difficulty, Light, Shadows, VehicleSpec, World};
use std::collections::BTreeSet;
use std::path::Path;

fn page(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../docs")
        .join(name);
    std::fs::read_to_string(path).unwrap()
}

/// All words before ` = ` and all table names of a TOML text.
fn keys(toml: &str) -> BTreeSet<String> {
    let mut keys = BTreeSet::new();
    for line in toml.lines() {
        for part in line.split(['{', ',']) {
            if let Some((key, _)) = part.split_once(" = ")
                && !key.trim().is_empty()
                && key
                    .trim()
                    .chars()
                    .all(|c| c.is_ascii_lowercase() || c == '_' || c.is_ascii_digit())
            {
                keys.insert(key.trim().to_owned());
            }
        }
        if line.starts_with('[') {
            let name = line.trim_matches(['[', ']']);
            keys.extend(name.split('.').map(str::to_owned));
        }
    }
    keys
}

fn check(page_name: &str, texts: &[String]) {
    let page = page(page_name);
    for text in texts {
        for key in keys(text) {
            let known = [
                format!("`{key}"),
                format!(".{key}`"),
                format!(".{key}]"),
                format!("[{key}]"),
                format!("{key} = "),
            ];
            assert!(
                known.iter().any(|form| page.contains(form)),
                "docs/{page_name} does not mention {key}"
            );
        }
    }
}

#[test]
fn every_key_of_a_world_is_on_its_page() {
    let mut texts: Vec<String> = World::names()
        .map(|name| World::named(name).unwrap().to_toml())
        .collect();
    let difficulty = Difficulty {
        things: 8,
        dashes: 0.5,
        shadows: 0.5,
        ..Difficulty::lane()
    };
    texts.extend((0..30).map(|seed| World::random(seed, &difficulty).to_toml()));
    let mut full = World::named("oval")
        .unwrap()
        .with_light("mixed")
        .unwrap()
        .reversed();
    full.light = Light {
        shadows: Some(Shadows {
            strength: 0.5,
            scale_m: 1.0,
            softness: 0.5,
            seed: 1,
        }),
        ..full.light
    };
    full.markings[0].span_m = Some((0.5, 1.0));
    full.markings[0].dash = Some(Dash {
        length_m: 0.1,
        gap_m: 0.1,
        phase_m: 0.0,
    });
    texts.push(full.to_toml());
    check("worlds.md", &texts);
}

#[test]
fn every_key_of_a_vehicle_is_on_its_page() {
    let texts: Vec<String> = VehicleSpec::names()
        .map(|name| VehicleSpec::named(name).unwrap().to_toml())
        .collect();
    check("vehicles.md", &texts);
}

/// The example at the top of the page is a world without a warning.
#[test]
fn the_example_works() {
    let page = page("worlds.md");
    let example = page.split("```toml").nth(1).unwrap().split("```").next().unwrap();
    let (world, warnings) = World::parse("docs/worlds.md", example).unwrap();
    assert_eq!((world.name.as_str(), warnings), ("mine", vec![]));
}
