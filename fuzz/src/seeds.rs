//! What fuzzing begins from: good files, made by us or lying in the repository.

use crate::{body, root};
use senda_core::{Channels, Command, Encoded, Explanation, Frame, Image, Observation, Stamp, Truth, codec};
use senda_data::{RecordingHeader, RecordingWriter};
use senda_geom::{Camera, Lens, Mounting, Vec2};
use senda_nets::{Darknet, DarknetWeights, InputSpec, Model, Network, OutputSpec, Provenance, Weights};
use senda_vision::calibration::{CalibrationOptions, Sheet, calibrate};
use senda_world::Texture;
use std::io::Cursor;
use std::path::Path;
use std::sync::OnceLock;

/// Name and bytes of a target's seeds.
pub fn seeds(target: &str) -> Vec<(String, Vec<u8>)> {
    match target {
        "world" => files(&root().join("worlds")),
        "waypoints" => vec![
            ("lap".into(), b"x,y\n140,0\n100,80\n0,100\n-100,70\n-140,0\n-90,-80\n10,-100\n110,-70\n".to_vec()),
            ("mixed".into(), b"140;0\n140;0\n0 100\n-140\t0\n0,-1e2\n140;0\n".to_vec()),
        ],
        "vehicle" => files(&root().join("vehicles")),
        "calibration" => vec![
            ("homography".into(), calibration(false)),
            ("camera".into(), calibration(true)),
        ],
        "tub" => vec![("good".into(), tub())],
        "udacity" => vec![("good".into(), UDACITY.as_bytes().to_vec())],
        "edits" => vec![("good".into(), EDITS.as_bytes().to_vec())],
        "archive" => vec![("tub".into(), archive())],
        "recording" => vec![("good".into(), recording())],
        "image" => images(),
        "network" => files(&root().join("networks")),
        "model" => vec![("tiny".into(), model().to_bytes())],
        "onnx" => vec![("tiny".into(), model().to_onnx())],
        "darknet" => vec![
            ("small".into(), detector()),
            (
                "tiny".into(),
                include_bytes!("../../networks/yolov3-tiny.cfg").to_vec(),
            ),
        ],
        "labels" => vec![
            (
                "boxes".into(),
                b"0 0.5 0.5 0.1 0.2\n3 0.1 0.9 0.05 0.06\n".to_vec(),
            ),
            (
                "set".into(),
                b"classes=4\ntrain = train.txt\nvalid=valid.txt\nnames=set.names\nbackup=.\n".to_vec(),
            ),
        ],
        "codes" => ["I2", "https://example.org/a"]
            .map(|text| (text.replace(['/', ':'], "-"), code(text)))
            .to_vec(),
        _ => Vec::new(),
    }
}

/// A byte for the width (beyond 24 px), then the pixels of a code of four pixels a module.
fn code(text: &str) -> Vec<u8> {
    let Some(Texture::Qr { cells, .. }) = Texture::qr(text) else {
        return Vec::new();
    };
    let side = 4 * cells.width;
    let mut bytes = vec![(side - 24) as u8];
    for v in 0..side {
        bytes.extend((0..side).map(|u| cells.cells[v / 4 * cells.width + u / 4].rgb[0]));
    }
    bytes
}

/// A small detector, a zero byte, its weights.
fn detector() -> Vec<u8> {
    let cfg = "[net]\nwidth=16\nheight=8\n[convolutional]\nbatch_normalize=1\nfilters=4\nsize=3\nstride=2\npad=1\n\
        activation=leaky\n[maxpool]\nsize=2\nstride=1\n[convolutional]\nfilters=6\nactivation=linear\n\
        [yolo]\nanchors=4,5\nclasses=1\n[route]\nlayers=-3\n[upsample]\nstride=2\n[convolutional]\nfilters=6\n\
        activation=linear\n[yolo]\nanchors=4,5\nclasses=1\n";
    let darknet = Darknet::parse("small.cfg", cfg).expect("a good detector");
    let weights = DarknetWeights {
        weights: Weights::random(&darknet.network, 1),
        seen: 0,
        convolutions: 0,
    };
    let mut bytes = cfg.as_bytes().to_vec();
    bytes.push(0);
    bytes.extend(weights.to_bytes(&darknet.network).expect("darknet's layers"));
    bytes
}

