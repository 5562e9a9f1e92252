//! `manifest.json`: five JSON values, one a line.

use crate::warnings::Warnings;
use serde_json::Value;
use std::collections::BTreeSet;

/// What a reader needs of a manifest.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Manifest {
    /// Names of the catalogs, in order.
    pub(super) catalogs: Vec<String>,
    /// Records that the user deleted.
    pub(super) deleted: BTreeSet<u64>,
    /// Who drove, where its metadata name a driver.
    pub(super) driver: Option<String>,
}

/// Reads what can be read; the rest becomes warnings. `name` is the file's name in them.
pub(super) fn parse(name: &str, bytes: &[u8], warnings: &mut Warnings) -> Manifest {
    let mut manifest = Manifest::default();
    let mut found = false;
    for (number, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
        if line.trim_ascii().is_empty() {
            continue;
        }
        let value: Value = match serde_json::from_slice(line) {
            Ok(value) => value,
            Err(reason) => {
                warnings.add("damaged manifest lines", || {
                    format!(
                        "{name}:{}: expected a JSON value, but {reason}: line left out",
                        number + 1
                    )
                });
                continue;
            }
        };
        // Old and new tubs differ in the order and content of the lines; the keys tell which is which.
        if let Some(paths) = value.get("paths").and_then(Value::as_array) {
            found = true;
            manifest
                .catalogs
                .extend(paths.iter().filter_map(Value::as_str).map(str::to_owned));
        }
        if let Some(driver) = value.get("driver").and_then(Value::as_str) {
            manifest.driver = Some(driver.to_owned());
        }
        if let Some(deleted) = value.get("deleted_indexes").and_then(Value::as_array) {
            manifest.deleted.extend(deleted.iter().filter_map(Value::as_u64));
        }
    }
    if !found {
        warnings.add("manifests without catalogs", || {
            format!("{name}: expected a line with `paths`, but found none: catalogs are taken by their names")
        });
    }
    manifest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, catalogs: &[&str], deleted: &[u64], warned: usize) {
        let mut warnings = Warnings::default();
        let manifest = parse("manifest.json", text.as_bytes(), &mut warnings);
        assert_eq!(manifest.catalogs, catalogs);
        assert_eq!(manifest.deleted.into_iter().collect::<Vec<_>>(), deleted);
        let warnings = warnings.finish();
        assert_eq!(warnings.len(), warned, "{warnings:?}");
    }

    #[test]
    fn five_lines_of_a_real_one() {
        check(
            "[\"cam/image_array\"]\n[\"image_array\"]\n{}\n{\"created_at\": 1.5}\n{\"paths\": [\"catalog_0.catalog\"], \"current_index\": 9, \"max_len\": 1000, \"deleted_indexes\": [3, 4]}\n",
            &["catalog_0.catalog"],
            &[3, 4],
            0,
        );
    }

    #[test]
    fn damage_costs_only_the_line() {
        check("", &[], &[], 1);
        check(
            "[1\n{\"paths\": [\"a\", 7], \"deleted_indexes\": [-1, 2.5, \"x\", 5]}",
            &["a"],
            &[5],
            1,
        );
        check("null\n5\n\"paths\"\n", &[], &[], 1);
    }
}
