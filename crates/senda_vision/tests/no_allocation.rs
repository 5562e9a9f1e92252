//! Extraction and fits allocate nothing once the first frames have passed.

#[path = "../../senda_core/tests/counting/mod.rs"]
mod counting;
mod support;

use senda_vision::{
    Contrast, ExtractorOptions, FloorLine, FloorMap, LineExtractor, LineFitter, WidthProfile,
};

#[test]
fn a_frame_allocates_nothing() {
    let frames = support::benchmark_frames(160, 120);
    let camera = support::gopigo_camera(160, 120);
    let profile = WidthProfile::from_camera(&camera, 0.02);
    let mut extractor = LineExtractor::new(160, 120, &profile, ExtractorOptions::default());
    let map = FloorMap::from_camera(&camera, 160, 120);
    let mut fitter = LineFitter::new();
    let mut round = || {
        let mut found = 0;
        for (i, frame) in frames.iter().enumerate() {
            let contrast = if i.is_multiple_of(2) {
                Contrast::Dark
            } else {
                Contrast::Light
            };
            for blob in extractor.extract(frame, contrast) {
                found += usize::from(FloorLine::from_blob_axis(blob, &map).is_some());
                found += usize::from(fitter.arc([blob], &map).is_some());
            }
        }
        found
    };
    let found = round();
    assert!(found >= 20, "only {found}");
    let before = counting::allocations();
    assert_eq!(round(), found);
    assert_eq!(counting::allocations(), before);
}
