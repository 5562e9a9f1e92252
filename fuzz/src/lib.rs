//! Hostile bytes for every reader of foreign bytes, and what must hold for whatever it accepts.
//!
//! Each target is a plain function: libFuzzer calls it with bytes of its making, and the tests below with seeds and
//! simple damage to them, so that the targets are tried with any compiler.

mod seeds;

pub use seeds::seeds;

use senda_core::{Body, Channels, Encoded, Image, Observation, Steering};
use senda_data::{Edits, Recording, darknet as labelled, named_frames, tub, udacity as udacity_format};
use senda_nets::{Darknet, DarknetWeights, Imported, Inference, Model, Network, suppress};
use senda_vision::calibration::Calibration;
use senda_vision::{QrLimits, QrReader};
use senda_world::{VehicleSpec, World, paint};
use std::io::Cursor;
use std::path::Path;

/// Every target by name.
pub const TARGETS: &[(&str, fn(&[u8]))] = &[
    ("world", world),
    ("vehicle", vehicle),
    ("calibration", calibration),
    ("tub", tub),
    ("udacity", udacity),
    ("archive", archive),
    ("edits", edits),
    ("recording", recording),
    ("image", image),
    ("waypoints", waypoints),
    ("network", network),
    ("model", model),
    ("onnx", onnx),
    ("darknet", darknet),
    ("labels", labels),
    ("codes", codes),
];

/// World files. What is accepted is written so that it is read as the same world.
pub fn world(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    if let Ok((world, _)) = World::parse("world.toml", text) {
        let written = world.to_toml();
        match World::parse("written.toml", &written) {
            Ok((again, _)) => assert_eq!(again, world, "{written}"),
            Err(error) => panic!("what was written is refused: {error}\n{written}"),
        }
        // What a world asks for in paint must stay within reason, whatever its size.
        let (low, high) = world.bounds();
        paint::paint(&world, ((high - low).max_element() / 40.0).max(0.01));
        let _ = world.reversed();
    }
}

/// Way points of a lap. What is accepted is a world that is written so that it is read as the same lap.
pub fn waypoints(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok((world, _)) = World::from_waypoints("points.csv", &text, 1.0, 1) {
        let written = world.to_toml();
        match World::parse("written.toml", &written) {
            Ok((again, _)) => assert_eq!(again, world, "{written}"),
            Err(error) => panic!("what was written is refused: {error}\n{written}"),
        }
    }
}

/// Grey pictures for the reader of codes: a byte for the width, then pixels. The same picture gives the same codes, with
/// corners that are numbers.
pub fn codes(bytes: &[u8]) {
    let Some((first, pixels)) = bytes.split_first() else {
        return;
    };
    let width = 24 + usize::from(*first);
    let height = (pixels.len() / width).min(400);
    let Some(image) = Image::from_pixels(
        width,
        height,
        Channels::Gray,
        pixels[..width * height].to_vec(),
    ) else {
        return;
    };
    for everywhere in [false, true] {
        let mut reader = QrReader::new(QrLimits {
            part: 1.0,
            everywhere,
            ..QrLimits::default()
        });
        let found = reader.read(&image).to_vec();
        for code in &found {
            assert!(code.corners_px.iter().flatten().all(|place| place.is_finite()), "{code:?}");
        }
        assert_eq!(reader.read(&image), found);
    }
}

/// Network files. What is accepted is written so that it is read as the same network.
pub fn network(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    if let Ok(network) = Network::parse("network.toml", text) {
        let written = network.to_toml();
        match Network::parse("written.toml", &written) {
            Ok(again) => assert_eq!(again, network, "{written}"),
            Err(error) => panic!("what was written is refused: {error}\n{written}"),
        }
    }
}

/// Model files. What is accepted is written so that it is read as the same model, and runs.
pub fn model(bytes: &[u8]) {
    if let Ok(model) = Model::from_bytes("model.senda", bytes) {
        match Model::from_bytes("written.senda", &model.to_bytes()) {
            Ok(again) => assert_eq!(again, model),
            Err(error) => panic!("what was written is refused: {error}"),
        }
        let layers = model.network.layers();
        let is_small = layers.iter().all(|layer| layer.output.len() < 1 << 20);
        if model.network.multiply_adds() < 1_000_000 && is_small {
            let input = vec![0.5; model.network.input().len()];
            model.inference().run(&input);
        }
    }
}

/// ONNX files. What is accepted runs.
pub fn onnx(bytes: &[u8]) {
    if let Ok(imported) = Imported::from_bytes("network.onnx", bytes) {
        let network = &imported.network;
        if network.multiply_adds() < 1_000_000
            && network.layers().iter().all(|layer| layer.output.len() < 1 << 20)
        {
            let input = vec![0.5; network.input().len()];
            Inference::new(network, &imported.weights, 1).run(&input);
        }
    }
}

