//! Locks of files (flock), which some file systems do not have.

use std::io;

/// The errors of Linux for a file system without locks: ENOLCK, ENOSYS, EOPNOTSUPP, and ENOTSUPP, which is not in libc.
const UNSUPPORTED: [i32; 4] = [37, 38, 95, 524];

/// The error of a lock, with the remedy if the file system has none.
#[must_use]
pub fn with_remedy(error: io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(number) if UNSUPPORTED.contains(&number) => io::Error::new(
            io::ErrorKind::Unsupported,
            format!(
                "its file system has no locks (flock, os error {number}): use a folder on a local disk, or mount it \
                 with locks (for Lustre the option flock)"
            ),
        ),
        _ => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_system_without_locks_is_named_with_the_remedy() {
        for number in UNSUPPORTED {
            let text = with_remedy(io::Error::from_raw_os_error(number)).to_string();
            assert!(
                text.contains(&format!("no locks (flock, os error {number})")) && text.contains("local disk"),
                "{text}"
            );
        }
        let other = with_remedy(io::Error::from_raw_os_error(13));
        assert_eq!(other.raw_os_error(), Some(13));
    }
}
