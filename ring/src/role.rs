//! The roles of the processes of a ring, and the lock file of each role, which one process holds at a time.
//!
//! The file counts the starts of the process, and its time of modification is the last heartbeat.

use std::fmt::Display;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{FileExt, MetadataExt as _, OpenOptionsExt};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use rustix::fs::{Timespec, Timestamps, UTIME_NOW, futimens};
use skysink_common::file_locks::with_remedy;
use skysink_common::terminal::one_line;
use strum::{EnumString, FromRepr, IntoStaticStr, VariantArray};

use crate::error::RingError;

/// Most characters of a line of the log.
const MAX_LINE: usize = 4000;

/// A process of the ring, by its number in messages and the name of its executable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, FromRepr, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[repr(u32)]
pub enum Role {
    /// Owns the queues and the slot clock.
    FieldSim,
    /// Owns the UAV and the channel.
    FlightSim,
    /// Plans the schedule and the waypoint.
    Planner,
    /// Records everything with rerun.
    Viewer,
    /// `skysink run`: launches the others and records.
    #[strum(serialize = "skysink")]
    Launcher,
}

impl Role {
    /// Whether the ring waits for the process in every slot, so that it is never far ahead of it. The others may lag:
    /// the viewer, and in paced runs the planner.
    #[must_use]
    pub fn blocks_ring(self) -> bool {
        matches!(self, Self::FieldSim | Self::FlightSim | Self::Launcher)
    }

    /// Writes a line to standard error, in the name of the process: control characters are escaped, and the middle of
    /// a long line is left out. Errors are ignored.
    pub fn log(self, line: impl Display) {
        let _ = writeln!(io::stderr(), "{}: {}", self.name(), one_line(&line.to_string(), MAX_LINE));
    }

    /// The name of the executable.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Period of the heartbeats.
pub const HEARTBEAT: Duration = Duration::from_millis(100);

/// The lock file of a role, `ROLE.seat`, locked while the process runs.
#[derive(Debug)]
pub struct RoleLock {
    file: File,
    /// Restart count of the process.
    pub(crate) restarts: u32,
    last_beat: Mutex<Instant>,
}

impl RoleLock {
    /// Locks the file of `role` in the ring of `folder`, and counts the start.
    ///
    /// # Errors
    /// If another process has locked it, or the file cannot be written.
    pub(crate) fn acquire(folder: &Path, role: Role) -> Result<Self, RingError> {
        let io = |error: io::Error| RingError::folder(folder, format_args!("{}: {error}", file_name(role)));
        let file = open(folder, role).map_err(io)?;
        match file.try_lock() {
            Ok(()) if is_at(&file, &folder.join(file_name(role))) => {}
            Ok(()) => return Err(RingError::folder(folder, "it was removed: the run has ended")),
            Err(TryLockError::WouldBlock) => {
                let message = format_args!("there is a {} already: end it first", role.name());
                return Err(RingError::folder(folder, message));
            }
            Err(TryLockError::Error(error)) => return Err(io(with_remedy(error))),
        }
        let restarts = read_count(&file).map_err(io)?;
        file.write_all_at(&(restarts + 1).to_le_bytes(), 0).map_err(io)?;
        Ok(Self { file, restarts, last_beat: Mutex::new(Instant::now()) })
    }

    /// Sends a heartbeat if one is due.
    pub fn beat(&self, now: Instant) {
        let mut last_beat = self.last_beat.lock().unwrap_or_else(PoisonError::into_inner);
        if now.saturating_duration_since(*last_beat) >= HEARTBEAT {
            *last_beat = now;
            let touch = Timespec { tv_sec: 0, tv_nsec: UTIME_NOW };
            // An error is noticed by the missing heartbeat.
            let _ = futimens(&self.file, &Timestamps { last_access: touch, last_modification: touch });
        }
    }
}

/// Whether `path` still leads to the open `file`.
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|named| file.metadata().is_ok_and(|held| held.ino() == named.ino()))
}

/// Opens the lock file of `role`.
fn open(folder: &Path, role: Role) -> io::Result<File> {
    let mut open = OpenOptions::new();
    let open = open.read(true).write(true).create(true).truncate(false).mode(0o600);
    open.open(folder.join(file_name(role)))
}

/// Locks the files of all roles, so that no process can join while the folder is removed; `None` if a process has one.
pub(crate) fn lock_all(folder: &Path) -> Option<Vec<File>> {
    let files = Role::VARIANTS.iter().filter_map(|&role| open(folder, role).ok()); // nobody can open the others, either
    files.map(|file| file.try_lock().is_ok().then_some(file)).collect()
}

/// Time of the last heartbeat of `role`, by the clock of the file system; `None` if the process was never started. Only
/// changes are meaningful, because that clock may be set.
#[must_use]
pub fn last_heartbeat(folder: &Path, role: Role) -> Option<SystemTime> {
    fs::metadata(folder.join(file_name(role))).and_then(|file| file.modified()).ok()
}

/// Number of starts of the process `role`.
#[must_use]
pub fn start_count(folder: &Path, role: Role) -> u32 {
    File::open(folder.join(file_name(role))).and_then(|file| read_count(&file)).unwrap_or(0)
}

fn file_name(role: Role) -> String {
    format!("{}.seat", role.name())
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
    fn a_role_is_exclusive_and_counts_its_starts() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(last_heartbeat(folder.path(), Role::Planner), None);
        let first = RoleLock::acquire(folder.path(), Role::Planner).unwrap();
        let error = RoleLock::acquire(folder.path(), Role::Planner).unwrap_err().to_string();
        assert!(error.contains("planner") && error.contains("already"), "{error}");
        assert_eq!(RoleLock::acquire(folder.path(), Role::FieldSim).unwrap().restarts, 0, "another role is free");
        assert_eq!(first.restarts, 0);
        drop(first);
        assert_eq!(RoleLock::acquire(folder.path(), Role::Planner).unwrap().restarts, 1);
    }

    #[test]
    fn a_heartbeat_is_visible_to_other_processes() {
        let folder = tempfile::tempdir().unwrap();
        let lock = RoleLock::acquire(folder.path(), Role::Planner).unwrap();
        let long_ago = SystemTime::now() - Duration::from_secs(60);
        lock.file.set_modified(long_ago).unwrap();
        let begin = Instant::now();
        lock.beat(begin); // not due yet
        assert_eq!(last_heartbeat(folder.path(), Role::Planner), Some(long_ago));
        lock.beat(begin + HEARTBEAT);
        assert!(last_heartbeat(folder.path(), Role::Planner).unwrap() > long_ago);
    }
}