/// Darknet's detectors: the bytes up to the first zero byte are the `.cfg`, the rest the `.weights`. What is accepted can be
/// written, and runs.
pub fn darknet(bytes: &[u8]) {
    let split = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let (cfg, weights) = bytes.split_at(split);
    let Ok(darknet) = Darknet::parse("network.cfg", &String::from_utf8_lossy(cfg)) else {
        return;
    };
    if let Ok(written) = darknet.to_cfg()
        && let Err(error) = Darknet::parse("written.cfg", &written)
    {
        panic!("what was written is refused: {error}\n{written}");
    }
    let network = &darknet.network;
    let weights = weights.get(1..).unwrap_or_default();
    if network.multiply_adds() > 1_000_000
        || network.layers().iter().any(|layer| layer.output.len() > 1 << 20)
    {
        return;
    }
    if let Ok(read) = DarknetWeights::from_bytes("network.weights", weights, network, None) {
        let input = network.input();
        let mut inference = Inference::new(network, &read.weights, 1);
        let mut found = Vec::new();
        let output = inference.run(&vec![0.5; input.len()]);
        darknet
            .detection
            .decode(output, [input.width, input.height], 0.5, &mut found);
        found.truncate(1000);
        suppress(&mut found, 0.45);
    }
}

/// Darknet's lists of pictures, names and boxes: the same text is tried as each.
pub fn labels(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok(data) = labelled::DataFile::parse(Path::new("set.data"), &text) {
        let again = labelled::DataFile::parse(Path::new("set.data"), &data.to_text()).expect("our own text");
        assert_eq!(again.classes, data.classes);
    }
    labelled::parse_names(&text);
    let (boxes, _) = labelled::parse_labels(&text, 4);
    assert_eq!(
        labelled::parse_labels(&labelled::labels_to_text(&boxes), 4)
            .0
            .len(),
        boxes
            .iter()
            .filter(|one| one.width.min(one.height) > 5e-7)
            .count()
    );
}

/// Vehicle files. As [`world`].
pub fn vehicle(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    if let Ok((vehicle, _)) = VehicleSpec::parse("vehicle.toml", text) {
        let written = vehicle.to_toml();
        match VehicleSpec::parse("written.toml", &written) {
            Ok((again, _)) => assert_eq!(again, vehicle, "{written}"),
            Err(error) => panic!("what was written is refused: {error}\n{written}"),
        }
        let _ = vehicle.body();
    }
}

/// Calibration files. As [`world`].
pub fn calibration(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    if let Ok(calibration) = Calibration::parse("calibration.toml", text) {
        let written = calibration.to_toml();
        match Calibration::parse("written.toml", &written) {
            Ok(again) => assert_eq!(again, calibration, "{written}"),
            Err(error) => panic!("what was written is refused: {error}\n{written}"),
        }
        let _ = calibration.floor_map(64, 48);
    }
}

/// Donkeycar tubs: the bytes up to the first zero byte are the manifest, the rest the catalog.
pub fn tub(bytes: &[u8]) {
    let split = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let (manifest, catalog) = bytes.split_at(split);
    let catalog = catalog.get(1..).unwrap_or_default();
    for line in catalog.split(|byte| *byte == b'\n') {
        let _ = tub::parse_line(line);
    }
    let files = [
        ("images/0_cam_image_array_.jpg", seeds::small_jpeg()),
        ("manifest.json", manifest),
        ("catalog_0.catalog", catalog),
    ];
    let folder = folder_with(&files);
    for recording in tub::read_runs(folder.path(), &body()).iter().flatten() {
        look_through(recording);
    }
}

/// Logs of the Udacity simulator, and names of pictures with the angle in them: each line is tried as both.
pub fn udacity(bytes: &[u8]) {
    for line in bytes.split(|byte| *byte == b'\n') {
        let _ = udacity_format::parse_line(line);
        if let Ok(name) = std::str::from_utf8(line) {
            let _ = named_frames::parse_name(name);
        }
    }
    let folder = folder_with(&[
        ("IMG/center_0.jpg", seeds::small_jpeg()),
        ("driving_log.csv", bytes),
    ]);
    for recording in udacity_format::read_runs(folder.path(), &body()).iter().flatten() {
        look_through(recording);
    }
}

/// Archives of data sets, whatever lies in them.
pub fn archive(bytes: &[u8]) {
    let folder = folder_with(&[("set.tar", bytes)]);
    for recording in senda_data::open_runs(&folder.path().join("set.tar"), &body())
        .iter()
        .flatten()
    {
        look_through(recording);
    }
}

