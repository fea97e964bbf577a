//! Where the executables are: those of the ring, and commands of the PATH.

use std::env;
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

/// The name of the command line program.
const COMMAND_LINE: &str = "skysink";

/// The executable and the first arguments that start the program `name`: the executable of that name beside `skysink`,
/// otherwise this one, which contains it ([`crate::programs::of`]).
///
/// # Errors
/// If the path of this executable is unknown.
pub fn command_of(name: &str) -> io::Result<(PathBuf, Vec<OsString>)> {
    let this = env::current_exe()?;
    let beside = this.with_file_name(name);
    let is_separate = this.file_name() == Some(COMMAND_LINE.as_ref()) && is_executable(&beside);
    Ok(if is_separate { (beside, Vec::new()) } else { (this, vec![name.into()]) })
}

/// Whether `program` is an executable file: a path, or a name in a folder of PATH.
#[must_use]
pub fn is_command(program: &str) -> bool {
    if program.contains('/') {
        return is_executable(Path::new(program));
    }
    let folders = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&folders).any(|folder| is_executable(&folder.join(program)))
}

fn is_executable(path: &Path) -> bool {
    path.is_file() && rustix::fs::access(path, rustix::fs::Access::EXEC_OK).is_ok()
}
