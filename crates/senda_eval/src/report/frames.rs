//! Camera frames and detections for the player, thinned to a budget.

use super::data_uri;
use crate::text;
use senda_core::codec::encode_jpeg;
use senda_core::{Encoded, ImageFormat, Shape};
use senda_data::{Recording, Step};
use serde_json::{Value, json};

/// Quality of frames that had to be made smaller: at 160x120 about half the bytes of a camera's own JPEG.
const SMALLER_QUALITY: u8 = 60;

/// Frames beyond this number show nothing new to a reader who scrubs, and fill a browser's memory.
const MOST_FRAMES: usize = 1200;

/// Every second frame as recorded is worth more than every frame spoilt by compression; beyond that the motion suffers.
const MOST_STRIDE_AS_RECORDED: usize = 2;

/// What a network looked at, for the player: pictures that are laid over the frames as light.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Look {
    /// What was looked with, as the caption says it.
    pub by: String,
    /// Which part of the frame the pictures cover: left, top, width and height, in parts of the frame.
    pub area: [f64; 4],
    /// One picture for each step of the recording, where there is one; black adds nothing.
    pub pictures: Vec<Option<Encoded>>,
}

/// Frames ready for the page.
pub(super) struct Film {
    /// For each frame: step, picture and shapes.
    pub(super) frames: Vec<Value>,
    /// Width and height of the first frame (px); `None` without a readable frame.
    pub(super) size: Option<[usize; 2]>,
    /// What a reader should know about them.
    pub(super) caption: String,
}

/// What the first camera's frames take as recorded (bytes of base64).
pub(super) fn size_of(recording: &Recording) -> usize {
    recording
        .steps
        .iter()
        .filter_map(|step| step.frames.first())
        .map(|f| base64_len(f.encoded.bytes.len()))
        .sum()
}

/// The first camera's frames of a recording, at most `budget_bytes` of base64.
pub(super) fn film(recording: &Recording, budget_bytes: usize, look: Option<&Look>) -> Film {
    let with_frame: Vec<(usize, &Step)> = recording
        .steps
        .iter()
        .enumerate()
        .filter(|(_, step)| !step.frames.is_empty())
        .collect();
    let mut size = None;
    let original = size_of(recording);
    let most_frames = with_frame.len().div_ceil(MOST_FRAMES);
    let mut stride = original.div_ceil(budget_bytes.max(1)).max(most_frames).max(1);
    let fits = stride <= MOST_STRIDE_AS_RECORDED.max(most_frames);
    if !fits {
        // The mean of a few recompressed frames tells how many will fit.
        let sample: Vec<usize> = (0..with_frame.len())
            .step_by(with_frame.len().div_ceil(8))
            .map(|i| base64_len(smaller(&with_frame[i].1.frames[0].encoded).bytes.len()))
            .collect();
        let mean = sample.iter().sum::<usize>().div_ceil(sample.len().max(1));
        let room = (budget_bytes / mean.max(1)).clamp(1, MOST_FRAMES);
        stride = with_frame.len().div_ceil(room).max(1);
    }
    let mut frames = Vec::new();
    let mut bytes = Vec::new();
    for (index, step) in with_frame.chunks(stride).filter_map(richest) {
        let encoded = &step.frames[0].encoded;
        let picture = if fits { encoded.clone() } else { smaller(encoded) };
        if size.is_none() {
            size = picture
                .decode()
                .ok()
                .filter(|image| !image.is_empty())
                .map(|image| [image.width(), image.height()]);
        }
        let mut len = base64_len(picture.bytes.len());
        let shapes: Vec<Value> = step.explanation.shapes.iter().map(shape_json).collect();
        let mut frame = json!({"step": index, "src": data_uri(&picture), "shapes": shapes});
        if let Some(light) = look.and_then(|look| look.pictures.get(*index)?.as_ref()) {
            len += base64_len(light.bytes.len());
            frame["look"] = json!(data_uri(light));
        }
        bytes.push(len);
        frames.push(frame);
    }
    // Frames may grow along a run, so that the estimate was too low: thin again, evenly, whatever they show.
    while frames.len() > 1 && bytes.iter().sum::<usize>() > budget_bytes + budget_bytes / 10 {
        frames = frames.into_iter().step_by(2).collect();
        bytes = bytes.into_iter().step_by(2).collect();
    }
    if size.is_none() {
        frames.clear();
    }
    let (shown, all) = (frames.len(), with_frame.len());
    let which = if shown == all {
        format!("All {all} camera frames")
    } else {
        format!("{shown} of {all} camera frames")
    };
    let how = if fits {
        "as recorded"
    } else {
        "compressed further to keep this file small"
    };
    let mut caption = format!("{which}, {how}, with what the driver saw in them.");
    if let Some(look) = look {
        let by = text::printable(&look.by);
        caption += &format!(" Light lies where {by} looks (VisualBackProp).");
    }
    Film {
        frames,
        size,
        caption,
    }
}

