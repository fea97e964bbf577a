//! The files of a recording. Each has one writer; a restarted viewer writes the next one.
//!
//! `mission.rrd`, `mission-2.rrd`, `mission-3.rrd` and so on share one recording id, so that rerun opens them as one
//! recording. Each contains the styles and the layout, and can be opened alone.

use std::borrow::Cow;
use std::fs::{self, File, Permissions, TryLockError};
use std::io::{self, BufReader, BufWriter, Read as _, Seek as _, SeekFrom, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use re_build_info::CrateVersion;
use re_log_encoding::rrd::{Decodable as _, EncodingOptions, RRD_FOURCC, StreamFooter};
use re_log_encoding::{DecoderApp, EncodeError, Encoder};
use re_log_types::{EntityPath, LogMsg};
use re_sdk::log::Chunk;
use re_sdk::{ApplicationId, TimelineName};
use tempfile::NamedTempFile;

use crate::slot::SLOT;

/// Whether a file is the first of its recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// It is the first.
    First,
    /// It continues an earlier file, whose entities stay visible until this file replaces them.
    Later,
}

/// The next file to write.
#[derive(Debug)]
pub(crate) struct NextFile {
    /// Its path.
    pub(crate) path: PathBuf,
    /// Locked while it is written; `None` if the file system has no locks, or the file cannot be created.
    pub(crate) _lock: Option<File>,
    /// Id of the recording in the earlier files; `None` if they contain none.
    pub(crate) recording_id: Option<String>,
}

impl NextFile {
    /// The first of `first`, `first-2`, `first-3` and so on that is empty and not locked, for a recording of
    /// `application`.
    pub(crate) fn find(first: &Path, application: &ApplicationId) -> Self {
        let mut recording_id = None;
        let mut number = 1;
        loop {
            let path = numbered(first, number);
            let is_begun = fs::metadata(&path).is_ok_and(|file| file.len() > 0);
            let file = File::options().append(true).create(true).open(&path);
            let lock = file.map(|file| (file.try_lock(), file));
            match lock {
                Ok((Err(TryLockError::WouldBlock), _)) => {} // another viewer is about to write it
                Ok((Ok(()), file)) if !is_begun && file.metadata().is_ok_and(|file| file.len() == 0) => {
                    return Self { path, _lock: Some(file), recording_id };
                }
                _ if !is_begun => return Self { path, _lock: None, recording_id },
                _ => {}
            }
            recording_id = recording_id.or_else(|| recording_id_of(&path, application));
            number += 1;
        }
    }
}

/// The path of the file with this number, from 1: `mission.rrd`, `mission-2.rrd` and so on.
fn numbered(first: &Path, number: u32) -> PathBuf {
    if number == 1 {
        return first.to_owned();
    }
    let mut name = first.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{number}"));
    first.with_file_name(name).with_added_extension(first.extension().unwrap_or_default())
}

/// Whether a file ends with the footer of a closed recording.
///
/// # Errors
/// If the file cannot be read.
pub fn has_footer(path: &Path) -> io::Result<bool> {
    let mut file = File::open(path)?;
    let mut end = [0; StreamFooter::ENCODED_SIZE_BYTES];
    let length = i64::try_from(end.len()).expect("a few bytes");
    if file.seek(SeekFrom::End(-length)).is_err() {
        return Ok(false); // it is shorter
    }
    file.read_exact(&mut end)?;
    Ok(StreamFooter::from_rrd_bytes(&end).is_ok())
}

/// Whether a file starts like a recording, or is that of a viewer that was killed before its first batch, which is
/// empty. Other files must not be changed.
fn is_recording(path: &Path) -> bool {
    let mut begin = Vec::new();
    let read = File::open(path).and_then(|file| file.take(RRD_FOURCC.len() as u64).read_to_end(&mut begin));
    read.is_ok() && (begin.is_empty() || begin == RRD_FOURCC)
}

/// Locks the file of a recording. Its writer holds the lock until it ends.
fn lock(path: &Path) -> io::Result<File> {
    let file = File::open(path)?;
    file.try_lock()?;
    Ok(file)
}

/// Adds the missing footer to all files of the recording that starts with `first`. Skips files that a viewer is still
/// writing.
///
/// # Errors
/// If a file cannot be rewritten. It can be opened nevertheless.
pub fn complete(first: &Path) -> Result<(), EncodeError> {
    let files = (1..).map(|number| numbered(first, number)).take_while(|path| path.exists());
    for path in files {
        remove_unfinished(&path)?;
        if is_recording(&path)
            && !has_footer(&path)?
            && let Ok(_lock) = lock(&path)
        {
            rewrite(&path)?;
        }
    }
    Ok(())
}

