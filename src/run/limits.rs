//! Checks the resources of the machine before a run: running out of them later would kill processes.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, StatVfs, access, statvfs};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use skysink_common::sensors::SensorList;
use skysink_ring::home::{SHARED_MEMORY, home};
use skysink_ring::topics::VIEWER_BUFFER;

use crate::error::Error;

const MIB: u64 = 1 << 20;

/// Maximum number of open files of a process of the ring, including connections to restarted peers.
const FILES: u64 = 256;

/// The largest file in shared memory without what it has for each sensor node [byte].
const LARGEST_SHARED: u64 = 2 * MIB;

/// Disk space for checkpoints, and inodes for sockets and files, in the ring folder.
const RING_BYTES: u64 = 16 * MIB;
const RING_INODES: u64 = 256;

/// Checks that the machine has enough open files, shared memory, and disk space for a run over these sensor nodes, and
/// allows files that are large enough.
pub fn check(list: &SensorList, viewer: bool) -> Result<(), Error> {
    check_files()?;
    let sensors = list.sensors().len() as u64;
    let samples = if viewer { VIEWER_BUFFER as u64 + 8 } else { 8 };
    let bytes_per_sensor = samples * 4 + 3 * 40; // buffered queue samples, and the sensor list
    let remedy = if viewer {
        "make it larger (docker: --shm-size), or pass --no-viewer, which needs less"
    } else {
        "make it larger (docker: --shm-size)"
    };
    check_file_size(getrlimit(Resource::Fsize).current, LARGEST_SHARED + bytes_per_sensor * sensors)?;
    check_space(Path::new(SHARED_MEMORY), 8 * MIB + bytes_per_sensor * sensors, 0, remedy)?;
    let state_bytes = 100 * sensors;
    check_space(&existing(home()), RING_BYTES + state_bytes, RING_INODES, "free some, or set TMPDIR to another folder")
}

/// Raises the soft limit of open files if necessary.
fn check_files() -> Result<(), Error> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let is_enough = |limit: Option<u64>| limit.is_none_or(|limit| limit >= FILES);
    if is_enough(current)
        || is_enough(maximum) && setrlimit(Resource::Nofile, Rlimit { current: Some(FILES), maximum }).is_ok()
    {
        return Ok(());
    }
    let found = format!("at most {}", maximum.or(current).unwrap_or_default());
    Err(insufficient("open files", found, FILES, "raise ulimit -n"))
}

/// Checks that a file may have this many bytes.
fn check_file_size(limit: Option<u64>, bytes: u64) -> Result<(), Error> {
    let refuse = |limit| {
        let found = format!("at most {limit} bytes");
        Err(insufficient("size of a file in shared memory", found, bytes, "raise ulimit -f"))
    };
    limit.filter(|limit| *limit < bytes).map_or(Ok(()), refuse)
}

/// Checks that `folder` is writable and has this many free bytes and inodes.
fn check_space(folder: &Path, bytes: u64, inodes: u64, remedy: &'static str) -> Result<(), Error> {
    let expected = format!("{} MiB for this run", bytes.div_ceil(MIB));
    let refuse = |found: String| insufficient(folder.display(), found, &expected, remedy);
    let StatVfs { f_bavail, f_frsize, f_favail, f_files, .. } =
        statvfs(folder).map_err(|error| refuse(error.to_string()))?;
    access(folder, Access::WRITE_OK).map_err(|error| refuse(format!("not writable ({error})")))?;
    if f_bavail * f_frsize < bytes {
        return Err(refuse(format!("{} MiB free", f_bavail * f_frsize / MIB)));
    }
    if f_files > 0 && f_favail < inodes {
        return Err(refuse(format!("room for {f_favail} files")));
    }
    Ok(())
}

/// The error for too little of a resource.
fn insufficient(what: impl Display, found: String, expected: impl Display, remedy: &'static str) -> Error {
    Error::Insufficient { what: what.to_string(), found, expected: expected.to_string(), remedy }
}

/// The folder, or its nearest ancestor that exists.
fn existing(folder: PathBuf) -> PathBuf {
    folder.ancestors().find(|folder| folder.is_dir()).unwrap_or(Path::new("/")).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_names_the_resource_and_the_required_amount() {
        let error = check_space(Path::new("/dev/shm"), 1 << 60, 0, "free some").unwrap_err().to_string();
        assert!(error.starts_with("/dev/shm: ") && error.contains(" MiB free: expected 1099511627776 MiB"), "{error}");
        let error = check_space(Path::new("/nowhere"), 1, 0, "free some").unwrap_err().to_string();
        assert!(error.contains("/nowhere: No such file"), "{error}");
        assert!(check_space(Path::new("/dev/shm"), 1, 0, "free some").is_ok());
    }

    #[test]
    fn a_file_size_limit_is_refused_before_the_start() {
        let error = check_file_size(Some(1_000), LARGEST_SHARED).unwrap_err().to_string();
        assert!(error.ends_with("at most 1000 bytes: expected 2097152: raise ulimit -f"), "{error}");
        assert!(check_file_size(Some(LARGEST_SHARED), LARGEST_SHARED).is_ok());
        assert!(check_file_size(None, LARGEST_SHARED).is_ok());
    }

    #[test]
    fn the_nearest_existing_ancestor_is_found() {
        assert_eq!(existing("/tmp/nowhere/at/all".into()), Path::new("/tmp"));
    }
}
