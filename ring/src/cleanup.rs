//! Removal of the resources of killed processes. iceoryx2 frees them on request, but not all.
//!
//! iceoryx2 creates shared memory write-only, sets its size, fills it, and then makes it readable. Opening memory whose
//! creator died before the size was set blocks for ever, and opening memory that is not readable blocks for a second.
//! So the janitor runs in its own thread: the launcher itself may be blocked.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Config, Node, NodeState, SemanticString, Service};

use crate::folder::RingFolder;
use crate::home::SHARED_MEMORY;

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

/// Scans that find a file unfinished before it counts as abandoned; a running creator needs microseconds. One that has to
/// wait for a core, or was stopped, needs any time: then it [`may_be_finished`].
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
        let thread = thread::spawn(move || {
            let mut unfinished = BTreeMap::new();
            while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(SCAN_PERIOD) {
                unfinished = remove_abandoned(Path::new(SHARED_MEMORY), &prefix, &unfinished);
            }
        });
        Self { end: Some(end), thread: Some(thread) }
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

/// Scans once: removes files that were unfinished in [`MAX_SCANS`] scans, and returns the other unfinished ones, each
/// with its number of scans. `before` is the result of the last scan.
fn remove_abandoned(folder: &Path, prefix: &str, before: &BTreeMap<PathBuf, u32>) -> BTreeMap<PathBuf, u32> {
    const OWNER_READ: u32 = 0o400;
    let mut unfinished = BTreeMap::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_of_ring = entry.file_name().to_string_lossy().starts_with(prefix);
        if !is_of_ring || entry.metadata().is_ok_and(|file| file.mode() & OWNER_READ != 0) {
            continue;
        }
        let path = entry.path();
        let scans = before.get(&path).map_or(1, |scans| scans + 1);
        if scans < MAX_SCANS || may_be_finished(&path) {
            unfinished.insert(path, scans.min(MAX_SCANS - 1));
        } else {
            let _ = fs::remove_file(path); // its creator may have removed it
        }
    }
    unfinished
}

/// Whether a thread of a process that has the file open runs, waits for a core, or is stopped: it may be creating the file.
/// Those who wait for the file sleep.
fn may_be_finished(path: &Path) -> bool {
    let own = fs::canonicalize("/proc/thread-self").unwrap_or_default();
    let entries = |folder: PathBuf| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_awake = |thread: &PathBuf| {
        let state = fs::read_to_string(thread.join("stat")).unwrap_or_default();
        let state = state.rsplit_once(") ").and_then(|(_, rest)| rest.chars().next());
        *thread != own && state.is_some_and(|state| !"SIZX".contains(state))
    };
    let has_it_open =
        |process: &PathBuf| entries(process.join("fd")).any(|fd| fs::read_link(fd).is_ok_and(|to| to == path));
    entries("/proc".into())
        .filter(has_it_open)
        .any(|process| entries(process.join("task")).any(|thread| is_awake(&thread)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn what_a_process_creates_that_waits_for_a_core_is_not_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky1_a.data");
        let mut file = fs::OpenOptions::new();
        let created =
            std::os::unix::fs::OpenOptionsExt::mode(file.write(true).create(true), 0o200).open(&path).unwrap();
        let scan = |unfinished: &BTreeMap<PathBuf, u32>| remove_abandoned(folder.path(), "sky1_", unfinished);
        let is_done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_done.load(Ordering::Relaxed) {
                    std::hint::spin_loop(); // the creator, as far as can be seen
                }
            });
            let unfinished = (0..20).fold(BTreeMap::new(), |unfinished, _| scan(&unfinished));
            is_done.store(true, Ordering::Relaxed);
            assert_eq!((unfinished.len(), path.exists()), (1, true));
        });
        drop(created); // it is dead
        let _ = (0..3).fold(BTreeMap::new(), |unfinished, _| scan(&unfinished));
        assert!(!path.exists());
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
        let mut unfinished = remove_abandoned(folder.path(), "sky1_", &BTreeMap::new());
        unfinished = remove_abandoned(folder.path(), "sky1_", &unfinished);
        assert!(abandoned.exists());
        fs::set_permissions(&late, fs::Permissions::from_mode(0o600)).unwrap();
        unfinished = remove_abandoned(folder.path(), "sky1_", &unfinished);
        assert!(unfinished.is_empty());
        assert_eq!([abandoned, late, finished, of_other_ring].map(|path| path.exists()), [false, true, true, true]);
    }
}