/// A network that nobody trained, as a model.
fn model() -> Model {
    let network = Network::named("tinypilotnet").expect("a ready network");
    Model {
        weights: Weights::random(&network, 1),
        input: InputSpec::of(network.input()),
        network,
        outputs: vec![OutputSpec {
            name: "steering".into(),
            unit: "rad".into(),
        }],
        provenance: Provenance::default(),
        grids: vec![],
        detection: None,
        forgets: false,
    }
}

/// A picture as cameras of toys deliver it.
pub(crate) fn small_jpeg() -> &'static [u8] {
    static JPEG: OnceLock<Vec<u8>> = OnceLock::new();
    JPEG.get_or_init(|| {
        codec::encode_jpeg(&picture(Channels::Rgb), 70)
            .expect("a small picture")
            .bytes
    })
}

/// Every TOML file of a folder.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .filter_map(|path| {
            Some((
                path.file_stem()?.to_string_lossy().into_owned(),
                std::fs::read(&path).ok()?,
            ))
        })
        .collect();
    files.sort();
    files
}

fn picture(channels: Channels) -> Image {
    let pixels = (0..32 * 24 * channels.count())
        .map(|i| (i * 7 % 251) as u8)
        .collect();
    Image::from_pixels(32, 24, channels, pixels).expect("as many bytes as pixels")
}

fn images() -> Vec<(String, Vec<u8>)> {
    let mut seeds = Vec::new();
    for (name, channels) in [("gray", Channels::Gray), ("rgb", Channels::Rgb)] {
        let image = picture(channels);
        let jpeg = codec::encode_jpeg(&image, 70).expect("a small picture");
        let png = codec::encode_png(&image).expect("a small picture");
        seeds.push((format!("{name}.jpg"), jpeg.bytes));
        seeds.push((format!("{name}.png"), png.bytes));
    }
    seeds
}

pub(crate) fn recording() -> Vec<u8> {
    let header = RecordingHeader {
        senda: "0.1.0".into(),
        commit: String::new(),
        scenario: "world = \"oval\"\n".into(),
        world: None,
        reversed: false,
        body: body(),
        driver: "line".into(),
        seed: 1,
    };
    let mut writer = RecordingWriter::new(Cursor::new(Vec::new()), &header).expect("memory takes a header");
    for number in 0..3_u64 {
        let stamp = Stamp::from_ns(number * 50_000_000);
        let encoded = Encoded {
            format: senda_core::ImageFormat::Jpeg,
            bytes: small_jpeg().to_vec(),
        };
        let image = encoded.decode().expect("our own picture");
        let frame = Frame {
            camera: "center".into(),
            stamp,
            image,
            encoded: Some(encoded),
        };
        let observation = Observation {
            stamp,
            frames: vec![frame],
            speed_mps: Some(0.1),
            ..Observation::default()
        };
        let mut explanation = Explanation::default();
        explanation.signal("d_m", f64::NAN);
        explanation.event("line lost");
        let truth = Truth {
            stamp,
            ..Truth::default()
        };
        writer
            .step(
                &observation,
                &Command::curvature(0.5, 0.1),
                Some(&truth),
                &explanation,
            )
            .expect("memory takes a step");
    }
    writer
        .finish(&serde_json::json!({ "completed": true }))
        .expect("memory takes a summary")
        .into_inner()
}

/// A manifest of five lines, a zero byte, and a catalog.
fn tub() -> Vec<u8> {
    concat!(
        r#"["cam/image_array", "user/angle", "user/throttle", "user/mode"]"#, "\n",
        r#"["image_array", "float", "float", "str"]"#, "\n",
        "{}\n",
        r#"{"created_at": 1.5, "sessions": {"all_full_ids": ["22-11-29_0"], "last_id": 0, "last_full_id": "22-11-29_0"}}"#, "\n",
        r#"{"paths": ["catalog_0.catalog"], "current_index": 3, "max_len": 1000, "deleted_indexes": [1]}"#, "\n",
        "\0",
        r#"{"_index": 0, "_session_id": "22-11-29_0", "_timestamp_ms": 1669759744666, "cam/image_array": "0_cam_image_array_.jpg", "user/angle": 0.25, "user/mode": "user", "user/throttle": 0.436}"#, "\n",
        r#"{"_index": 1, "_timestamp_ms": 1669759744669, "cam/image_array": "1_cam_image_array_.jpg", "user/angle": -1, "user/throttle": 0}"#, "\n",
        r#"{"__empty__": true}"#, "\n",
    )
    .as_bytes()
    .to_vec()
}

