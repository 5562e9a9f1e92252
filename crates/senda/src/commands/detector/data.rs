//! `senda detector data`: a darknet data set from the simulator.

use crate::commands::{drive::parse_size, write_file};
use crate::terminal;
use anyhow::{Context, Result, bail};
use clap::Args;
use senda_data::darknet::{DataFile, labels_to_text};
use senda_learn::detector::{CLASSES, Scenes, shots};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Folder to write into: `set.data`, `set.names`, `train.txt`, `valid.txt` and the folders `train` and `valid`.
    /// New or empty, or such a set, which is then replaced
    folder: PathBuf,
    /// Pictures to learn from
    #[arg(long, value_name = "N", default_value_t = 2000)]
    train: usize,
    /// Pictures that judge, from other warehouses
    #[arg(long, value_name = "N", default_value_t = 400)]
    valid: usize,
    /// Seed of the first warehouse to learn from
    #[arg(long, value_name = "S", default_value_t = 2_000_000)]
    first_world: u64,
    /// Seed of the first warehouse that judges
    #[arg(long, value_name = "S", default_value_t = 10_000)]
    first_valid_world: u64,
    /// Vehicle whose camera looks
    #[arg(long, value_name = "VEHICLE", default_value = "warehouse-cart")]
    vehicle: String,
    /// Image size
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "320x240")]
    image: [u32; 2],
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// One of thousands of small files: the list that names them comes last, so none needs to be seen onto the disk alone.
fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// What a set consists of; the folders hold pictures and their labels.
const FILES: [&str; 4] = ["set.data", "set.names", "train.txt", "valid.txt"];
const FOLDERS: [&str; 2] = ["train", "valid"];

/// Names in a folder, sorted; none where there is no folder.
fn names_in(folder: &Path) -> Result<Vec<String>> {
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
        names.push(entry?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

/// Refuses a folder that holds anything but a set of this command: old pictures beside new lists would mislead, and other
/// people's files are not this command's to remove.
fn check_folder(folder: &Path) -> Result<()> {
    let foreign = |folder: &Path, name: &str| {
        bail!(
            "{}: expected a folder that is new, empty or holds a set that this command made, but found {name}",
            folder.display()
        )
    };
    for name in names_in(folder)? {
        let place = folder.join(&name);
        if FOLDERS.contains(&name.as_str()) && place.is_dir() {
            for inner in names_in(&place)? {
                let ours = inner.ends_with(".jpg") || inner.ends_with(".txt");
                if !ours || !place.join(&inner).is_file() {
                    return foreign(&place, &inner);
                }
            }
        } else if !FILES.contains(&name.as_str()) || !place.is_file() {
            return foreign(folder, &name);
        }
    }
    Ok(())
}

/// Removes the set that [`check_folder`] found; the file that says that a set is whole goes first.
fn remove_set(folder: &Path) -> Result<()> {
    for name in FILES {
        let path = folder.join(name);
        if path.exists() {
            std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    for name in FOLDERS {
        let path = folder.join(name);
        if path.exists() {
            std::fs::remove_dir_all(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

pub(super) fn run(arguments: Arguments) -> Result<()> {
    let folder = &arguments.folder;
    if arguments.train + arguments.valid == 0 {
        bail!("--train, --valid: expected at least one picture, but found 0 of both");
    }
    check_folder(folder)?;
    let sets = [
        ("train", arguments.train, arguments.first_world),
        ("valid", arguments.valid, arguments.first_valid_world),
    ];
    let sets = sets.map(|(name, count, first_world)| {
        let scenes = Scenes {
            vehicle: arguments.vehicle.clone(),
            image_px: arguments.image,
            first_world,
            count,
        };
        (name, scenes)
    });
    sets[0].1.vehicle()?;
    remove_set(folder)?;
    let bar = terminal::bar("taking pictures");
    let total = arguments.train + arguments.valid;
    let mut boxes = [0usize; CLASSES.len()];
    let mut taken = 0;
    for (name, scenes) in sets {
        std::fs::create_dir_all(folder.join(name))
            .with_context(|| format!("cannot make folder {}", folder.join(name).display()))?;
        let mut list = String::new();
        shots(&scenes, &terminal::interrupted, &mut |shot| {
            let picture = format!("{name}/{}.jpg", shot.name);
            write(&folder.join(&picture), &shot.picture.bytes)?;
            let labels = labels_to_text(&shot.labels);
            write(
                &folder.join(format!("{name}/{}.txt", shot.name)),
                labels.as_bytes(),
            )?;
            list.push_str(&picture);
            list.push('\n');
            for label in &shot.labels {
                boxes[label.class] += 1;
            }
            taken += 1;
            bar.set_position((1000 * taken / total) as u64);
            Ok::<_, anyhow::Error>(())
        })?;
        if terminal::interrupted() {
            bail!(terminal::Interrupted(
                ": the data set is not whole and has no set.data; start again".to_owned()
            ));
        }
        write_file(&folder.join(format!("{name}.txt")), list.as_bytes())?;
    }
    bar.finish_and_clear();
    let data = DataFile {
        classes: CLASSES.len(),
        train: Some("train.txt".into()),
        valid: Some("valid.txt".into()),
        names: Some("set.names".into()),
        backup: Some("backup".into()),
        ..DataFile::default()
    };
    write_file(
        &folder.join("set.names"),
        format!("{}\n", CLASSES.join("\n")).as_bytes(),
    )?;
    // Last: whoever finds it finds the rest.
    let file = folder.join("set.data");
    write_file(&file, data.to_text().as_bytes())?;
    if arguments.json {
        let value = serde_json::json!({
            "data": file,
            "train": arguments.train,
            "valid": arguments.valid,
            "boxes": CLASSES.iter().zip(boxes).collect::<std::collections::BTreeMap<_, _>>(),
        });
        say!("{}", serde_json::to_string_pretty(&value)?)?;
        return Ok(());
    }
    say!(
        "{}: {} pictures to learn from, {} to judge",
        file.display(),
        arguments.train,
        arguments.valid
    )?;
    for (class, count) in CLASSES.iter().zip(boxes) {
        say!("  {class:14} {count} boxes")?;
    }
    Ok(())
}
