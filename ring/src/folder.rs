//! The folder of a ring: created by the launcher, opened by the other processes, and removed with its contents.
//!
//! The launcher holds a lock file beside it. With it the processes detect its death, and the next launcher removes the
//! folder. The lock file is created before the folder and removed after it.

use std::fmt::Debug;
use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::prelude::{Config, FilePath, SemanticString};
use rand::RngExt;
use skysink_common::file_locks::with_remedy;

use crate::error::RingError;
use crate::home::{SHARED_MEMORY, clear_abandoned, home, lock_path, prefix, remove};
use crate::role::is_at;
use crate::terms::Terms;

/// Defaults of ports in `iceoryx2.toml`, such as those of a link, which never waits for a reader: missed samples are
/// repeated.
const LINK_DEFAULTS: &str = "\n[defaults.publish-subscribe]\nbackpressure-strategy = \"DiscardData\"\n";

/// The folder of a ring. That of the launcher is removed with its contents on drop.
#[derive(Debug)]
pub struct RingFolder {
    path: PathBuf,
    terms: Terms,
    /// The locked file; `None` except in the launcher.
    lock: Option<File>,
}

impl RingFolder {
    /// Creates the folder of a new ring with these terms and a new `mission`, and removes the folders of dead
    /// launchers.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub fn create(terms: Terms) -> Result<Self, RingError> {
        let home = prepare_home()?;
        loop {
            let mission = rand::rng().random();
            if let Some(folder) = Self::create_in(&home, Terms { mission, ..terms.clone() })? {
                return Ok(folder);
            }
        }
    }

    /// Creates the folder for the processes of this host in the ring of another host. `file` is a copy of its
    /// `ring.toml`.
    ///
    /// # Errors
    /// If the ring has no link to other hosts, this host has joined it already, or the folder cannot be created.
    pub fn join(file: &Path) -> Result<Self, RingError> {
        let terms = Terms::read(file).map_err(|message| RingError::folder(file, message))?;
        if terms.link.is_none() {
            return Err(RingError::folder(file, "it has no link to other hosts: expected that of skysink run --link"));
        }
        let refusal = || RingError::folder(file, "this host has joined it already: end that skysink join first");
        Self::create_in(&prepare_home()?, terms)?.ok_or_else(refusal)
    }

    /// Creates the folder of a ring; `None` if one of that name exists.
    fn create_in(home: &Path, terms: Terms) -> Result<Option<Self>, RingError> {
        let path = home.join(format!("{:08x}", terms.mission >> 32));
        let lock = lock_new(&lock_path(&path)).map_err(|error| RingError::folder(home, error))?;
        let Some(lock) = lock else { return Ok(None) };
        let folder = Self { path, terms, lock: Some(lock) };
        folder.create_files().map_err(|error| RingError::folder(&folder.path, error))?;
        Ok(Some(folder))
    }

    /// Opens the folder of a running launcher.
    ///
    /// # Errors
    /// If `path` is not such a folder.
    pub fn open(path: &Path) -> Result<Self, RingError> {
        const EXPECTED: &str = "expected the folder that skysink run prints";
        let refuse = |message: String| RingError::folder(path, message);
        let path = fs::canonicalize(path).map_err(|error| refuse(format!("{error}: {EXPECTED}")))?;
        let terms = Terms::read(&path.join(TERMS)).map_err(|message| refuse(format!("{TERMS}: {message}")))?;
        Ok(Self { path, terms, lock: None })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The terms of the run.
    pub fn terms(&self) -> Terms {
        self.terms.clone()
    }

    /// The iceoryx2 configuration of the run.
    ///
    /// # Errors
    /// If the file is missing or invalid.
    pub fn config(&self) -> Result<Config, RingError> {
        Config::from_file(&self.config_file()?).map_err(|error| self.refuse_config(&error))
    }

    /// Makes the configuration of the run the global one of this process, which iceoryx2 needs to clean up after dead
    /// processes. Must be the first use of iceoryx2 in the process.
    ///
    /// # Errors
    /// If the file is missing or invalid.
    pub fn set_global_config(&self) -> Result<(), RingError> {
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

    /// The lock file of the launcher; `None` in the launcher itself.
    ///
    /// # Errors
    /// If the file is missing: the run has ended.
    pub(crate) fn supervisor(&self) -> Result<Option<File>, RingError> {
        if self.lock.is_some() {
            return Ok(None);
        }
        let refuse = |error| RingError::folder(&self.path, format_args!("lock: {error}: the run has ended"));
        File::open(lock_path(&self.path)).map(Some).map_err(refuse)
    }

    /// The path of the journal `name`.
    pub fn journal(&self, name: &str) -> PathBuf {
        self.path.join(format!("{name}.journal"))
    }

    /// Restricts iceoryx2's process counter, which is created writable for every user, to the owner.
    ///
    /// # Errors
    /// If the permissions cannot be changed.
    pub(crate) fn restrict_process_counter(&self) -> io::Result<()> {
        for entry in fs::read_dir(SHARED_MEMORY)?.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with(&self.prefix()) && name.ends_with(".global_mgmt") {
                fs::set_permissions(entry.path(), fs::Permissions::from_mode(0o600))?;
            }
        }
        Ok(())
    }

    /// Beginning of the names of the run's shared-memory files.
    pub fn prefix(&self) -> String {
        prefix(&self.path)
    }

    /// Writes the path of the run folder, by which `skysink topics` finds the ring of a run.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_record_path(&self, folder: &Path) -> Result<(), RingError> {
        let write = || write_private(&self.path.join(RECORD), &fs::canonicalize(folder)?.to_string_lossy());
        write().map_err(|error| RingError::folder(&self.path, error))
    }

    /// Creates the folder, and writes the files that the other processes read.
    fn create_files(&self) -> io::Result<()> {
        DirBuilder::new().mode(0o700).create(&self.path)?;
        DirBuilder::new().mode(0o700).create(self.path.join("config"))?;
        let path = self.path.to_str().ok_or(io::ErrorKind::InvalidFilename)?;
        let [root_path, prefix] = [format!("{path}/"), self.prefix()].map(toml::Value::from);
        let mut domain = format!("[global]\nroot-path = {root_path}\nprefix = {prefix}\n");
        if self.terms.link.is_some() {
            domain.push_str(LINK_DEFAULTS);
        }
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

/// The iceoryx2 configuration of the run, in the ring's folder.
const DOMAIN: &str = "config/iceoryx2.toml";

/// The terms of the run, in the ring's folder.
const TERMS: &str = "ring.toml";

/// Creates the parent folder of this user's rings, and removes the folders of dead launchers.
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

/// Writes a new file, readable by the owner alone.
fn write_private(path: &Path, text: &str) -> io::Result<()> {
    OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?.write_all(text.as_bytes())
}

/// Creates and locks a lock file; `None` if it exists, or if another process removes or locks it at the same time.
fn lock_new(path: &Path) -> io::Result<Option<File>> {
    let lock = match OpenOptions::new().write(true).create_new(true).mode(0o600).open(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Ok(None),
        lock => lock?,
    };
    match lock.try_lock() {
        Ok(()) => Ok(is_at(&lock, path).then_some(lock)),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(error)) => {
            let _ = fs::remove_file(path);
            Err(with_remedy(error))
        }
    }
}

