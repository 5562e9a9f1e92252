//! Darknet's data sets (FORMATS 5; D7 in SPEC): a `.data` file names lists of pictures and the classes' names; beside every
//! picture lies a `.txt` with a line a box.
//!
//! Boxes are `<class> <x> <y> <width> <height>`: the middle and the size in parts of the picture, from the upper left corner.

use crate::DataError;
use crate::warnings::Warnings;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Most classes of a data set: bounds what a hostile file can ask for (guess; ImageNet has 1,000).
const MOST_CLASSES: usize = 10_000;

/// What a `.data` file says. Paths are as written; relative ones start at the file's folder, or where the program runs.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct DataFile {
    /// Number of classes.
    pub classes: usize,
    /// List of the pictures to learn from.
    pub train: Option<PathBuf>,
    /// List of the pictures that judge.
    pub valid: Option<PathBuf>,
    /// The classes' names, a line each.
    pub names: Option<PathBuf>,
    /// Folder for weights.
    pub backup: Option<PathBuf>,
    /// Keys that are none of these.
    pub warnings: Vec<String>,
}

/// A box with its class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Label {
    /// Number of the class.
    pub class: usize,
    /// Middle, to the right (part of the picture's width).
    pub x: f32,
    /// Middle, down (part of the height).
    pub y: f32,
    /// Width (part of the width).
    pub width: f32,
    /// Height (part of the height).
    pub height: f32,
}

/// Pictures with their boxes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LabelledImages {
    /// Path of each picture, and what is in it.
    pub images: Vec<(PathBuf, Vec<Label>)>,
    /// What was left out.
    pub warnings: Vec<String>,
}

fn read_text(path: &Path) -> Result<String, DataError> {
    let bytes = std::fs::read(path).map_err(|source| DataError::read(path, source))?;
    // Names may be in any encoding; what is not UTF-8 stays visible as such.
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

impl DataFile {
    /// Reads a `.data` file's text; `path` is for messages.
    ///
    /// # Errors
    /// When a line is no `key=value`, or the number of classes is missing or none.
    pub fn parse(path: &Path, text: &str) -> Result<Self, DataError> {
        let wrong = |key: String, expected: &str, found: String| DataError::Value {
            path: path.to_owned(),
            key,
            expected: expected.to_owned(),
            found,
        };
        let mut data = Self::default();
        let mut classes = None;
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with(['#', ';']) {
                continue;
            }
            let Some((key, value)) = line.split_once('=') else {
                return Err(wrong(
                    format!("line {}", number + 1),
                    "key=value",
                    format!("{line:?}"),
                ));
            };
            let (key, value) = (key.trim(), value.trim());
            let place = match key {
                "classes" => {
                    let count = value
                        .parse()
                        .ok()
                        .filter(|count| (1..=MOST_CLASSES).contains(count));
                    let Some(count) = count else {
                        return Err(wrong(
                            "classes".into(),
                            "a number from 1 to 10000",
                            format!("{value:?}"),
                        ));
                    };
                    classes = Some(count);
                    continue;
                }
                "train" => &mut data.train,
                "valid" => &mut data.valid,
                "names" => &mut data.names,
                "backup" => &mut data.backup,
                other => {
                    let text = format!(
                        "{}:{}: key {other:?} is not known and left out",
                        path.display(),
                        number + 1
                    );
                    data.warnings.push(text);
                    continue;
                }
            };
            *place = Some(PathBuf::from(value));
        }
        data.classes =
            classes.ok_or_else(|| wrong("classes".into(), "a number from 1 to 10000", "nothing".into()))?;
        Ok(data)
    }

    /// Reads a `.data` file.
    ///
    /// # Errors
    /// As [`DataFile::parse`], and when it cannot be read.
    pub fn load(path: &Path) -> Result<Self, DataError> {
        Self::parse(path, &read_text(path)?)
    }

    /// As a `.data` file's text.
    pub fn to_text(&self) -> String {
        let mut out = format!("classes={}\n", self.classes);
        for (key, path) in [
            ("train", &self.train),
            ("valid", &self.valid),
            ("names", &self.names),
            ("backup", &self.backup),
        ] {
            if let Some(path) = path {
                // Writing to a String cannot fail.
                let _ = writeln!(out, "{key}={}", path.display());
            }
        }
        out
    }

    /// The classes' names; numbers where there is no file of names. `file` is the `.data` file's own path.
    ///
    /// # Errors
    /// When the names cannot be read, or there are fewer than classes.
    pub fn class_names(&self, file: &Path) -> Result<Vec<String>, DataError> {
        let Some(names) = &self.names else {
            return Ok((0..self.classes).map(|class| class.to_string()).collect());
        };
        let path = find(names, file.parent());
        let mut all = parse_names(&read_text(&path)?);
        if all.len() < self.classes {
            return Err(DataError::Value {
                path,
                key: "names".into(),
                expected: format!("{} lines, one for each class", self.classes),
                found: all.len().to_string(),
            });
        }
        all.truncate(self.classes);
        Ok(all)
    }

    /// The pictures of one of its lists with their boxes: `list` is [`DataFile::train`] or [`DataFile::valid`], `file` the
    /// `.data` file's own path. A picture without a label file is an empty one; broken lines are left out with a warning.
    ///
    /// # Errors
    /// When the list itself cannot be read.
    pub fn images(&self, list: &Path, file: &Path) -> Result<LabelledImages, DataError> {
        let list = find(list, file.parent());
        let text = read_text(&list)?;
        let mut warnings = Warnings::default();
        let mut images = Vec::new();
        for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
            let image = find(Path::new(line), file.parent());
            let labels = label_path(&image);
            let labels = match read_text(&labels) {
                Ok(text) => {
                    let (labels, broken) = parse_labels(&text, self.classes);
                    for (number, reason) in broken {
                        warnings.add("broken labels", || {
                            format!("{}:{number}: {reason}; the line is left out", labels_name(&image))
                        });
                    }
                    labels
                }
                Err(_) => {
                    warnings.add("pictures without a label file", || {
                        format!(
                            "{}: no label file: taken as a picture of nothing",
                            image.display()
                        )
                    });
                    Vec::new()
                }
            };
            images.push((image, labels));
        }
        Ok(LabelledImages {
            images,
            warnings: warnings.finish(),
        })
    }
}

