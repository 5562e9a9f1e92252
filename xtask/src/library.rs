//! Every world, vehicle and network file is in an embedded library, and every scenario is used somewhere.

use std::collections::{BTreeMap, BTreeSet};

/// Files that nobody would find by name.
pub(crate) fn violations(texts: &BTreeMap<String, String>, files: &BTreeSet<String>) -> Vec<String> {
    let mut findings = Vec::new();
    for file in files {
        let Some((folder, name)) = file.split_once('/') else {
            continue;
        };
        if name.contains('/') || !name.ends_with(".toml") {
            continue;
        }
        match folder {
            "worlds" | "vehicles" if !is_in_library(file, "senda_world", texts) => {
                findings.push(format!(
                    "{file} is not embedded: expected its name in the library of senda_world"
                ));
            }
            "networks" if !is_in_library(file, "senda_nets", texts) => {
                findings.push(format!(
                    "{file} is not embedded: expected its name in the library of senda_nets"
                ));
            }
            "scenarios" if !is_mentioned(file, texts) => {
                findings.push(format!("{file} is used by no test and shown on no page"));
            }
            _ => {}
        }
    }
    findings
}

/// Whether a source of the crate quotes both the folder and the name, as its library's macro call does.
fn is_in_library(file: &str, owner: &str, texts: &BTreeMap<String, String>) -> bool {
    let Some((folder, name)) = file.split_once('/') else {
        return false;
    };
    let (folder, name) = (
        format!("\"{folder}\""),
        format!("\"{}\"", name.trim_end_matches(".toml")),
    );
    texts.iter().any(|(source, text)| {
        source.starts_with(&format!("crates/{owner}/src/")) && text.contains(&folder) && text.contains(&name)
    })
}

fn is_mentioned(file: &str, texts: &BTreeMap<String, String>) -> bool {
    texts
        .iter()
        .any(|(name, text)| (name.ends_with(".rs") || name.ends_with(".md")) && text.contains(file))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(file: &str) -> Vec<String> {
        let source = "const WORLDS: &[(&str, &str)] = files!(\"worlds\": \"straight\", \"oval\");";
        let texts = BTreeMap::from([
            ("crates/senda_world/src/library.rs".to_owned(), source.to_owned()),
            (
                "README.md".to_owned(),
                "senda drive scenarios/first.toml".to_owned(),
            ),
        ]);
        violations(&texts, &BTreeSet::from([file.to_owned()]))
    }

    #[test]
    fn files_that_are_named_pass() {
        for file in [
            "worlds/straight.toml",
            "worlds/oval.toml",
            "scenarios/first.toml",
            "worlds/README.md",
            "deny.toml",
        ] {
            assert!(check(file).is_empty(), "{file}");
        }
    }

    #[test]
    fn forgotten_files_are_found() {
        for file in ["worlds/val.toml", "vehicles/gopigo.toml", "scenarios/second.toml"] {
            assert_eq!(check(file).len(), 1, "{file}");
        }
    }
}
