//! Tells recordings which commit they were made by: `SENDA_COMMIT` where the builder sets it, else what git says, else
//! nothing ("unknown").

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=SENDA_COMMIT");
    if option_env!("SENDA_COMMIT").is_some() {
        return;
    }
    let git = |arguments: &[&str]| -> Option<String> {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    // The log of HEAD grows with every commit and checkout; a copy of the sources inside another project's repository
    // has no such file at this place and stays "unknown".
    let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) else {
        return;
    };
    println!("cargo::rerun-if-changed={log}");
    if let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]) {
        println!("cargo::rustc-env=SENDA_COMMIT={commit}");
    }
}
