//! Object detectors (D7 in SPEC): pictures with boxes from the simulator or from darknet's files, training, and how good it got.

mod jitter;
mod scenes;
mod training;

pub use scenes::{CLASSES, Scenes, Shot, shots};
pub use training::{DetectorTraining, train};

use crate::LearnError;
use rayon::prelude::*;
use senda_core::{Encoded, Image};
use senda_data::darknet::{DataFile, Label};
use senda_nets::{Boxed, Finder, InputSpec, Model, Rect, Scorer, Scores};
use std::path::Path;

/// Pictures as a network sees them, with what is in each.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Pictures {
    /// Bytes of one picture, channel after channel, row after row.
    pub picture_len: usize,
    /// All pictures one after the other.
    pub pixels: Vec<u8>,
    /// What is in each.
    pub truths: Vec<Vec<Boxed>>,
    /// What could not be read.
    pub warnings: Vec<String>,
}

/// A label as something that is known to be there.
pub fn truth(label: &Label) -> Boxed {
    Boxed {
        class: label.class,
        confidence: 1.0,
        rect: Rect {
            x: label.x,
            y: label.y,
            width: label.width,
            height: label.height,
        },
    }
}

impl Pictures {
    /// Number of pictures.
    pub fn len(&self) -> usize {
        self.truths.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.truths.is_empty()
    }

    /// One picture's bytes.
    pub fn picture(&self, index: usize) -> &[u8] {
        &self.pixels[index * self.picture_len..(index + 1) * self.picture_len]
    }

    /// Reads a list of a `.data` file (its own path is `file`). A picture that cannot be read is left out with a warning. The
    /// input must not crop: boxes are parts of the whole picture.
    ///
    /// # Errors
    /// When the list cannot be read or names no good picture.
    pub fn load(data: &DataFile, file: &Path, list: &Path, input: &InputSpec) -> Result<Self, LearnError> {
        let listed = data.images(list, file)?;
        let prepared: Vec<Result<Vec<u8>, String>> = listed
            .images
            .par_iter()
            .map_init(
                || (Image::default(), None),
                |(image, preparer), (path, _)| {
                    let name = path.display();
                    let bytes = std::fs::read(path).map_err(|error| format!("{name}: {error}"))?;
                    let encoded = Encoded::recognise(bytes).map_err(|error| format!("{name}: {error}"))?;
                    encoded
                        .decode_into(image)
                        .map_err(|error| format!("{name}: {error}"))?;
                    let size = [image.width(), image.height()];
                    if size.contains(&0) {
                        return Err(format!("{name}: an empty picture"));
                    }
                    let preparer: &mut Option<senda_nets::Preparer> = preparer;
                    if preparer.as_ref().is_none_or(|one| one.frame_size() != size) {
                        *preparer = Some(input.preparer(size[0], size[1]));
                    }
                    let mut bytes = vec![0; input.len()];
                    if let Some(preparer) = preparer {
                        preparer.prepare_bytes(image, &mut bytes);
                    }
                    Ok(bytes)
                },
            )
            .collect();
        let mut pictures = Self {
            picture_len: input.len(),
            warnings: listed.warnings,
            ..Self::default()
        };
        let mut broken = 0usize;
        for (prepared, (_, labels)) in prepared.into_iter().zip(&listed.images) {
            match prepared {
                Ok(bytes) => {
                    pictures.pixels.extend_from_slice(&bytes);
                    pictures.truths.push(labels.iter().map(truth).collect());
                }
                Err(reason) => {
                    broken += 1;
                    if broken <= 5 {
                        pictures.warnings.push(format!("{reason}; left out"));
                    }
                }
            }
        }
        if broken > 5 {
            let text = format!("{broken} pictures in all were left out");
            pictures.warnings.push(text);
        }
        if pictures.is_empty() {
            return Err(LearnError::NoFrames {
                what: list.display().to_string(),
                help: "make some with `senda detector data`".to_owned(),
            });
        }
        Ok(pictures)
    }
}

/// Confidence from which boxes count for average precision: darknet's.
const LOWEST: f32 = 0.005;
/// Overlap of two boxes of a class above which only the surer one is kept: darknet's.
pub const SUPPRESSION: f32 = 0.45;

/// How good a detector is on pictures: overlap 0.5 (FORMATS 5), precision and recall at `threshold`.
///
/// # Errors
/// When the model is no detector.
pub fn evaluate(
    model: &Model,
    pictures: &Pictures,
    threshold: f32,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Scores, LearnError> {
    let mut finder = finder(model, LOWEST)?;
    let mut scorer = Scorer::new(finder.classes().len(), 0.5);
    for index in 0..pictures.len() {
        progress(index, pictures.len());
        scorer.add(
            finder.find_prepared(pictures.picture(index)),
            &pictures.truths[index],
        );
    }
    Ok(scorer.scores(threshold, None))
}

/// A detector's model, ready to run.
///
/// # Errors
/// When the model is no detector.
pub fn finder(model: &Model, threshold: f32) -> Result<Finder, LearnError> {
    Finder::new(model, threshold, SUPPRESSION).ok_or_else(|| LearnError::Option {
        key: "model",
        expected: "a detector, as `senda detector train` makes them".to_owned(),
        found: "a model that gives no boxes".to_owned(),
    })
}
