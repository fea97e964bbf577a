//! Folders of results: a command knows the files that it writes into its folder, locks the folder while it does, and
//! replaces earlier results. It touches no other file.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use skysink_common::file_locks::with_remedy;
use tempfile::TempDir;

use crate::error::{FileContext, MissionError};
use crate::files::{UNFINISHED, is_unfinished};

/// The unfinished folder of results that replace earlier ones.
const NEWER: &str = "results";

/// What happens to earlier results in the folder of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Earlier {
    /// They stay, and the command is refused.
    Kept,
    /// The new ones replace them.
    Replaced,
}

impl Earlier {
    /// The meaning of the option `--force`.
    #[must_use]
    pub fn by_force(force: bool) -> Self {
        if force { Self::Replaced } else { Self::Kept }
    }
}

/// Locks a file.
type LockFile = fn(&File) -> Result<(), TryLockError>;

/// The files of a kind of folder.
#[derive(Debug)]
pub struct FolderLayout {
    /// The file that a process locks before it changes anything in the folder.
    pub lock: &'static str,
    /// Whether a file of this name is a result. (Neither the lock nor unfinished files are asked about.)
    pub is_result: fn(&str) -> bool,
    /// Whether unfinished files and folders begin with this name. Those of results do.
    pub is_temporary: fn(&str) -> bool,
}

/// The names of the files in a folder.
#[derive(Debug, Default)]
pub struct FolderContent {
    /// Results.
    pub results: Vec<String>,
    /// Unfinished files and folders of killed processes.
    pub unfinished: Vec<String>,
    /// Files of others.
    pub foreign: Vec<String>,
    /// The lock file, if it exists.
    pub lock: Option<&'static str>,
}

impl FolderContent {
    /// The lock file, if it exists, and the results.
    pub fn own(&self) -> impl Iterator<Item = &str> {
        self.lock.into_iter().chain(self.results.iter().map(String::as_str))
    }

    /// Whether the folder holds neither results nor files of others.
    pub fn is_empty(&self) -> bool {
        self.results.is_empty() && self.foreign.is_empty()
    }
}

impl FolderLayout {
    /// What the folder `path` holds.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn content(&self, path: &Path) -> io::Result<FolderContent> {
        let mut content = FolderContent::default();
        for entry in fs::read_dir(path)? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            if name == self.lock {
                content.lock = Some(self.lock);
            } else if is_unfinished(&name, |name| name == NEWER || (self.is_result)(name) || (self.is_temporary)(name))
            {
                content.unfinished.push(name);
            } else if (self.is_result)(&name) {
                content.results.push(name);
            } else if !name.starts_with(".earlier-") {
                // (Such folders were left by killed replays of version 0.1.0.)
                content.foreign.push(name);
            }
        }
        Ok(content)
    }

    /// Creates the folder `path` if it does not exist, locks it like [`FolderLayout::lock`], and removes what killed
    /// processes have left. `check` refuses what it holds: before the lock file is created, and again under the lock.
    ///
    /// # Errors
    /// If the folder cannot be created or locked, or `check` refuses it.
    pub fn open<E: From<MissionError>>(
        &'static self,
        path: &Path,
        cannot_create: impl FnOnce(io::Error) -> E,
        check: impl Fn() -> Result<(), E>,
    ) -> Result<Option<OutputFolder>, E> {
        self.open_by(File::try_lock, path, cannot_create, check)
    }

    fn open_by<E: From<MissionError>>(
        &'static self,
        lock: LockFile,
        path: &Path,
        cannot_create: impl FnOnce(io::Error) -> E,
        check: impl Fn() -> Result<(), E>,
    ) -> Result<Option<OutputFolder>, E> {
        let is_new = !path.exists();
        fs::create_dir_all(path).map_err(cannot_create)?;
        check()?;
        let locked = self.lock_new(lock, path).inspect_err(|_| {
            if is_new {
                let _ = fs::remove_dir(path); // empty: the lock file is removed
            }
        });
        let Some(folder) = locked? else { return Ok(None) };
        check()?;
        folder.remove_unfinished()?;
        Ok(Some(folder))
    }

    /// Locks the folder `path` for writing, and creates the lock file if it does not exist. Returns `None` if another
    /// process has locked it.
    ///
    /// # Errors
    /// If the lock file cannot be opened, is a link, or the file system has no locks; a new lock file is then removed.
    pub fn lock(&'static self, path: &Path) -> Result<Option<OutputFolder>, MissionError> {
        self.lock_new(File::try_lock, path)
    }

    fn lock_new(&'static self, lock: LockFile, path: &Path) -> Result<Option<OutputFolder>, MissionError> {
        let mut options = File::options();
        options.read(true).append(true).create(true);
        options.custom_flags(rustix::fs::OFlags::NOFOLLOW.bits().cast_signed());
        let lock_path = path.join(self.lock);
        let is_new = fs::symlink_metadata(&lock_path).is_err();
        self.lock_by(lock, path, &options).inspect_err(|_| {
            if is_new {
                let _ = fs::remove_file(&lock_path);
            }
        })
    }

    /// Locks the folder `path` for reading, like [`FolderLayout::lock`]. The lock file must exist.
    ///
    /// # Errors
    /// If the lock file cannot be opened.
    pub fn lock_shared(&'static self, path: &Path) -> Result<Option<OutputFolder>, MissionError> {
        self.lock_by(File::try_lock_shared, path, File::options().read(true))
    }

    fn lock_by(
        &'static self,
        lock: LockFile,
        path: &Path,
        options: &OpenOptions,
    ) -> Result<Option<OutputFolder>, MissionError> {
        let lock_path = path.join(self.lock);
        let file = options.open(&lock_path).at(&lock_path)?;
        match lock(&file) {
            Ok(()) => Ok(Some(OutputFolder { layout: self, path: path.to_owned(), lock: file })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(with_remedy(error)).at(&lock_path),
        }
    }
}

