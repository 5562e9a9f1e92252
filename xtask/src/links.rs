//! Links between Markdown pages lead somewhere.

use std::collections::{BTreeMap, BTreeSet};

/// Relative links whose file, or heading, does not exist.
pub(crate) fn violations(texts: &BTreeMap<String, String>, files: &BTreeSet<String>) -> Vec<String> {
    let mut findings = Vec::new();
    for (page, text) in texts.iter().filter(|(name, _)| name.ends_with(".md")) {
        for target in targets(text) {
            if target.contains("://") || target.starts_with("mailto:") {
                continue;
            }
            let (path, anchor) = target.split_once('#').unwrap_or((target, ""));
            let file = if path.is_empty() {
                Some(page.clone())
            } else {
                resolve(page, path)
            };
            let folder_exists = |name: &str| files.iter().any(|file| file.starts_with(&format!("{name}/")));
            match file {
                Some(name) if files.contains(&name) => {
                    if let Some(text) = texts.get(&name)
                        && !anchor.is_empty()
                        && !headings(text).iter().any(|heading| heading == anchor)
                    {
                        findings.push(format!("{page}: {target} has no heading `#{anchor}`"));
                    }
                }
                Some(name) if folder_exists(name.trim_end_matches('/')) => {}
                _ => findings.push(format!("{page}: {target} does not exist")),
            }
        }
    }
    findings
}

/// Pages under `docs/` that the index there does not show.
pub(crate) fn unlisted(texts: &BTreeMap<String, String>) -> Vec<String> {
    let index = texts.get("docs/README.md").map_or("", String::as_str);
    let listed: Vec<&str> = targets(index);
    texts
        .keys()
        .filter(|name| name.ends_with(".md") && *name != "docs/README.md")
        .filter_map(|name| Some((name, name.strip_prefix("docs/")?)))
        .filter(|(_, relative)| !listed.contains(relative))
        .map(|(name, _)| format!("docs/README.md: expected a link to {name}"))
        .collect()
}

/// What `[text](target)` and `![text](target)` point at, code left out.
fn targets(text: &str) -> Vec<&str> {
    let mut fenced = false;
    let mut targets = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        if fenced {
            continue;
        }
        for (i, prose) in line.split("](").enumerate() {
            if i > 0
                && let Some((target, _)) = prose.split_once(')')
            {
                targets.push(target.split_whitespace().next().unwrap_or_default());
            }
        }
    }
    targets
}

/// `path` as written on `page`, relative to the root; `None` if it leaves the repository.
fn resolve(page: &str, path: &str) -> Option<String> {
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for part in path.split('/') {
        match part {
            "." => {}
            ".." => {
                parts.pop()?;
            }
            part => parts.push(part),
        }
    }
    Some(parts.join("/").trim_end_matches('/').to_owned())
}

/// The anchors that a page's headings get: lower case, blanks as dashes, punctuation dropped.
fn headings(text: &str) -> Vec<String> {
    let mut fenced = false;
    let mut anchors = Vec::new();
    for line in text.lines() {
        if line.starts_with("```") {
            fenced = !fenced;
        }
        if fenced || !line.starts_with('#') {
            continue;
        }
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let anchor = title
            .chars()
            .filter(|c| c.is_alphanumeric() || " -_".contains(*c))
            .collect::<String>();
        anchors.push(anchor.replace(' ', "-"));
    }
    anchors
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(link: &str) -> Vec<String> {
        let texts = BTreeMap::from([
            (
                "docs/README.md".to_owned(),
                format!("# Docs\n[x]({link})\n```\n[y](nowhere)\n```\n"),
            ),
            (
                "DESIGN.md".to_owned(),
                "# Why MCAP?\n## `senda_geom`: frames".to_owned(),
            ),
        ]);
        let files = texts
            .keys()
            .cloned()
            .chain(["worlds/oval.toml".to_owned()])
            .collect();
        violations(&texts, &files)
    }

    #[test]
    fn links_that_lead_somewhere_pass() {
        for link in [
            "../DESIGN.md",
            "../DESIGN.md#why-mcap",
            "../DESIGN.md#senda_geom-frames",
            "#docs",
            "../worlds",
            "../worlds/",
            "https://example.org/x",
            "../worlds/oval.toml",
        ] {
            assert!(check(link).is_empty(), "{link}: {:?}", check(link));
        }
    }

    #[test]
    fn a_page_that_the_index_leaves_out_is_found() {
        let texts = |index: &str| {
            BTreeMap::from([
                ("docs/README.md".to_owned(), index.to_owned()),
                ("docs/results/c.md".to_owned(), "# C".to_owned()),
                ("DESIGN.md".to_owned(), "# Design".to_owned()),
            ])
        };
        assert!(unlisted(&texts("[c](results/c.md)")).is_empty());
        assert_eq!(
            unlisted(&texts("c.md")),
            ["docs/README.md: expected a link to docs/results/c.md"]
        );
    }

    #[test]
    fn broken_links_are_found() {
        for link in [
            "DESIGN.md",
            "../DESIGN.md#why-json",
            "../../outside.md",
            "../tracks",
            "#nothing",
        ] {
            assert_eq!(check(link).len(), 1, "{link}");
        }
    }
}
