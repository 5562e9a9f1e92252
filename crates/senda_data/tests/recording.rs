//! Recordings: what is written comes back, damage costs little, and the same run gives the same bytes.

mod support;

use senda_core::{Command, Driver, Observation, Vehicle};
use senda_data::{DataError, Recording, RecordingOptions, RecordingWriter, Replay};
use std::io::{Cursor, Error, ErrorKind, Seek, SeekFrom, Write};
use support::{car, header, moment, record, recording};

#[test]
fn everything_comes_back_exactly() {
    let recording = recording(40);
    assert_eq!(recording.header, header(car()));
    assert_eq!(
        recording.summary,
        Some(serde_json::json!({"completed": true, "laps": 1.5}))
    );
    assert_eq!(recording.warnings, Vec::<String>::new());
    assert_eq!(recording.steps.len(), 40);
    for (number, step) in recording.steps.iter().enumerate() {
        let it = moment(number);
        assert_eq!(step.command, it.command, "step {number}");
        assert_eq!(step.truth, it.truth, "step {number}");
        assert_eq!(step.explanation, it.explanation, "step {number}");
        let (observation, damaged) = step.observation();
        assert_eq!(damaged, 0);
        let mut expected = it.observation;
        // A frame that came raw comes back with its lossless bytes.
        expected.frames[0]
            .encoded
            .clone_from(&observation.frames[0].encoded);
        assert_eq!(observation, expected, "step {number}");
    }
}

#[test]
fn the_sensors_bytes_are_kept_not_encoded_again() {
    let recording = recording(3);
    let sent = moment(0).observation.frames[0].encoded.clone().unwrap();
    assert_eq!(recording.steps[0].frames[0].encoded, sent);
}

#[test]
fn the_same_calls_give_the_same_bytes() {
    let bytes = record(40);
    assert_eq!(bytes, record(40));
    let copy = Recording::from_bytes(&bytes)
        .unwrap()
        .write(Cursor::new(Vec::new()))
        .unwrap();
    assert_eq!(copy.into_inner(), bytes, "a copy of a recording is the recording");
}

#[test]
fn other_readers_find_the_same_messages() {
    let bytes = record(40);
    let mut counts = std::collections::BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.channel.schema.is_some());
        *counts.entry(message.channel.topic.clone()).or_insert(0) += 1;
    }
    let expected = [
        ("/camera/center", 40),
        ("/command", 40),
        ("/explanation", 40),
        ("/observation", 40),
        ("/pose", 26),
        ("/truth", 26),
    ];
    assert_eq!(
        counts,
        expected.map(|(topic, count)| (topic.to_owned(), count)).into()
    );
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert!(
        summary.chunk_indexes.len() > 1,
        "a run of two seconds is more than one chunk"
    );
    assert_eq!(summary.metadata_indexes.len(), 2);
}

#[test]
fn cut_anywhere_it_reads_up_to_the_break_and_says_so() {
    let bytes = record(40);
    let whole = Recording::from_bytes(&bytes).unwrap();
    let mut longest = 0;
    for cut in (0..bytes.len())
        .step_by(97)
        .chain((0..16).map(|i| bytes.len() * i / 16))
    {
        match Recording::from_bytes(&bytes[..cut]) {
            Ok(part) => {
                assert_eq!(part.steps, whole.steps[..part.steps.len()]);
                assert!(
                    part.warnings
                        .iter()
                        .any(|w| w.contains("cut off after byte") && w.contains("could be read")),
                    "{:?}",
                    part.warnings
                );
                longest = longest.max(part.steps.len());
            }
            Err(error) => assert!(cut < 3000, "cut at {cut}: {error}"),
        }
    }
    assert_eq!(longest, 40);
}

#[test]
fn a_break_inside_a_chunk_keeps_the_complete_steps_of_it() {
    let bytes = record(15);
    // Less than a second: all steps are in one chunk.
    let part = Recording::from_bytes(&bytes[..bytes.len() / 2]).unwrap();
    assert!((3..12).contains(&part.steps.len()), "{}", part.steps.len());
}

