//! The folder of a ring: made by the launcher, named to the other processes, removed with everything in it.
//!
//! Beside it lies a lock file that the launcher holds as long as it lives, so that the processes notice its death and
//! the next launcher clears what it left.

use std::fmt::Debug;
use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use iceoryx2::prelude::{BackpressureStrategy, Config, FilePath, SemanticString};
use rand::RngExt;
use serde::Serialize;

use crate::error::RingError;
use crate::terms::{LinkTerms, Terms};
use crate::wait::{PAUSE, Waiting};
use skysink_common::estimate::Rates;
use skysink_common::pace::Pace;

/// Where iceoryx2 keeps its shared memory on Linux.
pub const SHARED_MEMORY: &str = "/dev/shm";

/// `iceoryx2.toml`, as far as a run has its own.
#[derive(Serialize)]
struct Domain {
    global: Global,
    #[serde(skip_serializing_if = "Option::is_none")]
    defaults: Option<Defaults>,
}

/// What ports have that ask for nothing else, as those of a link do.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Defaults {
    publish_subscribe: PortDefaults,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct PortDefaults {
    backpressure_strategy: BackpressureStrategy,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Global {
    root_path: String,
    prefix: String,
}

/// The folder of a ring. The launcher's is removed with everything in it when it is dropped.
#[derive(Debug)]
pub struct RingFolder {
    path: PathBuf,
    terms: Terms,
    /// The launcher's: held locked.
    lock: Option<File>,
}

impl RingFolder {
    /// Makes a folder for a new ring, and clears those whose launcher has died.
    ///
    /// # Errors
    /// If the folder cannot be made.
    pub fn create(
        pace: Pace,
        wait: Waiting,
        timeout_s: f64,
        viewer: bool,
        told: Option<Rates>,
    ) -> Result<Self, RingError> {
        let home = prepare_home()?;
        loop {
            let mission = rand::rng().random();
            let terms = Terms { mission, pace, wait, timeout_s, viewer, told, link: None };
            if let Some(folder) = Self::make(&home, terms)? {
                return Ok(folder);
            }
        }
    }

    /// Makes a folder for the processes of this host in the ring of another, of which `file` is a copy of `ring.toml`.
    ///
    /// # Errors
    /// If the ring has no link to other hosts, it is here already, or the folder cannot be made.
    pub fn join(file: &Path) -> Result<Self, RingError> {
        let terms = Terms::read(file).map_err(|message| RingError::folder(file, message))?;
        if terms.link.is_none() {
            return Err(RingError::folder(file, "it has no link to other hosts: expected that of skysink run --link"));
        }
        let here = || RingError::folder(file, "this host has joined it already: end that skysink join first");
        Self::make(&prepare_home()?, terms)?.ok_or_else(here)
    }

    /// Makes the folder of a ring; none if there is one of that name.
    fn make(home: &Path, terms: Terms) -> Result<Option<Self>, RingError> {
        let path = home.join(format!("{:08x}", terms.mission >> 32));
        let lock = lock_new(&lock_path(&path)).map_err(|error| RingError::folder(home, error))?;
        let Some(lock) = lock else { return Ok(None) };
        let folder = Self { path, terms, lock: Some(lock) };
        folder.furnish().map_err(|error| RingError::folder(&folder.path, error))?;
        Ok(Some(folder))
    }

    /// Lets a link carry the samples to other hosts; to be done before any process joins.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn link(&mut self, terms: LinkTerms) -> Result<(), RingError> {
        self.terms.link = Some(terms);
        let files = [self.path.join(DOMAIN), self.path.join(TERMS)];
        let rewritten = files.iter().try_for_each(fs::remove_file).and_then(|()| self.write_terms());
        rewritten.map_err(|error| RingError::folder(&self.path, error))
    }

    /// The folder that a launcher has made.
    ///
    /// # Errors
    /// If it is none.
    pub fn open(path: &Path) -> Result<Self, RingError> {
        const EXPECTED: &str = "expected the folder that skysink run prints";
        let refuse = |message: String| RingError::folder(path, message);
        let path = fs::canonicalize(path).map_err(|error| refuse(format!("{error}: {EXPECTED}")))?;
        let terms = Terms::read(&path.join(TERMS)).map_err(|message| refuse(format!("{TERMS}: {message}")))?;
        Ok(Self { path, terms, lock: None })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the run has agreed on.
    #[must_use]
    pub fn terms(&self) -> Terms {
        self.terms
    }

    /// The run's own iceoryx2 domain.
    ///
    /// # Errors
    /// If the folder has lost its configuration.
    pub fn config(&self) -> Result<Config, RingError> {
        Config::from_file(&self.config_file()?).map_err(|error| self.refuse_config(&error))
    }

    /// Makes the run's domain that of the whole process, which iceoryx2 needs to clear up after the dead. Must be the
    /// process's first use of iceoryx2.
    ///
    /// # Errors
    /// If the folder has lost its configuration.
    pub fn install(&self) -> Result<(), RingError> {
        let installed = Config::setup_global_config_from_file(&self.config_file()?);
        installed.map(drop).map_err(|error| self.refuse_config(&error))
    }

    fn config_file(&self) -> Result<FilePath, RingError> {
        let file = self.path.join(DOMAIN);
        FilePath::new(file.as_os_str().as_encoded_bytes()).map_err(|error| self.refuse_config(&error))
    }

    fn refuse_config(&self, error: &dyn Debug) -> RingError {
        RingError::folder(&self.path, format_args!("{DOMAIN}: {error:?}"))
    }

    /// The file that the launcher holds locked as long as it lives; none in the launcher itself.
    ///
    /// # Errors
    /// If the file is gone, and the run with it.
    pub(crate) fn supervisor(&self) -> Result<Option<File>, RingError> {
        if self.lock.is_some() {
            return Ok(None);
        }
        let refuse = |error| RingError::folder(&self.path, format_args!("lock: {error}: the run has ended"));
        File::open(lock_path(&self.path)).map(Some).map_err(refuse)
    }

    /// The file of the journal `name`.
    #[must_use]
    pub fn journal(&self, name: &str) -> PathBuf {
        self.path.join(format!("{name}.journal"))
    }

    /// Closes iceoryx2's counter of processes, which it makes for every user, to all but the owner.
    ///
    /// # Errors
    /// If the system refuses.
    pub(crate) fn close_counter(&self) -> io::Result<()> {
        for entry in fs::read_dir(SHARED_MEMORY)?.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with(&self.prefix()) && name.ends_with(".global_mgmt") {
                fs::set_permissions(entry.path(), fs::Permissions::from_mode(0o600))?;
            }
        }
        Ok(())
    }

    /// Beginning of the names of the run's shared-memory files.
    #[must_use]
    pub fn prefix(&self) -> String {
        prefix(&self.path)
    }

    /// Notes the folder in which the mission is put on record, for whoever looks for its ring.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn note_record(&self, folder: &Path) -> Result<(), RingError> {
        let note = || write_private(&self.path.join(RECORD), &fs::canonicalize(folder)?.to_string_lossy());
        note().map_err(|error| RingError::folder(&self.path, error))
    }

    /// Makes the folder, with what the other processes read.
    fn furnish(&self) -> io::Result<()> {
        DirBuilder::new().mode(0o700).create(&self.path)?;
        DirBuilder::new().mode(0o700).create(self.path.join("config"))?;
        self.write_terms()
    }

    /// Writes what the other processes read.
    fn write_terms(&self) -> io::Result<()> {
        let path = self.path.to_str().ok_or(io::ErrorKind::InvalidFilename)?;
        let global = Global { root_path: format!("{path}/"), prefix: self.prefix() };
        // A link never waits for a reader: what one misses comes again.
        let ports = PortDefaults { backpressure_strategy: BackpressureStrategy::DiscardData };
        let defaults = self.terms.link.map(|_| Defaults { publish_subscribe: ports });
        let domain = toml::to_string(&Domain { global, defaults }).expect("plain keys and values");
        write_private(&self.path.join(DOMAIN), &domain)?;
        let terms = toml::to_string(&self.terms).expect("plain keys and values");
        write_private(&self.path.join(TERMS), &terms)
    }
}

