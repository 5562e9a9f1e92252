//! The classical detector, judged on the same pictures as trained ones.

use crate::terminal;
use anyhow::{Context, Result, bail};
use senda_core::{Encoded, Image};
use senda_data::darknet::DataFile;
use senda_learn::detector::truth;
use senda_nets::{Boxed, Rect, Scorer, Scores};
use senda_vision::{ClassicalDetector, Detection, Detector, ObjectClass};
use std::path::Path;

/// Stands where a model file may.
pub(super) const NAME: &str = "classical";

/// Names of what it finds, in the order of [`ObjectClass::index`].
pub(super) fn names() -> Vec<String> {
    (0..)
        .map_while(ObjectClass::from_index)
        .map(ObjectClass::name)
        .collect()
}

/// What it finds in a picture; classes by [`ObjectClass::index`].
pub(super) fn find(detector: &mut ClassicalDetector, image: &Image) -> Vec<Boxed> {
    let (width, height) = (image.width() as f32, image.height() as f32);
    let boxed = |one: &Detection| {
        let [left, top, right, bottom] = one.box_px;
        Boxed {
            class: one.class.index(),
            confidence: one.confidence,
            rect: Rect {
                x: 0.5 * (left + right) / width,
                y: 0.5 * (top + bottom) / height,
                width: (right - left) / width,
                height: (bottom - top) / height,
            },
        }
    };
    detector.detect(image).iter().map(boxed).collect()
}

/// Its figures on a list of a data set, and how long a picture took it (ms). Classes that the data set does not name count for nothing.
pub(super) fn evaluate(
    data: &DataFile,
    file: &Path,
    list: &Path,
    threshold: f32,
) -> Result<(Vec<String>, Scores, usize, f64)> {
    if data.names.is_none() {
        bail!(
            "{}: expected the key names, the file with the classes' names, but found none; without it classes are mere numbers, \
             which the classical detector does not know",
            file.display()
        );
    }
    let wanted = data.class_names(file)?;
    let known = names();
    let places: Vec<Option<usize>> = known
        .iter()
        .map(|name| wanted.iter().position(|other| other == name))
        .collect();
    if places.iter().all(Option::is_none) {
        bail!(
            "{}: expected classes such as {}, which the classical detector finds, but found {}",
            file.display(),
            known[..4].join(", "),
            wanted.join(", ")
        );
    }
    let listed = data.images(list, file)?;
    super::warn(&listed.warnings);
    let mut scorer = Scorer::new(wanted.len(), 0.5);
    let (mut detector, mut image) = (ClassicalDetector::default(), Image::default());
    let (mut seconds, mut count) = (0.0, 0);
    let bar = terminal::bar("looking");
    for (index, (path, labels)) in listed.images.iter().enumerate() {
        bar.set_position((1000 * index / listed.images.len()) as u64);
        let decoded = std::fs::read(path).context("cannot be read").and_then(|bytes| {
            Encoded::recognise(bytes)?.decode_into(&mut image)?;
            Ok(())
        });
        if let Err(error) = decoded {
            bar.suspend(|| tell!("warning: {}: {error:#}; left out", path.display()));
            continue;
        }
        let began_ns = terminal::clock_ns();
        let mut found = find(&mut detector, &image);
        seconds += terminal::seconds_since(began_ns);
        count += 1;
        found.retain_mut(|one| match places[one.class] {
            Some(place) => {
                one.class = place;
                true
            }
            None => false,
        });
        let truths: Vec<Boxed> = labels.iter().map(truth).collect();
        scorer.add(&found, &truths);
    }
    bar.finish_and_clear();
    if count == 0 {
        bail!(
            "{}: expected pictures, but found none that can be read; make some with `senda detector data`",
            list.display()
        );
    }
    Ok((
        wanted,
        scorer.scores(threshold, None),
        count,
        1e3 * seconds / count as f64,
    ))
}