#[test]
fn a_damaged_chunk_costs_only_its_own_steps() {
    let mut bytes = record(60);
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let second = &chunks[2];
    let place = (second.chunk_start_offset + second.chunk_length / 2) as usize;
    bytes[place] ^= 0xff;
    let recording = Recording::from_bytes(&bytes).unwrap();
    assert!(
        (30..60).contains(&recording.steps.len()),
        "{}",
        recording.steps.len()
    );
    let warning = &recording.warnings[0];
    assert!(
        warning.contains(&format!("byte {}", second.chunk_start_offset)),
        "{warning}"
    );
    assert!(
        warning.contains("between 1.050 s") || warning.contains("between 1.0"),
        "{warning}"
    );
    let [lost] = recording.lost[..] else {
        panic!("{:?}", recording.lost)
    };
    assert_eq!(lost.count as usize, 60 - recording.steps.len());
    let whole = support::recording(60).steps;
    assert_eq!(recording.steps[lost.before - 1], whole[lost.before - 1]);
    assert_eq!(
        recording.steps[lost.before],
        whole[lost.before + lost.count as usize]
    );
}

#[test]
fn damaged_channel_declarations_are_found_again_in_the_summary() {
    let mut bytes = record(10);
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    // The first chunk holds nothing but schemas and channels.
    bytes[(chunks[0].chunk_start_offset + chunks[0].chunk_length / 2) as usize] ^= 0xff;
    let recording = Recording::from_bytes(&bytes).unwrap();
    assert_eq!(recording.steps, support::recording(10).steps);
    assert_eq!(recording.warnings.len(), 1);
}

#[test]
fn no_flipped_byte_makes_the_reader_panic() {
    let bytes = record(4);
    for place in 0..bytes.len() {
        let mut broken = bytes.clone();
        broken[place] ^= 0xff;
        if let Ok(recording) = Recording::from_bytes(&broken) {
            for step in &recording.steps {
                let _ = step.observation();
            }
        }
    }
}

#[test]
fn a_damaged_picture_costs_only_itself() {
    let mut damaged = recording(5);
    damaged.steps[3].frames[0].encoded.bytes.truncate(200);
    let mut replay = Replay::new(damaged);
    let mut observation = Observation::default();
    let mut seen = Vec::new();
    while replay.observe(&mut observation).unwrap() {
        seen.push(observation.frames.len());
    }
    assert_eq!(seen, [1, 1, 1, 0, 1]);
    assert_eq!(replay.damaged_frames(), 1);
}

/// Gives the recorded commands again, except in one step.
struct Parrot {
    commands: Vec<Command>,
    next: usize,
}

impl Driver for Parrot {
    fn drive(&mut self, _observation: &Observation) -> Command {
        self.next += 1;
        self.commands[self.next - 1]
    }
}

fn replayed(mut driver: Parrot) -> Replay {
    let mut replay = Replay::new(recording(10));
    let mut observation = Observation::default();
    while replay.observe(&mut observation).unwrap() {
        let command = driver.drive(&observation);
        assert_eq!(
            replay.truth().is_some(),
            replay.recording().steps[driver.next - 1].truth.is_some()
        );
        replay.actuate(&command).unwrap();
    }
    replay
}

#[test]
fn replay_proves_equality_or_says_where_it_ends() {
    let commands: Vec<_> = recording(10).steps.iter().map(|step| step.command).collect();
    let same = replayed(Parrot {
        commands: commands.clone(),
        next: 0,
    });
    assert_eq!((same.compared(), same.differences()), (10, 0));
    let mut other = commands;
    other[6] = Command::STOP;
    other[8] = Command::STOP;
    let different = replayed(Parrot {
        commands: other,
        next: 0,
    });
    assert_eq!((different.compared(), different.differences()), (10, 2));
    assert_eq!(different.first_difference().unwrap().step, 6);
}

#[test]
fn recording_a_replay_gives_the_recording() {
    let original = recording(10);
    let mut replay = Replay::new(original.clone());
    let mut writer = RecordingWriter::new(Cursor::new(Vec::new()), &original.header).unwrap();
    let mut observation = Observation::default();
    while replay.observe(&mut observation).unwrap() {
        let step = &original.steps[writer.steps() as usize];
        writer
            .step(&observation, &step.command, replay.truth(), &step.explanation)
            .unwrap();
    }
    let again = writer
        .finish(original.summary.as_ref().unwrap())
        .unwrap()
        .into_inner();
    assert_eq!(again, record(10));
}

