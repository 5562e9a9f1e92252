//! `senda detector`: signs and lights in pictures (D7 in SPEC).

mod classical;
mod darknet;
mod data;
mod train;

use crate::terminal;
use anyhow::{Context, Result, anyhow, bail};
use clap::{Args, Subcommand};
use senda_core::{Encoded, Image};
use senda_data::darknet::DataFile;
use senda_learn::detector::{Pictures, evaluate, finder};
use senda_nets::{Boxed, Model, Scores};
use senda_vision::ClassicalDetector;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make pictures with exact boxes in the simulator, as a darknet data set
    Data(data::Arguments),
    /// Train a detector on a darknet data set
    Train(train::Arguments),
    /// How good a detector is on the pictures that judge: average precision, precision, recall
    Evaluate {
        /// Model file, or `classical`
        model: PathBuf,
        /// `.data` file of the data set
        data: PathBuf,
        /// Confidence from which a box counts for precision and recall
        #[arg(long, value_name = "PART", default_value_t = 0.5, value_parser = part)]
        threshold: f32,
        /// Judge on the pictures to learn from
        #[arg(long)]
        train: bool,
        /// Print as JSON
        #[arg(long)]
        json: bool,
    },
    /// Find things in a picture and draw boxes around them
    Run {
        /// Model file, or `classical`
        model: PathBuf,
        /// JPEG or PNG
        picture: PathBuf,
        /// Confidence from which a box is drawn
        #[arg(long, value_name = "PART", default_value_t = 0.5, value_parser = part)]
        threshold: f32,
        /// Where the picture with boxes is written (PNG)
        #[arg(short, long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Print as JSON
        #[arg(long)]
        json: bool,
    },
    /// Make a model of darknet's `.cfg`, `.weights` and `.names`, as they are
    Import {
        /// Network: a `.cfg` file, or a ready detector's name
        cfg: PathBuf,
        /// `.weights` file, which must fit exactly
        weights: PathBuf,
        /// `.names` file: a class a line
        names: PathBuf,
        /// Where the model is written
        #[arg(short, long, value_name = "FILE", default_value = "detector.senda")]
        out: PathBuf,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
    /// Write a detector as darknet's `.cfg`, `.weights` and `.names`
    Export {
        /// Model file
        model: PathBuf,
        /// Folder to write into
        folder: PathBuf,
        /// Print the result as JSON
        #[arg(long)]
        json: bool,
    },
}

/// A part, 0 to 1.
fn part(text: &str) -> Result<f32, String> {
    let part = text.parse().ok().filter(|part| (0.0..=1.0).contains(part));
    part.ok_or_else(|| "expected a part from 0 to 1".to_owned())
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    match arguments.command {
        Command::Data(arguments) => data::run(arguments),
        Command::Train(arguments) => train::run(arguments),
        Command::Evaluate {
            model,
            data,
            threshold,
            train,
            json,
        } => judge(&model, &data, threshold, train, json),
        Command::Run {
            model,
            picture,
            threshold,
            out,
            json,
        } => find(&model, &picture, threshold, out.as_deref(), json),
        Command::Import {
            cfg,
            weights,
            names,
            out,
            json,
        } => darknet::import(&cfg, &weights, &names, &out, json),
        Command::Export { model, folder, json } => darknet::export(&model, &folder, json),
    }
}

/// A `.data` file and one of its lists.
fn list(path: &Path, of_training: bool) -> Result<(DataFile, PathBuf)> {
    let data = DataFile::load(path)?;
    let (key, list) = if of_training {
        ("train", &data.train)
    } else {
        ("valid", &data.valid)
    };
    let list = list
        .clone()
        .ok_or_else(|| anyhow!("{}: expected the key {key}, but found none", path.display()))?;
    for warning in &data.warnings {
        tell!("warning: {warning}");
    }
    Ok((data, list))
}

fn warn(warnings: &[String]) {
    for warning in warnings.iter().take(20) {
        tell!("warning: {warning}");
    }
}

