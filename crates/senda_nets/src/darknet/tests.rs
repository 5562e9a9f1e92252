use super::*;
use crate::network::{Kind, Shape};
use crate::{Inference, Weights};
use proptest::prelude::*;

const SMALL: &str = "[net]
width=32
height=24
channels=3

[convolutional]
batch_normalize=1
filters=4
size=3
stride=2
pad=1
activation=leaky

[maxpool]
size=2
stride=1

[convolutional]
filters=14
size=1
activation=linear

[yolo]
mask=1,2
anchors=4,5, 8,8, 12,16
classes=2
num=3

[route]
layers=-3

[upsample]
stride=2

[convolutional]
filters=7
size=1
activation=linear

[yolo]
mask=0
anchors=4,5, 8,8, 12,16
classes=2
num=3
";

fn noisy(network: &Network) -> Weights {
    let mut weights = Weights::random(network, 3);
    for (i, value) in weights.values.iter_mut().enumerate() {
        *value += 0.05 * ((i * 7 % 11) as f32 / 11.0);
    }
    weights
}

#[test]
fn tiny_yolov3_has_the_sizes_of_the_paper_and_its_file() {
    let tiny = Darknet::find("yolov3-tiny").unwrap();
    assert!(tiny.warnings.is_empty(), "{:?}", tiny.warnings);
    assert_eq!(tiny.network.parameter_count(), 8_858_734);
    let heads: Vec<[usize; 2]> = tiny
        .detection
        .heads
        .iter()
        .map(|head| [head.height, head.width])
        .collect();
    assert_eq!(heads, [[13, 13], [26, 26]]);
    assert_eq!(tiny.detection.heads[0].anchors_px[0], [81.0, 82.0]);
    assert_eq!(tiny.detection.output_len(), (13 * 13 + 26 * 26) * 3 * 85);
    let weights = DarknetWeights {
        weights: Weights {
            values: vec![0.5; 8_858_734],
        },
        seen: 32_013_312,
        convolutions: 13,
    };
    let bytes = weights.to_bytes(&tiny.network).unwrap();
    assert_eq!(bytes.len(), 35_434_956);
    assert_eq!(
        DarknetWeights::from_bytes("x", &bytes, &tiny.network, None).unwrap(),
        weights
    );
}

#[test]
fn the_last_pool_is_padded_right_and_below_only() {
    let tiny = Darknet::find("yolov3-tiny").unwrap();
    let pools: Vec<_> = tiny
        .network
        .layers()
        .iter()
        .filter_map(|layer| match layer.kind {
            Kind::MaxPool { stride, padding, .. } => {
                Some((stride[0], padding.amounts(layer.inputs[0], [2, 2], stride)))
            }
            _ => None,
        })
        .collect();
    assert_eq!(pools[0], (2, [0; 4]));
    assert_eq!(pools[5], (1, [0, 0, 1, 1]));
}

#[test]
fn classes_and_input_change_the_heads() {
    let tiny = Darknet::find("yolov3-tiny").unwrap();
    let names: Vec<String> = ["green light", "red light", "sign 0", "sign 1"]
        .map(String::from)
        .to_vec();
    let four = tiny.with_classes(&names).unwrap().with_input(320, 256).unwrap();
    assert_eq!(four.detection.classes, names);
    assert_eq!(
        (four.detection.heads[1].height, four.detection.heads[1].width),
        (16, 20)
    );
    assert_eq!(four.detection.fault(&four.network), None);
    assert!(tiny.with_classes(&[]).is_err());
}

#[test]
fn what_is_written_is_read_as_the_same() {
    let mut all: Vec<Darknet> = Darknet::names()
        .map(|name| Darknet::find(name).unwrap())
        .collect();
    all.push(Darknet::parse("small.cfg", SMALL).unwrap());
    for darknet in all {
        let text = darknet.to_cfg().unwrap();
        let again = Darknet::parse(&format!("{}.cfg", darknet.network.name()), &text).unwrap();
        assert_eq!(again.detection.heads.len(), darknet.detection.heads.len());
        assert_eq!(again.detection.output_len(), darknet.detection.output_len());
        for (a, b) in again.detection.heads.iter().zip(&darknet.detection.heads) {
            assert_eq!(a, b);
        }
        // Layers may be called differently, the function is the same.
        assert_eq!(again.network.parameter_count(), darknet.network.parameter_count());
        if darknet.network.multiply_adds() < 100_000_000 {
            let weights = noisy(&darknet.network);
            let input: Vec<f32> = (0..darknet.network.input().len())
                .map(|i| (i % 17) as f32 / 17.0)
                .collect();
            let own = Inference::new(&darknet.network, &weights, 1).run(&input).to_vec();
            let other = Inference::new(&again.network, &weights, 1).run(&input).to_vec();
            assert_eq!(own, other);
        }
    }
}

#[test]
fn networks_that_darknet_cannot_hold_are_named() {
    let network = Network::named("tinypilotnet").unwrap();
    let mut darknet = Darknet::parse("small.cfg", SMALL).unwrap();
    darknet.network = network.clone();
    assert!(darknet.to_cfg().unwrap_err().to_string().contains("flatten") || darknet.to_cfg().is_err());
    let weights = DarknetWeights {
        weights: Weights::random(&network, 1),
        seen: 0,
        convolutions: 0,
    };
    let error = weights.to_bytes(&network).unwrap_err().to_string();
    assert!(error.contains("dense"), "{error}");
}

