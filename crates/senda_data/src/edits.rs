//! Data hygiene (A6 in SPEC): frames that are left out and labels that are corrected, in a file beside data that stay as
//! they are.
//!
//! ```
//! use senda_data::Edits;
//! let mut edits = Edits::default();
//! edits.drop_steps(0, 0, 5); // exposure settles
//! edits.correct(0, 17, -12.5);
//! assert!(!edits.keeps(0, 4) && edits.keeps(0, 5));
//! assert_eq!(edits.corrected_deg(0, 17), Some(-12.5));
//! assert_eq!(Edits::parse("run.mcap.edits.toml".as_ref(), &edits.to_toml()).unwrap(), edits);
//! ```
//!
//! The file of `run.mcap` is `run.mcap.edits.toml`, that of the folder `tub` is `tub.edits.toml` beside it. Steps are
//! numbered from 0 as they were recorded, whatever else is edited, so edits never shift each other and can be undone one by one.

use crate::open::{Format, left_out, open_runs, recordings_in};
use crate::{DataError, Recording};
use senda_core::{Body, Turn, whole_file};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The version of the file that this program writes and reads.
pub const VERSION: u32 = 1;
/// Largest steering angle that can be meant (degrees): beyond a right angle wheels point backwards.
const STEERING_LIMIT_DEG: f64 = 90.0;
const HEAD: &str = "# What is not to be learned from. Steps are numbered from 0 as recorded; `to` is the first one that is kept again.
# Steering is the angle of the front wheels in degrees, left positive. The data themselves stay as they are.
";

/// Steps of a run that are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dropped {
    /// Which run of the data set, from 0.
    #[serde(default)]
    pub run: usize,
    /// First step that is left out.
    pub from: usize,
    /// First step after it that is kept.
    pub to: usize,
}

/// A corrected label.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CorrectedAngle {
    /// Which run of the data set, from 0.
    #[serde(default)]
    pub run: usize,
    /// Which step of the run, from 0.
    pub step: usize,
    /// Angle of the front wheels (degrees, left positive) that would have been right.
    pub steering_deg: f64,
}

/// The edits of one recording or foreign data set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edits {
    version: u32,
    /// Steps of every run when the edits were made: other data under the same name are noticed. Empty: unknown.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<usize>,
    /// What is left out.
    #[serde(default, rename = "drop", skip_serializing_if = "Vec::is_empty")]
    pub dropped: Vec<Dropped>,
    /// What is corrected.
    #[serde(default, rename = "angle", skip_serializing_if = "Vec::is_empty")]
    pub angles: Vec<CorrectedAngle>,
}

impl Default for Edits {
    fn default() -> Self {
        Self {
            version: VERSION,
            steps: Vec::new(),
            dropped: Vec::new(),
            angles: Vec::new(),
        }
    }
}

impl Edits {
    /// Where the edits of a recording or foreign data set lie.
    pub fn path_of(data: &Path) -> PathBuf {
        // `.` and `..` have no name of their own; a trailing slash is dropped by `file_name`.
        let named = match data.file_name() {
            Some(_) => data.to_owned(),
            None => data.canonicalize().unwrap_or_else(|_| data.to_owned()),
        };
        let mut name: OsString = named.file_name().unwrap_or_default().to_owned();
        name.push(".edits.toml");
        named.with_file_name(name)
    }

    /// Reads the text of a file. `path` is only for messages.
    pub fn parse(path: &Path, text: &str) -> Result<Self, DataError> {
        let wrong = |reason: String| {
            Err(DataError::Edits {
                path: path.to_owned(),
                reason,
            })
        };
        let edits: Self = match toml::from_str(text) {
            Ok(edits) => edits,
            Err(error) => return wrong(error.to_string().trim_end().to_owned()),
        };
        if edits.version != VERSION {
            return wrong(format!(
                "version: expected {VERSION}, but found {}; use the senda that wrote it",
                edits.version
            ));
        }
        for (number, Dropped { from, to, .. }) in edits.dropped.iter().enumerate() {
            if from >= to {
                return wrong(format!(
                    "[[drop]] number {}: expected `from` below `to`, but found {from} and {to}",
                    number + 1
                ));
            }
        }
        for (number, angle) in edits.angles.iter().enumerate() {
            // Not a number is in no range.
            if !(-STEERING_LIMIT_DEG..=STEERING_LIMIT_DEG).contains(&angle.steering_deg) {
                return wrong(format!(
                    "[[angle]] number {}: steering_deg: expected -{STEERING_LIMIT_DEG} to {STEERING_LIMIT_DEG}, but found {}",
                    number + 1,
                    angle.steering_deg
                ));
            }
        }
        Ok(edits)
    }