/// A folder of results, locked by this process until it is dropped.
#[derive(Debug)]
pub struct OutputFolder {
    layout: &'static FolderLayout,
    path: PathBuf,
    /// The lock file.
    pub(crate) lock: File,
}

impl OutputFolder {
    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it holds now.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn content(&self) -> Result<FolderContent, MissionError> {
        self.layout.content(&self.path).at(&self.path)
    }

    /// Removes the results, and what killed processes have left.
    ///
    /// # Errors
    /// If a result cannot be removed.
    pub fn remove_results(&self) -> Result<(), MissionError> {
        for name in self.content()?.results {
            let path = self.path.join(name);
            fs::remove_file(&path).at(&path)?;
        }
        self.remove_unfinished()
    }

    /// Removes what killed processes have left.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn remove_unfinished(&self) -> Result<(), MissionError> {
        for name in self.content()?.unfinished {
            let path = self.path.join(name);
            let _ = fs::remove_file(&path).or_else(|_| fs::remove_dir_all(&path));
        }
        Ok(())
    }

    /// Where new results are written: here, or, if there are earlier ones, in an unfinished folder in this one.
    ///
    /// # Errors
    /// If that cannot be made.
    pub fn begin(&self) -> Result<NewResults<'_>, MissionError> {
        let has_earlier = !self.content()?.results.is_empty();
        let make = || tempfile::Builder::new().prefix(&format!(".{NEWER}.")).suffix(UNFINISHED).tempdir_in(&self.path);
        Ok(NewResults { folder: self, apart: has_earlier.then(make).transpose().at(&self.path)? })
    }
}

/// New results, which replace earlier ones once they are complete. Dropping them leaves the earlier ones.
#[derive(Debug)]
pub struct NewResults<'a> {
    folder: &'a OutputFolder,
    /// Their folder, if there are earlier ones.
    apart: Option<TempDir>,
}

