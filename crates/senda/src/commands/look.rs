//! `senda look`: what a network looks at, as pictures.

use super::write_file;
use crate::terminal;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use senda_core::codec::{encode_jpeg, encode_png};
use senda_core::{Channels, Encoded, Image};
use senda_data::{Recording, Step};
use senda_drivers::is_gap;
use senda_eval::report::Look;
use senda_nets::{Gaze, Model, heat, overlay};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Model file
    model: PathBuf,
    /// A picture (JPEG or PNG), or a run: a recording, tub, Udacity folder or named frames
    seen: PathBuf,
    /// Where the picture is written (PNG); for a run the folder of its pictures
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Frames of a run that are shown, evenly spread over it
    #[arg(long, value_name = "N", default_value_t = 12)]
    frames: usize,
    /// Vehicle that foreign data come from
    #[arg(long, value_name = "VEHICLE", default_value = "picar")]
    vehicle: String,
    /// Print what was written, with the network's answers, as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let model = Model::load(&arguments.model)?;
    let mut gaze = gaze_of(&model)?;
    let path = &arguments.seen;
    if !path.exists() {
        bail!("{}: no such file or folder", path.display());
    }
    let written = if is_picture(path) {
        let out = arguments.out.clone().unwrap_or_else(|| "look.png".into());
        vec![picture(&mut gaze, &model, path, &out)?]
    } else {
        if arguments.frames == 0 {
            bail!("--frames: expected at least 1, but found 0");
        }
        let out = arguments.out.clone().unwrap_or_else(|| "look".into());
        of_runs(&mut gaze, &model, &arguments, &out)?
    };
    if arguments.json {
        return terminal::print(&serde_json::to_string_pretty(&written)?);
    }
    for one in &written {
        let answers: Vec<String> = one["answers"]
            .as_object()
            .into_iter()
            .flatten()
            .map(|(name, value)| format!("{name} {:.3}", value.as_f64().unwrap_or(f64::NAN)))
            .collect();
        let path = one["picture"].as_str().unwrap_or_default();
        terminal::print(format!("{path}  {}", answers.join(", ")))?;
    }
    Ok(())
}

fn gaze_of(model: &Model) -> Result<Gaze> {
    Gaze::new(model).ok_or_else(|| {
        anyhow!(
            "{}: expected a network with convolutions, but none of its layers gives a picture",
            model.network.name()
        )
    })
}

fn is_picture(path: &Path) -> bool {
    let extension = path
        .extension()
        .map(|extension| extension.to_string_lossy().to_lowercase());
    path.is_file() && matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg"))
}

/// Looks at one frame and writes it with the mask over it.
fn picture(gaze: &mut Gaze, model: &Model, path: &Path, out: &Path) -> Result<Value> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let frame = Encoded::recognise(bytes)
        .and_then(|encoded| encoded.decode())
        .with_context(|| path.display().to_string())?;
    if frame.is_empty() {
        bail!("{}: an empty picture", path.display());
    }
    gaze.look(&frame);
    write(gaze, model, &frame, out)
}

/// Writes the mask that was found last over its frame.
fn write(gaze: &mut Gaze, model: &Model, frame: &Image, out: &Path) -> Result<Value> {
    let shown = overlay(gaze.mask(), gaze.spec(), frame);
    write_file(out, &encode_png(&shown)?.bytes)?;
    let answers: serde_json::Map<String, Value> = model
        .outputs
        .iter()
        .zip(gaze.answers())
        .map(|(output, value)| (output.name.clone(), json!(value)))
        .collect();
    Ok(json!({"picture": out, "answers": answers}))
}

fn of_runs(gaze: &mut Gaze, model: &Model, arguments: &Arguments, out: &Path) -> Result<Vec<Value>> {
    let body = senda_run::scenario::find_vehicle(&arguments.vehicle)?.body();
    let runs = senda_data::open_edited_runs(&arguments.seen, &body)?;
    let several = runs.len() > 1;
    let mut written = Vec::new();
    let bar = terminal::bar("looking");
    for (number, recording) in runs.iter().enumerate() {
        for warning in recording.warnings.iter().take(5) {
            bar.suspend(|| tell!("warning: {warning}"));
        }
        let count = recording
            .steps
            .iter()
            .filter(|step| !step.frames.is_empty())
            .count();
        let wanted: Vec<usize> = (0..arguments.frames.min(count))
            .map(|i| (2 * i + 1) * count / (2 * arguments.frames.min(count)))
            .collect();
        let mut place = 0;
        follow(gaze, recording, &mut |gaze, index, frame| {
            if terminal::interrupted() {
                bail!(terminal::Interrupted(format!(
                    "; {} pictures lie in {}",
                    written.len(),
                    out.display()
                )));
            }
            bar.set_position((1000 * (number * count + place) / (runs.len() * count).max(1)) as u64);
            if wanted.binary_search(&place).is_ok() {
                let run = if several {
                    format!("run-{number}-")
                } else {
                    String::new()
                };
                let name = out.join(format!("{run}frame-{index:06}.png"));
                written.push(write(gaze, model, frame, &name)?);
            }
            place += 1;
            Ok(())
        })?;
    }
    bar.finish_and_clear();
    if written.is_empty() {
        bail!(
            "{}: expected frames, but found none that can be read",
            arguments.seen.display()
        );
    }
    Ok(written)
}

/// Looks at every frame of a run in order; frames that cannot be read are left out.
fn follow(
    gaze: &mut Gaze,
    recording: &Recording,
    seen: &mut dyn FnMut(&mut Gaze, usize, &Image) -> Result<()>,
) -> Result<()> {
    gaze.forget();
    let mut image = Image::default();
    let mut before: Option<&Step> = None;
    for (index, step) in recording.steps.iter().enumerate() {
        let Some(frame) = step.frames.first() else {
            continue;
        };
        if frame.encoded.decode_into(&mut image).is_err() || image.is_empty() {
            continue;
        }
        if before.is_some_and(|before| is_gap(&recording.header.body, before.stamp, step.stamp)) {
            gaze.skip();
        }
        before = Some(step);
        gaze.look(&image);
        seen(gaze, index, &image)?;
    }
    Ok(())
}

/// Quality of the player's pictures of masks: smooth and small.
const LIGHT_QUALITY: u8 = 70;

/// What a model looks at in every frame of a run, for a report's player.
pub(crate) fn for_player(path: &Path, recording: &Recording) -> Result<Look> {
    let model = Model::load(path)?;
    let mut gaze = gaze_of(&model)?;
    let crop = model.input.crop;
    let mut look = Look {
        by: path.display().to_string(),
        area: [
            crop.left,
            crop.top,
            1.0 - crop.left - crop.right,
            1.0 - crop.top - crop.bottom,
        ],
        pictures: vec![None; recording.steps.len()],
    };
    let (width, height) = (model.input.width, model.input.height);
    let mut light = Image::new(width, height, Channels::Rgb);
    follow(&mut gaze, recording, &mut |gaze, index, _| {
        for (v, row) in gaze.mask().chunks_exact(width).enumerate() {
            for (to, value) in light.row_mut(v).chunks_exact_mut(3).zip(row) {
                to.copy_from_slice(&heat(*value));
            }
        }
        look.pictures[index] = Some(encode_jpeg(&light, LIGHT_QUALITY)?);
        Ok(())
    })?;
    Ok(look)
}
