//! A crate uses only crates of strictly lower rank.

use crate::rules::RANKS;
use crate::workspace::Crate;

/// Every edge that does not go down. A crate's tests may also use crates of the same rank: the drivers are tried in
/// the simulator, and neither knows the other.
pub(crate) fn violations(crates: &[Crate]) -> Vec<String> {
    let mut findings = Vec::new();
    for user in crates {
        let Some(own) = rank(&user.name) else {
            findings.push(format!(
                "crate {} has no rank; expected a line for it in xtask/src/rules.rs and in ARCHITECTURE.md",
                user.name
            ));
            continue;
        };
        for dependency in &user.dependencies {
            let Some(theirs) = rank(&dependency.name) else {
                continue;
            };
            let allowed = if dependency.tests_only {
                theirs <= own
            } else {
                theirs < own
            };
            if !allowed {
                let (kind, limit) = if dependency.tests_only {
                    ("the tests of ", "equal or lower")
                } else {
                    ("", "strictly lower")
                };
                findings.push(format!(
                    "{kind}{} (rank {own}) -> {} (rank {theirs}): expected a crate of {limit} rank",
                    user.name, dependency.name
                ));
            }
        }
    }
    findings
}

fn rank(name: &str) -> Option<u8> {
    RANKS
        .iter()
        .find(|(crate_name, _)| *crate_name == name)
        .map(|(_, rank)| *rank)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::workspace::Dependency;

    pub(crate) fn a_crate(name: &str, uses: &[&str], tests_use: &[&str]) -> Crate {
        let dependency = |tests_only| {
            move |name: &&str| Dependency {
                name: (*name).to_owned(),
                tests_only,
            }
        };
        Crate {
            name: name.to_owned(),
            folder: format!("crates/{name}"),
            dependencies: uses
                .iter()
                .map(dependency(false))
                .chain(tests_use.iter().map(dependency(true)))
                .collect(),
        }
    }

    #[test]
    fn downward_is_allowed() {
        assert!(violations(&[a_crate("senda_sim", &["senda_world", "senda_core", "glam"], &[])]).is_empty());
    }

    #[test]
    fn sideways_and_upward_are_refused_with_the_path() {
        let findings = violations(&[a_crate("senda_drivers", &["senda_sim", "senda_run"], &[])]);
        assert_eq!(findings.len(), 2);
        assert!(
            findings[0].contains("senda_drivers (rank 3) -> senda_sim (rank 3)"),
            "{findings:?}"
        );
    }

    #[test]
    fn tests_reach_sideways_but_not_upward() {
        assert!(violations(&[a_crate("senda_drivers", &[], &["senda_sim"])]).is_empty());
        assert_eq!(
            violations(&[a_crate("senda_drivers", &[], &["senda_run"])]).len(),
            1
        );
    }

    #[test]
    fn a_crate_without_a_rank_is_refused() {
        assert!(violations(&[a_crate("senda_utils", &[], &[])])[0].contains("no rank"));
    }
}
