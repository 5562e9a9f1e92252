//! Extraction and fits allocate nothing once the first frames have passed.
#![allow(unsafe_code, reason = "a counting allocator has no other way")]

mod support;

use senda_vision::{
    Contrast, ExtractorOptions, FloorLine, FloorMap, LineExtractor, LineFitter, WidthProfile,
};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises hold for the system's allocator too.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

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
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    assert_eq!(round(), found);
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed), before);
}
