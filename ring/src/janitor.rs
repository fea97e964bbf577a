//! Clears away what a process was making when it was killed.
//!
//! iceoryx2 makes a piece of shared memory write-only, sets its size, fills it, and then makes it readable. Who opens one
//! whose maker has died before the size was set waits for ever, and a second for one that is not readable. So this runs
//! beside the launcher's own work, which may be what waits.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::ring_folder::{RingFolder, SHARED_MEMORY};

/// How often it looks.
const ROUND: Duration = Duration::from_millis(40);

/// Rounds in which it sees a piece unfinished before it takes it for abandoned: a living maker needs microseconds.
const PATIENCE: u32 = 3;

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
        if rounds < PATIENCE {
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
