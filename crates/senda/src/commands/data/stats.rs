//! `senda data stats`: what data would teach, which frames are suspicious, whether the camera has moved (A6 in SPEC).

use anyhow::{Context, Result, bail};
use clap::Args;
use senda_core::{Body, Encoded, Image};
use senda_run::scenario::find_vehicle;
use senda_vision::alignment::{self, Alignment, Verdict};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Recording, tub, Udacity folder or named pictures; with --reference also a single picture (PNG, JPEG)
    data: PathBuf,
    /// Compare the camera's pose with this picture of the same scene (PNG, JPEG)
    #[arg(long, value_name = "PICTURE")]
    reference: Option<PathBuf>,
    /// Step whose picture is compared; without it the first one that is kept
    #[arg(long, value_name = "STEP", requires = "reference")]
    frame: Option<usize>,
    /// Vehicle that foreign data come from
    #[arg(long, default_value = "donkeycar")]
    vehicle: String,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: Arguments) -> Result<()> {
    let body = find_vehicle(&arguments.vehicle)?.body();
    let reference = arguments.reference.as_deref().map(picture).transpose()?;
    let is_picture = arguments.data.is_file() && picture(&arguments.data).is_ok();
    let stats = match (is_picture, &reference) {
        (true, None) => bail!(
            "{}: a picture alone has no figures; compare it with --reference, or give a data set",
            arguments.data.display()
        ),
        (true, Some(_)) => None,
        (false, _) => Some(senda_data::stats(&arguments.data, &body)?),
    };
    // A picture alone has no records, and none are expected.
    let recorded = stats.as_ref().map_or(1, |stats| stats.recorded);
    let alignment = match &reference {
        None => None,
        Some(reference) => {
            let today = if is_picture {
                picture(&arguments.data)?
            } else {
                frame(&arguments.data, &body, arguments.frame)?
            };
            let found = alignment::align(reference, &today).with_context(|| {
                format!(
                    "expected pictures of the same shape, but found {}x{} for today and {}x{} for the reference",
                    today.width(),
                    today.height(),
                    reference.width(),
                    reference.height()
                )
            })?;
            Some(found)
        }
    };
    if arguments.json {
        let mut value = match &stats {
            Some(stats) => serde_json::to_value(stats)?,
            None => serde_json::json!({ "path": arguments.data }),
        };
        if let Some(found) = &alignment {
            value["reference"] = serde_json::json!({
                "verdict": match found.verdict() {
                    Verdict::Same => "same",
                    Verdict::Moved => "moved",
                    Verdict::Unclear => "unclear",
                },
                "right_px": found.offset_px[0],
                "down_px": found.offset_px[1],
                "clockwise_deg": found.rotation_rad.to_degrees(),
                "scale": found.scale,
                "matches": found.matches,
                "agreeing": found.agreeing,
                "near_matches": found.near_matches,
                "near_agreeing": found.near_agreeing,
            });
        }
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return super::expect_steps(recorded, &arguments.data);
    }
    if let Some(stats) = &stats {
        say!("{}", stats.to_string().trim_end())?;
    }
    if let Some(found) = alignment {
        say!("{}", words(&found))?;
    }
    super::expect_steps(recorded, &arguments.data)
}

fn picture(path: &Path) -> Result<Image> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    Encoded::recognise(bytes)
        .and_then(|encoded| encoded.decode())
        .with_context(|| format!("{}: expected a picture (PNG, JPEG)", path.display()))
}

/// The picture of a step of the first run: of this one, as recorded, or the first that the edits keep and that can be decoded.
fn frame(data: &Path, body: &Body, step: Option<usize>) -> Result<Image> {
    let mut runs = match step {
        Some(_) => senda_data::open_runs(data, body)?,
        None => senda_data::open_edited_runs(data, body)?,
    }
    .into_iter();
    let steps = runs.next().map(|run| run.steps).unwrap_or_default();
    let decoded = |step: &senda_data::Step| step.frames.first()?.encoded.decode().ok();
    match step {
        Some(number) => match steps.get(number) {
            None => bail!("--frame {number}: expected a step below {}", steps.len()),
            Some(step) => decoded(step).with_context(|| format!("--frame {number}: its picture is broken")),
        },
        None => steps
            .iter()
            .find_map(decoded)
            .with_context(|| format!("{}: no picture to compare", data.display())),
    }
}

fn words(found: &Alignment) -> String {
    let [right, down] = found.offset_px;
    let measured = format!(
        "{right:+.1} px to the right, {down:+.1} px down, turned {:+.2}° clockwise, scale {:.3} ({} of {} corners agree)",
        found.rotation_rad.to_degrees(),
        found.scale,
        found.agreeing,
        found.matches
    );
    match found.verdict() {
        Verdict::Same => format!("camera pose: as in the reference: {measured}"),
        Verdict::Moved => format!(
            "camera pose: MOVED; the scene lies {measured}. Put the camera right, or take a new reference"
        ),
        Verdict::Unclear => format!(
            "camera pose: cannot tell: {} of {} corners agree, in the lower half, near the vehicle, {} of {}. Put the vehicle where the \
             reference was taken, with a pattern on the floor before it",
            found.agreeing, found.matches, found.near_agreeing, found.near_matches
        ),
    }
}
