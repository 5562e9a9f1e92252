//! Line extraction (C3 to C5 in SPEC) and the fits on the floor, per frame.

#[path = "../tests/support/mod.rs"]
mod support;

use criterion::{Criterion, criterion_group, criterion_main};
use senda_core::Image;
use senda_vision::{Contrast, ExtractorOptions, FloorMap, LineExtractor, LineFitter, WidthProfile};
use std::hint::black_box;

fn line(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("line");
    for (width, height) in [(123, 92), (160, 120), (320, 240), (640, 480)] {
        let frames = support::benchmark_frames(width, height);
        let greys: Vec<Image> = frames.iter().map(support::grey).collect();
        let camera = support::gopigo_camera(width, height);
        let profile = WidthProfile::from_camera(&camera, 0.02);
        let mut extractor = LineExtractor::new(
            width as usize,
            height as usize,
            &profile,
            ExtractorOptions::default(),
        );
        let map = FloorMap::from_camera(&camera, width as usize, height as usize);
        let mut fitter = LineFitter::new();
        let mut next = 0usize;
        // Frames alternate between dark and light lines.
        let mut turn = move || {
            next = (next + 1) % 12;
            (
                next,
                if next.is_multiple_of(2) {
                    Contrast::Dark
                } else {
                    Contrast::Light
                },
            )
        };
        group.bench_function(format!("extract-rgb-{width}x{height}"), |bench| {
            bench.iter(|| {
                let (i, contrast) = turn();
                black_box(extractor.extract(&frames[i], contrast).len())
            });
        });
        group.bench_function(format!("extract-gray-{width}x{height}"), |bench| {
            bench.iter(|| {
                let (i, contrast) = turn();
                black_box(extractor.extract(&greys[i], contrast).len())
            });
        });
        extractor.extract(&frames[4], Contrast::Dark);
        group.bench_function(format!("fit-arc-{width}x{height}"), |bench| {
            bench.iter(|| black_box(fitter.arc(extractor.blobs().first(), &map)));
        });
    }
    group.finish();
}

criterion_group!(benches, line);
criterion_main!(benches);
