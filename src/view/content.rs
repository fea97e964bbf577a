//! What is shown: recordings, as files or found in folders, and a running mission.

use std::fs::{self, DirEntry};
use std::io;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::terminal::shell_path;
use skysink_mission::error::FileContext;
use skysink_ring::role::Role;

use super::recording::ShownRecording;
use crate::error::Error;

/// The content of a page.
pub struct PageContent {
    pub recordings: Vec<ShownRecording>,
    /// The port of a running mission on this machine.
    pub live: Option<u16>,
}

impl PageContent {
    /// Says why not all of a recording may be shown.
    pub fn warn(&self) {
        for notice in self.recordings.iter().flat_map(|recording| &recording.notices) {
            Role::Launcher.log(format_args!("warning: {notice}"));
        }
    }

    /// The command that opens the content with rerun.
    #[cfg(not(feature = "viewer"))]
    pub fn rerun_command(&self) -> String {
        let files = self.recordings.iter().map(|recording| format!(" {}", shell_path(&recording.path)));
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
///
/// # Errors
/// If a file is none that the viewer can show, or a folder has none.
pub fn recordings(runs: &[PathBuf]) -> Result<Vec<ShownRecording>, Error> {
    let mut recordings = Vec::new();
    for run in runs {
        if !run.is_dir() {
            recordings.push(ShownRecording::read(run)?);
            continue;
        }
        let found = recordings_in(run).at(run)?;
        if found.is_empty() {
            let run_path = shell_path(run);
            let message =
                format_args!("it contains no recording: make one of a finished run with `skysink replay {run_path}`");
            return Err(InputError::new("recording", run, message).into());
        }
        for recording in &found {
            recordings.push(ShownRecording::read(recording)?);
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::os::unix::fs::symlink;
    use std::process::Command;
    use std::time::Duration;

    /// A recording with a message, and its end.
    const WHOLE: [&[u8]; 4] =
        [b"RRF2\0\x24\x03\0\x01\x02\0\0", b"\x01\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0!", &[0; 8], &[0; 8]];

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
            fs::write(run.join(name), WHOLE.concat()).unwrap();
        }
        let expected = ["mission-2.rrd", "mission-10.rrd"].map(|name| run.join(name));
        let found = recordings(std::slice::from_ref(&run)).unwrap();
        assert_eq!(found, expected.map(|path| ShownRecording { path, notices: Vec::new() }));
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
                io::Write::write_all(&mut &file, b"RRF2").unwrap();
                file.set_modified(std::time::UNIX_EPOCH + Duration::from_secs(seconds)).unwrap();
            }
        }
        assert_eq!(newest(place.path()).unwrap(), place.path().join("replay"));
    }
}