impl Drop for RingFolder {
    fn drop(&mut self) {
        if self.lock.is_some() {
            remove(&self.path);
        }
    }
}

/// Where the rings of this user are: in the folder for temporary files, or in `/tmp` if that has a path that iceoryx2
/// does not take.
#[must_use]
pub fn home() -> PathBuf {
    let user = format!("skysink-{}", rustix::process::getuid().as_raw());
    let home = std::env::temp_dir().join(&user);
    if std::env::temp_dir().is_dir() && is_usable(&home.join("12345678")) { home } else { Path::new("/tmp").join(user) }
}

/// Whether `path` can be a ring's folder: iceoryx2 takes no quotes and other special letters, and puts UNIX sockets
/// there, whose paths end at 108 bytes.
fn is_usable(path: &Path) -> bool {
    path.is_absolute()
        && path.to_str().is_some_and(|path| path.len() <= 48)
        && FilePath::new(path.as_os_str().as_encoded_bytes()).is_ok()
}

/// The run's iceoryx2 domain, in the ring's folder.
const DOMAIN: &str = "config/iceoryx2.toml";

/// What all processes of a run are told, in the ring's folder.
const TERMS: &str = "ring.toml";

/// Makes the folder of this user's rings, and clears those whose launcher has died.
fn prepare_home() -> Result<PathBuf, RingError> {
    let home = home();
    let refuse = |error: io::Error| RingError::folder(&home, error);
    DirBuilder::new().recursive(true).mode(0o700).create(&home).map_err(refuse)?;
    let owner = fs::symlink_metadata(&home).map_err(refuse)?.uid();
    if owner != rustix::process::getuid().as_raw() {
        let message = format_args!("belongs to user {owner}: remove it, or set TMPDIR to another folder");
        return Err(RingError::folder(&home, message));
    }
    clear_abandoned(Duration::ZERO);
    Ok(home)
}