/// The file with the path of the run folder.
const RECORD: &str = "record";

/// The run folder of a ring; `None` if its launcher has not written it yet.
#[must_use]
pub fn record_path(ring: &Path) -> Option<PathBuf> {
    fs::read_to_string(ring.join(RECORD)).ok().map(PathBuf::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::terms::LinkTerms;
    use iceoryx2::prelude::BackpressureStrategy;
    use skysink_common::estimate::Rates;

    const LINK: Option<LinkTerms> = Some(LinkTerms { version: 5, scenario: u64::MAX });

    fn new(link: Option<LinkTerms>) -> RingFolder {
        RingFolder::create(Terms { belief: Some(Rates::Known), link, ..Terms::default() }).unwrap()
    }

    #[test]
    fn the_ports_of_a_ring_with_a_link_never_wait() {
        let domain = |folder: &RingFolder| fs::read_to_string(folder.path().join(DOMAIN)).unwrap();
        assert!(!domain(&new(None)).contains("defaults"));
        let folder = new(LINK);
        assert!(domain(&folder).contains("backpressure-strategy = \"DiscardData\""), "{}", domain(&folder));
        assert_eq!(RingFolder::open(folder.path()).unwrap().terms(), folder.terms());
        assert_eq!(folder.terms().link, LINK);
        let strategy = folder.config().unwrap().defaults.publish_subscribe.backpressure_strategy;
        assert_eq!(strategy, BackpressureStrategy::DiscardData);
    }

    #[test]
    fn a_host_joins_once_with_the_terms_of_the_first_host() {
        let first = new(LINK);
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
    fn a_ring_without_a_link_cannot_be_joined() {
        let folder = new(None);
        let error = RingFolder::join(&folder.path().join(TERMS)).unwrap_err().to_string();
        assert!(error.contains("no link to other hosts: expected that of skysink run --link"), "{error}");
        let error = RingFolder::join(Path::new("/nowhere/ring.toml")).unwrap_err().to_string();
        assert!(error.starts_with("ring /nowhere/ring.toml: No such file"), "{error}");
    }
}
