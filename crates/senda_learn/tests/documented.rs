//! `docs/learning.md` knows every key of the experiment files.

use senda_learn::gather::Selection;
use senda_learn::{Learning, Training};
use std::collections::BTreeSet;
use std::path::Path;

fn keys(table: &toml::Table, into: &mut BTreeSet<String>) {
    for (key, value) in table {
        into.insert(key.clone());
        if let toml::Value::Table(inner) = value {
            keys(inner, into);
        }
    }
}

#[test]
fn every_key_is_on_its_page() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/learning.md");
    let page = std::fs::read_to_string(path).unwrap();
    // What may be left out is given, so that it appears.
    let learning = Learning {
        colour: Some(senda_nets::Colour::Rgb),
        ..Learning::default()
    };
    let mut all = BTreeSet::new();
    for text in [
        learning.to_toml(),
        toml::to_string(&Training::default()).unwrap(),
        toml::to_string(&Selection::default()).unwrap(),
    ] {
        assert!(!text.is_empty());
        keys(&text.parse().unwrap(), &mut all);
    }
    // The keys of `senda train` that are no tables of these.
    for key in [
        "data",
        "validation",
        "split",
        "validation_share",
        "split_gap",
        "vehicle",
        "full_lock_deg",
        "selection",
    ] {
        all.insert(key.to_owned());
    }
    assert!(all.len() > 50, "{all:?}");
    for key in all {
        assert!(
            ["`KEY`", "`KEY = ", "`[KEY]`"]
                .iter()
                .any(|form| page.contains(&form.replace("KEY", &key))),
            "docs/learning.md does not mention {key}"
        );
    }
}