/// Whether a message ends a batch: it names the recording, as a static property, which changes nothing.
pub(crate) fn ends_batch(message: &LogMsg) -> bool {
    let LogMsg::ArrowMsg(store, message) = message else { return false };
    let schema = message.batch.schema();
    let entity = schema.metadata().get("rerun:entity_path");
    store.is_recording() && entity.is_some_and(|entity| *entity == EntityPath::properties().to_string())
}

/// The slots of the rows of a message; none for static data.
fn slots_of(message: &LogMsg) -> Vec<i64> {
    let LogMsg::ArrowMsg(store, message) = message else { return Vec::new() };
    let chunk = Chunk::from_arrow_msg(message).ok().filter(|_| store.is_recording());
    let slots = chunk.as_ref().and_then(|chunk| chunk.timelines().get(&TimelineName::from_static_str(SLOT)));
    slots.map_or_else(Vec::new, |slots| slots.times_raw().to_vec())
}

/// Replaces a recording by a copy with all its complete batches and a footer: so all entities end with the same slot.
/// The copy of a file without batches has all complete messages. Such a file has the name of its recording only once,
/// amid the messages of its first slots; earlier versions wrote it so.
fn rewrite(path: &Path) -> Result<(), EncodeError> {
    let messages = DecoderApp::decode_lazy(BufReader::new(File::open(path)?)).map_while(Result::ok);
    let write = BufWriter::new(unfinished(path)?);
    let mut encoder = Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, write)?;
    let mut batch: Vec<LogMsg> = Vec::new();
    let mut ends = 0;
    let mut first_batch = None; // its last slot
    for message in messages {
        batch.push(message);
        if batch.last().is_some_and(ends_batch) {
            ends += 1;
            if ends == 1 {
                first_batch = batch.iter().flat_map(slots_of).max();
            }
            batch.drain(..).try_for_each(|message| encoder.append(&message).map(drop))?;
        }
    }
    let is_after_first = || batch.iter().flat_map(slots_of).min() > first_batch;
    let has_batches = ends > 1 || ends == 1 && first_batch.is_some() && is_after_first();
    if !has_batches {
        batch.iter().try_for_each(|message| encoder.append(message).map(drop))?;
    }
    encoder.finish()?;
    let new = encoder.into_inner()?.into_inner().map_err(io::IntoInnerError::into_error)?;
    new.persist(path).map_err(io::Error::from)?;
    Ok(())
}

/// A new file beside `path`, `.NAME.*.new`.
fn unfinished(path: &Path) -> io::Result<NamedTempFile> {
    let permissions = Permissions::from_mode(0o666); // less the umask
    tempfile::Builder::new()
        .prefix(&format!(".{}.", name(path)))
        .suffix(".new")
        .permissions(permissions)
        .tempfile_in(folder(path))
}

/// Removes the files of [`unfinished`] that killed processes have left, which are not locked.
fn remove_unfinished(path: &Path) -> io::Result<()> {
    let prefix = format!(".{}.", name(path));
    for entry in fs::read_dir(folder(path))?.flatten() {
        let found = entry.file_name();
        let is_own = found.to_string_lossy().strip_prefix(&prefix).is_some_and(|rest| rest.ends_with(".new"));
        if is_own && entry.file_type()?.is_file() && lock(&entry.path()).is_ok() {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Writes the beginning of a recording under another name, and renames it: no other process ever finds a part of it,
/// and a killed one leaves none. The file is locked.
///
/// # Errors
/// The system's.
pub(crate) fn begin_file(path: &Path, bytes: &[u8]) -> io::Result<File> {
    let path = path.canonicalize()?; // of a link, its target
    let mut new = unfinished(&path)?;
    let _ = new.as_file().try_lock(); // a file system may have no locks
    new.write_all(bytes)?;
    new.persist(&path).map_err(io::Error::from)
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn name(path: &Path) -> Cow<'_, str> {
    path.file_name().unwrap_or_default().to_string_lossy()
}

/// Id of the recording of `application` in a file, from its first messages; `None` if there is no such recording.
fn recording_id_of(path: &Path, application: &ApplicationId) -> Option<String> {
    let messages = DecoderApp::decode_lazy(BufReader::new(File::open(path).ok()?)).map_while(Result::ok);
    let mut stores = messages.map(|message| message.store_id().clone());
    let store = stores.find(|store| store.is_recording() && store.application_id() == application)?;
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
