//! What every data format owes: what is written comes back with its signs, and damage of any kind is a warning or a
//! clear error, never a panic and never nonsense.

mod support;

use proptest::prelude::*;
use senda_core::{Body, Turn};
use senda_data::{DataError, Format, Recording, named_frames, tub, udacity};
use std::fs;
use std::path::{Path, PathBuf};
use support::{car, recording};

/// A data format under test.
struct Kit {
    format: Format,
    /// Writes a recording to a path that does not exist yet.
    write: fn(&Recording, &Path),
    read: fn(&Path, &Body) -> Result<Recording, DataError>,
    /// The file (below the path) that lists the records.
    list: &'static str,
    /// How exactly steering comes back (rad).
    precision_rad: f64,
}

const KITS: [Kit; 4] = [
    Kit {
        format: Format::Recording,
        write: |recording, path| recording.save(path).unwrap(),
        read: |path, _| Recording::read(path),
        list: "",
        precision_rad: 0.0,
    },
    Kit {
        format: Format::Tub,
        write: |recording, path| {
            tub::write(recording, path, &tub::TubOptions::default()).unwrap();
        },
        read: tub::read,
        list: "catalog_0.catalog",
        precision_rad: 1e-12,
    },
    Kit {
        format: Format::Udacity,
        write: |recording, path| {
            udacity::write(recording, path, &udacity::UdacityOptions::default()).unwrap();
        },
        read: udacity::read,
        list: "driving_log.csv",
        precision_rad: 1e-12,
    },
    Kit {
        format: Format::NamedFrames,
        write: |recording, path| {
            named_frames::write(recording, path, "v010000").unwrap();
        },
        read: named_frames::read,
        list: "",
        // Whole servo degrees: half of one of 50 to full lock.
        precision_rad: 0.5 / 50.0 * 0.4 + 1e-12,
    },
];

impl Kit {
    /// A written data set of so many steps; the folder must live as long as the path is used.
    fn sample(&self, steps: usize) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = match self.format {
            Format::Recording => folder.path().join("set.mcap"),
            _ => folder.path().join("set"),
        };
        (self.write)(&recording(steps), &path);
        (folder, path)
    }

    fn list_path(&self, path: &Path) -> PathBuf {
        if self.list.is_empty() {
            path.to_owned()
        } else {
            path.join(self.list)
        }
    }

    /// Formats whose records are in one file; names of pictures are checked elsewhere.
    fn has_list(&self) -> bool {
        self.format != Format::NamedFrames
    }
}

/// The steering angle (rad) that a step asks for, within the car's limits.
fn steering(recording: &Recording, number: usize) -> f64 {
    let step = &recording.steps[number];
    let body = &recording.header.body;
    body.steering_of(step.command.turn, body.speed_of(&step.command))
        .clamp(-0.4, 0.4)
}

#[test]
fn what_is_written_comes_back() {
    let original = recording(9);
    for kit in &KITS {
        let (_folder, path) = kit.sample(9);
        assert_eq!(Format::detect(&path).unwrap(), kit.format);
        let back = senda_data::open(&path, &car()).unwrap();
        assert_eq!(back.steps.len(), 9, "{}: {:#?}", kit.format.name(), back.warnings);
        for (number, (step, before)) in back.steps.iter().zip(&original.steps).enumerate() {
            let (found, expected) = (steering(&back, number), steering(&original, number));
            assert!(
                (found - expected).abs() <= kit.precision_rad,
                "{} step {number}: expected {expected}, but found {found}",
                kit.format.name()
            );
            assert_eq!(step.frames.len(), 1);
            assert_eq!(step.frames[0].camera, "center");
            if number % 3 == 0 {
                assert_eq!(step.frames[0].encoded, before.frames[0].encoded, "bytes are kept");
            }
        }
        assert!(back.steps.is_sorted_by_key(|step| step.stamp));
    }
}

#[test]
fn left_stays_left() {
    for kit in &KITS {
        let mut original = recording(2);
        original.steps[0].command = senda_core::Command::steering(0.2, 0.5);
        original.steps[1].command = senda_core::Command::steering(-0.3, 0.5);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("set.mcap");
        (kit.write)(&original, &path);
        let back = (kit.read)(&path, &car()).unwrap();
        let turns: Vec<_> = back.steps.iter().map(|step| step.command.turn).collect();
        let [Turn::SteeringRad(left), Turn::SteeringRad(right)] = turns[..] else {
            panic!("{}: {turns:?}", kit.format.name());
        };
        assert!(
            (left - 0.2).abs() <= kit.precision_rad.max(1e-12),
            "{}: {left}",
            kit.format.name()
        );
        assert!(
            (right + 0.3).abs() <= kit.precision_rad.max(1e-12),
            "{}: {right}",
            kit.format.name()
        );
    }
}

