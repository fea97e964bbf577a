//! Removal of the resources of killed processes. iceoryx2 frees them on request, but not all.
//!
//! iceoryx2 creates shared memory write-only, sets its size, fills it, and then makes it readable. Opening memory whose
//! creator died before the size was set blocks for ever, and opening memory that is not readable blocks for a second.
//! So the janitor runs in its own thread: the launcher itself may be blocked. If the launcher dies, the other processes
//! do the same until they have left the ring.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Config, Node, NodeState, SemanticString, Service};

use crate::folder::RingFolder;
use crate::home::SHARED_MEMORY;
use crate::wait::SUPERVISOR_CHECK;

/// Removes the resources of dead processes, whose buffers would block a writer for ever.
pub fn remove_dead_nodes<S: Service>(config: &Config) {
    let _ = Node::<S>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            let _ = node.try_remove_stale_resources(); // another process may have removed them
        }
        CallbackProgression::Continue
    });
}

/// As [`remove_dead_nodes`], and also removes nodes without details: iceoryx2 leaves those of processes that were
/// killed while joining, and every joining process would scan them again. Only one process of the ring may call it.
pub(crate) fn purge_dead_nodes<S: Service>(config: &Config) {
    let _ = Node::<S>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            let id = node.id().value();
            let has_no_details = node.details().is_none();
            if node.try_remove_stale_resources().is_err() && has_no_details {
                remove_files(config, id);
            }
        }
        CallbackProgression::Continue
    });
}

/// Whether no other process uses the same services.
pub(crate) fn is_only_node<S: Service>(own: &Node<S>) -> bool {
    let mut is_only = true;
    let _ = Node::<S>::list(own.config(), |state| {
        is_only &= !matches!(&state, NodeState::Alive(other) if other.id() != own.id());
        CallbackProgression::Continue
    });
    is_only
}

