//! Options that are commands of the Python package now: grids of heights and flight logs. They are refused by a line
//! with the command.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::Args;
use skysink_common::error::InputError;
use skysink_common::terminal::{shell_path, shell_word};

/// Other options that the command for flight logs has.
const OF_LOGS: [&str; 3] = ["--sensors", "--zones", "--out"];

/// The options.
#[derive(Debug, Clone, Default, Args)]
pub struct MovedOptions {
    /// Heights of the ground.
    #[arg(long, hide = true, value_name = "FILE")]
    terrain: Option<PathBuf>,
    /// Least height of the flight above the ground [m].
    #[arg(long, hide = true, value_name = "M", allow_hyphen_values = true)]
    clearance: Option<String>,
    /// Folder of a flight log.
    #[arg(long, hide = true, value_name = "DIR")]
    log: Option<PathBuf>,
}

impl MovedOptions {
    /// # Errors
    /// If one is given; the message has the command instead, for the mission `name` with these other options and
    /// values.
    pub fn check(&self, name: &str, others: &[(&str, Option<OsString>)]) -> Result<(), InputError> {
        let Self { terrain, clearance, log } = self;
        let (option, module) = match (terrain, clearance, log) {
            (None, None, None) => return Ok(()),
            (Some(_), _, Some(_)) => {
                let expected = "expected one of --terrain and --log, which are two commands of the Python package";
                return Err(InputError::of_argument("option", "--log", expected));
            }
            (None, None, Some(_)) => ("--log", "measured"),
            (None, Some(_), _) => ("--clearance", "terrain"),
            (Some(_), ..) => ("--terrain", "terrain"),
        };
        let mut command = format!("python -m skysink.{module} {}", shell_path(Path::new(name)));
        let paths = [("--terrain", terrain.as_deref()), ("--log", log.as_deref())];
        for (option, value) in others.iter().filter(|(option, _)| module == "terrain" || OF_LOGS.contains(option)) {
            command +=
                &value.iter().map(|value| format!(" {option} {}", shell_path(value.as_ref()))).collect::<String>();
        }
        for (option, path) in paths.into_iter().filter_map(|(option, path)| Some((option, path?))) {
            command += &format!(" {option} {}", shell_path(path));
        }
        if let Some(clearance) = clearance {
            command += &format!(" --clearance {}", shell_word(clearance));
        }
        let expected = format!("expected the command of the Python package that reads it: {command}");
        Err(InputError::of_argument("option", option, expected))
    }
}
