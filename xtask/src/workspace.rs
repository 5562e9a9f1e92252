//! What the checks look at: the workspace's crates, the packages they are built from, and the tracked files.

use anyhow::{Context as _, Result, bail};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Everything read from the repository.
pub(crate) struct Workspace {
    /// The workspace's own crates.
    pub(crate) crates: Vec<Crate>,
    /// Packages that the programs are built from, tests left out.
    pub(crate) packages: Vec<Package>,
    /// Paths of all files that git tracks or would track, relative to the root, with `/`.
    pub(crate) files: BTreeSet<String>,
    /// Contents of those that are text.
    pub(crate) texts: BTreeMap<String, String>,
}

/// A crate of the workspace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Crate {
    /// Its name.
    pub(crate) name: String,
    /// Its folder, relative to the root.
    pub(crate) folder: String,
    /// What it uses.
    pub(crate) dependencies: Vec<Dependency>,
}

/// One line of a `[dependencies]` table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Dependency {
    /// Name of the package.
    pub(crate) name: String,
    /// Whether only tests and benchmarks use it.
    pub(crate) tests_only: bool,
}

/// A package that ends in a program of ours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Package {
    /// Its name.
    pub(crate) name: String,
    /// The native library that its build script announces.
    pub(crate) links: Option<String>,
    /// Its licence as an SPDX expression.
    pub(crate) licence: String,
    /// The packages that lead to it, outermost first, itself last.
    pub(crate) path: Vec<String>,
}

impl Workspace {
    /// Reads crates from `cargo metadata` and files from git.
    pub(crate) fn read(root: &Path) -> Result<Self> {
        let metadata = cargo_metadata(root)?;
        let files = tracked_files(root)?;
        let texts = files
            .iter()
            .filter_map(|name| Some((name.clone(), std::fs::read_to_string(root.join(name)).ok()?)))
            .collect();
        Ok(Self {
            crates: crates(&metadata, root)?,
            packages: packages(&metadata)?,
            files,
            texts,
        })
    }
}

/// Only this machine's platform: packages of the others need not even be downloaded.
fn cargo_metadata(root: &Path) -> Result<Value> {
    let about_rustc = output_of(root, "rustc", &["-vV"])?;
    let host = about_rustc
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .context("rustc -vV: expected a line `host: …`")?;
    let arguments = ["metadata", "--format-version", "1", "--filter-platform", host];
    let metadata = output_of(root, "cargo", &arguments)?;
    serde_json::from_str(&metadata).context("cargo metadata printed something that is not JSON")
}