fn remove_files(config: &Config, id: u128) {
    let root = Path::new(std::str::from_utf8(config.global.root_path().as_bytes()).unwrap_or_default());
    let nodes = root.join(String::from_utf8_lossy(config.global.node.directory.as_bytes()).as_ref());
    let _ = fs::remove_dir_all(nodes.join(id.to_string()));
    let prefix = format!("{}{id}.", String::from_utf8_lossy(config.global.prefix.as_bytes()));
    for entry in fs::read_dir(&nodes).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Period of the janitor's scans.
const SCAN_PERIOD: Duration = Duration::from_millis(40);

/// Scans that find a file unfinished before it counts as abandoned; a running creator needs microseconds. One that has
/// to wait for a core, or was stopped, needs any time ([`has_waking_process`]).
const MAX_SCANS: u32 = 3;

/// A thread that removes abandoned shared memory of a ring until it is dropped.
#[derive(Debug)]
pub struct Janitor {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Janitor {
    /// Starts the thread for the ring of `folder`.
    #[must_use]
    pub fn start(folder: &RingFolder) -> Self {
        let (end, ended) = channel();
        let prefix = folder.prefix();
        let is_over = move || ended.recv_timeout(SCAN_PERIOD) != Err(RecvTimeoutError::Timeout);
        let thread = thread::spawn(move || clean(&prefix, is_over));
        Self { end: Some(end), thread: Some(thread) }
    }
}

/// Starts a thread that does what the [`Janitor`] does once the launcher, which has locked `supervisor`, is dead, as
/// long as the process runs and the ring has a folder.
pub(crate) fn stand_by(folder: &RingFolder, supervisor: File) {
    let path = folder.path().to_owned();
    let prefix = folder.prefix();
    thread::spawn(move || {
        while supervisor.try_lock_shared().is_err() {
            thread::sleep(SUPERVISOR_CHECK);
        }
        drop(supervisor); // the other processes try it, too
        clean(&prefix, || {
            thread::sleep(SCAN_PERIOD);
            !path.exists()
        });
    });
}

/// Removes abandoned shared memory, whose names begin with `prefix`, until the ring `is_over`.
fn clean(prefix: &str, is_over: impl Fn() -> bool) {
    let mut unfinished = BTreeMap::new();
    while !is_over() {
        unfinished = remove_abandoned(Path::new(SHARED_MEMORY), prefix, &unfinished, has_waking_process);
    }
}

impl Drop for Janitor {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Scans once: removes files that were unfinished in [`MAX_SCANS`] scans and that no awake process has open, and
/// returns the other unfinished ones, each with its number of scans. `before` is the result of the last scan.
fn remove_abandoned(
    folder: &Path,
    prefix: &str,
    before: &BTreeMap<PathBuf, u32>,
    has_waking_process: impl Fn(&Path) -> bool,
) -> BTreeMap<PathBuf, u32> {
    let mut unfinished = BTreeMap::new();
    for path in entries(folder) {
        let is_of_ring = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix));
        if !is_of_ring || is_finished(&path) {
            continue;
        }
        let scans = before.get(&path).map_or(1, |scans| scans + 1);
        if scans < MAX_SCANS || has_waking_process(&path) {
            unfinished.insert(path, scans.min(MAX_SCANS - 1));
        } else if !is_finished(&path) {
            // Its creator has not finished it and gone to sleep while the processes were looked through.
            let _ = fs::remove_file(path); // its creator may have removed it
        }
    }
    unfinished
}

/// Whether a file is readable, or there is none.
fn is_finished(path: &Path) -> bool {
    const OWNER_READ: u32 = 0o400;
    fs::symlink_metadata(path).map_or(true, |file| file.mode() & OWNER_READ != 0)
}

/// Whether a thread of a process that has the file open runs, waits for a core, or is stopped: it may be creating the
/// file. Those who wait for the file sleep. The calling thread does not count.
fn has_waking_process(path: &Path) -> bool {
    let own = fs::canonicalize("/proc/thread-self").unwrap_or_default();
    let is_awake = |thread: PathBuf| {
        let state = fs::read_to_string(thread.join("stat")).unwrap_or_default();
        let state = state.rsplit_once(") ").and_then(|(_, rest)| rest.chars().next());
        thread != own && state.is_some_and(|state| !"SIZX".contains(state))
    };
    let is_numbered =
        |process: &PathBuf| process.file_name().is_some_and(|name| name.to_string_lossy().parse::<u32>().is_ok());
    let has_it_open =
        |process: &PathBuf| entries(&process.join("fd")).any(|fd| fs::read_link(fd).is_ok_and(|to| to == path));
    entries(Path::new("/proc"))
        .filter(is_numbered) // not `self`, by which the calling thread has another path
        .filter(has_it_open)
        .any(|process| entries(&process.join("task")).any(is_awake))
}

/// The paths in a folder; none if it cannot be read.
fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
    use std::process::{Child, Command};

    /// Scans `count` times.
    fn scans(folder: &Path, count: u32, has_waking_process: fn(&Path) -> bool) -> BTreeMap<PathBuf, u32> {
        let scan = |unfinished, _| remove_abandoned(folder, "sky1_", &unfinished, has_waking_process);
        (0..count).fold(BTreeMap::new(), scan)
    }

    /// An unfinished file, held open by a process.
    fn unfinished_in(folder: &Path, script: &str) -> (PathBuf, Child) {
        let path = folder.join("sky1_a.data");
        let file = fs::OpenOptions::new().write(true).create(true).truncate(true).mode(0o200).open(&path).unwrap();
        (path, Command::new("sh").args(["-c", script]).stdout(file).spawn().unwrap())
    }

    fn end(mut process: Child) {
        process.kill().unwrap();
        process.wait().unwrap();
    }

    #[test]
    fn what_a_process_creates_that_waits_for_a_core_is_not_removed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, busy) = unfinished_in(folder.path(), "while :; do :; done");
        let unfinished = scans(folder.path(), 20, has_waking_process);
        assert_eq!((unfinished.len(), path.exists()), (1, true));
        end(busy);
        scans(folder.path(), MAX_SCANS, has_waking_process);
        assert!(!path.exists(), "its creator is dead");
    }

    #[test]
    fn what_only_sleeping_processes_have_open_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, asleep) = unfinished_in(folder.path(), "exec sleep 1000");
        let _own = fs::OpenOptions::new().append(true).open(&path).unwrap(); // whoever scans does not create it
        while path.exists() {
            scans(folder.path(), MAX_SCANS, has_waking_process); // until it and all other tests sleep
        }
        end(asleep);
    }

    #[test]
    fn what_is_finished_while_processes_are_looked_through_is_not_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky1_a.data");
        fs::write(&path, "").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o200)).unwrap();
        let finish_and_sleep = |path: &Path| fs::set_permissions(path, fs::Permissions::from_mode(0o600)).is_err();
        assert_eq!(scans(folder.path(), MAX_SCANS, finish_and_sleep).len(), 0);
        assert!(path.exists());
    }

    #[test]
    fn the_other_processes_clean_up_once_the_launcher_is_dead() {
        let folder = RingFolder::create(crate::terms::Terms::default()).unwrap();
        let path = Path::new(SHARED_MEMORY).join(folder.prefix() + "a.connection");
        fs::write(&path, "").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o200)).unwrap();
        let locked = tempfile::NamedTempFile::new().unwrap();
        locked.as_file().lock().unwrap(); // the launcher
        stand_by(&folder, locked.reopen().unwrap());
        thread::sleep(SCAN_PERIOD * MAX_SCANS * 2);
        assert!(path.exists(), "the launcher does it");
        drop(locked);
        while path.exists() {
            thread::sleep(SCAN_PERIOD);
        }
    }

    #[test]
    fn only_files_that_remain_unfinished_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, mode: u32| {
            let path = folder.path().join(name);
            fs::write(&path, "").unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            path
        };
        let abandoned = file("sky1_a.connection", 0o200);
        let late = file("sky1_b.connection", 0o200);
        let finished = file("sky1_c.data", 0o600);
        let of_other_ring = file("sky2_a.connection", 0o200);
        let scan = |unfinished| remove_abandoned(folder.path(), "sky1_", &unfinished, has_waking_process);
        let unfinished = scan(scan(BTreeMap::new()));
        assert!(abandoned.exists());
        fs::set_permissions(&late, fs::Permissions::from_mode(0o600)).unwrap();
        assert!(scan(unfinished).is_empty());
        assert_eq!([abandoned, late, finished, of_other_ring].map(|path| path.exists()), [false, true, true, true]);
    }
}
