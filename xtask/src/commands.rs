//! Command lines shown in the documentation are understood by the program.

use anyhow::{Context as _, Result};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// A `senda …` line of a page.
pub(crate) struct Shown {
    /// Page and line number.
    place: String,
    /// The words after `senda`.
    words: Vec<String>,
}

/// Every line of a fenced block that runs the program, on the root's pages and under `docs/`.
pub(crate) fn shown(texts: &BTreeMap<String, String>) -> Vec<Shown> {
    let mut lines = Vec::new();
    for (name, text) in texts {
        if !name.ends_with(".md") || (name.contains('/') && !name.starts_with("docs/")) {
            continue;
        }
        let mut fenced = false;
        for (number, line) in text.lines().enumerate() {
            if line.trim_start().starts_with("```") {
                fenced = !fenced;
            } else if fenced && let Some(rest) = after_program(line) {
                // A comment, a pipe or a second command ends what this program sees.
                let words = rest
                    .split_whitespace()
                    .take_while(|word| !["#", "|", "&&", ">", "\\", ";"].contains(word));
                let place = format!("{name}:{}", number + 1);
                lines.push(Shown {
                    place,
                    words: words.map(str::to_owned).collect(),
                });
            }
        }
    }
    lines
}

/// What follows the program's name, however the line starts it.
fn after_program(line: &str) -> Option<&str> {
    let line = line.trim().trim_start_matches("$ ");
    if line == "senda" {
        return Some("");
    }
    // An example is another program.
    if line.starts_with("cargo run") && !line.contains(" --example ") {
        return line.split_once(" -- ").map(|(_, rest)| rest);
    }
    line.strip_prefix("senda ")
        .or_else(|| line.strip_prefix("./target/release/senda "))
}

/// Lines with a command or an option that `help` (the program's help for some words) does not mention.
pub(crate) fn violations(
    lines: &[Shown],
    help: &mut impl FnMut(&[String]) -> Result<String>,
) -> Result<Vec<String>> {
    let mut findings = Vec::new();
    for line in lines {
        let mut command: Vec<String> = Vec::new();
        let mut page = help(&command)?;
        for word in &line.words {
            let commands = commands_in(&page);
            if word.starts_with('-') || commands.is_empty() {
                break;
            }
            if !commands.contains(&word.as_str()) {
                findings.push(format!(
                    "{}: `senda {}` has no command `{word}`; expected one of {}",
                    line.place,
                    command.join(" "),
                    commands.join(", ")
                ));
                break;
            }
            command.push(word.clone());
            page = help(&command)?;
        }
        for word in line
            .words
            .iter()
            .filter(|word| word.starts_with("--") && word.len() > 2)
        {
            let option = word.split('=').next().unwrap_or(word);
            let known = page
                .split(|c: char| !(c.is_alphanumeric() || c == '-'))
                .any(|found| found == option);
            if !known {
                findings.push(format!(
                    "{}: `senda {}` has no option {option}",
                    line.place,
                    command.join(" ")
                ));
            }
        }
    }
    Ok(findings)
}

/// The names under `Commands:` of a help page.
fn commands_in(page: &str) -> Vec<&str> {
    page.lines()
        .skip_while(|line| line.trim() != "Commands:")
        .skip(1)
        .take_while(|line| line.starts_with("  "))
        // Names stand two blanks in; their wrapped descriptions stand further in.
        .filter(|line| !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .collect()
}

/// Runs `program WORDS --help`.
pub(crate) fn help_of(program: &Path, words: &[String]) -> Result<String> {
    let output = Command::new(program)
        .args(words)
        .arg("--help")
        .output()
        .with_context(|| format!("cannot run {}", program.display()))?;
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn help(words: &[String]) -> Result<String> {
        Ok(match words.join(" ").as_str() {
            "" => {
                "Commands:\n  drive  Drives\n             and more\n  world  Worlds\n\nOptions:\n  -h, --help"
            }
            "drive" => "Usage: senda drive\n\nOptions:\n  --world <W>  the world\n  --laps <N>",
            "world" => "Commands:\n  draw  Draws\n\nOptions:",
            _ => "Options:\n  --svg",
        }
        .to_owned())
    }

    fn check(line: &str) -> Vec<String> {
        let page = format!("# Title\nsenda nonsense outside a block\n```sh\n{line}\n```\n");
        let lines = shown(&BTreeMap::from([("README.md".to_owned(), page)]));
        assert_eq!(lines.len(), 1, "{line}");
        violations(&lines, &mut help).unwrap()
    }

    #[test]
    fn known_commands_pass() {
        for line in [
            "senda",
            "senda drive --world oval --laps=2   # a comment --with dashes",
            "$ senda world draw oval --svg | head --lines 3",
            "cargo run --release -- drive --laps 1",
        ] {
            assert!(check(line).is_empty(), "{line}: {:?}", check(line));
        }
    }

    #[test]
    fn an_example_is_another_program() {
        assert_eq!(
            after_program("cargo run --release -p senda_nets --example speed -- 20"),
            None
        );
    }

    #[test]
    fn unknown_commands_and_options_are_found() {
        for line in [
            "senda dirve",
            "senda world darw",
            "senda drive --word oval",
            "cargo run -- drive --lap 1",
        ] {
            assert_eq!(check(line).len(), 1, "{line}: {:?}", check(line));
        }
    }
}