/// Of frames one of which is shown, the first with the most words on it: a code or a sign is read in one frame of several, and was
/// never shown where those happened to be the others.
fn richest<'a, 'b>(frames: &'a [(usize, &'b Step)]) -> Option<&'a (usize, &'b Step)> {
    let words = |step: &Step| {
        let is_text = |shape: &&Shape| matches!(shape, Shape::Text { .. });
        step.explanation.shapes.iter().filter(is_text).count()
    };
    frames.iter().rev().max_by_key(|(_, step)| words(step))
}

/// The frame as a stronger compressed JPEG, or as it is where that saves nothing.
fn smaller(encoded: &Encoded) -> Encoded {
    match encoded
        .decode()
        .and_then(|image| encode_jpeg(&image, SMALLER_QUALITY))
    {
        Ok(jpeg) if jpeg.bytes.len() < encoded.bytes.len() || encoded.format == ImageFormat::Png => jpeg,
        _ => encoded.clone(),
    }
}

fn base64_len(bytes: usize) -> usize {
    bytes.div_ceil(3) * 4
}

/// A detection as the script draws it, coordinates to a tenth of a pixel.
fn shape_json(shape: &Shape) -> Value {
    let tenth = |value: f32| {
        let value = f64::from(value);
        if value.is_finite() {
            (value.clamp(-1e5, 1e5) * 10.0).round() / 10.0
        } else {
            0.0
        }
    };
    let colour = safe_colour(colour_of(shape));
    match shape {
        Shape::Polyline { points, closed, .. } => {
            let points: Vec<[f64; 2]> = points
                .iter()
                .map(|[u, v]| [f64::from(*u), f64::from(*v)])
                .collect();
            let mut list = vec![json!("line"), json!(colour), json!(closed)];
            for [u, v] in crate::plot::thinned(&points, 0.2) {
                list.push(json!(tenth(u as f32)));
                list.push(json!(tenth(v as f32)));
            }
            Value::Array(list)
        }
        Shape::Circle {
            centre: [u, v],
            radius_px,
            ..
        } => {
            json!(["circle", colour, tenth(*u), tenth(*v), tenth(radius_px.abs())])
        }
        Shape::Text { at: [u, v], text, .. } => {
            let word: String = text::printable(text).chars().take(80).collect();
            json!(["text", colour, tenth(*u), tenth(*v), word])
        }
    }
}

pub(super) fn colour_of(shape: &Shape) -> &str {
    match shape {
        Shape::Polyline { color, .. } | Shape::Circle { color, .. } | Shape::Text { color, .. } => color,
    }
}

/// A colour that is only a colour: names, `#…`, `rgb(…)`, `hsl(…)`. Anything else (a `url(…)` would load something)
/// becomes magenta.
pub(super) fn safe_colour(colour: &str) -> String {
    let rest = ["rgb(", "rgba(", "hsl(", "hsla("]
        .iter()
        .find_map(|prefix| colour.strip_prefix(prefix));
    let is_plain = match rest {
        Some(rest) => rest
            .strip_suffix(')')
            .is_some_and(|inner| inner.chars().all(|c| "0123456789.,% /deg".contains(c))),
        None => {
            let word = colour.strip_prefix('#').unwrap_or(colour);
            !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric())
        }
    };
    if is_plain && colour.len() <= 64 {
        colour.to_owned()
    } else {
        "magenta".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_core::{Command, Explanation, Stamp};

    #[test]
    fn colours_are_only_colours() {
        for good in ["red", "#00ff00", "rgb(1, 2, 3)", "hsl(120deg 50% 50% / 0.5)"] {
            assert_eq!(safe_colour(good), good);
        }
        for bad in [
            "url(https://example.com/a#b)",
            "red;background:url(x)",
            "",
            "rgb(1,2,3) url(x)",
            "\"><script>",
        ] {
            assert_eq!(safe_colour(bad), "magenta");
        }
    }

    #[test]
    fn of_several_frames_the_one_that_says_most_is_shown() {
        let step = |words: usize| {
            let mut step = Step {
                stamp: Stamp::default(),
                frames: vec![],
                speed_mps: None,
                wheels: None,
                battery_v: None,
                command: Command::STOP,
                truth: None,
                explanation: Explanation::default(),
            };
            (0..words).for_each(|_| step.explanation.text([0.0, 0.0], "I2", "magenta"));
            step
        };
        let steps = [step(1), step(3), step(3), step(0)];
        let frames: Vec<(usize, &Step)> = steps.iter().enumerate().collect();
        assert_eq!(richest(&frames).unwrap().0, 1);
        assert_eq!(richest(&frames[3..]).unwrap().0, 3);
    }

    #[test]
    fn shapes_keep_their_numbers_in_order() {
        let shape = Shape::Polyline {
            points: vec![[1.0, 2.0], [f32::NAN, 4.0]],
            color: "red".into(),
            closed: true,
        };
        assert_eq!(
            shape_json(&shape),
            json!(["line", "red", true, 1.0, 2.0, 0.0, 4.0])
        );
    }
}
