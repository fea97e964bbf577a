//! Cleans up after processes that were killed: iceoryx2 frees what they held when it is asked to, but not everything.
//!
//! iceoryx2 makes a piece of shared memory write-only, sets its size, fills it, and then makes it readable. A process
//! that opens one whose maker has died before the size was set waits for ever, and a second for one that is not
//! readable. So the janitor runs beside the launcher's own work, which may be what waits.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Config, Node, NodeState, SemanticString, Service};

use crate::folder::{RingFolder, SHARED_MEMORY};

/// Frees what processes that died have left behind; a writer would wait for their buffers for ever.
pub fn remove_dead_nodes<S: Service>(config: &Config) {
    let _ = Node::<S>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            let _ = node.try_remove_stale_resources(); // another process may have been quicker
        }
        CallbackProgression::Continue
    });
}

/// The same, and removes what iceoryx2 leaves of a process that was killed while it joined: a node without details,
/// which would be looked at again by every process that joins. To be done by one process of the ring.
pub(crate) fn purge_dead_nodes<S: Service>(config: &Config) {
    let _ = Node::<S>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            let (id, bare) = (node.id().value(), node.details().is_none());
            if node.try_remove_stale_resources().is_err() && bare {
                remove_files(config, id);
            }
        }
        CallbackProgression::Continue
    });
}

/// Whether no other process lives that uses the same services.
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

/// How often the janitor scans.
const ROUND: Duration = Duration::from_millis(40);

/// Rounds in which a piece is unfinished before it counts as abandoned: a living maker needs microseconds.
const MAX_ROUNDS: u32 = 3;

/// Watches over the shared memory of a ring until it is dropped.
#[derive(Debug)]
pub struct Janitor {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Janitor {
    /// Begins to watch over the ring of `folder`.
    #[must_use]
    pub fn of(folder: &RingFolder) -> Self {
        let (end, ended) = channel();
        let prefix = folder.prefix();
        let thread = std::thread::spawn(move || {
            let mut unfinished = BTreeMap::new();
            while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(ROUND) {
                unfinished = tidy(Path::new(SHARED_MEMORY), &prefix, &unfinished);
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

/// One round: removes what has been unfinished for too long; returns what is, with the rounds.
fn tidy(folder: &Path, prefix: &str, before: &BTreeMap<PathBuf, u32>) -> BTreeMap<PathBuf, u32> {
    const OWNER_READ: u32 = 0o400;
    let mut unfinished = BTreeMap::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let ours = entry.file_name().to_string_lossy().starts_with(prefix);
        if !ours || entry.metadata().is_ok_and(|file| file.mode() & OWNER_READ != 0) {
            continue;
        }
        let path = entry.path();
        let rounds = before.get(&path).map_or(1, |rounds| rounds + 1);
        if rounds < MAX_ROUNDS {
            unfinished.insert(path, rounds);
        } else {
            let _ = fs::remove_file(path); // its maker may have been alive after all
        }
    }
    unfinished
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn what_stays_unfinished_is_removed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, mode: u32| {
            let path = folder.path().join(name);
            fs::write(&path, "").unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            path
        };
        let (mine, late) = (file("sky1_a.connection", 0o200), file("sky1_b.connection", 0o200));
        let (whole, other) = (file("sky1_c.data", 0o600), file("sky2_a.connection", 0o200));
        let mut unfinished = tidy(folder.path(), "sky1_", &BTreeMap::new());
        unfinished = tidy(folder.path(), "sky1_", &unfinished);
        assert!(mine.exists());
        fs::set_permissions(&late, fs::Permissions::from_mode(0o600)).unwrap();
        unfinished = tidy(folder.path(), "sky1_", &unfinished);
        assert!(unfinished.is_empty());
        assert_eq!([mine, late, whole, other].map(|path| path.exists()), [false, true, true, true]);
    }
}
