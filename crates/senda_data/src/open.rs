//! Any data set by its path: which format it is, and its recordings.

use crate::store::Store;
use crate::warnings::Warnings;
use crate::{DataError, Recording, named_frames, tub, udacity};
use senda_core::Body;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::{Path, PathBuf};

/// The data formats that can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// A recording of senda: an MCAP file, or a folder of such files.
    Recording,
    /// A Donkeycar tub, version 2.
    Tub,
    /// A recording of the Udacity simulator.
    Udacity,
    /// Pictures with the angle in their names.
    NamedFrames,
}

impl Format {
    /// All formats.
    pub const ALL: [Format; 4] = [Self::Recording, Self::Tub, Self::Udacity, Self::NamedFrames];

    /// The name that commands and files use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Tub => "tub",
            Self::Udacity => "udacity",
            Self::NamedFrames => "named_frames",
        }
    }

    /// Which format lies at a path: by what is in it, not by its name.
    pub fn detect(path: &Path) -> Result<Self, DataError> {
        if path.is_file() {
            let mut head = Vec::new();
            std::fs::File::open(path)
                .and_then(|file| file.take(8).read_to_end(&mut head))
                .map_err(|e| DataError::read(path, e))?;
            // A recording that was cut off within its first bytes still has its name.
            if head.starts_with(MAGIC) || has_end(path, "mcap") {
                return Ok(Self::Recording);
            }
            if has_end(path, "csv") {
                return Ok(Self::Udacity);
            }
        }
        let mut warnings = Warnings::default();
        let store = Store::open(path, EXPECTED, &mut warnings)?;
        let holds =
            |wanted: &dyn Fn(&str) -> bool| store.folders_with(wanted).map(|folders| !folders.is_empty());
        if path.is_dir() && store.files_in("")?.iter().any(|name| is_recording(name)) {
            Ok(Self::Recording)
        } else if holds(&tub::is_tub_file)? {
            Ok(Self::Tub)
        } else if holds(&|name| name == udacity::LOG)? {
            Ok(Self::Udacity)
        } else if holds(&|name| named_frames::parse_name(name).is_some())? {
            Ok(Self::NamedFrames)
        } else if path.is_dir() && holds(&is_recording)? {
            Ok(Self::Recording)
        } else {
            Err(DataError::NotThat {
                path: path.to_owned(),
                expected: EXPECTED.into(),
                found: match warnings.finish().first() {
                    Some(warning) => format!("none of them in what can be read: {warning}"),
                    None => "none of them".into(),
                },
                advice: "give the file or the folder itself".into(),
            })
        }
    }
}

/// How every MCAP file begins.
const MAGIC: &[u8] = b"\x89MCAP";

const EXPECTED: &str = "a recording (.mcap), a Donkeycar tub, a folder with driving_log.csv, pictures with the angle in \
                        their names, or a .tar.gz of one of these";

fn is_recording(name: &str) -> bool {
    has_end(Path::new(name), "mcap")
}

fn has_end(path: &Path, end: &str) -> bool {
    path.extension()
        .is_some_and(|found| found.eq_ignore_ascii_case(end))
}

/// Reads any data set as one recording. `body` is the vehicle that recorded foreign data; recordings of senda bring
/// their own.
pub fn open(path: &Path, body: &Body) -> Result<Recording, DataError> {
    match Format::detect(path)? {
        Format::Recording if path.is_dir() => match recordings_in(path)?.as_slice() {
            [only] => Recording::read(only),
            several => Err(DataError::NotThat {
                path: path.to_owned(),
                expected: "one recording".into(),
                found: format!("{} recordings", several.len()),
                advice: format!("give one of them, such as {}", several[0].display()),
            }),
        },
        Format::Recording => Recording::read(path),
        Format::Tub => tub::read(path, body),
        Format::Udacity => udacity::read(path, body),
        Format::NamedFrames => named_frames::read(path, body),
    }
}

/// Reads any data set as one recording per run.
pub fn open_runs(path: &Path, body: &Body) -> Result<Vec<Recording>, DataError> {
    match Format::detect(path)? {
        Format::Recording if path.is_dir() => {
            let recordings = recordings_in(path)?;
            let mut runs: Vec<Recording> = recordings
                .iter()
                .map(|path| Recording::read(path))
                .collect::<Result<_, _>>()?;
            if let Some(first) = runs.first_mut() {
                first.warnings.splice(..0, left_out(path)?);
            }
            Ok(runs)
        }
        Format::Recording => Ok(vec![Recording::read(path)?]),
        Format::Tub => tub::read_runs(path, body),
        Format::Udacity => udacity::read_runs(path, body),
        Format::NamedFrames => named_frames::read_runs(path, body),
    }
}

