//! Files that a process writes while it runs, and how it notices that another process has changed one. The system does
//! not report that: writes to a file that was deleted or replaced succeed, and are lost.

use std::fmt;
use std::fs::{self, File, Metadata};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{FileExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::Xxh3;

/// What another process has done to a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FileChange {
    /// The path leads to nothing.
    #[error("it was deleted or moved during the run")]
    Missing,
    /// The path leads to something else.
    #[error("it was replaced during the run")]
    Replaced,
    /// It has another length.
    #[error("it was truncated or extended during the run: {found} bytes: expected {written}")]
    Length {
        /// Its length [byte].
        found: u64,
        /// Length of what was written [byte].
        written: u64,
    },
    /// It has other bytes.
    #[error("it was overwritten during the run")]
    Content,
}

impl FileChange {
    /// Whether this is the error of such a change.
    #[must_use]
    pub fn is_cause_of(error: &io::Error) -> bool {
        error.get_ref().is_some_and(|cause| cause.is::<Self>())
    }
}

impl From<FileChange> for io::Error {
    fn from(change: FileChange) -> Self {
        Self::other(change)
    }
}

/// How much of a file is compared with what was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// Its identity and its length.
    Quick,
    /// Also all its bytes, which are read once more.
    Full,
}

/// What the file of a path must contain.
pub struct ExpectedFile {
    path: PathBuf,
    length: u64,
    bytes: Xxh3,
}

impl ExpectedFile {
    /// An empty file.
    fn empty(path: &Path) -> Self {
        Self { path: path.to_owned(), length: 0, bytes: Xxh3::new() }
    }

    /// The file as it is.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(path: &Path) -> io::Result<Self> {
        let mut expected = Self::empty(path);
        let mut file = File::open(path)?;
        let mut buffer = vec![0; 1 << 16];
        loop {
            match file.read(&mut buffer)? {
                0 => return Ok(expected),
                count => expected.add(&buffer[..count]),
            }
        }
    }

    /// The path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Compares the file with what it must contain. A copy of it is accepted.
    ///
    /// # Errors
    /// [`FileChange`], or if it cannot be read.
    pub fn compare(&self, extent: Extent) -> io::Result<()> {
        let found = self.find()?.len();
        if found != self.length {
            return Err(FileChange::Length { found, written: self.length }.into());
        }
        if extent == Extent::Full && Self::read(&self.path)?.bytes.digest() != self.bytes.digest() {
            return Err(FileChange::Content.into());
        }
        Ok(())
    }

    fn add(&mut self, bytes: &[u8]) {
        self.length += bytes.len() as u64;
        self.bytes.update(bytes);
    }

    /// The regular file that the path leads to.
    fn find(&self) -> io::Result<Metadata> {
        use io::ErrorKind::{NotADirectory, NotFound};
        match fs::symlink_metadata(&self.path) {
            Ok(found) if found.is_file() => Ok(found),
            Ok(_) => Err(FileChange::Replaced.into()),
            Err(error) if matches!(error.kind(), NotFound | NotADirectory) => Err(FileChange::Missing.into()),
            Err(error) => Err(error),
        }
    }
}

impl fmt::Debug for ExpectedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ExpectedFile").field("path", &self.path).field("length", &self.length).finish_non_exhaustive()
    }
}

/// An open file that only this process writes.
#[derive(Debug)]
pub struct WrittenFile {
    file: File,
    expected: ExpectedFile,
}

impl WrittenFile {
    /// The open `file` of `path`, of which nothing is known yet. If it was opened to append, which must not be for
    /// [`WrittenFile::overwrite`], its length tells for ever that another process has removed or added bytes.
    #[must_use]
    pub fn new(path: &Path, file: File) -> Self {
        Self { file, expected: ExpectedFile::empty(path) }
    }

    /// The path.
    pub fn path(&self) -> &Path {
        &self.expected.path
    }

    /// Length of what is known or was written [byte].
    pub fn length(&self) -> u64 {
        self.expected.length
    }

    /// Adds bytes that an earlier process has written after those known so far.
    pub fn add_known(&mut self, bytes: &[u8]) {
        self.expected.add(bytes);
    }

    /// Truncates the file after what is known.
    ///
    /// # Errors
    /// The system's.
    pub fn cut(&self) -> io::Result<()> {
        self.file.set_len(self.expected.length)
    }

