//! The parent folder of a user's rings, and the removal of rings whose launchers are dead.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use iceoryx2::prelude::{FilePath, SemanticString};

use crate::role::lock_all;
use crate::wait::PAUSE;

/// The shared memory of iceoryx2 on Linux.
pub const SHARED_MEMORY: &str = "/dev/shm";

/// The parent folder of this user's rings: in the folder for temporary files, or in `/tmp` if iceoryx2 does not accept
/// that path.
#[must_use]
pub fn home() -> PathBuf {
    let user = format!("skysink-{}", rustix::process::getuid().as_raw());
    let home = std::env::temp_dir().join(&user);
    if std::env::temp_dir().is_dir() && is_usable(&home.join("12345678")) { home } else { Path::new("/tmp").join(user) }
}

/// Whether `path` can be a ring's folder: iceoryx2 accepts no quotes and other special characters, and creates UNIX
/// sockets there, whose paths are limited to 108 bytes.
fn is_usable(path: &Path) -> bool {
    path.is_absolute()
        && path.to_str().is_some_and(|path| path.len() <= 48)
        && FilePath::new(path.as_os_str().as_encoded_bytes()).is_ok()
}

/// The lock file of the launcher.
pub(crate) fn lock_path(folder: &Path) -> PathBuf {
    folder.with_extension("lock")
}

/// Beginning of the names of a ring's shared-memory files.
pub(crate) fn prefix(folder: &Path) -> String {
    let name = folder.file_name().map_or_else(Default::default, |name| name.to_string_lossy());
    format!("sky{name}_")
}

/// The folders of this user's rings whose launchers are running.
#[must_use]
pub fn running_rings() -> Vec<PathBuf> {
    rings(&home()).into_iter().filter(|folder| is_held(&lock_path(folder))).collect()
}

/// Extension of a folder that is being removed.
const GONE: &str = "gone";

/// The folders in `home` of rings that have a folder, even if it is being removed, or a lock.
pub(crate) fn rings(home: &Path) -> BTreeSet<PathBuf> {
    let entries = fs::read_dir(home).into_iter().flatten().flatten().map(|entry| entry.path());
    let names = entries.filter(|path| path.extension().is_none_or(|found| found == "lock" || found == GONE));
    let is_ring = |folder: &PathBuf| {
        let name = folder.file_name().unwrap_or_default().as_encoded_bytes();
        name.len() == 8 && name.iter().all(u8::is_ascii_hexdigit)
    };
    names.map(|path| path.with_extension("")).filter(is_ring).collect()
}

/// Whether a process has locked the file `path`.
pub(crate) fn is_held(path: &Path) -> bool {
    File::open(path).is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

/// Removes the rings of this user whose launchers are dead. Waits up to `timeout` for their other processes to end, and
/// leaves the rings of those that do not.
pub fn clear_abandoned(timeout: Duration) {
    clear_abandoned_in(&home(), timeout);
}

fn clear_abandoned_in(home: &Path, timeout: Duration) {
    let begin = Instant::now();
    for folder in rings(home) {
        let _lock = match File::open(lock_path(&folder)) {
            Ok(lock) if lock.try_lock_shared().is_ok() => Some(lock), // shared: the processes of the ring test it, too
            // A process without a role, such as an observer, has made the removed folder again.
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            _ => continue,
        };
        let mut roles = lock_all(&folder);
        while roles.is_none() && begin.elapsed() < timeout {
            thread::sleep(PAUSE);
            roles = lock_all(&folder);
        }
        if roles.is_some() {
            remove(&folder);
        }
    }
}

/// Attempts to remove a ring's folder.
const REMOVALS: u32 = 100;

/// Between two attempts.
const REMOVAL_PAUSE: Duration = Duration::from_millis(10);

/// Removes the shared memory, the folder and the lock of a ring, as far as they exist.
pub(crate) fn remove(folder: &Path) {
    let prefix = prefix(folder);
    for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            let _ = fs::remove_file(entry.path());
        }
    }
    let gone = folder.with_extension(GONE);
    // An attempt fails if another process removes files at the same time.
    let is_gone = |folder: &Path| fs::remove_dir_all(folder).is_ok() || !folder.exists();
    for _ in 0..REMOVALS {
        // Renamed at first: while its files are removed one after another, a process could still join it.
        if is_gone(&gone) && (fs::rename(folder, &gone).is_ok() && is_gone(&gone) || !folder.exists()) {
            let _ = fs::remove_file(lock_path(folder)); // else the next launcher tries again
            return;
        }
        thread::sleep(REMOVAL_PAUSE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::role::{Role, RoleLock};

    #[test]
    fn an_abandoned_ring_is_removed_once_its_processes_have_ended() {
        let home = tempfile::tempdir().unwrap();
        fs::create_dir(home.path().join("notes")).unwrap();
        for has_lock in [true, false] {
            let folder = abandoned(home.path());
            let half_gone = folder.with_extension(GONE);
            fs::create_dir_all(half_gone.join("services")).unwrap();
            if !has_lock {
                fs::remove_file(lock_path(&folder)).unwrap();
            }
            let memory = Path::new(SHARED_MEMORY).join(prefix(&folder) + "a.data");
            fs::write(&memory, "").unwrap();
            let role = RoleLock::acquire(&folder, Role::Planner).unwrap();
            clear_abandoned_in(home.path(), Duration::ZERO);
            assert!(folder.exists() && memory.exists());
            drop(role);
            clear_abandoned_in(home.path(), Duration::ZERO);
            assert_eq!([&folder, &half_gone, &lock_path(&folder), &memory].map(|path| path.exists()), [false; 4]);
        }
        assert!(home.path().join("notes").exists());
    }

    /// A ring in `home` whose launcher has died.
    fn abandoned(home: &Path) -> PathBuf {
        let folder = home.join(format!("{:08x}", rand::random::<u32>()));
        fs::create_dir(&folder).unwrap();
        fs::write(lock_path(&folder), "").unwrap();
        folder
    }

    #[test]
    fn a_running_ring_is_not_removed() {
        let home = tempfile::tempdir().unwrap();
        let folder = abandoned(home.path());
        let lock = File::open(lock_path(&folder)).unwrap();
        lock.lock().unwrap();
        clear_abandoned_in(home.path(), Duration::ZERO);
        assert!(folder.exists());
        drop(lock);
        clear_abandoned_in(home.path(), Duration::ZERO);
        assert!(!folder.exists());
    }

    #[test]
    fn joining_and_removing_an_abandoned_ring_are_exclusive() {
        let home = tempfile::tempdir().unwrap();
        let mut joined = 0;
        for _ in 0..200 {
            let folder = abandoned(home.path());
            let role = thread::scope(|scope| {
                let role = scope.spawn(|| RoleLock::acquire(&folder, Role::Viewer));
                clear_abandoned_in(home.path(), Duration::ZERO);
                role.join().unwrap()
            });
            assert_eq!(role.is_ok(), folder.exists(), "{role:?}");
            joined += u32::from(role.is_ok());
            drop(role);
            clear_abandoned_in(home.path(), Duration::ZERO);
            assert!(!folder.exists());
        }
        println!("{joined} of 200 joined");
    }
}
