//! The inputs that are kept, and those that went wrong.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::xxh3_64;

/// Where this crate is.
const HOME: &str = env!("CARGO_MANIFEST_DIR");

/// The kept inputs of a target by name, in the order of their names.
///
/// # Errors
/// If they cannot be read.
pub fn read(target: &str) -> io::Result<Vec<(PathBuf, Vec<u8>)>> {
    let mut files: Vec<PathBuf> = fs::read_dir(Path::new(HOME).join("corpus").join(target))?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<io::Result<_>>()?;
    files.sort_unstable();
    files.into_iter().map(|file| fs::read(&file).map(|bytes| (file, bytes))).collect()
}

/// Keeps an input that went wrong, and returns where.
///
/// # Errors
/// If it cannot be written.
pub fn keep(target: &str, bytes: &[u8]) -> io::Result<PathBuf> {
    let folder = Path::new(HOME).join("artifacts").join(target);
    fs::create_dir_all(&folder)?;
    let file = folder.join(format!("{:016x}", xxh3_64(bytes)));
    fs::write(&file, bytes)?;
    Ok(file)
}
