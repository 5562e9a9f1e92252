//! Reading a file that somebody named: what it turns out to be costs no more memory than such a file may.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// Bytes of a gibibyte: networks of other programs beyond it are refused.
pub const GIBIBYTE: u64 = 1 << 30;

/// A file's bytes, at most so many. Errors go on after the file's name: "it is a folder".
///
/// # Errors
/// What the system says, and what is no regular file or longer.
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let found = fs::metadata(path)?;
    let wrong = |reason: String| io::Error::new(io::ErrorKind::InvalidInput, reason);
    if found.is_dir() {
        return Err(wrong("it is a folder".to_owned()));
    }
    // A device has no end, and a pipe may never have one.
    if !found.is_file() {
        return Err(wrong("it is a device or a pipe and no file".to_owned()));
    }
    let mut bytes = Vec::new();
    // One byte more tells a file that is too long from one that is just not.
    let mut file = File::open(path)?.take(most.saturating_add(1));
    if found.len() <= most {
        file.read_to_end(&mut bytes)?;
    }
    if found.len() > most || bytes.len() as u64 > most {
        return Err(wrong(format!(
            "it has {:.0} MB, and at most {:.0} MB are read",
            found.len().max(bytes.len() as u64) as f64 * 1e-6,
            most as f64 * 1e-6
        )));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_up_to_their_bound() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, [7; 2_000_000]).unwrap();
        assert_eq!(read(&path, 2_000_000).unwrap().len(), 2_000_000);
        let long = read(&path, 1_000_000).unwrap_err().to_string();
        assert_eq!(long, "it has 2 MB, and at most 1 MB are read");
        let none = read(&folder.path().join("none"), 1).unwrap_err();
        assert_eq!(none.kind(), io::ErrorKind::NotFound);
        assert_eq!(read(folder.path(), 1).unwrap_err().to_string(), "it is a folder");
    }

    /// A name that leads to a device was read until the memory was full.
    #[test]
    #[cfg(unix)]
    fn devices_are_refused() {
        let message = read(Path::new("/dev/zero"), GIBIBYTE).unwrap_err().to_string();
        assert!(message.contains("device"), "{message}");
    }
}