fn labels_name(image: &Path) -> String {
    label_path(image).display().to_string()
}

/// A relative path starts at the data file's folder if something lies there, otherwise where the program runs.
fn find(path: &Path, folder: Option<&Path>) -> PathBuf {
    match folder {
        Some(folder) if path.is_relative() && folder.join(path).exists() => folder.join(path),
        _ => path.to_owned(),
    }
}

/// The classes' names in a `.names` file's text: a line each, empty lines at the end left out.
pub fn parse_names(text: &str) -> Vec<String> {
    text.trim_end()
        .lines()
        .map(|line| line.trim().to_owned())
        .collect()
}

/// Where a picture's labels lie: beside it, or, where that file does not exist, in the folder `labels` in place of `images`, as
/// darknet has it.
pub fn label_path(image: &Path) -> PathBuf {
    let beside = image.with_extension("txt");
    let folder = image.parent();
    if !beside.exists()
        && let Some(parent) = folder.filter(|folder| folder.file_name().is_some_and(|name| name == "images"))
        && let Some(name) = beside.file_name()
    {
        return parent.with_file_name("labels").join(name);
    }
    beside
}

/// The boxes of a label file's text, and the lines that are none with what is wrong about them. Boxes that stick out a little,
/// as tools write them, are kept.
pub fn parse_labels(text: &str, classes: usize) -> (Vec<Label>, Vec<(usize, String)>) {
    let mut labels = Vec::new();
    let mut broken = Vec::new();
    for (number, line) in text.lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        match parse_label(line, classes) {
            Ok(label) => labels.push(label),
            Err(reason) => broken.push((number + 1, reason)),
        }
    }
    (labels, broken)
}

fn parse_label(line: &str, classes: usize) -> Result<Label, String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [class, rest @ ..] = &words[..] else {
        return Err("expected a box, but found nothing".to_owned());
    };
    let class = class
        .parse()
        .ok()
        .filter(|class| *class < classes)
        .ok_or_else(|| {
            format!(
                "expected a class from 0 to {}, but found {class:?}",
                classes.saturating_sub(1)
            )
        })?;
    let numbers: Vec<f32> = rest.iter().map_while(|word| word.parse().ok()).collect();
    let [x, y, width, height] = numbers[..] else {
        return Err(format!(
            "expected four numbers after the class, but found {line:?}"
        ));
    };
    let is_middle = |place: f32| (-0.5..=1.5).contains(&place);
    let is_size = |size: f32| size > 0.0 && size <= 1.5;
    if rest.len() != 4 || !is_middle(x) || !is_middle(y) || !is_size(width) || !is_size(height) {
        return Err(format!("expected parts of the picture, but found {line:?}"));
    }
    Ok(Label {
        class,
        x,
        y,
        width,
        height,
    })
}

