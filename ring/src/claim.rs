//! A place in the ring: one process has it at a time, counts how often it was taken, and shows that it is alive.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};

use rustix::fs::{Timespec, Timestamps, UTIME_NOW, futimens};

use crate::node::Role;
use crate::ring::RingError;

/// How often a process shows that it is alive.
pub const HEARTBEAT: Duration = Duration::from_millis(100);

/// A place in the ring, held as long as the process lives: the file of the role, locked.
#[derive(Debug)]
pub struct Claim {
    file: File,
    epoch: u32,
    beaten: Instant,
}

impl Claim {
    /// Takes the place of `role` in the ring of `folder`.
    ///
    /// # Errors
    /// If another process has it, or the file cannot be written.
    pub(crate) fn take(folder: &Path, role: Role) -> Result<Self, RingError> {
        let refuse = |message: String| RingError::Folder { folder: folder.display().to_string(), message };
        let io = |error: io::Error| refuse(format!("{}: {error}", file_name(role)));
        let mut open = OpenOptions::new();
        let open = open.read(true).write(true).create(true).truncate(false).mode(0o600);
        let file = open.open(folder.join(file_name(role))).map_err(io)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(RingError::Taken { folder: folder.display().to_string(), role });
            }
            Err(TryLockError::Error(error)) => return Err(io(error)),
        }
        let epoch = read_count(&file).map_err(io)?;
        file.write_all_at(&(epoch + 1).to_le_bytes(), 0).map_err(io)?;
        Ok(Self { file, epoch, beaten: Instant::now() })
    }

    /// How often the place was taken before.
    #[must_use]
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Shows that the process is alive, if it is time to.
    pub fn beat(&mut self, now: Instant) {
        if now.saturating_duration_since(self.beaten) >= HEARTBEAT {
            self.beaten = now;
            let touch = Timespec { tv_sec: 0, tv_nsec: UTIME_NOW };
            let _ = futimens(&self.file, &Timestamps { last_access: touch, last_modification: touch }); // seen by its absence
        }
    }
}

/// When the process in the place of `role` last showed that it is alive, by the clock of the file system; none if there
/// never was one. Only a change of it means something: that clock may be set.
#[must_use]
pub fn last_beat(folder: &Path, role: Role) -> Option<SystemTime> {
    std::fs::metadata(folder.join(file_name(role))).and_then(|file| file.modified()).ok()
}

fn file_name(role: Role) -> String {
    format!("{}.claim", role.name())
}

/// The number in the file; 0 in a new one.
fn read_count(file: &File) -> io::Result<u32> {
    let mut bytes = [0; 4];
    match file.read_exact_at(&mut bytes, 0) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(0),
        read => read.map(|()| u32::from_le_bytes(bytes)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_taken_by_one_at_a_time_and_counts_how_often() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(last_beat(folder.path(), Role::Planner), None);
        let first = Claim::take(folder.path(), Role::Planner).unwrap();
        let error = Claim::take(folder.path(), Role::Planner).unwrap_err().to_string();
        assert!(error.contains("planner") && error.contains("already"), "{error}");
        assert_eq!(Claim::take(folder.path(), Role::FieldSim).unwrap().epoch(), 0, "another place is free");
        assert_eq!(first.epoch(), 0);
        drop(first);
        assert_eq!(Claim::take(folder.path(), Role::Planner).unwrap().epoch(), 1);
    }

    #[test]
    fn a_beat_is_seen_from_outside() {
        let folder = tempfile::tempdir().unwrap();
        let mut claim = Claim::take(folder.path(), Role::Planner).unwrap();
        let long_ago = SystemTime::now() - Duration::from_secs(60);
        claim.file.set_modified(long_ago).unwrap();
        let begin = Instant::now();
        claim.beat(begin); // too early: nothing happens
        assert_eq!(last_beat(folder.path(), Role::Planner), Some(long_ago));
        claim.beat(begin + HEARTBEAT);
        assert!(last_beat(folder.path(), Role::Planner).unwrap() > long_ago);
    }
}