fn lock_path(folder: &Path) -> PathBuf {
    folder.with_extension("lock")
}

/// Beginning of the names of a ring's shared-memory files; two homes may hold rings of the same name.
fn prefix(folder: &Path) -> String {
    let name = folder.file_name().map_or_else(Default::default, |name| name.to_string_lossy());
    format!("sky{name}_")
}

/// Writes a new file for the owner alone.
fn write_private(path: &Path, text: &str) -> io::Result<()> {
    OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?.write_all(text.as_bytes())
}

/// A new lock file, held; none if another process clears it at this moment or has it already.
fn lock_new(path: &Path) -> io::Result<Option<File>> {
    let lock = match OpenOptions::new().write(true).create_new(true).mode(0o600).open(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Ok(None),
        lock => lock?,
    };
    if lock.try_lock().is_err() {
        return Ok(None);
    }
    let same = fs::metadata(path).is_ok_and(|named| lock.metadata().is_ok_and(|held| held.ino() == named.ino()));
    Ok(same.then_some(lock))
}

/// What names the folder in which the mission of a ring is put on record.
const RECORD: &str = "record";

/// Where the mission of a ring is put on record; none if its launcher has not noted it yet.
#[must_use]
pub fn record_of(ring: &Path) -> Option<PathBuf> {
    fs::read_to_string(ring.join(RECORD)).ok().map(PathBuf::from)
}

/// The folders of this user's rings whose launchers live.
#[must_use]
pub fn running_rings() -> Vec<PathBuf> {
    let entries = fs::read_dir(home()).into_iter().flatten().flatten().map(|entry| entry.path());
    let locks = entries.filter(|path| path.extension().is_some_and(|extension| extension == "lock"));
    let is_held = |path: &PathBuf| {
        File::open(path).is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
    };
    locks.filter(is_held).map(|path| path.with_extension("")).collect()
}

/// Removes every ring of this user whose launcher does not live any more, once its other processes have ended, too;
/// waits for them for so long.
pub fn clear_abandoned(patience: Duration) {
    let begin = Instant::now();
    let Ok(entries) = fs::read_dir(home()) else { return };
    for path in entries.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "lock"))
    {
        let Ok(lock) = File::open(&path) else { continue };
        if lock.try_lock_shared().is_err() {
            continue; // shared: the processes of the ring must find it free, too
        }
        let folder = path.with_extension("");
        while has_processes(&folder) && begin.elapsed() < patience {
            std::thread::sleep(PAUSE);
        }
        if !has_processes(&folder) {
            remove(&folder);
        }
    }
}

