//! Checks that the workspace keeps its own rules: `cargo xtask check`.
//!
//! Each check is a pure function from what was read to a list of findings, with a bad example in its tests. Reading
//! files and running `cargo` happens here and in [`workspace`] only. The rules themselves are data, in [`rules`].

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program that reports to a person"
)]

mod rules;
mod workspace;

mod ranks;

mod dependencies;
mod licences;

mod architecture;
mod front_pages;
mod library;
mod links;
mod texts;

mod commands;

use anyhow::{Context as _, Result, bail};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use workspace::Workspace;

const USAGE: &str = "\
usage:
  cargo xtask check              ranks, dependencies, documentation, texts
  cargo xtask commands PROGRAM   every `senda …` line in the documentation against PROGRAM's own help";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let findings = match words.as_slice() {
        ["check"] => check(&root()),
        ["commands", program] => check_commands(&root(), Path::new(program)),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    match findings {
        Ok(findings) if findings.is_empty() => ExitCode::SUCCESS,
        Ok(findings) => {
            for finding in &findings {
                eprintln!("error: {finding}");
            }
            eprintln!("xtask: {} to put right", count(findings.len(), "finding"));
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("xtask: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Runs every check on the workspace and returns what is wrong.
fn check(root: &Path) -> Result<Vec<String>> {
    let workspace = Workspace::read(root)?;
    let architecture = read(root, "ARCHITECTURE.md")?;
    let checks: [(&str, Vec<String>); 11] = [
        ("ranks", ranks::violations(&workspace.crates)),
        ("dependencies", dependencies::violations(&workspace.crates)),
        ("native libraries", dependencies::native(&workspace.packages)),
        (
            "sources",
            dependencies::foreign_sources(&read(root, "Cargo.lock")?),
        ),
        (
            "licences",
            licences::violations(&workspace.packages, &read(root, "deny.toml")?),
        ),
        (
            "architecture",
            architecture::violations(&architecture, &workspace.crates, &workspace.files),
        ),
        (
            "front pages",
            front_pages::violations(&workspace.crates, &workspace.texts),
        ),
        ("links", links::violations(&workspace.texts, &workspace.files)),
        ("index", links::unlisted(&workspace.texts)),
        ("texts", texts::machine_paths(&workspace.texts)),
        ("library", library::violations(&workspace.texts, &workspace.files)),
    ];
    let mut all = Vec::new();
    for (name, findings) in checks {
        let result = if findings.is_empty() {
            "ok".to_owned()
        } else {
            count(findings.len(), "finding")
        };
        println!("{name:<18}{result}");
        all.extend(findings.into_iter().map(|finding| format!("{name}: {finding}")));
    }
    for long in texts::long_files(&workspace.texts) {
        println!("note: {long}");
    }
    Ok(all)
}

/// Checks the command lines that the documentation shows against what the program itself says it understands.
fn check_commands(root: &Path, program: &Path) -> Result<Vec<String>> {
    let workspace = Workspace::read(root)?;
    let lines = commands::shown(&workspace.texts);
    if lines.is_empty() {
        bail!("expected at least one `senda …` line in README.md or docs/, found none");
    }
    let findings = commands::violations(&lines, &mut |words| commands::help_of(program, words))?;
    println!("{:<18}{}", "commands", count(lines.len(), "line"));
    Ok(findings)
}

fn count(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

fn read(root: &Path, name: &str) -> Result<String> {
    std::fs::read_to_string(root.join(name))
        .with_context(|| format!("expected {name} in the repository's root"))
}

/// The repository's root: the folder above this crate.
fn root() -> PathBuf {
    let mut root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    root.pop();
    root
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So that `cargo test` alone refuses a dependency that goes up.
    #[test]
    fn this_workspace_keeps_its_rules() {
        let findings = check(&root()).unwrap();
        assert!(findings.is_empty(), "{}", findings.join("\n"));
    }
}
