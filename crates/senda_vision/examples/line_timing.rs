//! Times the steps of the line extraction over a folder of PNG frames, one line of JSON on standard output.
//!
//! `cargo run --release -p senda_vision --example line_timing -- make DIR 320 240` writes the frames,
//! `… -- time DIR` measures. `benches/peers/line_extraction.sh` runs this and OpenCV over the same frames.
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "a measurement reads the clock and prints"
)]

#[path = "../tests/support/mod.rs"]
mod support;

use senda_core::{Channels, Encoded, Image, codec};
use senda_vision::components::Components;
use senda_vision::{
    Contrast, ExtractorOptions, LineExtractor, WidthProfile, blur::GaussianBlur, luminance,
    morphology::LineResidue,
};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["make", folder, width, height] => make(Path::new(folder), width.parse()?, height.parse()?),
        ["time", folder] => time(Path::new(folder)),
        _ => Err("expected: make DIR WIDTH HEIGHT, or time DIR".into()),
    }
}

fn make(folder: &Path, width: u32, height: u32) -> Result<(), Box<dyn std::error::Error>> {
    std::fs::create_dir_all(folder)?;
    for (i, frame) in support::benchmark_frames(width, height).iter().enumerate() {
        std::fs::write(
            folder.join(format!("frame-{i:02}.png")),
            codec::encode_png(frame)?.bytes,
        )?;
    }
    Ok(())
}

/// Times one step on every frame, several rounds; appends the best and the median time per frame (µs), of each frame by
/// itself and then averaged over the frames: so that a machine that is busy with something else for a while does not count.
fn measure(report: &mut String, name: &str, frames: &[Image], mut step: impl FnMut(usize, &Image)) {
    let mut times = vec![Vec::with_capacity(ROUNDS); frames.len()];
    for _ in 0..ROUNDS {
        for (i, frame) in frames.iter().enumerate() {
            let begin = Instant::now();
            step(i, frame);
            times[i].push(begin.elapsed().as_secs_f64() * 1e6);
        }
    }
    for times in &mut times {
        times.sort_by(f64::total_cmp);
    }
    let mean = |index: usize| times.iter().map(|times| times[index]).sum::<f64>() / frames.len() as f64;
    let (best, median) = (mean(0), mean(ROUNDS / 2));
    report.push_str(&format!(
        ",\"{name}_us\":{best:.1},\"{name}_median_us\":{median:.1}"
    ));
}

const ROUNDS: usize = 200;

fn time(folder: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let mut names: Vec<_> = std::fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    names.sort_by_key(|entry| entry.file_name());
    let frames: Vec<Image> = names
        .iter()
        .filter(|entry| entry.path().extension().is_some_and(|e| e == "png"))
        .map(|entry| Ok(Encoded::recognise(std::fs::read(entry.path())?)?.decode()?))
        .collect::<Result<_, Box<dyn std::error::Error>>>()?;
    let first = frames.first().ok_or("no PNG in the folder")?;
    let (width, height) = (first.width(), first.height());
    let camera = support::gopigo_camera(width as u32, height as u32);
    let profile = WidthProfile::from_camera(&camera, 0.02);
    let options = ExtractorOptions::default();
    // Frames alternate between dark and light lines.
    let contrast = |i: usize| {
        if i.is_multiple_of(2) {
            Contrast::Dark
        } else {
            Contrast::Light
        }
    };

    let greys: Vec<Image> = frames.iter().map(support::grey).collect();
    let mut grey = vec![0; width * height];
    let mut blur = GaussianBlur::new(options.blur_sigma_px * width as f64 / 320.0);
    let mut blurred = vec![0; width * height];
    let mut fine = vec![0u16; width * height];
    let mut residue = vec![0; width * height];
    let mut extractor = LineExtractor::new(width, height, &profile, options);
    let mut filter = LineResidue::new(width, extractor.filter_widths().iter().copied());
    assert_eq!(extractor.top(), 0, "this camera sees no horizon");
    let fixed = extractor.filter_widths()[height / 2];
    let mut fixed_filter = LineResidue::new(width, std::iter::repeat_n(fixed, height));
    let mut components = Components::with_size(width, height);

    let mut report = String::new();
    measure(&mut report, "luminance", &frames, |_, frame| {
        luminance::luminance(frame.pixels(), black_box(&mut grey));
    });
    measure(&mut report, "blur", &greys, |_, frame| {
        blur.blur(frame.pixels(), width, black_box(&mut blurred))
    });
    measure(&mut report, "residue", &greys, |i, frame| {
        filter.filter(frame.pixels(), contrast(i), black_box(&mut residue));
    });
    measure(&mut report, "residue_fixed_width", &greys, |i, frame| {
        fixed_filter.filter(frame.pixels(), contrast(i), black_box(&mut residue));
    });
    measure(&mut report, "residue_blur", &greys, |_, frame| {
        blur.blur_fine(frame.pixels(), width, black_box(&mut fine));
    });
    // Components of pictures as they come: the thresholded residues.
    let masks: Vec<Image> = greys
        .iter()
        .enumerate()
        .map(|(i, frame)| {
            blur.blur(frame.pixels(), width, &mut blurred);
            filter.filter(&blurred, contrast(i), &mut residue);
            blur.blur(&residue, width, &mut blurred);
            extractor.extract(frame, contrast(i));
            let threshold = extractor.statistics().threshold;
            let mask = blurred
                .iter()
                .map(|value| u8::from(f64::from(*value) > threshold))
                .collect();
            Image::from_pixels(width, height, Channels::Gray, mask).expect("one byte a pixel")
        })
        .collect();
    let mut row = vec![0; width.next_multiple_of(8)];
    measure(&mut report, "components", &masks, |_, mask| {
        components.label(height, &mut row, |y, row| {
            row[..width].copy_from_slice(mask.row(y))
        });
        black_box(components.moments());
    });
    measure(&mut report, "total_rgb", &frames, |i, frame| {
        black_box(extractor.extract(frame, contrast(i)));
    });
    measure(&mut report, "total_gray", &greys, |i, frame| {
        black_box(extractor.extract(frame, contrast(i)));
    });
    let lines: usize = greys
        .iter()
        .enumerate()
        .map(|(i, frame)| extractor.extract(frame, contrast(i)).len())
        .sum();
    println!(
        "{{\"who\":\"senda\",\"width\":{width},\"height\":{height},\"frames\":{},\"lines\":{lines},\
         \"middle_widths\":[{},{}]{report}}}",
        frames.len(),
        fixed.0,
        fixed.1
    );
    Ok(())
}