#[test]
fn a_dropped_writer_leaves_a_whole_file_without_a_summary() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut writer = RecordingWriter::create(&path, &header(car())).unwrap();
    let it = moment(1);
    writer
        .step(&it.observation, &it.command, it.truth.as_ref(), &it.explanation)
        .unwrap();
    drop(writer);
    let recording = Recording::read(&path).unwrap();
    assert_eq!((recording.steps.len(), recording.summary), (1, None));
    assert!(
        recording.warnings[0].contains("no summary"),
        "{:?}",
        recording.warnings
    );
}

/// A disk with room for so many bytes.
struct FullDisk {
    inner: Cursor<Vec<u8>>,
    room: usize,
}

impl Write for FullDisk {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let room = self.room.saturating_sub(self.inner.get_ref().len());
        if room == 0 {
            return Err(Error::new(ErrorKind::StorageFull, "no space left on device"));
        }
        self.inner.write(&bytes[..bytes.len().min(room)])
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Seek for FullDisk {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.inner.seek(to)
    }
}

#[test]
fn a_full_disk_ends_the_recording_with_its_words_and_keeps_what_is_there() {
    use std::{cell::RefCell, rc::Rc};
    /// Keeps the bytes when the writer is gone.
    struct Shared(Rc<RefCell<FullDisk>>);
    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.borrow_mut().write(bytes)
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    impl Seek for Shared {
        fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
            self.0.borrow_mut().seek(to)
        }
    }
    let whole = recording(100);
    let disk = Rc::new(RefCell::new(FullDisk {
        inner: Cursor::default(),
        room: 60_000,
    }));
    let mut writer = RecordingWriter::new(Shared(disk.clone()), &header(car())).unwrap();
    let mut failure = None;
    for step in &whole.steps {
        if let Err(error) = writer.recorded_step(step) {
            failure = Some(error);
            break;
        }
    }
    let text = failure.expect("the disk is full").to_string();
    assert!(
        text.contains("recording: cannot be written: no space left"),
        "{text}"
    );
    let promised: usize = text
        .split_once("the first ")
        .and_then(|(_, rest)| rest.split_once(' '))
        .expect("says how much was saved")
        .0
        .parse()
        .unwrap();
    assert!(
        writer.recorded_step(&whole.steps[0]).is_err(),
        "it does not pretend to go on"
    );
    drop(writer);
    let disk = disk.borrow();
    let part = Recording::from_bytes(disk.inner.get_ref()).unwrap();
    assert!(
        part.steps.len() >= promised && promised > 20,
        "{} {promised}",
        part.steps.len()
    );
    assert_eq!(part.steps, whole.steps[..part.steps.len()]);
}

#[test]
fn a_file_that_cannot_be_created_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("no/such/run.mcap");
    let error = RecordingWriter::create(&path, &header(car())).err().unwrap();
    assert!(error.to_string().contains("no/such/run.mcap"), "{error}");
}

#[test]
fn commands_that_are_no_numbers_are_refused_by_step() {
    let mut writer = RecordingWriter::new(Cursor::new(Vec::new()), &header(car())).unwrap();
    let bad = Command::curvature(f64::NAN, 0.1);
    let error = writer
        .step(&Observation::default(), &bad, None, &Default::default())
        .unwrap_err();
    assert!(
        matches!(error, DataError::Unrecordable { step: 0, .. }),
        "{error}"
    );
}

#[test]
fn every_nth_picture_on_request() {
    let options = RecordingOptions { frames_every: 4 };
    let mut writer = RecordingWriter::with_options(Cursor::new(Vec::new()), &header(car()), options).unwrap();
    for number in 0..10 {
        let it = moment(number);
        writer
            .step(&it.observation, &it.command, None, &it.explanation)
            .unwrap();
    }
    let bytes = writer.finish_without_summary().unwrap().into_inner();
    let recording = Recording::from_bytes(&bytes).unwrap();
    let frames: Vec<_> = recording.steps.iter().map(|step| step.frames.len()).collect();
    assert_eq!(frames, [1, 0, 0, 0, 1, 0, 0, 0, 1, 0]);
}