#[test]
fn every_format_can_be_looked_into_and_imported() {
    for kit in &KITS {
        let (folder, path) = kit.sample(9);
        let info = senda_data::info(&path, &car()).unwrap();
        assert_eq!(
            (info.format, info.steps, info.frames, info.damaged_frames),
            (kit.format, 9, 9, 0)
        );
        assert_eq!((info.cameras[0].width_px, info.cameras[0].height_px), (16, 12));
        assert_eq!(info.steering.counts.iter().sum::<usize>(), 9);
        assert!(
            info.to_string().contains("camera center: 9 frames of 16x12 px"),
            "{info}"
        );
        let to = folder.path().join("imported");
        let imported = senda_data::import(&path, &car(), &to);
        if kit.format == Format::Recording {
            assert!(imported.unwrap_err().to_string().contains("a recording of senda"));
            continue;
        }
        let imported = imported.unwrap();
        assert_eq!(imported.len(), 1);
        let mut direct = (kit.read)(&path, &car()).unwrap();
        let stored = Recording::read(&imported[0].path).unwrap();
        direct.warnings.clear();
        assert_eq!(stored.steps, direct.steps);
        assert_eq!(stored.header, direct.header);
        let again = senda_data::import(&path, &car(), &to).unwrap_err().to_string();
        assert!(again.contains("already there"), "{again}");
    }
}

#[test]
fn empty_lists_are_warnings_or_clear_errors() {
    for kit in KITS.iter().filter(|kit| kit.has_list()) {
        let (_folder, path) = kit.sample(3);
        fs::write(kit.list_path(&path), b"").unwrap();
        match (kit.read)(&path, &car()) {
            Ok(recording) => {
                assert!(recording.steps.is_empty());
                assert!(recording.warnings.iter().any(|w| w.contains("no usable record")));
            }
            Err(error) => assert!(error.to_string().contains("expected"), "{error}"),
        }
    }
}

#[test]
fn a_list_cut_at_every_sixteenth_gives_its_beginning() {
    for kit in KITS.iter().filter(|kit| kit.has_list()) {
        let (_folder, path) = kit.sample(12);
        let list = kit.list_path(&path);
        let bytes = fs::read(&list).unwrap();
        let whole = (kit.read)(&path, &car()).unwrap();
        let mut before = 0;
        for part in 1..16 {
            fs::write(&list, &bytes[..bytes.len() * part / 16]).unwrap();
            let recording = match (kit.read)(&path, &car()) {
                Ok(recording) => recording,
                // Only the very beginning of a recording, its header, is needed.
                Err(error) if kit.format == Format::Recording && part < 4 => {
                    assert!(error.to_string().contains("cut off"), "{error}");
                    continue;
                }
                Err(error) => panic!("{}: {part}/16: {error}", kit.format.name()),
            };
            let count = recording.steps.len();
            assert!(
                count >= before && count <= 12,
                "{}: {part}/16: {count}",
                kit.format.name()
            );
            before = count;
            let commands = |r: &Recording| r.steps[..count].iter().map(|s| s.command).collect::<Vec<_>>();
            // The last row of a log that is cut in a number still is a row: nobody can know.
            let sure = if kit.format == Format::Udacity {
                count.saturating_sub(1)
            } else {
                count
            };
            assert_eq!(commands(&recording)[..sure], commands(&whole)[..sure]);
            let told = !recording.warnings.is_empty() || kit.format == Format::Udacity;
            assert!(told, "{}: {part}/16: nothing was said", kit.format.name());
        }
        assert!(before >= 9, "{}: {before}", kit.format.name());
    }
}