fn output_of(root: &Path, program: &str, arguments: &[&str]) -> Result<String> {
    let output = Command::new(program)
        .args(arguments)
        .current_dir(root)
        .output()
        .with_context(|| format!("cannot run {program}"))?;
    if !output.status.success() {
        let reason = String::from_utf8_lossy(&output.stderr);
        bail!("{program} {} failed: {}", arguments.join(" "), reason.trim());
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// The workspace's crates as `cargo metadata` tells them.
fn crates(metadata: &Value, root: &Path) -> Result<Vec<Crate>> {
    let members: BTreeSet<&str> = list(metadata, "workspace_members")?
        .iter()
        .filter_map(Value::as_str)
        .collect();
    let mut crates = Vec::new();
    for package in list(metadata, "packages")? {
        if !members.contains(text(package, "id")?) {
            continue;
        }
        let folder = PathBuf::from(text(package, "manifest_path")?);
        let folder = folder.parent().unwrap_or(&folder);
        let dependencies = list(package, "dependencies")?
            .iter()
            .map(|dependency| {
                Ok(Dependency {
                    name: text(dependency, "name")?.to_owned(),
                    tests_only: dependency["kind"] == "dev",
                })
            })
            .collect::<Result<_>>()?;
        crates.push(Crate {
            name: text(package, "name")?.to_owned(),
            folder: folder
                .strip_prefix(root)
                .unwrap_or(folder)
                .to_string_lossy()
                .replace('\\', "/"),
            dependencies,
        });
    }
    Ok(crates)
}

/// Every package that a workspace crate is built from, with the way that leads to it.
fn packages(metadata: &Value) -> Result<Vec<Package>> {
    let mut described = BTreeMap::new();
    for package in list(metadata, "packages")? {
        described.insert(text(package, "id")?, package);
    }
    let mut uses: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for node in list(&metadata["resolve"], "nodes")? {
        let used = list(node, "deps")?
            .iter()
            .filter(|dep| {
                dep["dep_kinds"]
                    .as_array()
                    .is_none_or(|kinds| kinds.iter().any(|k| k["kind"] != "dev"))
            })
            .filter_map(|dep| dep["pkg"].as_str())
            .collect();
        uses.insert(text(node, "id")?, used);
    }
    let mut waiting: Vec<(&str, Vec<String>)> = Vec::new();
    for member in list(metadata, "workspace_members")? {
        waiting.push((member.as_str().unwrap_or_default(), Vec::new()));
    }
    let (mut seen, mut packages) = (BTreeSet::new(), Vec::new());
    while let Some((id, mut path)) = waiting.pop() {
        if !seen.insert(id) {
            continue;
        }
        let Some(package) = described.get(id) else {
            continue;
        };
        let name = text(package, "name")?.to_owned();
        path.push(name.clone());
        for next in uses.get(id).into_iter().flatten() {
            waiting.push((next, path.clone()));
        }
        packages.push(Package {
            name,
            links: package["links"].as_str().map(str::to_owned),
            licence: package["license"].as_str().unwrap_or_default().to_owned(),
            path,
        });
    }
    Ok(packages)
}

/// Files that git tracks or would track; without git (an unpacked archive) every file outside build folders.
fn tracked_files(root: &Path) -> Result<BTreeSet<String>> {
    let listed = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard", "-z"])
        .current_dir(root)
        .output();
    if let Ok(output) = listed
        && output.status.success()
    {
        let names = String::from_utf8_lossy(&output.stdout);
        return Ok(names
            .split('\0')
            .filter(|name| !name.is_empty() && root.join(name).is_file())
            .map(str::to_owned)
            .collect());
    }
    let mut files = BTreeSet::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in
            std::fs::read_dir(&folder).with_context(|| format!("cannot list {}", folder.display()))?
        {
            let path = entry?.path();
            let name = path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            if path.is_dir() {
                if !["target", ".git", "runs", "node_modules"].contains(&name.as_str()) {
                    folders.push(path);
                }
            } else if let Ok(relative) = path.strip_prefix(root) {
                files.insert(relative.to_string_lossy().replace('\\', "/"));
            }
        }
    }
    Ok(files)
}

fn list<'a>(value: &'a Value, key: &str) -> Result<&'a Vec<Value>> {
    value[key]
        .as_array()
        .with_context(|| format!("cargo metadata: expected a list `{key}`"))
}

fn text<'a>(value: &'a Value, key: &str) -> Result<&'a str> {
    value[key]
        .as_str()
        .with_context(|| format!("cargo metadata: expected a text `{key}`"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn metadata() -> Value {
        json!({
            "workspace_members": ["path#a"],
            "packages": [
                {"id": "path#a", "name": "a", "manifest_path": "/repo/crates/a/Cargo.toml", "links": null,
                 "dependencies": [{"name": "b", "kind": null}, {"name": "t", "kind": "dev"}]},
                {"id": "reg#b", "name": "b", "manifest_path": "/reg/b/Cargo.toml", "links": "z", "dependencies": []},
                {"id": "reg#t", "name": "t", "manifest_path": "/reg/t/Cargo.toml", "links": "y", "dependencies": []}
            ],
            "resolve": {"nodes": [
                {"id": "path#a", "deps": [
                    {"pkg": "reg#b", "dep_kinds": [{"kind": null}]},
                    {"pkg": "reg#t", "dep_kinds": [{"kind": "dev"}]}]},
                {"id": "reg#b", "deps": []},
                {"id": "reg#t", "deps": []}
            ]}
        })
    }

    #[test]
    fn only_members_are_crates_and_tests_are_told_apart() {
        let crates = crates(&metadata(), Path::new("/repo")).unwrap();
        assert_eq!(crates.len(), 1);
        assert_eq!(
            (crates[0].name.as_str(), crates[0].folder.as_str()),
            ("a", "crates/a")
        );
        let tests_only: Vec<bool> = crates[0].dependencies.iter().map(|d| d.tests_only).collect();
        assert_eq!(tests_only, [false, true]);
    }

    #[test]
    fn packages_of_tests_do_not_count_and_paths_lead_to_the_rest() {
        let packages = packages(&metadata()).unwrap();
        let b = packages.iter().find(|p| p.name == "b").unwrap();
        assert_eq!(
            (b.links.as_deref(), b.path.join(" -> ").as_str()),
            (Some("z"), "a -> b")
        );
        assert!(packages.iter().all(|p| p.name != "t"));
    }
}
