//! Drawing allocates nothing per frame once the first frames have passed, also where nobody looked before.
#![allow(unsafe_code, reason = "a counting allocator has no other way")]

use senda_core::Image;
use senda_sim::render::{Optics, Renderer, Scene, Shot};
use senda_world::{VehicleSpec, World};
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
static ALLOCATOR: Counting = Counting;

#[test]
fn a_lap_allocates_nothing_but_in_its_first_frames() {
    let world = World::named("oval").unwrap().with_floor("wood").unwrap();
    let scene = Scene::new(&world, 0.003);
    let camera = &VehicleSpec::named("gopigo").unwrap().cameras[0].camera;
    let mut renderer = Renderer::new(camera, &scene, &Optics::default());
    let mut image = Image::default();
    let frames = (world.path.length_m() / 0.02) as usize;
    let mut allocating = Vec::with_capacity(frames);
    for frame in 0..frames {
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        let pose = world.path.pose_at(0.02 * frame as f64);
        renderer.render(&scene, &Shot::still(pose), &mut image);
        if ALLOCATIONS.load(Ordering::Relaxed) > before {
            allocating.push(frame);
        }
    }
    // The whole lap looks at new floor. A buffer may still grow where a tile shows more than any before it.
    let late = allocating.iter().filter(|frame| **frame > 10).count();
    assert!(frames > 100 && late <= 3, "{allocating:?} of {frames}");
}
