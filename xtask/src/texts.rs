//! Rules for the text of all files: no path of somebody's machine, no file that is too long to hold in mind.

use crate::rules::LONG_FILE_LINES;
use std::collections::BTreeMap;

/// Beginnings of paths that exist on one machine only. Written in pieces so that this file does not contain them.
fn machine_prefixes() -> Vec<String> {
    [["/ro", "ot/"], ["/wo", "rk/"], ["/tm", "p/senda"], ["/home", "/"]]
        .iter()
        .map(|parts| parts.concat())
        .collect()
}

/// Lines with a path of somebody's machine.
pub(crate) fn machine_paths(texts: &BTreeMap<String, String>) -> Vec<String> {
    let prefixes = machine_prefixes();
    let mut findings = Vec::new();
    for (name, text) in texts {
        for (number, line) in text.lines().enumerate() {
            for prefix in prefixes.iter().filter(|prefix| starts_a_word(line, prefix)) {
                findings.push(format!(
                    "{name}:{}: a path of somebody's machine: {prefix}…",
                    number + 1
                ));
            }
        }
    }
    findings
}

/// Whether the line has `prefix` where a path begins: `docs/home/x` is no path under `/home`.
fn starts_a_word(line: &str, prefix: &str) -> bool {
    line.match_indices(prefix).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        before.is_none_or(|c| !c.is_alphanumeric() && !"._-/*}".contains(c))
    })
}

/// Source files past the length at which one should look for two ideas. A note, not an error.
pub(crate) fn long_files(texts: &BTreeMap<String, String>) -> Vec<String> {
    texts
        .iter()
        .filter(|(name, _)| name.ends_with(".rs"))
        .map(|(name, text)| (name, text.lines().count()))
        .filter(|(_, lines)| *lines > LONG_FILE_LINES)
        .map(|(name, lines)| format!("{name} has {lines} lines (look for two ideas past {LONG_FILE_LINES})"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(text: String) -> BTreeMap<String, String> {
        BTreeMap::from([("src/a.rs".to_owned(), text)])
    }

    #[test]
    fn machine_paths_are_found_with_their_line() {
        for prefix in machine_prefixes() {
            let findings = machine_paths(&one(format!("fine\nsee {prefix}x for more")));
            assert_eq!(findings.len(), 1, "{prefix}");
            assert!(findings[0].starts_with("src/a.rs:2:"), "{findings:?}");
        }
        assert!(
            machine_paths(&one(
                ["docs/ro", "ot/x and https://example.org/wo", "rk/"].concat()
            ))
            .is_empty()
        );
    }

    #[test]
    fn long_files_are_noted() {
        assert!(long_files(&one("x\n".repeat(LONG_FILE_LINES))).is_empty());
        assert_eq!(long_files(&one("x\n".repeat(LONG_FILE_LINES + 1))).len(), 1);
    }
}
