//! Every library opens with one sentence, shows an example that runs, and says what it does not do.

use crate::workspace::Crate;
use std::collections::BTreeMap;

/// Crates whose first page lacks something, or that leave the workspace's lints out.
pub(crate) fn violations(crates: &[Crate], texts: &BTreeMap<String, String>) -> Vec<String> {
    let mut findings = Vec::new();
    for own in crates {
        let library = format!("{}/src/lib.rs", own.folder);
        let program = format!("{}/src/main.rs", own.folder);
        if let Some(source) = texts.get(&library) {
            findings.extend(page(&library, source, true));
        } else if let Some(source) = texts.get(&program) {
            findings.extend(page(&program, source, false));
        }
        let manifest = format!("{}/Cargo.toml", own.folder);
        if texts
            .get(&manifest)
            .is_none_or(|text| !text.contains("[lints]\nworkspace = true"))
        {
            findings.push(format!("{manifest}: expected [lints] workspace = true"));
        }
    }
    findings
}

fn page(name: &str, source: &str, is_library: bool) -> Vec<String> {
    let lines: Vec<&str> = source
        .lines()
        .take_while(|line| line.starts_with("//!"))
        .map(|line| line.trim_start_matches("//!").trim())
        .collect();
    let mut findings = Vec::new();
    let first: Vec<&str> = lines
        .iter()
        .take_while(|line| !line.is_empty())
        .copied()
        .collect();
    if !first.join(" ").ends_with(['.', ':']) || lines.first().is_none_or(|line| line.starts_with('#')) {
        findings.push(format!(
            "{name}: expected to open with `//!` and a sentence that says what it does"
        ));
    }
    if is_library && !lines.iter().any(|line| line.starts_with("```")) {
        findings.push(format!("{name}: expected an example in the first comment"));
    }
    if is_library && !lines.join(" ").to_lowercase().contains("not ") {
        findings.push(format!(
            "{name}: expected a word on what the crate does not do or know"
        ));
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ranks::tests::a_crate;

    fn check(source: &str, manifest: &str) -> Vec<String> {
        let texts = BTreeMap::from([
            ("crates/senda_geom/src/lib.rs".to_owned(), source.to_owned()),
            ("crates/senda_geom/Cargo.toml".to_owned(), manifest.to_owned()),
        ]);
        violations(&[a_crate("senda_geom", &[], &[])], &texts)
    }

    #[test]
    fn a_good_page_passes() {
        let source = "//! Geometry.\n//!\n//! ```\n//! let x = 1;\n//! ```\n//!\n//! Does not know files.\n\npub mod a;";
        assert!(check(source, "[lints]\nworkspace = true\n").is_empty());
    }

    #[test]
    fn a_page_without_sentence_example_or_limits_is_found() {
        assert_eq!(check("pub mod a;", "[lints]\nworkspace = true\n").len(), 3);
        assert_eq!(
            check(
                "//! # Geometry\n//!\n//! ```\n//! ```\n//! Not files.",
                "[lints]\nworkspace = true\n"
            )
            .len(),
            1
        );
    }

    #[test]
    fn a_crate_without_the_shared_lints_is_found() {
        let source = "//! Geometry.\n//! ```\n//! ```\n//! Not files.";
        let findings = check(source, "[package]\n");
        assert!(findings.iter().any(|f| f.contains("[lints]")), "{findings:?}");
    }
}
