//! Which outside packages a crate may use, and where packages may come from.

use crate::rules::{LINKS_NOTHING, RESERVED, TESTS_ONLY};
use crate::workspace::{Crate, Package};

/// Dependencies in a crate that may not have them.
pub(crate) fn violations(crates: &[Crate]) -> Vec<String> {
    let mut findings = Vec::new();
    for user in crates {
        for dependency in user.dependencies.iter().filter(|d| !d.tests_only) {
            if TESTS_ONLY.contains(&dependency.name.as_str()) {
                findings.push(format!(
                    "{} -> {}: expected in [dev-dependencies], it is for tests and benchmarks",
                    user.name, dependency.name
                ));
            }
            for rule in RESERVED.iter().filter(|rule| rule.dependency == dependency.name) {
                if !rule.users.contains(&user.name.as_str()) {
                    let allowed = if rule.users.is_empty() {
                        "nobody".to_owned()
                    } else {
                        rule.users.join(", ")
                    };
                    findings.push(format!(
                        "{} -> {}: allowed in {allowed}; {}",
                        user.name, dependency.name, rule.reason
                    ));
                }
            }
        }
    }
    findings
}

/// Packages that link a native library: one binary, built by cargo alone, is a promise.
pub(crate) fn native(packages: &[Package]) -> Vec<String> {
    packages
        .iter()
        .filter(|package| !LINKS_NOTHING.contains(&package.name.as_str()))
        .filter_map(|package| {
            let library = package.links.as_ref()?;
            Some(format!(
                "{}: links the native library `{library}`",
                package.path.join(" -> ")
            ))
        })
        .collect()
}

/// Lines of `Cargo.lock` that take a package from somewhere else than crates.io.
pub(crate) fn foreign_sources(lock: &str) -> Vec<String> {
    let crates_io = "source = \"registry+https://github.com/rust-lang/crates.io-index\"";
    lock.lines()
        .filter(|line| line.starts_with("source = ") && *line != crates_io)
        .map(|line| format!("Cargo.lock: expected crates.io, found {line}"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ranks::tests::a_crate;

    #[test]
    fn a_reserved_dependency_elsewhere_is_refused_with_the_reason() {
        let findings = violations(&[a_crate("senda_sim", &["anyhow", "thiserror"], &[])]);
        assert_eq!(findings.len(), 1);
        assert!(
            findings[0].contains("senda_sim -> anyhow") && findings[0].contains("thiserror"),
            "{findings:?}"
        );
        assert!(violations(&[a_crate("senda", &["anyhow", "clap"], &[])]).is_empty());
    }

    #[test]
    fn test_tools_stay_in_tests() {
        assert_eq!(violations(&[a_crate("senda_geom", &["proptest"], &[])]).len(), 1);
        assert!(violations(&[a_crate("senda_geom", &[], &["proptest", "anyhow"])]).is_empty());
    }

    #[test]
    fn what_nobody_may_use() {
        assert!(violations(&[a_crate("senda_vision", &["opencv"], &[])])[0].contains("nobody"));
    }

    #[test]
    fn a_native_library_is_found_with_the_way_to_it() {
        let package = |name: &str, links: Option<&str>| Package {
            name: name.to_owned(),
            links: links.map(str::to_owned),
            licence: String::new(),
            path: vec!["senda_data".to_owned(), name.to_owned()],
        };
        let found = native(&[
            package("zstd-sys", Some("zstd")),
            package("rayon-core", Some("rayon-core")),
            package("toml", None),
        ]);
        assert_eq!(found, ["senda_data -> zstd-sys: links the native library `zstd`"]);
    }

    #[test]
    fn a_package_from_elsewhere_is_found() {
        let lock = "name = \"x\"\nsource = \"git+https://example.org/x#123\"\n";
        assert_eq!(foreign_sources(lock).len(), 1);
        let lock = "source = \"registry+https://github.com/rust-lang/crates.io-index\"\n";
        assert!(foreign_sources(lock).is_empty());
    }
}