/// As a label file's text.
pub fn labels_to_text(labels: &[Label]) -> String {
    let mut out = String::new();
    for label in labels {
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "{} {:.6} {:.6} {:.6} {:.6}",
            label.class, label.x, label.y, label.width, label.height
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn boxes_are_middle_and_size_in_parts_from_the_upper_left() {
        let (labels, broken) = parse_labels("3 0.25 0.5 0.1 0.2\n", 4);
        assert!(broken.is_empty());
        let [label] = labels[..] else { panic!("{labels:?}") };
        // A box left of the middle, in the middle of the height, higher than wide.
        assert_eq!(
            (label.class, label.x, label.y, label.width, label.height),
            (3, 0.25, 0.5, 0.1, 0.2)
        );
    }

    #[test]
    fn broken_lines_cost_only_themselves() {
        let text = "0 0.5 0.5 0.1 0.1\n4 0.5 0.5 0.1 0.1\n0 0.5 0.5 0.1\n\n1 0.5 nan 0.1 0.1\n1 0.5 0.5 0 0.1\n1 0.5 0.5 0.1 0.1 7\n1 0.1 0.1 0.1 0.1";
        let (labels, broken) = parse_labels(text, 4);
        assert_eq!(labels.len(), 2);
        let lines: Vec<usize> = broken.iter().map(|(line, _)| *line).collect();
        assert_eq!(lines, [2, 3, 5, 6, 7]);
        assert!(broken[0].1.contains("class from 0 to 3"));
    }

    proptest! {
        #[test]
        fn written_labels_are_read_back(
            boxes in prop::collection::vec((0usize..4, 0.0f32..1.0, 0.0f32..1.0, 0.01f32..1.0, 0.01f32..1.0), 0..9),
        ) {
            let labels: Vec<Label> = boxes
                .iter()
                .map(|&(class, x, y, width, height)| Label { class, x, y, width, height })
                .collect();
            let (again, broken) = parse_labels(&labels_to_text(&labels), 4);
            prop_assert!(broken.is_empty());
            prop_assert_eq!(again.len(), labels.len());
            for (a, b) in again.iter().zip(&labels) {
                prop_assert!(a.class == b.class && (a.x - b.x).abs() < 1e-6 && (a.height - b.height).abs() < 1e-6);
            }
        }

        #[test]
        fn no_text_makes_the_readers_panic(text in "\\PC*", lines in "([0-9 .=a-z-]*\n){0,6}") {
            for text in [text, lines] {
                let _ = DataFile::parse(Path::new("x.data"), &text);
                parse_labels(&text, 3);
                parse_names(&text);
            }
        }
    }

    #[test]
    fn a_data_set_on_disk_is_read_with_what_is_missing_told() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let data = DataFile {
            classes: 2,
            train: Some("train.txt".into()),
            names: Some("set.names".into()),
            ..DataFile::default()
        };
        std::fs::create_dir_all(at("images")).unwrap();
        std::fs::create_dir_all(at("labels")).unwrap();
        for (name, text) in [
            ("set.data", data.to_text().as_str()),
            ("set.names", "lamp\nsign\n\n"),
            ("train.txt", "images/a.jpg\nimages/b.jpg\r\nimages/c.jpg\n"),
            ("images/a.txt", "0 0.5 0.5 0.2 0.2\n1 2\n"),
            ("labels/b.txt", "1 0.5 0.5 0.2 0.2\n"),
            ("images/a.jpg", ""),
            ("images/b.jpg", ""),
            ("images/c.jpg", ""),
        ] {
            std::fs::write(at(name), text).unwrap();
        }
        let file = at("set.data");
        let read = DataFile::load(&file).unwrap();
        assert_eq!(read, data);
        assert_eq!(read.class_names(&file).unwrap(), ["lamp", "sign"]);
        let images = read.images(read.train.as_ref().unwrap(), &file).unwrap();
        let counts: Vec<usize> = images.images.iter().map(|(_, labels)| labels.len()).collect();
        assert_eq!(counts, [1, 1, 0]);
        assert!(images.warnings[0].contains("a.txt:2"), "{:?}", images.warnings);
        assert!(images.warnings[1].contains("c.jpg"), "{:?}", images.warnings);
        std::fs::write(at("set.names"), "lamp\n").unwrap();
        assert!(
            read.class_names(&file)
                .unwrap_err()
                .to_string()
                .contains("expected 2 lines")
        );
        for (text, word) in [
            ("train=a\n", "classes"),
            ("classes=0\n", "\"0\""),
            ("milk\n", "line 1"),
        ] {
            let error = DataFile::parse(&file, text).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
