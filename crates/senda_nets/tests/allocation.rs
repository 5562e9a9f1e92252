//! After the first call nothing on the hot paths asks for memory.

#[path = "../../senda_core/tests/counting/mod.rs"]
mod counting;

use senda_core::{Channels, Image};
use senda_nets::{Edges, Eye, Inference, InputSpec, Network, Shape, TrainOptions, Trainer, Weights};

/// Allocations of three times this work, once everything is warm. A thread may begin late and allocate what every thread
/// does at its start: the least of some attempts counts.
fn allocations(mut work: impl FnMut()) -> usize {
    work();
    let mut attempt = || {
        let before = counting::allocations();
        for _ in 0..3 {
            work();
        }
        counting::allocations() - before
    };
    (0..20).map(|_| attempt()).min().unwrap_or_default()
}

/// One test, so that no other thread of the test program allocates meanwhile.
#[test]
fn steps_and_frames_allocate_nothing() {
    let norm = "[input]\nheight = 4\nwidth = 4\nchannels = 2\n[[layer]]\nkind = \"batch_norm\"\n[[layer]]\nkind = \"flatten\"\n[[layer]]\nkind = \"dense\"\nunits = 1\n";
    let mut networks: Vec<Network> = ["tinypilotnet", "pilotnet", "deepestlstm-tinypilotnet"]
        .into_iter()
        .map(|name| Network::named(name).unwrap())
        .collect();
    networks.push(Network::parse("norm", norm).unwrap());
    for network in networks {
        let weights = Weights::random(&network, 1);
        let input = vec![0.5; 8 * network.input().len()];
        let target = vec![0.1; 8 * network.output_len()];
        let mut inference = Inference::new(&network, &weights, 8);
        assert_eq!(
            allocations(|| assert!(!inference.run(&input).is_empty())),
            0,
            "{}",
            network.name()
        );
        for threads in [1, 2] {
            let options = TrainOptions {
                threads,
                clip_norm: Some(1.0),
                ..TrainOptions::default()
            };
            let mut trainer = Trainer::new(network.clone(), weights.clone(), options).unwrap();
            let count = allocations(|| {
                trainer.step(&input, &target, None);
            });
            assert_eq!(count, 0, "{} with {threads} threads", network.name());
        }
    }
    let spec = InputSpec {
        edges: Some(Edges::default()),
        stack: 2,
        ..InputSpec::of(Shape {
            channels: 3,
            height: 66,
            width: 200,
        })
    };
    let frame = Image::new(320, 240, Channels::Rgb);
    let mut eye = Eye::new(&spec);
    eye.see(&frame);
    let count = allocations(|| {
        eye.see(&frame);
    });
    assert_eq!(count, 0);
}
