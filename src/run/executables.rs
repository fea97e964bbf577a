//! Where the executables are: those of the ring, and commands of the PATH.

use std::env;
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A command that runs the programs of the ring, such as `python3 -m skysink.programs`. The name of the program and its
/// arguments are appended.
#[derive(Debug)]
pub struct Interpreter(pub Vec<OsString>);

/// The interpreter; if unset, programs are executables in the folder of this one.
static INTERPRETER: OnceLock<Interpreter> = OnceLock::new();

/// The name of the command line program.
const COMMAND_LINE: &str = "skysink";

/// Sets the interpreter that starts programs from now on. Only the first call has an effect.
pub fn set_interpreter(interpreter: Interpreter) {
    let _ = INTERPRETER.set(interpreter);
}

/// The executable and the first arguments that start the program `name`.
///
/// # Errors
/// If the path of this executable is unknown.
pub fn command_of(name: &str) -> io::Result<(PathBuf, Vec<OsString>)> {
    if let Some((program, words)) = INTERPRETER.get().and_then(|Interpreter(words)| words.split_first()) {
        return Ok((program.into(), [words, &[name.into()]].concat()));
    }
    let this = env::current_exe()?;
    Ok((if name == COMMAND_LINE { this } else { this.with_file_name(name) }, Vec::new()))
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