#[test]
fn archives_of_every_foreign_format() {
    for kit in KITS.iter().filter(|kit| kit.format != Format::Recording) {
        let (folder, path) = kit.sample(9);
        let direct = (kit.read)(&path, &car()).unwrap();
        let mut builder = tar::Builder::new(flate2::write::GzEncoder::new(
            Vec::new(),
            flate2::Compression::fast(),
        ));
        builder.append_dir_all("data/set", &path).unwrap();
        let bytes = builder.into_inner().unwrap().finish().unwrap();
        let archive = folder.path().join("set.tar.gz");
        fs::write(&archive, &bytes).unwrap();
        assert_eq!(Format::detect(&archive).unwrap(), kit.format);
        let packed = senda_data::open(&archive, &car()).unwrap();
        assert_eq!(packed.steps, direct.steps);
        // Cut anywhere it is what was before the cut, and says so.
        for part in 1..16 {
            fs::write(&archive, &bytes[..bytes.len() * part / 16]).unwrap();
            match (kit.read)(&archive, &car()) {
                Ok(recording) => assert!(
                    recording.warnings.iter().any(|w| w.contains("cut off")),
                    "{part}/16"
                ),
                Err(error) => assert!(error.to_string().contains("expected"), "{error}"),
            }
            // Where nothing is left by which to know the format, the cut is the reason.
            if let Err(error) = Format::detect(&archive) {
                assert!(error.to_string().contains("cut off"), "{part}/16: {error}");
            }
        }
    }
}

#[test]
fn nothing_there_is_named() {
    for kit in &KITS {
        let error = (kit.read)(Path::new("/no/such/place"), &car())
            .unwrap_err()
            .to_string();
        assert!(error.contains("/no/such/place: cannot be read"), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let error = senda_data::open(folder.path(), &car()).unwrap_err().to_string();
    assert!(
        error.contains("expected a recording") && error.contains("none of them"),
        "{error}"
    );
}

/// Puts bytes in the place of the list and reads; anything but a panic is right.
fn throw(kit: &Kit, path: &Path, bytes: &[u8]) {
    fs::write(kit.list_path(path), bytes).unwrap();
    if let Ok(recording) = (kit.read)(path, &car()) {
        for step in &recording.steps {
            let _ = step.observation();
        }
    }
}

#[test]
fn bytes_that_are_not_unicode_and_huge_numbers() {
    for kit in KITS.iter().filter(|kit| kit.has_list()) {
        let (_folder, path) = kit.sample(3);
        let good = fs::read(kit.list_path(&path)).unwrap();
        for bad in [
            &b"\xff\xfe\x00\xd8"[..],
            b"{\"_index\": 99999999999999999999999, \"user/angle\": 1e999}\n",
            b"{\"_index\": 18446744073709551615, \"_timestamp_ms\": 18446744073709551615, \"user/angle\": 0, \"cam/image_array\": \"0_cam_image_array_.jpg\"}\n",
            b"a,b,c,1e999,1e-999,0,99999999999999999999999999999\n",
            b"a,b,c,0,1,2,3,4,5\n,,,,,,\n\"\"\"\n",
        ] {
            throw(kit, &path, bad);
            throw(kit, &path, &[bad, &good].concat());
            throw(kit, &path, &[&good, bad].concat());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file.mcap");
        fs::write(&file, &bytes).unwrap();
        let _ = senda_data::open(&file, &car());
        let _ = Recording::from_bytes(&[&b"\x89MCAP0\r\n"[..], &bytes].concat());
        let _ = tub::parse_line(&bytes);
        let _ = udacity::parse_line(&bytes);
        let _ = named_frames::parse_name(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn random_damage_never_panics(
        which in 0..3usize,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in any::<prop::sample::Index>(),
    ) {
        let kit = &KITS[which];
        let (_folder, path) = kit.sample(4);
        let mut bytes = fs::read(kit.list_path(&path)).unwrap();
        for (place, value) in edits {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        throw(kit, &path, &bytes);
        bytes.truncate(cut.index(bytes.len()));
        throw(kit, &path, &bytes);
    }

    #[test]
    fn any_text_in_a_log_line_never_panics(text in ".{0,80}", numbers in prop::collection::vec(any::<f64>(), 0..8)) {
        let _ = udacity::parse_line(text.as_bytes());
        let row: Vec<String> = numbers.iter().map(f64::to_string).collect();
        let _ = udacity::parse_line(format!("a,b,c,{}", row.join(",")).as_bytes());
        let _ = tub::parse_line(format!("{{\"_index\": 1, \"k\": {text:?}}}").as_bytes());
        let _ = named_frames::parse_name(&format!("v1-f{}-a{text}.png", numbers.len()));
    }
}
