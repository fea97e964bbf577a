//! Who takes part in a ring: the roles, and the seat of each, which one process has at a time.
//!
//! A seat counts how often it was taken; its holder shows by heartbeats that it is alive.

use std::fmt::Display;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Write as _};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use rustix::fs::{Timespec, Timestamps, UTIME_NOW, futimens};
use strum::{EnumString, FromRepr, IntoStaticStr};

use crate::error::RingError;

/// A process of the ring, by its number in messages and the name of its executable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, FromRepr, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[repr(u32)]
pub enum Role {
    /// Owns the queues and the slot clock.
    FieldSim,
    /// Owns the UAV and the channel.
    FlightSim,
    /// Decides the schedule and the waypoint.
    Planner,
    /// Logs everything to rerun.
    Viewer,
    /// `skysink run`: launches the others and records.
    #[strum(serialize = "skysink")]
    Launcher,
}

impl Role {
    /// Whether the ring cannot go on without the process, so that its peers are never far ahead. The others may lag:
    /// the viewer, and in paced runs the planner.
    #[must_use]
    pub fn keeps_the_ring_waiting(self) -> bool {
        matches!(self, Self::FieldSim | Self::FlightSim | Self::Launcher)
    }

    /// Writes a line to standard error. Where it cannot be written there is nobody to tell.
    pub fn say(self, line: impl Display) {
        let _ = writeln!(io::stderr(), "{}: {line}", self.name());
    }

    /// The name of the executable.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// How often a process shows that it is alive.
pub const HEARTBEAT: Duration = Duration::from_millis(100);

/// The seat of a role, held as long as the process lives: a file, locked.
#[derive(Debug)]
pub struct Seat {
    file: File,
    /// How often it was taken before: the restart count of its holder.
    pub(crate) restarts: u32,
    last_beat: Mutex<Instant>,
}

impl Seat {
    /// Takes the seat of `role` in the ring of `folder`.
    ///
    /// # Errors
    /// If another process has it, or the file cannot be written.
    pub(crate) fn take(folder: &Path, role: Role) -> Result<Self, RingError> {
        let io = |error: io::Error| RingError::folder(folder, format_args!("{}: {error}", file_name(role)));
        let mut open = OpenOptions::new();
        let open = open.read(true).write(true).create(true).truncate(false).mode(0o600);
        let file = open.open(folder.join(file_name(role))).map_err(io)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let message = format_args!("there is a {} already: end it first", role.name());
                return Err(RingError::folder(folder, message));
            }
            Err(TryLockError::Error(error)) => return Err(io(error)),
        }
        let restarts = read_count(&file).map_err(io)?;
        file.write_all_at(&(restarts + 1).to_le_bytes(), 0).map_err(io)?;
        Ok(Self { file, restarts, last_beat: Mutex::new(Instant::now()) })
    }

    /// Shows that the process is alive, if it is time to.
    pub fn beat(&self, now: Instant) {
        let mut last_beat = self.last_beat.lock().unwrap_or_else(PoisonError::into_inner);
        if now.saturating_duration_since(*last_beat) >= HEARTBEAT {
            *last_beat = now;
            let touch = Timespec { tv_sec: 0, tv_nsec: UTIME_NOW };
            let _ = futimens(&self.file, &Timestamps { last_access: touch, last_modification: touch }); // seen by its absence
        }
    }
}

/// When the process in the seat of `role` last showed that it is alive, by the clock of the file system; none if there
/// never was one. Only a change of it means something: that clock may be set.
#[must_use]
pub fn last_heartbeat(folder: &Path, role: Role) -> Option<SystemTime> {
    std::fs::metadata(folder.join(file_name(role))).and_then(|file| file.modified()).ok()
}

/// How often the seat of `role` was taken: the restart count of its last holder, and one.
#[must_use]
pub fn times_taken(folder: &Path, role: Role) -> u32 {
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
    fn a_seat_is_taken_by_one_at_a_time_and_counts_how_often() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(last_heartbeat(folder.path(), Role::Planner), None);
        let first = Seat::take(folder.path(), Role::Planner).unwrap();
        let error = Seat::take(folder.path(), Role::Planner).unwrap_err().to_string();
        assert!(error.contains("planner") && error.contains("already"), "{error}");
        assert_eq!(Seat::take(folder.path(), Role::FieldSim).unwrap().restarts, 0, "another seat is free");
        assert_eq!(first.restarts, 0);
        drop(first);
        assert_eq!(Seat::take(folder.path(), Role::Planner).unwrap().restarts, 1);
    }

    #[test]
    fn a_beat_is_seen_from_outside() {
        let folder = tempfile::tempdir().unwrap();
        let seat = Seat::take(folder.path(), Role::Planner).unwrap();
        let long_ago = SystemTime::now() - Duration::from_secs(60);
        seat.file.set_modified(long_ago).unwrap();
        let begin = Instant::now();
        seat.beat(begin); // too early: nothing happens
        assert_eq!(last_heartbeat(folder.path(), Role::Planner), Some(long_ago));
        seat.beat(begin + HEARTBEAT);
        assert!(last_heartbeat(folder.path(), Role::Planner).unwrap() > long_ago);
    }
}
