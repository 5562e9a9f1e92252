//! Drawing allocates nothing per frame once the first frames have passed, also where nobody looked before.

#[path = "../../senda_core/tests/counting/mod.rs"]
mod counting;

use senda_core::Image;
use senda_sim::render::{Optics, Renderer, Scene, Shot};
use senda_world::{VehicleSpec, World};

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
        let before = counting::allocations();
        let pose = world.path.pose_at(0.02 * frame as f64);
        renderer.render(&scene, &Shot::still(pose), &mut image);
        if counting::allocations() > before {
            allocating.push(frame);
        }
    }
    // The whole lap looks at new floor. A buffer may still grow where a tile shows more than any before it.
    let late = allocating.iter().filter(|frame| **frame > 10).count();
    assert!(frames > 100 && late <= 3, "{allocating:?} of {frames}");
}