/// The recordings in a folder and up to two folders below it, sorted by name. Files that are called recordings and are none are
/// left out ([`left_out`]); nothing but such files is an error.
pub fn recordings_in(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let mut named = named_recordings(folder)?;
    let count = named.len();
    named.retain(|path| !is_something_else(path));
    if named.is_empty() && count > 0 {
        return Err(DataError::NotThat {
            path: folder.to_owned(),
            expected: "a recording (MCAP)".into(),
            found: format!("none among the {count} of that name"),
            advice: "record the runs again".into(),
        });
    }
    Ok(named)
}

/// What to say of files in a folder of recordings that have a recording's name and are none: what a run that failed before its
/// first step left behind, for example.
pub fn left_out(folder: &Path) -> Result<Vec<String>, DataError> {
    let mut named = named_recordings(folder)?;
    named.retain(|path| is_something_else(path));
    Ok(named.iter().map(|path| no_recording(path)).collect())
}

/// Of several files that were named, those that are recordings, and what to say of the others. A file alone is kept whatever it is:
/// reading it says what is wrong.
pub fn recordings_among(paths: &[PathBuf]) -> (Vec<PathBuf>, Vec<String>) {
    let (others, recordings): (Vec<PathBuf>, Vec<PathBuf>) =
        paths.iter().cloned().partition(|path| is_something_else(path));
    if recordings.is_empty() {
        return (others, Vec::new());
    }
    (recordings, others.iter().map(|path| no_recording(path)).collect())
}

fn no_recording(path: &Path) -> String {
    format!(
        "{}: left out: expected a recording (MCAP), but found a file that does not begin like one",
        path.display()
    )
}

/// Whether a file that can be read does not begin as a recording does.
fn is_something_else(path: &Path) -> bool {
    let mut head = Vec::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut head))
        .is_ok_and(|_| head != MAGIC)
}

/// The files with a recording's name.
fn named_recordings(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let store = Store::Folder(folder.to_owned());
    let mut found = Vec::new();
    for inside in store.folders_with(&is_recording)? {
        let names = store.files_in(&inside)?;
        let recordings = names.iter().filter(|name| is_recording(name));
        found.extend(recordings.map(|name| folder.join(&inside).join(name)));
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_are_found_in_the_folder_and_below() {
        let top = tempfile::tempdir().unwrap();
        let folder = top.path();
        let put = |name: &str| {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, MAGIC).unwrap();
            path
        };
        let below = [
            put("monday/a.mcap"),
            put("monday/b.mcap"),
            put("tuesday/late/c.MCAP"),
        ];
        put("monday/report.html");
        put("far/too/deep/d.mcap");
        assert_eq!(recordings_in(folder).unwrap(), below);
        // Recordings beside folders are the data set; what else lies in the folders is something else.
        let beside = put("e.mcap");
        assert_eq!(recordings_in(folder).unwrap(), [beside]);
    }

    /// A file without a byte, left by a run that never began, blocked the whole folder.
    #[test]
    fn files_that_are_no_recordings_do_not_block_a_folder() {
        let top = tempfile::tempdir().unwrap();
        let [empty, good] = ["a.mcap", "b.mcap"].map(|name| top.path().join(name));
        std::fs::write(&empty, b"").unwrap();
        let error = recordings_in(top.path()).unwrap_err().to_string();
        assert!(error.contains("none among the 1 of that name"), "{error}");
        let alone = recordings_among(std::slice::from_ref(&empty));
        assert_eq!(alone, (vec![empty.clone()], vec![]));
        std::fs::write(&good, MAGIC).unwrap();
        assert_eq!(recordings_in(top.path()).unwrap(), std::slice::from_ref(&good));
        let [words] = &left_out(top.path()).unwrap()[..] else {
            panic!("one file is left out")
        };
        assert!(words.contains("a.mcap: left out"), "{words}");
        assert_eq!(
            recordings_among(&[empty, good.clone()]),
            (vec![good], vec![words.clone()])
        );
    }

    #[test]
    fn other_data_stay_what_they_are_with_recordings_below() {
        let top = tempfile::tempdir().unwrap();
        std::fs::create_dir(top.path().join("runs")).unwrap();
        std::fs::write(top.path().join("runs/a.mcap"), b"").unwrap();
        assert_eq!(Format::detect(top.path()).unwrap(), Format::Recording);
        std::fs::write(top.path().join("manifest.json"), b"").unwrap();
        assert_eq!(Format::detect(top.path()).unwrap(), Format::Tub);
    }
}
