//! Files of a foreign data set, wherever they lie: a folder, or a `.tar`, `.tar.gz` or `.tgz` of one.

use crate::DataError;
use crate::warnings::Warnings;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader, Read};
use std::path::{Component, Path, PathBuf};

/// The largest file taken out of an archive (bytes): a picture has a few thousand, a catalog a few hundred thousand.
const LARGEST_FILE: u64 = 64 << 20;
/// The most taken out of one archive (bytes): it is held in memory, and a few kB of archive can unpack to anything.
const LARGEST_TOTAL: u64 = 4 << 30;

/// A set of files with relative names, `/` between parts.
#[derive(Debug)]
pub(crate) enum Store {
    Folder(PathBuf),
    Archive {
        path: PathBuf,
        files: BTreeMap<String, Vec<u8>>,
    },
}

impl Store {
    /// Opens a folder, or reads an archive into memory. Nothing is ever unpacked onto the disk.
    pub(crate) fn open(path: &Path, expected: &str, warnings: &mut Warnings) -> Result<Self, DataError> {
        let about = std::fs::metadata(path).map_err(|e| DataError::read(path, e))?;
        if about.is_dir() {
            return Ok(Self::Folder(path.to_owned()));
        }
        let file = std::fs::File::open(path).map_err(|e| DataError::read(path, e))?;
        let mut file = BufReader::with_capacity(1 << 16, file);
        let head = file.fill_buf().map_err(|e| DataError::read(path, e))?;
        let is_gzip = head.starts_with(&[0x1f, 0x8b]);
        let is_tar = head.get(257..262) == Some(b"ustar");
        let files = if is_gzip {
            unpack(flate2::bufread::MultiGzDecoder::new(file), warnings)
        } else if is_tar {
            unpack(file, warnings)
        } else {
            return Err(DataError::NotThat {
                path: path.to_owned(),
                expected: expected.to_owned(),
                found: if head.is_empty() {
                    "an empty file".into()
                } else {
                    "a file that is no archive".into()
                },
                advice: "give its folder, or a .tar.gz of it".into(),
            });
        };
        Ok(Self::Archive {
            path: path.to_owned(),
            files,
        })
    }

    /// Where it lies.
    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Folder(path) | Self::Archive { path, .. } => path,
        }
    }

    /// Its own name, without the way to it.
    pub(crate) fn name(&self) -> String {
        let name = self.path().file_name().unwrap_or(self.path().as_os_str());
        name.to_string_lossy().into_owned()
    }

    /// The first folder that holds a file that `wanted` accepts; a warning names the others. `what`: a plural.
    pub(crate) fn find(
        &self,
        what: &str,
        wanted: &dyn Fn(&str) -> bool,
        warnings: &mut Warnings,
    ) -> Result<Option<String>, DataError> {
        let mut folders = self.folders_with(wanted)?;
        if folders.len() > 1 {
            warnings.add("several sets", || {
                format!(
                    "there are {} {what} ({}): the first is read; give the folder of another",
                    folders.len(),
                    folders.join(", ")
                )
            });
        }
        folders.truncate(1);
        Ok(folders.pop())
    }

    /// How a file is named in messages.
    pub(crate) fn show(&self, name: &str) -> String {
        match self {
            Self::Folder(path) => path.join(name).display().to_string(),
            Self::Archive { path, .. } => format!("{}: {name}", path.display()),
        }
    }

    /// The bytes of a file; `None` when there is none of that name.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, DataError> {
        match self {
            Self::Archive { files, .. } => Ok(files.get(name).cloned()),
            Self::Folder(_) if !is_plain(name) => Ok(None),
            Self::Folder(path) => match std::fs::read(path.join(name)) {
                Ok(bytes) => Ok(Some(bytes)),
                Err(e)
                    if matches!(
                        e.kind(),
                        std::io::ErrorKind::NotFound | std::io::ErrorKind::NotADirectory
                    ) =>
                {
                    Ok(None)
                }
                Err(e) => Err(DataError::read(&path.join(name), e)),
            },
        }
    }

    /// As [`Store::read`], giving up the archive's copy: pictures need not be in memory twice.
    pub(crate) fn take(&mut self, name: &str) -> Result<Option<Vec<u8>>, DataError> {
        match self {
            Self::Archive { files, .. } => Ok(files.remove(name)),
            Self::Folder(_) => self.read(name),
        }
    }

    /// Names of the files in a folder of the set (`""`: its top), sorted. macOS's `._*` shadows are left out.
    pub(crate) fn files_in(&self, folder: &str) -> Result<Vec<String>, DataError> {
        let mut names = Vec::new();
        match self {
            Self::Archive { files, .. } => {
                for name in files.keys() {
                    let (parent, file) = name.rsplit_once('/').unwrap_or(("", name));
                    if parent == folder {
                        names.push(file.to_owned());
                    }
                }
            }
            Self::Folder(path) => {
                for (name, is_folder) in entries(&path.join(folder))? {
                    if !is_folder {
                        names.push(name);
                    }
                }
            }
        }
        names.retain(|name| !name.starts_with("._"));
        names.sort();
        Ok(names)
    }

    /// Folders that hold a file that `wanted` accepts: the top, or up to two levels below it.
    pub(crate) fn folders_with(&self, wanted: &dyn Fn(&str) -> bool) -> Result<Vec<String>, DataError> {
        let mut found = BTreeSet::new();
        match self {
            Self::Archive { files, .. } => {
                for name in files.keys() {
                    let (parent, file) = name.rsplit_once('/').unwrap_or(("", name));
                    if !file.starts_with("._") && wanted(file) {
                        found.insert(parent.to_owned());
                    }
                }
            }
            Self::Folder(path) => search(path, "", 2, wanted, &mut found)?,
        }
        Ok(found.into_iter().collect())
    }
}