fn judge(model: &Path, file: &Path, threshold: f32, of_training: bool, json: bool) -> Result<()> {
    let (data, list) = list(file, of_training)?;
    let (names, scores, pictures, ms) = if model == Path::new(classical::NAME) {
        classical::evaluate(&data, file, &list, threshold)?
    } else {
        judge_model(&Model::load(model)?, &data, file, &list, threshold)?
    };
    if json {
        let value = serde_json::json!({
            "pictures": pictures,
            "threshold": threshold,
            "classes": names,
            "scores": scores,
            "ms_per_picture": ms,
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    say!("{pictures} pictures, {ms:.2} ms each")?;
    print_scores(&names, &scores, threshold)?;
    Ok(())
}

/// Names of the classes, figures, number of pictures, milliseconds a picture.
fn judge_model(
    model: &Model,
    data: &DataFile,
    file: &Path,
    list: &Path,
    threshold: f32,
) -> Result<(Vec<String>, Scores, usize, f64)> {
    let classes = finder(model, threshold)?.classes().to_vec();
    let pictures = Pictures::load(data, file, list, &model.input)?;
    warn(&pictures.warnings);
    if data.classes != classes.len() {
        bail!(
            "{}: expected {} classes as the model has, but found {}",
            file.display(),
            classes.len(),
            data.classes
        );
    }
    let bar = terminal::bar("looking");
    let begin_ns = terminal::clock_ns();
    let scores = evaluate(model, &pictures, threshold, &mut |done, of| {
        bar.set_position((1000 * done / of.max(1)) as u64);
    })?;
    let ms = 1e3 * terminal::seconds_since(begin_ns) / pictures.len() as f64;
    bar.finish_and_clear();
    Ok((classes, scores, pictures.len(), ms))
}

fn print_scores(names: &[String], scores: &Scores, threshold: f32) -> Result<()> {
    say!(
        "mAP at overlap 0.5: {:.1} %; precision and recall at confidence {threshold}",
        100.0 * scores.mean_average_precision
    )?;
    let part = |part: Option<f64>| part.map_or("-".to_owned(), |part| format!("{:.1} %", 100.0 * part));
    for (name, class) in names.iter().zip(&scores.classes) {
        say!(
            "  {name:14} AP {:>7}  precision {:>7}  recall {:>7}  of {}",
            part(class.average_precision),
            part(class.precision),
            part(class.recall),
            class.truths
        )?;
    }
    Ok(())
}

fn find(model: &Path, picture: &Path, threshold: f32, out: Option<&Path>, json: bool) -> Result<()> {
    if let Some(out) = out.filter(|out| {
        out.extension()
            .is_none_or(|ending| !ending.eq_ignore_ascii_case("png"))
    }) {
        bail!("{}: expected a name that ends in .png", out.display());
    }
    let name = picture.display();
    let bytes = std::fs::read(picture).with_context(|| format!("cannot read {name}"))?;
    let mut image = Encoded::recognise(bytes)
        .and_then(|encoded| encoded.decode())
        .with_context(|| format!("{name}"))?;
    if image.is_empty() {
        bail!("{name}: expected a picture, but found an empty one");
    }
    let (classes, found) = if model == Path::new(classical::NAME) {
        let mut found = classical::find(&mut ClassicalDetector::default(), &image);
        found.retain(|one| one.confidence > threshold);
        (classical::names(), found)
    } else {
        let mut finder = finder(&Model::load(model)?, threshold)?;
        let found = finder.find(&image).to_vec();
        (finder.classes().to_vec(), found)
    };
    if let Some(out) = out {
        for one in &found {
            outline(&mut image, one);
        }
        let encoded = senda_core::codec::encode_png(&image)?;
        super::write_file(out, &encoded.bytes)?;
    }
    if json {
        let found: Vec<serde_json::Value> = found
            .iter()
            .map(|one| serde_json::json!({ "class": classes[one.class], "confidence": one.confidence, "rect": one.rect }))
            .collect();
        say!(
            "{}",
            serde_json::to_string_pretty(&serde_json::json!({ "found": found }))?
        )?;
        return Ok(());
    }
    for one in &found {
        let rect = one.rect;
        say!(
            "{:14} {:>3.0} %  middle {:.3} {:.3}, size {:.3} {:.3} (parts of the picture)",
            classes[one.class],
            100.0 * one.confidence,
            rect.x,
            rect.y,
            rect.width,
            rect.height
        )?;
    }
    if found.is_empty() {
        say!("nothing found")?;
    }
    Ok(())
}

/// Draws a box's edges, a colour for each class.
fn outline(image: &mut Image, one: &Boxed) {
    const COLOURS: [[u8; 3]; 6] = [
        [40, 220, 90],
        [255, 50, 50],
        [255, 180, 0],
        [220, 60, 255],
        [0, 200, 255],
        [255, 255, 255],
    ];
    let colour = COLOURS[one.class % COLOURS.len()];
    let (width, height) = (image.width(), image.height());
    let count = image.channels().count();
    let edge = |place: f32, full: usize| ((place * full as f32).max(0.0) as usize).min(full - 1);
    let rect = one.rect;
    let (left, right) = (
        edge(rect.x - 0.5 * rect.width, width),
        edge(rect.x + 0.5 * rect.width, width),
    );
    let (top, bottom) = (
        edge(rect.y - 0.5 * rect.height, height),
        edge(rect.y + 0.5 * rect.height, height),
    );
    for v in top..=bottom {
        let row = image.row_mut(v);
        for u in left..=right {
            if v == top || v == bottom || u == left || u == right {
                row[u * count..(u + 1) * count].copy_from_slice(&colour[..count]);
            }
        }
    }
}