/// Files of edits. What is accepted is written so that it is read as the same edits, and can be applied to any run.
pub fn edits(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    if let Ok(edits) = Edits::parse(Path::new("run.mcap.edits.toml"), text) {
        let written = edits.to_toml();
        match Edits::parse(Path::new("written.toml"), &written) {
            Ok(again) => assert_eq!(again, edits, "{written}"),
            Err(error) => panic!("what was written is refused: {error}\n{written}"),
        }
        let mut recording = Recording::from_bytes(&seeds::recording()).expect("our own bytes");
        let before = recording.steps.len();
        edits.apply(0, &mut recording);
        assert!(recording.steps.len() <= before);
    }
}

fn folder_with(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    for (name, bytes) in files {
        let path = folder.path().join(name);
        let parent = path.parent().expect("it lies in the folder");
        std::fs::create_dir_all(parent).expect("a temporary folder can be written to");
        std::fs::write(path, bytes).expect("a temporary folder can be written to");
    }
    folder
}

/// Recordings. What is accepted can be looked through, and written so that its steps are read again.
pub fn recording(bytes: &[u8]) {
    if let Ok(recording) = Recording::from_bytes(bytes) {
        look_through(&recording);
        let written = recording.write(Cursor::new(Vec::new())).map(Cursor::into_inner);
        let again =
            Recording::from_bytes(&written.expect("memory takes a recording")).expect("our own bytes");
        assert_eq!(again.steps.len(), recording.steps.len());
        assert_eq!(again.header, recording.header);
    }
}

/// JPEG and PNG. What is accepted survives a lossless round trip.
pub fn image(bytes: &[u8]) {
    if let Ok(encoded) = Encoded::recognise(bytes.to_vec())
        && let Ok(image) = encoded.decode()
        && !image.is_empty()
    {
        assert_eq!(
            image.pixels().len(),
            image.width() * image.height() * image.channels().count()
        );
        let mut again = Image::default();
        senda_core::codec::encode_png(&image)
            .and_then(|png| png.decode_into(&mut again))
            .expect("a decoded image can be encoded");
        assert_eq!(again, image);
    }
}

/// What a report or a replay does with a recording.
fn look_through(recording: &Recording) {
    let mut observation = Observation::default();
    for step in &recording.steps {
        step.observation_into(&mut observation);
    }
    let _ = (recording.duration_s(), recording.truths());
}

fn body() -> Body {
    Body {
        name: "car".into(),
        steering: Steering::Ackermann {
            wheelbase_m: 0.17,
            steering_limit_rad: 0.4,
        },
        width_m: 0.19,
        length_m: 0.29,
        speed_limit_mps: 2.0,
        yaw_rate_limit_radps: 5.0,
        period_s: 0.05,
        encoders: None,
        cameras: Vec::new(),
    }
}

/// The repository's root.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("fuzz/ lies in the repository")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Damage `number` to a seed: cut short, one byte changed, a part doubled, left out, or a digit grown.
    fn damaged(seed: &[u8], number: u64) -> Vec<u8> {
        // SplitMix64 (Steele et al. 2014): a few words of well-mixed bits without a dependency.
        let mut state = number;
        let mut draw = |below: usize| {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut bits = state;
            bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((bits ^ (bits >> 31)) % below.max(1) as u64) as usize
        };
        let mut bytes = seed.to_vec();
        for _ in 0..=draw(3) {
            let at = draw(bytes.len());
            let end = (at + 1 + draw(24)).min(bytes.len());
            match draw(6) {
                0 => bytes.truncate(at),
                1 if at < bytes.len() => bytes[at] ^= 1 << draw(8),
                2 => bytes
                    .splice(at..at, seed[..seed.len().min(end - at.min(end))].to_vec())
                    .for_each(drop),
                3 => drop(bytes.drain(at..end)),
                4 => bytes.splice(at..at, *b"9999").for_each(drop),
                _ => bytes.splice(at..at, *b"-").for_each(drop),
            }
        }
        bytes
    }

    #[test]
    fn every_target_takes_its_seeds() {
        for (name, target) in TARGETS {
            let seeds = seeds(name);
            assert!(!seeds.is_empty(), "{name} has no seeds");
            for (_, seed) in seeds {
                target(&seed);
            }
            target(b"");
        }
    }

    #[test]
    fn every_target_takes_damaged_seeds() {
        for (name, target) in TARGETS {
            let seeds = seeds(name);
            for number in 0..600 {
                let (_, seed) = &seeds[number % seeds.len()];
                target(&damaged(seed, number as u64));
            }
        }
    }
}