#[test]
fn mistakes_in_a_cfg_are_told_at_their_line() {
    for (from, to, words) in [
        ("filters=14", "filters=15", "small.cfg:23: expected 14 channels"),
        ("stride=2\npad", "stride=x\npad", "small.cfg:10"),
        ("[upsample]", "[reorg]", "[reorg], which this program lacks"),
        ("activation=leaky", "activation=mish", "mish"),
        ("layers=-3", "layers=-9", "an earlier layer"),
        ("mask=1,2", "mask=1,3", "mask=numbers from 0 to 2"),
        ("anchors=4,5, 8,8", "anchors=4,5, 8", "pairs"),
        ("width=32", "width=", "width=N"),
        ("[net]", "[nut]", "[net] first"),
        ("size=2\nstride=1", "size=80\nstride=1", "size=N"),
        ("batch_normalize=1", "groups=2", "groups=1"),
        ("channels=3\n", "channels=3\nmilk\n", "small.cfg:5"),
    ] {
        assert!(SMALL.contains(from), "{from}");
        let error = Darknet::parse("small.cfg", &SMALL.replacen(from, to, 1))
            .unwrap_err()
            .to_string();
        assert!(error.contains(words), "{error} ({words})");
    }
    assert!(
        Darknet::parse("x.cfg", "")
            .unwrap_err()
            .to_string()
            .contains("[net]")
    );
    let odd = Darknet::parse("x.cfg", &SMALL.replacen("pad=1", "pad=1\nmilk=3", 1)).unwrap();
    assert!(odd.warnings[0].contains("milk"), "{:?}", odd.warnings);
}

#[test]
fn weights_that_are_cut_too_long_or_of_another_network_are_refused() {
    let small = Darknet::parse("small.cfg", SMALL).unwrap();
    let weights = DarknetWeights {
        weights: noisy(&small.network),
        seen: 77,
        convolutions: 3,
    };
    let bytes = weights.to_bytes(&small.network).unwrap();
    let read = |bytes: &[u8]| DarknetWeights::from_bytes("w", bytes, &small.network, None);
    assert_eq!(read(&bytes).unwrap(), weights);
    for end in 0..bytes.len() {
        let error = read(&bytes[..end]).unwrap_err().to_string();
        assert!(error.starts_with("w: expected"), "{error}");
    }
    let mut long = bytes.clone();
    long.extend([0; 4]);
    assert!(read(&long).unwrap_err().to_string().contains("4 more"));
    let mut broken = bytes.clone();
    broken[40..44].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(read(&broken).unwrap_err().to_string().contains("finite"));
    // The old header has 32 bits for what was seen.
    let mut old = vec![0; 12];
    old[4] = 1;
    old.extend(77u32.to_le_bytes());
    old.extend(&bytes[20..]);
    assert_eq!(read(&old).unwrap(), weights);
}

#[test]
fn a_file_of_the_first_layers_leaves_the_others_as_they_were() {
    let small = Darknet::parse("small.cfg", SMALL).unwrap();
    let whole = DarknetWeights {
        weights: noisy(&small.network),
        seen: 0,
        convolutions: 3,
    };
    let bytes = whole.to_bytes(&small.network).unwrap();
    let initial = Weights::random(&small.network, 9);
    let first = 20 + 4 * (4 * 4 + 4 * 3 * 9);
    let read =
        |bytes: &[u8], most| DarknetWeights::from_bytes("w", bytes, &small.network, Some((&initial, most)));
    let cut = read(&bytes[..first], usize::MAX).unwrap();
    assert_eq!((cut.convolutions, &cut), (1, &read(&bytes, 1).unwrap()));
    let tensor = small.network.tensors().last().unwrap().range();
    assert_eq!(cut.weights.values[tensor.clone()], initial.values[tensor]);
    assert_eq!(cut.weights.values[..4], whole.weights.values[..4]);
    assert!(read(&bytes[..first + 4], usize::MAX).is_err());
}

proptest! {
    #[test]
    fn no_text_makes_the_reader_panic(text in "\\PC*", at in 0usize..400, noise in "[-0-9=,a-z\\[\\]\n ]{0,12}") {
        let _ = Darknet::parse("x.cfg", &text);
        let mut damaged = SMALL.to_owned();
        let at = at.min(damaged.len());
        damaged.insert_str(at, &noise);
        if let Ok(darknet) = Darknet::parse("x.cfg", &damaged) {
            prop_assert_eq!(darknet.detection.fault(&darknet.network), None);
        }
    }
}

#[test]
fn shapes_are_those_that_the_engine_computes() {
    let small = Darknet::parse("small.cfg", SMALL).unwrap();
    let shape = |name: &str| {
        small
            .network
            .layers()
            .iter()
            .find(|layer| layer.name == name)
            .unwrap()
            .output
    };
    assert_eq!(
        shape("maxpool_1"),
        Shape {
            channels: 4,
            height: 12,
            width: 16
        }
    );
    assert_eq!(shape("heads"), Shape::flat(small.detection.output_len()));
}