    /// The file's text.
    pub fn to_toml(&self) -> String {
        format!("{HEAD}{}", toml::to_string(self).unwrap_or_default())
    }

    /// The edits of a recording or foreign data set; none where there is no file.
    pub fn of(data: &Path) -> Result<Self, DataError> {
        let path = Self::path_of(data);
        match std::fs::read_to_string(&path) {
            Ok(text) => Self::parse(&path, &text),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(DataError::read(&path, error)),
        }
    }

    /// Writes them beside the data, the old file or the new one whole; no edits leave no file.
    pub fn save(&self, data: &Path) -> Result<(), DataError> {
        let path = Self::path_of(data);
        if self.is_empty() {
            return match std::fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    Err(DataError::write(&path, "the edits are as before", error))
                }
                _ => Ok(()),
            };
        }
        whole_file::replace(&path, |file| file.write_all(self.to_toml().as_bytes()))
            .map_err(|error| DataError::write(&path, "the edits are as before", error))
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.dropped.is_empty() && self.angles.is_empty()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.dropped.len() + self.angles.len()
    }

    /// Leaves out steps `from..to` of a run. Nothing happens for an empty range or one that is there already.
    pub fn drop_steps(&mut self, run: usize, from: usize, to: usize) {
        let dropped = Dropped { run, from, to };
        if from < to && !self.dropped.contains(&dropped) {
            self.dropped.push(dropped);
        }
    }

    /// Corrects the steering (degrees, left positive) of a step, in place of an earlier correction.
    pub fn correct(&mut self, run: usize, step: usize, steering_deg: f64) {
        self.angles.retain(|angle| (angle.run, angle.step) != (run, step));
        self.angles.push(CorrectedAngle {
            run,
            step,
            steering_deg,
        });
    }

    /// Takes back the edit with this number, from 1: what is left out first, then what is corrected. `false` when there is none.
    pub fn undo(&mut self, number: usize) -> bool {
        let Some(index) = number.checked_sub(1).filter(|index| *index < self.len()) else {
            return false;
        };
        match index.checked_sub(self.dropped.len()) {
            None => drop(self.dropped.remove(index)),
            Some(index) => drop(self.angles.remove(index)),
        }
        true
    }

    /// Whether a step is kept.
    pub fn keeps(&self, run: usize, step: usize) -> bool {
        !self
            .dropped
            .iter()
            .any(|dropped| dropped.run == run && (dropped.from..dropped.to).contains(&step))
    }

    /// The corrected steering (degrees, left positive) of a step, where it was corrected.
    pub fn corrected_deg(&self, run: usize, step: usize) -> Option<f64> {
        let angle = self
            .angles
            .iter()
            .find(|angle| (angle.run, angle.step) == (run, step))?;
        Some(angle.steering_deg)
    }

    /// Applies them to a run that was read. Edits that name steps which it does not have are warned of.
    pub fn apply(&self, run: usize, recording: &mut Recording) {
        recording
            .warnings
            .extend(self.misfits(run, recording.steps.len()));
        for angle in self.angles.iter().filter(|angle| angle.run == run) {
            if let Some(step) = recording.steps.get_mut(angle.step) {
                step.command.turn = Turn::SteeringRad(angle.steering_deg.to_radians());
            }
        }
        let mut number = 0;
        recording.steps.retain(|_| {
            number += 1;
            self.keeps(run, number - 1)
        });
    }

    /// What does not fit a run of so many steps, in words.
    pub(crate) fn misfits(&self, run: usize, steps: usize) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(were) = self.steps.get(run).filter(|were| **were != steps) {
            warnings.push(format!(
                "the edits were made for {were} steps, but there are {steps}: check them with `senda data clean --list`"
            ));
        }
        let beyond = |end: &usize| *end > steps;
        let ends = self
            .dropped
            .iter()
            .filter(|d| d.run == run)
            .map(|d| d.to)
            .filter(beyond);
        let angles = self.angles.iter().filter(|a| a.run == run).map(|a| a.step + 1);
        let count = ends.chain(angles.filter(beyond)).count();
        if count > 0 {
            warnings.push(format!(
                "{count} edits name steps beyond the last one ({steps} steps)"
            ));
        }
        warnings
    }
}

