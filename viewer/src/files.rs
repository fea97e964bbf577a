//! The files of a recording. Each has one writer; a viewer that is started again writes the next one.
//!
//! `mission.rrd`, `mission-2.rrd`, `mission-3.rrd` ... share one recording id, by which rerun opens them as one
//! recording. Each holds the style and the layout, and can be opened alone.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use rerun::external::re_log_encoding::DecoderApp;

/// Whether a file begins the recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// It does.
    First,
    /// An earlier file does. What that one drew last stays on the screen until this one draws it anew.
    Later,
}

/// The next file to write.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct NextFile {
    /// Its path.
    pub(crate) path: PathBuf,
    /// Id of the recording that the files before it have begun; none if they hold none.
    pub(crate) recording_id: Option<String>,
}

impl NextFile {
    /// The first of `first`, `first-2`, `first-3` ... to which nothing has been written, for a recording of
    /// `application`.
    pub(crate) fn find(first: &Path, application: &str) -> Self {
        let mut recording_id = None;
        let mut number = 1;
        loop {
            let path = numbered(first, number);
            if !fs::metadata(&path).is_ok_and(|file| file.len() > 0) {
                return Self { path, recording_id };
            }
            recording_id = recording_id.or_else(|| recording_id_of(&path, application));
            number += 1;
        }
    }
}

/// The path of file `number`, counted from 1: `mission.rrd`, `mission-2.rrd` ...
fn numbered(first: &Path, number: u32) -> PathBuf {
    if number == 1 {
        return first.to_owned();
    }
    let mut name = first.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{number}"));
    if let Some(extension) = first.extension() {
        name.push(".");
        name.push(extension);
    }
    first.with_file_name(name)
}

/// Id of the recording of `application` in a file, from its first messages; none if there is no such recording.
fn recording_id_of(path: &Path, application: &str) -> Option<String> {
    let messages = DecoderApp::decode_lazy(BufReader::new(File::open(path).ok()?)).map_while(Result::ok);
    let mut stores = messages.map(|message| message.store_id().clone());
    let store = stores.find(|store| store.is_recording() && store.application_id().as_str() == application)?;
    Some(store.recording_id().as_str().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_numbered_before_their_extension() {
        let names = |first: &str| [1, 2, 12].map(|number| numbered(Path::new(first), number).display().to_string());
        assert_eq!(names("run/mission.rrd"), ["run/mission.rrd", "run/mission-2.rrd", "run/mission-12.rrd"]);
        assert_eq!(names("a.b/mission"), ["a.b/mission", "a.b/mission-2", "a.b/mission-12"]);
    }
}