/// `name` inside `folder`, which may be the top (`""`).
pub(crate) fn join(folder: &str, name: &str) -> String {
    if folder.is_empty() {
        name.to_owned()
    } else {
        format!("{folder}/{name}")
    }
}

/// Whether a name that a file gives stays inside the folder: no `..`, no root, no drive.
fn is_plain(name: &str) -> bool {
    !name.is_empty()
        && Path::new(name)
            .components()
            .all(|part| matches!(part, Component::Normal(_)))
}

/// The last part of a path written on any system; `None` when there is none that names a file.
pub(crate) fn file_name(path: &str) -> Option<&str> {
    let name = path.rsplit(['/', '\\']).next()?.trim();
    (!name.is_empty() && name != "." && name != "..").then_some(name)
}

fn entries(folder: &Path) -> Result<Vec<(String, bool)>, DataError> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| DataError::read(folder, e))? {
        let entry = entry.map_err(|e| DataError::read(folder, e))?;
        // Names that are not Unicode cannot be named by any of the formats.
        if let Ok(name) = entry.file_name().into_string() {
            all.push((name, entry.path().is_dir()));
        }
    }
    Ok(all)
}

fn search(
    base: &Path,
    relative: &str,
    levels: usize,
    wanted: &dyn Fn(&str) -> bool,
    found: &mut BTreeSet<String>,
) -> Result<(), DataError> {
    let mut folders = Vec::new();
    for (name, is_folder) in entries(&base.join(relative))? {
        if is_folder {
            folders.push(name);
        } else if !name.starts_with("._") && wanted(&name) {
            found.insert(relative.to_owned());
        }
    }
    // A data set's own folders (its images) can hold a hundred thousand files: no need to look inside.
    if levels > 0 && !found.contains(relative) {
        for name in folders {
            search(base, &join(relative, &name), levels - 1, wanted, found)?;
        }
    }
    Ok(())
}

fn unpack(from: impl Read, warnings: &mut Warnings) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut archive = tar::Archive::new(from.take(LARGEST_TOTAL));
    let entries = match archive.entries() {
        Ok(entries) => entries,
        Err(reason) => {
            warnings.add("archive breaks", || {
                format!("the archive cannot be read: {reason}")
            });
            return files;
        }
    };
    for entry in entries {
        let mut entry = match entry {
            Ok(entry) => entry,
            Err(reason) => {
                let count = files.len();
                warnings.add("archive breaks", || {
                    format!("the archive is damaged or cut off after {count} files: {reason}")
                });
                break;
            }
        };
        if !entry.header().entry_type().is_file() {
            continue;
        }
        let name = String::from_utf8_lossy(&entry.path_bytes()).into_owned();
        let name = name.strip_prefix("./").unwrap_or(&name);
        if !is_plain(name) || entry.size() > LARGEST_FILE {
            warnings.add("archive entries skipped", || {
                format!(
                    "archive: {name:?} ({} bytes): not a plain name, or too large: skipped",
                    entry.size()
                )
            });
            continue;
        }
        let mut bytes = Vec::new();
        match entry.read_to_end(&mut bytes) {
            Ok(_) => {
                files.insert(name.to_owned(), bytes);
            }
            Err(reason) => {
                let count = files.len();
                warnings.add("archive breaks", || {
                    format!("the archive is damaged or cut off in {name}, after {count} files: {reason}")
                });
                break;
            }
        }
    }
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_leave_the_folder_are_refused() {
        for name in ["", "/etc/passwd", "../x", "a/../../x", "..", "./../x"] {
            assert!(!is_plain(name), "{name}");
        }
        assert!(is_plain("images/0.jpg"));
    }

    #[test]
    fn file_names_of_any_system() {
        assert_eq!(file_name(r"C:\Users\me\IMG\center_1.jpg"), Some("center_1.jpg"));
        assert_eq!(file_name(" IMG/left_1.jpg"), Some("left_1.jpg"));
        assert_eq!(file_name("../.."), None);
        assert_eq!(file_name("images/"), None);
    }

    #[test]
    fn an_archive_cannot_write_or_name_anything_outside() {
        let mut builder = tar::Builder::new(Vec::new());
        let mut header = tar::Header::new_gnu();
        header.set_size(1);
        header.set_entry_type(tar::EntryType::Regular);
        // Written past the crate's own check, as an attacker would.
        header.as_old_mut().name[..9].copy_from_slice(b"../../x\0\0");
        header.set_cksum();
        builder.append(&header, &b"x"[..]).unwrap();
        let mut warnings = Warnings::default();
        let files = unpack(&builder.into_inner().unwrap()[..], &mut warnings);
        assert!(files.is_empty());
        assert_eq!(warnings.finish().len(), 1);
    }
}
