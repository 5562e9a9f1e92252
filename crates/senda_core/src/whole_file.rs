//! Files that are there whole or not at all: no full disk, kill or power cut leaves half a one over a good one.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes a file beside the old one (`<name>.partial`), sees it onto the disk, and only then puts it in its place. After an
/// error the old file is as it was, and nothing of the new one is left. A link stays one: what it leads to is replaced. What is
/// no file (a device, a pipe) is written to as it stands, for there is nothing to replace.
pub fn replace(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    put(path, write, |_| Ok(()))
}

/// As [`replace`], but the old file stays as `<name>.earlier`, where the answer says. It keeps its own name until the new one is
/// whole.
pub fn replace_keeping_earlier(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<Option<PathBuf>> {
    let mut earlier = None;
    put(path, write, |target| {
        if target.is_file() {
            let aside = with_end(target, ".earlier");
            if let Err(error) = fs::remove_file(&aside)
                && error.kind() != io::ErrorKind::NotFound
            {
                return Err(error);
            }
            // Not every file system has hard links.
            fs::hard_link(target, &aside).or_else(|_| fs::copy(target, &aside).map(drop))?;
            earlier = Some(aside);
        }
        Ok(())
    })?;
    Ok(earlier)
}

/// Whether a file could be put here, found out before the work that it is to hold. Nothing is left behind.
pub fn check_place(path: &Path) -> io::Result<()> {
    if is_stream(path) {
        return Ok(());
    }
    let target = target_of(path)?;
    if target.is_dir() {
        return Err(io::Error::other("expected a file, but found a folder"));
    }
    let partial = with_end(&target, ".partial");
    File::create(&partial)?;
    fs::remove_file(&partial)
}

/// `before_rename` is called with the place of the old file when the new one is whole.
fn put(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    before_rename: impl FnOnce(&Path) -> io::Result<()>,
) -> io::Result<()> {
    if is_stream(path) {
        let mut stream = BufWriter::new(OpenOptions::new().write(true).open(path)?);
        write(&mut stream)?;
        return stream.flush();
    }
    let target = target_of(path)?;
    let partial = with_end(&target, ".partial");
    let whole = || {
        let mut file = BufWriter::new(File::create(&partial)?);
        write(&mut file)?;
        file.into_inner()?.sync_all()?;
        before_rename(&target)?;
        fs::rename(&partial, &target)
    };
    whole().inspect_err(|_| {
        // Of no use; failing to remove it changes nothing.
        let _ = fs::remove_file(&partial);
    })
}

/// Whether something lies here that is neither a file nor a folder.
fn is_stream(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Where links lead, whether or not something lies there already.
fn target_of(path: &Path) -> io::Result<PathBuf> {
    // As many as Linux follows.
    const LINKS: usize = 40;
    let mut target = path.to_owned();
    for _ in 0..LINKS {
        match fs::read_link(&target) {
            // Relative links count from the folder that they lie in; absolute ones replace it.
            Ok(next) => target = target.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(target),
        }
    }
    Err(io::Error::other(
        "expected a link that leads somewhere, but it leads in a circle",
    ))
}

fn with_end(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.senda");
        replace(&path, |file| file.write_all(b"old")).unwrap();
        let failed = replace(&path, |file| {
            file.write_all(&[0; 100_000])?;
            Err(io::Error::other("the disk is full"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "the disk is full");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        replace(&path, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn where_nothing_can_be_written_the_systems_words_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no/such/folder/file");
        assert!(replace(&path, |_| Ok(())).is_err());
    }

    #[test]
    fn the_earlier_file_keeps_its_name_until_the_new_one_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.senda");
        let put =
            |bytes: &'static [u8]| replace_keeping_earlier(&path, |file| file.write_all(bytes)).unwrap();
        assert_eq!(put(b"first"), None);
        let aside = folder.path().join("model.senda.earlier");
        assert_eq!(put(b"second").as_ref(), Some(&aside));
        put(b"third");
        assert_eq!(
            (fs::read(&path).unwrap(), fs::read(&aside).unwrap()),
            (b"third".to_vec(), b"second".to_vec())
        );
        // A full disk took the name from the model that was there.
        let failed = replace_keeping_earlier(&path, |_| Err(io::Error::other("the disk is full")));
        assert!(failed.is_err());
        assert_eq!(
            (fs::read(&path).unwrap(), fs::read(&aside).unwrap()),
            (b"third".to_vec(), b"second".to_vec())
        );
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    /// The link was replaced, and what it led to stayed old.
    #[test]
    #[cfg(unix)]
    fn a_link_stays_one_and_leads_to_the_new_file() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("far")).unwrap();
        symlink("far/next", at("link")).unwrap();
        symlink("file", at("far/next")).unwrap();
        // First where nothing lies yet.
        for text in ["old", "new"] {
            check_place(&at("link")).unwrap();
            replace(&at("link"), |file| file.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(at("far/file")).unwrap(), text);
            assert!(at("link").is_symlink() && at("far/next").is_symlink());
        }
        let earlier = replace_keeping_earlier(&at("link"), |file| file.write_all(b"newest")).unwrap();
        assert_eq!(earlier, Some(at("far/file.earlier")));
        assert_eq!(fs::read_to_string(at("link")).unwrap(), "newest");
        assert!(at("link").is_symlink());
        symlink("round", at("round")).unwrap();
        assert!(replace(&at("round"), |_| Ok(())).is_err());
    }

    /// A pipe, and so every device, was replaced by a file. The pipe is this test's own.
    #[test]
    #[cfg(unix)]
    fn what_is_no_file_is_written_to_and_stays_what_it_is() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        let from = pipe.clone();
        let reader = std::thread::Builder::new()
            .name("reader".into())
            .spawn(move || fs::read(from).unwrap())
            .unwrap();
        check_place(&pipe).unwrap();
        let earlier = replace_keeping_earlier(&pipe, |file| file.write_all(b"through the pipe")).unwrap();
        assert_eq!(earlier, None);
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(reader.join().unwrap(), b"through the pipe");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn places_where_nothing_can_be_put_are_told_beforehand() {
        let folder = tempfile::tempdir().unwrap();
        check_place(&folder.path().join("model.senda")).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(check_place(folder.path()).is_err());
        assert!(check_place(&folder.path().join("no/such/folder/file")).is_err());
    }
}