impl NewResults<'_> {
    /// The folder to write them into.
    pub fn path(&self) -> &Path {
        self.apart.as_ref().map_or(&self.folder.path, TempDir::path)
    }

    /// Replaces the earlier results, with the file that was written last as the last one.
    ///
    /// # Errors
    /// If a file cannot be removed or moved.
    pub fn replace_earlier(self) -> Result<(), MissionError> {
        let Some(apart) = &self.apart else { return Ok(()) };
        let mut written = self.folder.layout.content(apart.path()).at(apart.path())?.results;
        let since = |name: &String| fs::metadata(apart.path().join(name)).and_then(|file| file.modified()).ok();
        written.sort_by_key(since);
        if let Some(last) = written.last() {
            let _ = fs::remove_file(self.folder.path.join(last)); // without it neither results are complete
        }
        for name in &written {
            let path = apart.path().join(name);
            fs::rename(&path, self.folder.path.join(name)).at(&path)?;
        }
        for name in self.folder.content()?.results.iter().filter(|name| !written.contains(name)) {
            let path = self.folder.path.join(name);
            fs::remove_file(&path).at(&path)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    static LAYOUT: FolderLayout =
        FolderLayout { lock: "lock", is_result: |name| name.ends_with(".csv"), is_temporary: |name| name == "film" };

    /// Opens a folder that `check` accepts.
    fn open(path: &Path, check: impl Fn() -> bool) -> Result<OutputFolder, MissionError> {
        let error = |source| MissionError::File { path: path.to_owned(), source };
        let check = || if check() { Ok(()) } else { Err(error(io::ErrorKind::InvalidInput.into())) };
        LAYOUT.open(path, error, check).map(Option::unwrap)
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<_> = entries.collect();
        names.sort();
        names
    }

    #[test]
    fn own_results_are_replaced_and_other_files_kept() {
        let place = tempfile::tempdir().unwrap();
        for name in ["a.csv", "notes.md", ".a.csv.x.new", ".notes.md.x.new"] {
            fs::write(place.path().join(name), name).unwrap();
        }
        let folder = LAYOUT.lock(place.path()).unwrap().unwrap();
        let content = folder.content().unwrap();
        assert!(content.lock.is_some() && !content.is_empty());
        assert_eq!((content.results, content.unfinished), (vec!["a.csv".to_owned()], vec![".a.csv.x.new".to_owned()]));
        folder.remove_results().unwrap();
        assert_eq!(names(place.path()), [".notes.md.x.new", "lock", "notes.md"]);
    }

    #[test]
    fn unfinished_files_are_removed_without_following_links() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("out");
        for folder in [".film.x.new", ".other.x.new", "mine"] {
            fs::create_dir_all(path.join(folder)).unwrap();
            fs::write(path.join(folder).join("a.rrd"), "half").unwrap();
        }
        symlink(path.join("mine"), path.join(".film.y.new")).unwrap();
        fs::write(path.join(".a.csv.x.new"), "half").unwrap();
        open(&path, || true).unwrap();
        assert_eq!(names(&path), [".other.x.new", "lock", "mine"]);
        assert_eq!(names(&path.join("mine")), ["a.rrd"]);
    }

    #[test]
    fn a_folder_is_checked_before_and_after_it_is_locked() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("deep/out");
        assert!(open(&path, || false).is_err());
        assert!(names(&path).is_empty());
        let arrives_late = || {
            let is_empty = LAYOUT.content(&path).unwrap().is_empty();
            fs::write(path.join("a.csv"), "of another").unwrap();
            is_empty
        };
        assert!(open(&path, arrives_late).is_err());
        assert_eq!(names(&path), ["a.csv", "lock"]);
    }

    #[test]
    fn new_results_replace_earlier_ones_when_they_are_complete() {
        let place = tempfile::tempdir().unwrap();
        let folder = open(place.path(), || true).unwrap();
        let first = folder.begin().unwrap();
        for name in ["a.csv", "b.csv"] {
            fs::write(first.path().join(name), "earlier").unwrap();
        }
        first.replace_earlier().unwrap();
        let second = folder.begin().unwrap();
        fs::write(second.path().join("a.csv"), "killed").unwrap();
        std::mem::forget(second); // as a kill does
        drop(folder);
        let folder = open(place.path(), || true).unwrap();
        assert_eq!(names(place.path()), ["a.csv", "b.csv", "lock"]);
        let third = folder.begin().unwrap();
        fs::write(third.path().join("a.csv"), "new").unwrap();
        let result = || fs::read_to_string(place.path().join("a.csv")).unwrap();
        assert_eq!(result(), "earlier");
        third.replace_earlier().unwrap();
        assert_eq!((names(place.path()), result()), (vec!["a.csv".to_owned(), "lock".to_owned()], "new".to_owned()));
    }

    #[test]
    fn without_locks_nothing_is_left_and_the_error_says_what_to_do() {
        let lock: LockFile = |_| Err(TryLockError::Error(io::Error::from_raw_os_error(38)));
        let place = tempfile::tempdir().unwrap();
        let error = |source| MissionError::File { path: place.path().to_owned(), source };
        let [new, old] = ["new", "old"].map(|name| place.path().join(name));
        fs::create_dir(&old).unwrap();
        for path in [&new, &old] {
            let refused = LAYOUT.open_by(lock, path, error, || Ok(())).unwrap_err().to_string();
            assert!(
                refused.contains("/lock: its file system has no locks (flock, os error 38): use a folder on"),
                "{refused}"
            );
        }
        assert_eq!(names(place.path()), ["old"]);
        assert!(names(&old).is_empty());
        fs::write(old.join("lock"), "kept").unwrap();
        LAYOUT.open_by(lock, &old, error, || Ok(())).unwrap_err();
        assert_eq!(names(&old), ["lock"]);
    }

    #[test]
    fn a_folder_has_one_writer_or_several_readers() {
        let place = tempfile::tempdir().unwrap();
        let writer = LAYOUT.lock(place.path()).unwrap();
        assert!(writer.is_some());
        assert!(LAYOUT.lock(place.path()).unwrap().is_none() && LAYOUT.lock_shared(place.path()).unwrap().is_none());
        drop(writer);
        let readers = [LAYOUT.lock_shared(place.path()), LAYOUT.lock_shared(place.path())];
        assert!(readers.iter().all(|reader| matches!(reader, Ok(Some(_)))));
        assert!(LAYOUT.lock(place.path()).unwrap().is_none());
    }

    #[test]
    fn a_lock_replaced_by_a_link_is_not_opened() {
        let place = tempfile::tempdir().unwrap();
        let victim = place.path().join("victim");
        fs::write(&victim, "mine").unwrap();
        symlink(&victim, place.path().join("lock")).unwrap();
        assert!(LAYOUT.lock(place.path()).is_err());
    }
}
