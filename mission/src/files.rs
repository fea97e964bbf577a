//! Files that are written whole or not at all, under a temporary name first.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::{FileContext, MissionError};

/// Suffix of unfinished files.
pub const UNFINISHED: &str = ".new";

/// Characters of a file's name that are used for its unfinished file, whose name may have at most 255 bytes.
const NAME_CHARACTERS: usize = 40;

/// Reads a regular file. Another process may have put a pipe or a device in its place, which would hold the reader or
/// never end.
///
/// # Errors
/// If it is none, or cannot be read.
pub fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    if fs::metadata(path)?.is_file() { fs::read(path) } else { Err(io::Error::other("it is no regular file")) }
}

/// Writes a file, whole or not at all.
///
/// # Errors
/// If it cannot be written.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), MissionError> {
    write_all(&[(path.to_owned(), bytes)])
}

/// Writes files, all or none as far as the disk allows: each is complete before the first gets its name.
///
/// # Errors
/// If one cannot be written.
pub fn write_all(files: &[(PathBuf, &[u8])]) -> Result<(), MissionError> {
    let begun = files.iter().map(|(path, bytes)| Ok((path, write_unfinished(path, bytes).at(path)?)));
    for (path, file) in begun.collect::<Result<Vec<_>, MissionError>>()? {
        file.persist(path).map_err(io::Error::from).at(path)?;
    }
    Ok(())
}

/// Writes the content of `path` to a new temporary file beside it, `.NAME.*.new`. [`NamedTempFile::persist`] renames it
/// to `path`; dropping removes it.
///
/// # Errors
/// If it cannot be written.
pub fn write_unfinished(path: &Path, bytes: &[u8]) -> io::Result<NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let prefix = format!(".{}.", name.chars().take(NAME_CHARACTERS).collect::<String>());
    let create = |path: &Path| File::options().write(true).create_new(true).open(path); // with the usual permissions
    let mut file = tempfile::Builder::new().prefix(&prefix).suffix(UNFINISHED).make_in(folder, create)?;
    file.write_all(bytes)?;
    Ok(file)
}

/// Whether this is the name of an unfinished file, such as a killed process leaves: `.NAME.new` or `.NAME.*.new`, where
/// `is_own` holds for NAME.
pub fn is_unfinished(name: &str, is_own: impl Fn(&str) -> bool) -> bool {
    let name = name.strip_prefix('.').and_then(|name| name.strip_suffix(UNFINISHED));
    name.is_some_and(|name| is_own(name) || name.rsplit_once('.').is_some_and(|(name, _)| is_own(name)))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    use super::*;

    fn names(folder: &Path) -> Vec<std::ffi::OsString> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect()
    }

    #[test]
    fn a_planted_link_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [path, victim] = ["summary.json", "victim"].map(|name| folder.path().join(name));
        fs::write(&victim, "mine").unwrap();
        symlink(&victim, folder.path().join(".summary.json.new")).unwrap();
        write_whole(&path, b"new").unwrap();
        assert_eq!([&victim, &path].map(|path| fs::read_to_string(path).unwrap()), ["mine", "new"]);
        assert!(fs::symlink_metadata(&path).unwrap().is_file());
        assert_eq!(names(folder.path()).len(), 3);
    }

    #[test]
    fn a_failed_write_leaves_no_file_and_a_written_file_has_the_usual_permissions() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("taken")).unwrap();
        assert!(write_whole(&folder.path().join("taken"), b"new").is_err());
        assert_eq!(names(folder.path()), ["taken"]);
        let long = folder.path().join("ä".repeat(100));
        write_whole(&long, b"new").unwrap();
        let plain = folder.path().join("plain");
        fs::write(&plain, "").unwrap();
        let [ours, usual] = [long, plain].map(|path| fs::metadata(path).unwrap().permissions().mode());
        assert_eq!(ours, usual);
    }

    #[test]
    fn an_unfinished_file_is_recognised_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let begun = write_unfinished(&folder.path().join("sweep.json"), b"{").unwrap();
        let is_ours = |name: &str| is_unfinished(name, |name| name == "sweep.json");
        assert!(is_ours(begun.path().file_name().unwrap().to_str().unwrap()) && is_ours(".sweep.json.new"));
        for other in ["sweep.json", "sweep.json.a1.new", ".a.new", ".notes.md.a1.new", ".sweep.json.a1.b2.new", ".new"]
        {
            assert!(!is_ours(other), "{other}");
        }
    }
}
