//! Where training stands, in a file that survives kills, full disks and power cuts.

use crate::LearnError;
use crate::train::{Epoch, Lesson, Progress, Training};
use senda_nets::{Trainer, Weights};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::path::Path;

const MAGIC: &[u8; 16] = b"senda checkpoint";

/// 2: SHA-256 of all bytes before stands at the end. 1 had none, and bits that a disk lost were learned on from.
const VERSION: u32 = 2;
const SUM_BYTES: usize = 32;

#[derive(Serialize, Deserialize)]
struct Head {
    version: u32,
    fingerprint: String,
    history: Vec<Epoch>,
    best_epoch: u32,
    best_len: usize,
    trainer_len: usize,
}

/// What must be equal for a checkpoint to be of the same experiment: also the weights that it began with, or fine-tuning
/// another model in the same folder would go on with the first one's.
pub(crate) fn fingerprint(lesson: &Lesson, beginning: &Weights) -> String {
    let same_for_any_threads = Training {
        threads: 0,
        ..lesson.options.clone()
    };
    let mut digest = Digest::default();
    digest.add(lesson.network.to_toml().as_bytes());
    digest.add(&serde_json::to_vec(lesson.input).unwrap_or_default());
    digest.add(&serde_json::to_vec(&lesson.answers.is_turn).unwrap_or_default());
    digest.add(&serde_json::to_vec(&same_for_any_threads).unwrap_or_default());
    digest.add_values(&beginning.values);
    for samples in [lesson.training, lesson.validation] {
        digest.add(&samples.pixels);
        digest.add_values(&samples.targets);
        if lesson.options.is_ordered(lesson.network) {
            for stretch in samples.stretches() {
                digest.add(&(stretch.end as u64).to_le_bytes());
            }
        }
    }
    format!("{:016x}", digest.0)
}

/// The same for experiments that are no [`Lesson`]: everything that must be equal, as bytes.
pub(crate) fn fingerprint_of(parts: &[&[u8]], beginning: &Weights) -> String {
    let mut digest = Digest::default();
    for part in parts {
        digest.add(part);
    }
    digest.add_values(&beginning.values);
    format!("{:016x}", digest.0)
}

/// FNV-1a, 64 bits: tells experiments apart, guards against nothing.
struct Digest(u64);

impl Default for Digest {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Digest {
    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
        }
    }

    fn add_values(&mut self, values: &[f32]) {
        for value in values {
            self.add(&value.to_le_bytes());
        }
    }
}

/// Writes the state beside the old one and then replaces it: the last good checkpoint survives a full disk.
pub(crate) fn save(
    path: &Path,
    fingerprint: &str,
    trainer: &Trainer,
    progress: &Progress,
) -> Result<(), LearnError> {
    let state = trainer.state();
    let best: &[f32] = progress.best.as_ref().map_or(&[], |weights| &weights.values);
    let head = Head {
        version: VERSION,
        fingerprint: fingerprint.to_owned(),
        history: progress.history.clone(),
        best_epoch: progress.best_epoch,
        best_len: best.len(),
        trainer_len: state.len(),
    };
    let head = serde_json::to_vec(&head).unwrap_or_default();
    let best: Vec<u8> = best.iter().flat_map(|value| value.to_le_bytes()).collect();
    let length = (head.len() as u64).to_le_bytes();
    let parts = [MAGIC.as_slice(), &length, &head, &best, &state];
    let mut sum = Sha256::new();
    crate::store::replace(path, |file| {
        for part in parts {
            sum.update(part);
            file.write_all(part)?;
        }
        file.write_all(&sum.finalize())
    })
}

/// Refuses a checkpoint that is damaged or of another experiment; none at all is fine.
pub(crate) fn check(path: &Path, fingerprint: &str) -> Result<(), LearnError> {
    match read(path)? {
        Some(bytes) => take_apart(path, fingerprint, &bytes).map(|_| ()),
        None => Ok(()),
    }
}

/// Reads the state back, if there is one.
pub(crate) fn load(
    path: &Path,
    fingerprint: &str,
    trainer: &mut Trainer,
) -> Result<Option<Progress>, LearnError> {
    let Some(bytes) = read(path)? else {
        return Ok(None);
    };
    let (head, best, state) = take_apart(path, fingerprint, &bytes)?;
    trainer.resume(state).map_err(|_| wrong(path, CUT))?;
    let best: Vec<f32> = best
        .chunks_exact(4)
        .map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
        .collect();
    Ok(Some(Progress {
        history: head.history,
        best: (!best.is_empty()).then_some(Weights { values: best }),
        best_epoch: head.best_epoch,
        interrupted: false,
    }))
}

fn read(path: &Path) -> Result<Option<Vec<u8>>, LearnError> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(source) => Err(LearnError::io(path, source)),
    }
}

const CUT: &str = "it is cut short or damaged";

fn wrong(path: &Path, reason: &str) -> LearnError {
    LearnError::Checkpoint {
        path: path.to_owned(),
        reason: reason.to_owned(),
    }
}

/// What it says, the best weights, and the trainer's state.
fn take_apart<'a>(
    path: &Path,
    fingerprint: &str,
    bytes: &'a [u8],
) -> Result<(Head, &'a [u8], &'a [u8]), LearnError> {
    let cut = || wrong(path, CUT);
    let rest = bytes
        .strip_prefix(MAGIC.as_slice())
        .ok_or_else(|| wrong(path, "it is no checkpoint at all"))?;
    let (length, rest) = rest.split_first_chunk::<8>().ok_or_else(cut)?;
    let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| cut())?;
    let (head, rest) = rest.split_at_checked(length).ok_or_else(cut)?;
    let head: Head = serde_json::from_slice(head).map_err(|_| cut())?;
    if head.version != VERSION {
        let found = head.version;
        return Err(wrong(
            path,
            &format!("it has version {found} and this program reads {VERSION}"),
        ));
    }
    let (summed, sum) = bytes.split_last_chunk::<SUM_BYTES>().ok_or_else(cut)?;
    if Sha256::digest(summed).as_slice() != sum {
        return Err(cut());
    }
    let rest = rest.get(..rest.len().saturating_sub(SUM_BYTES)).ok_or_else(cut)?;
    if head.fingerprint != fingerprint {
        return Err(wrong(
            path,
            "its network, options, data or first weights are others",
        ));
    }
    let best_bytes = head.best_len.checked_mul(4).ok_or_else(cut)?;
    let (best, state) = rest.split_at_checked(best_bytes).ok_or_else(cut)?;
    if state.len() != head.trainer_len {
        return Err(cut());
    }
    Ok((head, best, state))
}