/// What has edits of its own at a path: every recording of a folder, else the path itself.
pub fn parts(path: &Path) -> Result<Vec<PathBuf>, DataError> {
    if Format::detect(path)? == Format::Recording && path.is_dir() {
        recordings_in(path)
    } else {
        Ok(vec![path.to_owned()])
    }
}

/// What to say of files at a path that are none of its [`parts`] though they have the name.
pub fn no_parts(path: &Path) -> Result<Vec<String>, DataError> {
    if path.is_dir() && Format::detect(path)? == Format::Recording {
        left_out(path)
    } else {
        Ok(Vec::new())
    }
}

/// As [`open_runs`], with the edits beside the data applied.
pub fn open_edited_runs(path: &Path, body: &Body) -> Result<Vec<Recording>, DataError> {
    let mut all = Vec::new();
    for part in parts(path)? {
        let edits = Edits::of(&part)?;
        for (run, mut recording) in open_runs(&part, body)?.into_iter().enumerate() {
            edits.apply(run, &mut recording);
            all.push(recording);
        }
    }
    if let Some(first) = all.first_mut() {
        first.warnings.splice(..0, no_parts(path)?);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn refused(text: &str) -> String {
        Edits::parse(Path::new("a.edits.toml"), text)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn the_file_lies_beside_the_data() {
        let name = |data: &str| Edits::path_of(Path::new(data)).display().to_string();
        assert_eq!(name("runs/oval-1.mcap"), "runs/oval-1.mcap.edits.toml");
        assert_eq!(name("tub/"), "tub.edits.toml");
        assert_eq!(name("tub.tar.gz"), "tub.tar.gz.edits.toml");
        assert!(name(".").ends_with(".edits.toml") && name(".") != ".edits.toml");
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        let message = refused("version = 1\n[[drop]]\nfrom = 5\nto = 5\n");
        assert!(
            message.contains("[[drop]] number 1") && message.contains("from"),
            "{message}"
        );
        let message = refused("version = 1\n[[drop]]\nfrom = 5\nuntil = 9\n");
        assert!(
            message.contains("line 4") && message.contains("until"),
            "{message}"
        );
        let message = refused("version = 1\n[[angle]]\nstep = 1\nsteering_deg = nan\n");
        assert!(message.contains("steering_deg"), "{message}");
        assert!(refused("version = 2\n").contains("expected 1"));
        assert!(refused("version = 1\n[[drop]]\nfrom = -1\nto = 5\n").contains("line 3"));
        assert!(refused("").contains("version"));
    }

    #[test]
    fn a_correction_replaces_the_one_before_and_undo_takes_one_back() {
        let mut edits = Edits::default();
        edits.correct(0, 3, 10.0);
        edits.correct(0, 3, -10.0);
        edits.drop_steps(1, 2, 4);
        edits.drop_steps(1, 2, 4);
        edits.drop_steps(1, 4, 4);
        assert_eq!(edits.len(), 2);
        assert_eq!(edits.corrected_deg(0, 3), Some(-10.0));
        assert_eq!(edits.corrected_deg(1, 3), None);
        assert!(!edits.undo(0) && !edits.undo(3));
        assert!(edits.undo(1) && edits.keeps(1, 3));
        assert!(edits.undo(1) && edits.is_empty());
    }

    #[test]
    fn no_edits_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("run.mcap");
        let mut edits = Edits::default();
        edits.save(&data).unwrap();
        edits.drop_steps(0, 0, 4);
        edits.save(&data).unwrap();
        assert_eq!(Edits::of(&data).unwrap(), edits);
        Edits::default().save(&data).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_again(
            drops in proptest::collection::vec((0..5usize, 0..1000usize, 1..1000usize), 0..20),
            angles in proptest::collection::vec((0..5usize, 0..1000usize, -90.0..=90.0f64), 0..20),
        ) {
            let mut edits = Edits::default();
            for (run, from, length) in drops {
                edits.drop_steps(run, from, from + length);
            }
            for (run, step, steering_deg) in angles {
                edits.correct(run, step, steering_deg);
            }
            prop_assert_eq!(Edits::parse(Path::new("x"), &edits.to_toml()).unwrap(), edits);
        }

        #[test]
        fn any_text_is_taken_or_refused(text in "\\PC{0,200}") {
            let _ = Edits::parse(Path::new("x"), &text);
        }
    }
}
