//! Files of an experiment's folder: samples of a round, figures.

use crate::learn::Round;
use crate::train::Epoch;
use crate::{LearnError, Run, Samples};
use senda_core::whole_file;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

const MAGIC: &[u8; 16] = b"senda samples 1\n";

#[derive(Serialize, Deserialize)]
struct Head {
    frame_len: usize,
    outputs: usize,
    frames: usize,
    runs: Vec<(String, String, usize)>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    breaks: Vec<usize>,
}

/// Writes beside the old file, then in its place.
pub(crate) fn replace(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), LearnError> {
    whole_file::replace(path, write).map_err(|source| LearnError::io(path, source))
}

pub(crate) fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), LearnError> {
    let text = serde_json::to_string_pretty(value).unwrap_or_default();
    replace(path, |file| file.write_all(text.as_bytes()))
}

pub(crate) fn read_history(path: &Path) -> Option<Vec<Epoch>> {
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}

impl Samples {
    /// Writes them to a file, whole or not at all.
    pub fn save(&self, path: &Path) -> Result<(), LearnError> {
        let head = Head {
            frame_len: self.frame_len,
            outputs: self.outputs,
            frames: self.len(),
            runs: self
                .runs
                .iter()
                .map(|run| (run.name.clone(), run.world.clone(), run.frames.len()))
                .collect(),
            breaks: self.breaks.clone(),
        };
        let head = serde_json::to_vec(&head).unwrap_or_default();
        replace(path, |file| {
            file.write_all(MAGIC)?;
            file.write_all(&(head.len() as u64).to_le_bytes())?;
            file.write_all(&head)?;
            file.write_all(&self.pixels)?;
            for target in &self.targets {
                file.write_all(&target.to_le_bytes())?;
            }
            Ok(())
        })
    }

    /// Reads what [`Samples::save`] wrote. `None` where no such file is, and where it is damaged: then it is to be made again.
    pub fn load(path: &Path) -> Result<Option<Self>, LearnError> {
        match std::fs::read(path) {
            Ok(bytes) => Ok(parse(&bytes)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(LearnError::io(path, source)),
        }
    }
}

/// The figures go last: a round with figures is whole.
pub(crate) fn write_round(
    samples_path: &Path,
    round_path: &Path,
    samples: &Samples,
    round: &Round,
) -> Result<(), LearnError> {
    samples.save(samples_path)?;
    write_json(round_path, round)
}

/// A finished round; `None` if there is none. A damaged one counts as none: it is made again.
pub(crate) fn read_round(
    samples_path: &Path,
    round_path: &Path,
) -> Result<Option<(Samples, Round)>, LearnError> {
    let text = match std::fs::read_to_string(round_path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(LearnError::io(round_path, source)),
    };
    let Ok(round) = serde_json::from_str(&text) else {
        return Ok(None);
    };
    Ok(Samples::load(samples_path)?.map(|samples| (samples, round)))
}

fn parse(bytes: &[u8]) -> Option<Samples> {
    let rest = bytes.strip_prefix(MAGIC.as_slice())?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let head: Head = serde_json::from_slice(rest.get(..length)?).ok()?;
    let rest = rest.get(length..)?;
    let pixels = head.frames.checked_mul(head.frame_len)?;
    let targets = head.frames.checked_mul(head.outputs)?.checked_mul(4)?;
    if rest.len() != pixels.checked_add(targets)? {
        return None;
    }
    let mut runs = Vec::new();
    let mut start = 0usize;
    for (name, world, length) in head.runs {
        let end = start.checked_add(length)?;
        runs.push(Run {
            name,
            world,
            frames: start..end,
        });
        start = end;
    }
    let is_whole = start == head.frames && head.breaks.is_sorted();
    is_whole.then(|| Samples {
        frame_len: head.frame_len,
        outputs: head.outputs,
        pixels: rest[..pixels].to_vec(),
        targets: rest[pixels..]
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect(),
        runs,
        breaks: head.breaks,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_are_read_back_and_damaged_ones_are_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("r.samples"), folder.path().join("r.json"));
        assert_eq!(read_round(&a, &b).unwrap(), None);
        let mut samples = Samples::new(3, 2);
        samples.begin_run("a", "oval");
        samples.push(&[1, 2, 3], &[0.5, -0.5]);
        samples.skip();
        samples.push(&[4, 5, 6], &[0.25, 1.0]);
        let round = Round {
            number: 0,
            frames: 2,
            drives: 1,
            strayed: 0,
            loss: 0.1,
            trial: Some([3, 4]),
            lane_error_m: Some(0.01),
        };
        write_round(&a, &b, &samples, &round).unwrap();
        assert_eq!(read_round(&a, &b).unwrap(), Some((samples, round)));
        let whole = std::fs::read(&a).unwrap();
        for length in 0..whole.len() {
            std::fs::write(&a, &whole[..length]).unwrap();
            assert_eq!(read_round(&a, &b).unwrap(), None);
        }
    }
}