/// The simulator's own lines, then a published set's header and blanks, a decimal comma, and names with angles.
const UDACITY: &str = r"C:\somebody\IMG\center_0.jpg,C:\somebody\IMG\left_0.jpg,C:\somebody\IMG\right_0.jpg,-0.05,0.9,0,22.5
center,left,right,steering,throttle,brake,speed
IMG/center_0.jpg, IMG/left_0.jpg, IMG/right_0.jpg, 1.2E-02, 1, 0, 30.1
v231130-f17-a85.png
video01_003_92.png
";

/// One of everything.
const EDITS: &str = "version = 1
steps = [3, 20]

[[drop]]
from = 0
to = 2

[[drop]]
run = 1
from = 10
to = 12

[[angle]]
step = 2
steering_deg = -12.5
";

/// A tub in a tar.
fn archive() -> Vec<u8> {
    let bytes = tub();
    let split = bytes
        .iter()
        .position(|byte| *byte == 0)
        .expect("a zero byte stands between the two");
    let mut builder = tar::Builder::new(Vec::new());
    for (name, bytes) in [
        ("tub/manifest.json", &bytes[..split]),
        ("tub/catalog_0.catalog", &bytes[split + 1..]),
        ("tub/images/0_cam_image_array_.jpg", small_jpeg()),
    ] {
        let mut header = tar::Header::new_ustar();
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        builder
            .append_data(&mut header, name, bytes)
            .expect("memory takes a file");
    }
    builder.into_inner().expect("memory takes the end")
}

/// A calibration file from a picture of the sheet as a vehicle's camera sees it: 4x4 looks a pixel.
fn calibration(with_lens: bool) -> Vec<u8> {
    let sheet = Sheet::a4_portrait();
    let mounting = Mounting {
        x_m: 0.0,
        y_m: 0.0,
        z_m: 0.095,
        yaw_rad: 0.0,
        tilt_rad: 0.576,
        roll_rad: 0.0,
    };
    let lens = Lens::pinhole(320, 240, 0.942, 0.738);
    let camera = Camera {
        name: "center".into(),
        width_px: 320,
        height_px: 240,
        lens,
        mounting,
    };
    let is_black = |floor: Vec2| {
        sheet.squares().iter().any(|square| {
            let low = square.iter().fold(Vec2::INFINITY, |low, corner| low.min(*corner));
            let high = square
                .iter()
                .fold(Vec2::NEG_INFINITY, |high, corner| high.max(*corner));
            floor.cmpge(low).all() && floor.cmple(high).all()
        })
    };
    let mut image = Image::new(320, 240, Channels::Gray);
    for v in 0..240_u32 {
        for u in 0..320_u32 {
            let looks = (0..16_u32).filter(|look| {
                let inside = |place: u32, part: u32| f64::from(place) + (f64::from(part) + 0.5) / 4.0;
                let pixel = Vec2::new(inside(u, look % 4), inside(v, look / 4));
                camera.floor_from_pixel(pixel).is_some_and(is_black)
            });
            image.row_mut(v as usize)[u as usize] = 225 - 12 * looks.count() as u8;
        }
    }
    let options = CalibrationOptions {
        lens: with_lens.then_some(camera.lens),
        ..CalibrationOptions::default()
    };
    let mut calibration = calibrate(&image, &sheet, &options).expect("a clear picture of the sheet");
    if let Some(camera) = &mut calibration.camera {
        camera.name = "a [[name]], ['of'] \"signs\"".into();
    }
    calibration.to_toml().into_bytes()
}