#[test]
fn other_programs_files_are_named_for_what_they_are() {
    let check = |bytes: &[u8], words: &str| {
        let error = Recording::from_bytes(bytes).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    check(b"", "does not begin as MCAP does");
    check(b"\x89PNG\r\n\x1a\n", "does not begin as MCAP does");
    let mut other = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    other
        .add_channel(0, "/lidar", "cdr", &Default::default())
        .unwrap();
    other.finish().unwrap();
    check(
        &other.into_inner().into_inner(),
        "an MCAP file of another program, with /lidar",
    );
}

#[test]
fn foreign_channels_in_our_files_are_ignored_with_a_warning() {
    let bytes = record(3);
    let mut copy = mcap::WriteOptions::new()
        .compression(None)
        .create(Cursor::new(Vec::new()))
        .unwrap();
    let header = mcap::read::LinearReader::new(&bytes)
        .unwrap()
        .find_map(|record| match record.unwrap() {
            mcap::records::Record::Metadata(metadata) => Some(metadata),
            _ => None,
        })
        .unwrap();
    copy.write_metadata(&header).unwrap();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        copy.write(&message.unwrap()).unwrap();
    }
    let id = copy.add_channel(0, "/lidar", "cdr", &Default::default()).unwrap();
    let head = mcap::records::MessageHeader {
        channel_id: id,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    copy.write_to_known_channel(&head, b"x").unwrap();
    copy.finish().unwrap();
    let recording = Recording::from_bytes(&copy.into_inner().into_inner()).unwrap();
    assert_eq!(recording.steps, support::recording(3).steps);
    assert!(
        recording.warnings[0].contains("/lidar"),
        "{:?}",
        recording.warnings
    );
}

#[test]
fn a_newer_format_is_refused_with_the_version_to_use() {
    let mut bytes = record(1);
    // The metadata of this file is not covered by a checksum that the reader needs.
    let place = bytes.windows(12).position(|w| w == b"senda_format").unwrap() + 12 + 4;
    assert_eq!(bytes[place], b'1');
    bytes[place] = b'7';
    let error = Recording::from_bytes(&bytes).unwrap_err().to_string();
    assert!(
        error.contains("expected at most 1, but found 7") && error.contains("senda 0.1.0"),
        "{error}"
    );
}

/// Written by senda 0.1.0 and never again: what a newer program must still read.
#[test]
fn a_file_of_version_1_still_opens() {
    let old = Recording::from_bytes(include_bytes!("data/recording_v1.mcap")).unwrap();
    let now = recording(4);
    assert_eq!(old.warnings, Vec::<String>::new());
    assert_eq!((&old.header, &old.summary), (&now.header, &now.summary));
    assert_eq!(old.steps.len(), 4);
    for (old, now) in old.steps.iter().zip(&now.steps) {
        assert_eq!(
            (old.stamp, old.command, old.truth),
            (now.stamp, now.command, now.truth)
        );
        assert_eq!(
            (old.speed_mps, old.wheels, old.battery_v),
            (now.speed_mps, now.wheels, now.battery_v)
        );
        assert_eq!(old.explanation, now.explanation);
        // Pictures are not compared byte by byte with today's encoder.
        let (observation, damaged) = old.observation();
        assert_eq!((damaged, observation.frames[0].image.width()), (0, 16));
    }
}

/// Size and checksum of a run without pictures, the same on every processor. Changes when the format does: then it needs
/// a new `senda_format` and a new old file.
#[test]
fn the_bytes_are_pinned() {
    let mut writer = RecordingWriter::new(Cursor::new(Vec::new()), &header(car())).unwrap();
    for number in 0..40 {
        let mut it = moment(number);
        it.observation.frames.clear();
        writer
            .step(&it.observation, &it.command, it.truth.as_ref(), &it.explanation)
            .unwrap();
    }
    let summary = serde_json::json!({"completed": true});
    let bytes = writer.finish(&summary).unwrap().into_inner();
    assert_eq!((bytes.len(), crc32fast::hash(&bytes)), (35_224, 3_854_247_322));
}