    /// Appends bytes, all or none.
    ///
    /// # Errors
    /// The system's.
    pub fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        if let Err(error) = self.file.write_all(bytes) {
            let _ = self.cut(); // whoever resumes the run cuts an incomplete end, too
            return Err(error);
        }
        self.expected.add(bytes);
        Ok(())
    }

    /// Replaces the whole content by as many or more bytes.
    ///
    /// # Errors
    /// The system's.
    pub fn overwrite(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all_at(bytes, 0)?;
        self.expected.length = 0;
        self.expected.bytes.reset();
        self.expected.add(bytes);
        Ok(())
    }

    /// Compares what the path leads to with the open file and with what was written. A pipe or a device has nothing to
    /// compare.
    ///
    /// # Errors
    /// [`FileChange`], or if it cannot be read.
    pub fn compare(&self, extent: Extent) -> io::Result<()> {
        let written = self.file.metadata()?;
        if !written.is_file() {
            return Ok(());
        }
        let identity = |file: &Metadata| (file.dev(), file.ino());
        if identity(&self.expected.find()?) != identity(&written) {
            return Err(FileChange::Replaced.into());
        }
        self.expected.compare(extent)
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    /// What the quick and the full comparison of a file find after `change`, and two more bytes written.
    fn found(change: impl Fn(&Path)) -> [Option<FileChange>; 2] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let mut file = WrittenFile::new(&path, File::options().create(true).append(true).open(&path).unwrap());
        let bytes: Vec<u8> = (0..100_000u32).flat_map(u32::to_le_bytes).collect();
        bytes.chunks(999).for_each(|bytes| file.append(bytes).unwrap());
        file.compare(Extent::Full).unwrap();
        change(&path);
        file.append(b"ab").unwrap();
        [Extent::Quick, Extent::Full].map(|extent| {
            let error = file.compare(extent).err()?;
            assert!(FileChange::is_cause_of(&error), "{error}");
            error.get_ref()?.downcast_ref().copied()
        })
    }

    #[test]
    fn any_external_change_is_detected_during_writing() {
        let length = |found| Some(FileChange::Length { found, written: 400_002 });
        let copy = |path: &Path| {
            fs::copy(path, path.with_extension("copy")).unwrap();
            fs::rename(path.with_extension("copy"), path).unwrap();
        };
        assert_eq!(found(|_| {}), [None; 2]);
        assert_eq!(found(|path| fs::remove_file(path).unwrap()), [Some(FileChange::Missing); 2]);
        assert_eq!(found(|path| fs::remove_dir_all(path.parent().unwrap()).unwrap()), [Some(FileChange::Missing); 2]);
        assert_eq!(found(copy), [Some(FileChange::Replaced); 2]);
        let link = |path: &Path| {
            fs::rename(path, path.with_extension("moved")).unwrap();
            symlink(path.with_extension("moved"), path).unwrap();
        };
        assert_eq!(found(link), [Some(FileChange::Replaced); 2]);
        let set_length = |length: u64| move |path: &Path| File::options().write(true).open(path)?.set_len(length);
        assert_eq!(found(|path| set_length(0)(path).unwrap()), [length(2); 2]);
        assert_eq!(found(|path| set_length(399_990)(path).unwrap()), [length(399_992); 2]);
        assert_eq!(found(|path| set_length(500_000)(path).unwrap()), [length(500_002); 2]);
        for at in [0, 65_536, 399_999] {
            let flip = |path: &Path| File::options().write(true).open(path).unwrap().write_all_at(b"\xff", at).unwrap();
            assert_eq!(found(flip), [None, Some(FileChange::Content)], "byte {at}");
        }
    }

    #[test]
    fn a_closed_file_may_be_replaced_by_an_identical_copy_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "ab").unwrap();
        let expected = ExpectedFile::read(&path).unwrap();
        let found = || [Extent::Quick, Extent::Full].map(|extent| expected.compare(extent).is_ok());
        fs::remove_file(&path).unwrap();
        assert_eq!(found(), [false; 2]);
        fs::write(&path, "ab").unwrap();
        assert_eq!(found(), [true; 2]);
        fs::write(&path, "ac").unwrap();
        assert_eq!(found(), [true, false]);
    }

    #[test]
    fn known_and_overwritten_bytes_are_compared() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "abc").unwrap();
        let mut file = WrittenFile::new(&path, File::options().append(true).open(&path).unwrap());
        file.add_known(b"ab");
        assert!(file.compare(Extent::Quick).is_err());
        file.cut().unwrap();
        file.append(b"d").unwrap();
        file.compare(Extent::Full).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"abd");
        let mut file = WrittenFile::new(&path, File::options().write(true).open(&path).unwrap());
        file.overwrite(b"1234").unwrap();
        file.overwrite(b"5678").unwrap();
        file.compare(Extent::Full).unwrap();
        assert_eq!((fs::read(&path).unwrap(), file.length()), (b"5678".to_vec(), 4));
    }

    #[test]
    fn a_failed_write_adds_no_expected_bytes() {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let mut file = WrittenFile::new(Path::new("/dev/full"), full);
        assert!(!FileChange::is_cause_of(&file.append(b"ab").unwrap_err()));
        assert_eq!(file.length(), 0);
    }
}