/// Whether a process has a seat of the ring.
fn has_processes(folder: &Path) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut seats = entries.filter(|path| path.extension().is_some_and(|extension| extension == "seat"));
    seats.any(|seat| File::open(seat).is_ok_and(|seat| matches!(seat.try_lock_shared(), Err(TryLockError::WouldBlock))))
}

/// How often the removal of a ring's folder is tried.
const REMOVALS: u32 = 100;

/// Between two attempts.
const REMOVAL_PAUSE: Duration = Duration::from_millis(10);

/// Removes a ring: its shared memory, its folder, its lock. What is gone already is no matter.
fn remove(folder: &Path) {
    let prefix = prefix(folder);
    for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            let _ = fs::remove_file(entry.path());
        }
    }
    // What others of the ring remove at the same time ends an attempt early.
    let is_gone = || fs::remove_dir_all(folder).is_ok() || !folder.exists();
    for _ in 0..REMOVALS {
        if is_gone() {
            let _ = fs::remove_file(lock_path(folder)); // else the next launcher tries again
            return;
        }
        thread::sleep(REMOVAL_PAUSE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINK: LinkTerms = LinkTerms { version: 5, scenario: u64::MAX };

    fn new() -> RingFolder {
        RingFolder::create(Pace::Max, Waiting::Event, 1.0, false, Some(Rates::Known)).unwrap()
    }

    #[test]
    fn a_ring_with_a_link_says_so_and_its_ports_wait_for_nobody() {
        let mut folder = new();
        let domain = |folder: &RingFolder| fs::read_to_string(folder.path().join(DOMAIN)).unwrap();
        assert!(!domain(&folder).contains("defaults"), "{}", domain(&folder));
        folder.link(LINK).unwrap();
        assert!(domain(&folder).contains("backpressure-strategy = \"DiscardData\""), "{}", domain(&folder));
        assert_eq!(RingFolder::open(folder.path()).unwrap().terms(), folder.terms());
        assert_eq!(folder.terms().link, Some(LINK));
        let strategy = folder.config().unwrap().defaults.publish_subscribe.backpressure_strategy;
        assert_eq!(strategy, BackpressureStrategy::DiscardData);
    }

    #[test]
    fn a_host_joins_with_the_terms_of_another_and_only_once() {
        let mut first = new();
        first.link(LINK).unwrap();
        let copies = tempfile::tempdir().unwrap();
        let copy = copies.path().join("ring.toml");
        fs::copy(first.path().join(TERMS), &copy).unwrap();
        let error = RingFolder::join(&copy).unwrap_err().to_string();
        assert!(error.contains("joined it already"), "on the same host: {error}");
        let terms = first.terms();
        drop(first);
        let joined = RingFolder::join(&copy).unwrap();
        assert_eq!(joined.terms(), terms);
        assert!(RingFolder::join(&copy).is_err());
    }

    #[test]
    fn an_abandoned_ring_is_removed_once_its_processes_have_gone() {
        let mut folder = new();
        folder.lock = None; // as if the launcher had died
        let seat = crate::role::Seat::take(folder.path(), crate::role::Role::Planner).unwrap();
        clear_abandoned(Duration::ZERO);
        assert!(folder.path().exists());
        drop(seat);
        clear_abandoned(Duration::ZERO);
        assert!(!folder.path().exists());
    }

    #[test]
    fn a_ring_without_a_link_cannot_be_joined() {
        let folder = new();
        let error = RingFolder::join(&folder.path().join(TERMS)).unwrap_err().to_string();
        assert!(error.contains("no link to other hosts: expected that of skysink run --link"), "{error}");
        let error = RingFolder::join(Path::new("/nowhere/ring.toml")).unwrap_err().to_string();
        assert!(error.starts_with("ring /nowhere/ring.toml: No such file"), "{error}");
    }
}
