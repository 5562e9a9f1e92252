//! Reads the codes in a folder of JPEG frames and times it, with and without the look for finder patterns first; one line of JSON
//! on standard output.
//!
//! `cargo run --release -p senda_vision --example codes_timing -- DIR`. `benches/peers/codes.sh` runs this and zbar over the
//! same frames.
#![allow(
    clippy::disallowed_types,
    clippy::print_stdout,
    reason = "a measurement reads the clock and prints"
)]

use senda_core::{Encoded, Image};
use senda_vision::{QrLimits, QrReader};
use std::time::Instant;

const ROUNDS: usize = 5;
/// Smaller codes belong to other places: the mission's `code_part`.
const LEAST_PART: f32 = 0.085;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("expected: DIR")?;
    let mut names: Vec<_> = std::fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    names.sort_by_key(|entry| entry.file_name());
    let frames: Vec<Image> = names
        .iter()
        .filter(|entry| entry.path().extension().is_some_and(|e| e == "jpg"))
        .map(|entry| Ok(Encoded::recognise(std::fs::read(entry.path())?)?.decode()?))
        .collect::<Result<_, Box<dyn std::error::Error>>>()?;
    let mut parts = Vec::new();
    for everywhere in [false, true] {
        let mut reader = QrReader::new(QrLimits {
            everywhere,
            ..QrLimits::default()
        });
        let (mut codes, mut near) = (0, 0);
        let mut best_s = 0.0;
        for frame in &frames {
            // Of each frame the best: a machine that is busy with something else for a while does not count.
            let mut frame_s = f64::INFINITY;
            for _ in 0..ROUNDS {
                let begin = Instant::now();
                reader.read(frame);
                frame_s = frame_s.min(begin.elapsed().as_secs_f64());
            }
            best_s += frame_s;
            let found = reader.read(frame);
            codes += found.len();
            near += found
                .iter()
                .filter(|code| code.size_px() >= LEAST_PART * frame.width() as f32)
                .count();
        }
        let name = if everywhere { "everywhere" } else { "default" };
        parts.push(format!(
            "\"{name}\":{{\"ms\":{:.3},\"codes\":{codes},\"near_codes\":{near}}}",
            1e3 * best_s / frames.len().max(1) as f64
        ));
    }
    println!(
        "{{\"who\":\"senda\",\"frames\":{},{}}}",
        frames.len(),
        parts.join(",")
    );
    Ok(())
}
