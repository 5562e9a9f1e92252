//! `ARCHITECTURE.md` names every crate with its rank, no crate that does not exist, and only files that exist.

use crate::rules::RANKS;
use crate::workspace::Crate;
use std::collections::BTreeSet;

/// Where the page and the workspace disagree.
///
/// The code map gives each crate a heading such as ``### `senda_geom` (rank 0)``.
pub(crate) fn violations(page: &str, crates: &[Crate], files: &BTreeSet<String>) -> Vec<String> {
    let mut findings = Vec::new();
    for own in crates {
        let rank = RANKS
            .iter()
            .find(|(name, _)| *name == own.name)
            .map(|(_, rank)| *rank);
        let heading = match rank {
            Some(rank) if own.name != "xtask" => format!("### `{}` (rank {rank})", own.name),
            _ => format!("### `{}`", own.name),
        };
        if !page.lines().any(|line| line.starts_with(&heading)) {
            findings.push(format!(
                "ARCHITECTURE.md: expected a section with the heading {heading}"
            ));
        }
    }
    for word in quoted(page) {
        if is_crate_name(word) && !crates.iter().any(|own| own.name == word) {
            findings.push(format!(
                "ARCHITECTURE.md: `{word}` is not a crate of this workspace"
            ));
        }
        if is_path(word) && !exists(word, files) {
            findings.push(format!("ARCHITECTURE.md: `{word}` does not exist"));
        }
    }
    findings
}

/// Words between single backticks.
fn quoted(page: &str) -> Vec<&str> {
    let mut fenced = false;
    let mut words = Vec::new();
    for line in page.lines() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        } else if !fenced {
            words.extend(line.split('`').skip(1).step_by(2));
        }
    }
    words
}

fn is_crate_name(word: &str) -> bool {
    word.starts_with("senda_") && word.chars().all(|c| c.is_ascii_lowercase() || c == '_')
}

fn is_path(word: &str) -> bool {
    let plain = word
        .chars()
        .all(|c| c.is_ascii_alphanumeric() || "_-./*".contains(c));
    plain && word.contains('/') && !word.starts_with('/')
}

fn exists(path: &str, files: &BTreeSet<String>) -> bool {
    if let Some((before, after)) = path.split_once('*') {
        return files
            .iter()
            .any(|file| file.starts_with(before) && file.ends_with(after));
    }
    let folder = format!("{}/", path.trim_end_matches('/'));
    files.contains(path) || files.iter().any(|file| file.starts_with(&folder))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ranks::tests::a_crate;

    fn files() -> BTreeSet<String> {
        ["crates/senda_geom/src/curve.rs", "worlds/oval.toml"]
            .map(str::to_owned)
            .into()
    }

    fn check(page: &str) -> Vec<String> {
        violations(page, &[a_crate("senda_geom", &[], &[])], &files())
    }

    #[test]
    fn a_true_page_passes() {
        assert!(
            check(
                "### `senda_geom` (rank 0)\nSee `crates/senda_geom/src/curve.rs`, `worlds/*.toml`, `a + b/c`."
            )
            .is_empty()
        );
    }

    #[test]
    fn a_missing_crate_and_a_wrong_rank_are_found() {
        assert!(check("nothing")[0].contains("### `senda_geom` (rank 0)"));
        assert_eq!(check("### `senda_geom` (rank 3)").len(), 1);
    }

    #[test]
    fn a_crate_or_file_that_does_not_exist_is_found() {
        let findings =
            check("### `senda_geom` (rank 0)\n`senda_magic` lives in `crates/senda_geom/src/magic.rs`.");
        assert_eq!(findings.len(), 2, "{findings:?}");
        assert!(check("### `senda_geom` (rank 0)\n`tracks/*.toml`").len() == 1);
    }
}
