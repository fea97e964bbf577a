//! What is shown: recordings, as files or found in folders, and a running mission.

use std::fs::{self, DirEntry, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_mission::error::FileContext;

use crate::error::Error;

/// The first bytes of every rerun recording.
const MAGIC: &[u8] = b"RRF2";

/// The content of a page.
pub struct PageContent {
    pub recordings: Vec<PathBuf>,
    /// The port of a running mission on this machine.
    pub live: Option<u16>,
}

#[cfg(not(feature = "viewer"))]
impl PageContent {
    /// The command that opens the content with rerun.
    pub fn rerun_command(&self) -> String {
        let files = self.recordings.iter().map(|recording| format!(" {}", recording.display()));
        let live = self.live.map(|port| format!(" rerun+http://127.0.0.1:{port}/proxy"));
        format!("rerun{}", files.chain(live).collect::<String>())
    }
}

/// The folder in `runs` with the newest recording: of a run, a replay or a comparison.
pub fn newest(runs: &Path) -> Result<PathBuf, InputError> {
    let written = |folder: &PathBuf| {
        let recordings = recordings_in(folder).ok()?;
        recordings.iter().filter_map(|recording| fs::metadata(recording).and_then(|file| file.modified()).ok()).max()
    };
    let folders = fs::read_dir(runs).into_iter().flatten().flatten().map(|entry| entry.path());
    let newest = folders.filter_map(|folder| Some((written(&folder)?, folder))).max();
    newest.map(|(_, folder)| folder).ok_or_else(|| {
        let message = "it contains no recording: make one with `skysink run`, or name a run or recording";
        InputError::new("folder", runs, message)
    })
}

/// All recordings in these run folders; a file is a recording itself.
pub fn recordings(runs: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut recordings = Vec::new();
    for run in runs {
        if !run.is_dir() {
            check(run)?;
            recordings.push(run.clone());
            continue;
        }
        let found = recordings_in(run).at(run)?;
        if found.is_empty() {
            let run_path = run.display();
            let message =
                format_args!("it contains no recording: make one of a finished run with `skysink replay {run_path}`");
            return Err(InputError::new("recording", run, message).into());
        }
        found.iter().try_for_each(|recording| check(recording))?;
        recordings.extend(found);
    }
    Ok(recordings)
}

/// The non-empty files with the extension of recordings in a folder, in the order of their creation.
fn recordings_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let is_recording = |entry: &DirEntry| {
        let is_named = entry.path().extension().is_some_and(|ending| ending == "rrd");
        is_named && entry.metadata().is_ok_and(|file| file.is_file() && file.len() > 0)
    };
    let mut found: Vec<PathBuf> =
        fs::read_dir(folder)?.flatten().filter(is_recording).map(|entry| entry.path()).collect();
    found.sort_by_key(|path| (path.as_os_str().len(), path.clone())); // mission.rrd before mission-2.rrd
    Ok(found)
}

/// Checks that the path is a file that starts like a recording.
fn check(path: &Path) -> Result<(), InputError> {
    let is_recording = || {
        let mut begin = Vec::new();
        let is_file = fs::metadata(path)?.is_file(); // opening a pipe would block until it has a writer
        if is_file {
            File::open(path)?.take(MAGIC.len() as u64).read_to_end(&mut begin)?;
        }
        Ok::<bool, io::Error>(begin == MAGIC)
    };
    match is_recording() {
        Ok(true) => Ok(()),
        Ok(false) => {
            Err(InputError::new("recording", path, "expected a recording of rerun (.rrd), or a folder with one"))
        }
        Err(error) => Err(InputError::new("recording", path, error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;
    use std::process::Command;
    use std::time::Duration;

    #[test]
    fn the_recordings_of_a_folder_are_its_regular_files_with_a_recording() {
        let place = tempfile::tempdir().unwrap();
        let [run, secret] = ["run", "secret.txt"].map(|name| place.path().join(name));
        fs::create_dir(&run).unwrap();
        fs::write(&secret, "secret").unwrap();
        assert!(recordings(std::slice::from_ref(&run)).unwrap_err().to_string().contains("it contains no recording"));
        symlink(&secret, run.join("mission-3.rrd")).unwrap();
        fs::create_dir(run.join("mission-4.rrd")).unwrap();
        fs::write(run.join("mission-5.rrd"), "").unwrap(); // just begun
        assert!(Command::new("mkfifo").arg(run.join("mission-6.rrd")).status().unwrap().success());
        assert!(recordings(std::slice::from_ref(&run)).is_err());
        for name in ["mission-10.rrd", "mission-2.rrd"] {
            fs::write(run.join(name), "RRF2 and so on").unwrap();
        }
        let expected = ["mission-2.rrd", "mission-10.rrd"].map(|name| run.join(name));
        assert_eq!(recordings(std::slice::from_ref(&run)).unwrap(), expected);
        assert!(recordings(&[run.join("mission-6.rrd")]).is_err(), "a pipe");
        fs::write(run.join("mission-11.rrd"), "something else").unwrap();
        let refused = recordings(&[run]).unwrap_err().to_string();
        assert!(refused.contains("mission-11.rrd: expected a recording of rerun"), "{refused}");
    }

    #[test]
    fn the_newest_recording_is_shown_instead_of_the_newest_run() {
        let place = tempfile::tempdir().unwrap();
        assert!(newest(place.path()).is_err());
        for (name, recording, seconds) in [("old", true, 1), ("replay", true, 5), ("simulated", false, 9)] {
            let folder = place.path().join(name);
            fs::create_dir(&folder).unwrap();
            fs::write(folder.join("slots.csv"), "").unwrap();
            if recording {
                let file = File::create(folder.join("mission.rrd")).unwrap();
                io::Write::write_all(&mut &file, MAGIC).unwrap();
                file.set_modified(std::time::UNIX_EPOCH + Duration::from_secs(seconds)).unwrap();
            }
        }
        assert_eq!(newest(place.path()).unwrap(), place.path().join("replay"));
    }
}
