//! The file of a recording. A sink encodes messages and writes them batch by batch; it keeps the first error until the
//! end: a mission is flown to its end even if its recording cannot be.
//!
//! Batches end with a slot. A process that is killed while it writes one leaves a part of it, which [`ends_batch`]
//! tells from a whole one; the first batch comes into the file as a whole.
//!
//! rerun's own file sink logs an error, ends its thread, and may then wait forever for that thread.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use re_build_info::CrateVersion;
use re_log_encoding::{EncodeError, Encoder, EncodingOptions};
use re_log_types::LogMsg;
use re_sdk::sink::{LogSink, SinkFlushError};
use skysink_common::written_file::{Extent, FileChange, WrittenFile};

use crate::files::{begin_file, ends_batch};

/// An open file; clones share it.
#[derive(Clone)]
pub(crate) struct RrdFile(Arc<Shared>);

struct Shared {
    encoding: Mutex<Encoding>,
    /// Notified when a batch has been written.
    written: Condvar,
}

struct Encoding {
    /// `None` after the end.
    encoder: Option<Encoder<Batches>>,
    /// The message that ends the next batch.
    end: Option<LogMsg>,
    /// Number of batches that were begun, and written.
    begun: u64,
    written: u64,
    /// The first error. Nothing is written after it, so that what precedes it can be read.
    error: Option<EncodeError>,
}

impl Encoding {
    fn attempt<T>(&mut self, action: impl FnOnce(&mut Encoder<Batches>) -> Result<T, EncodeError>) {
        let Some(encoder) = self.encoder.as_mut().filter(|_| self.error.is_none()) else { return };
        if let Err(error) = action(encoder) {
            self.error = Some(error);
            encoder.do_not_emit_footer();
        }
    }
}

/// A file to which a batch is written when it is flushed.
struct Batches {
    path: PathBuf,
    /// `None` before the first batch.
    file: Option<WrittenFile>,
    /// The bytes of the next batch.
    batch: Vec<u8>,
}

impl Write for Batches {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.batch.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let batch = std::mem::take(&mut self.batch); // a failed batch is not written again
        match &mut self.file {
            _ if batch.is_empty() => {}
            None => {
                let file = begin_file(&self.path, &batch).map_err(|error| match error.kind() {
                    io::ErrorKind::NotFound => FileChange::Missing.into(), // it was created before
                    _ => error,
                })?;
                // Of a link, its target.
                let file = self.file.insert(WrittenFile::new(&self.path.canonicalize()?, file));
                file.add_known(&batch);
            }
            Some(file) => file.append(&batch)?,
        }
        Ok(())
    }
}

impl RrdFile {
    /// Creates the file, or opens it if it is there; its first batch replaces it.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        let file = File::options().append(true).create(true).open(path)?;
        let is_replaced = file.metadata()?.is_file(); // a pipe or a device is not
        let file = (!is_replaced).then(|| WrittenFile::new(path, file));
        Self::new(Batches { path: path.to_owned(), file, batch: Vec::new() })
    }

    fn new(batches: Batches) -> io::Result<Self> {
        let encoder = Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, batches);
        let encoder = encoder.map_err(io::Error::other)?;
        let encoding = Mutex::new(Encoding { encoder: Some(encoder), end: None, begun: 0, written: 0, error: None });
        Ok(Self(Arc::new(Shared { encoding, written: Condvar::new() })))
    }

    /// Waits, at most for `limit`, until the last batch has been written, so that it has no part of the next one.
    pub(crate) fn begin_batch(&self, limit: Duration) {
        let encoding = self.lock();
        let waited = self.0.written.wait_timeout_while(encoding, limit, |encoding| encoding.written < encoding.begun);
        waited.unwrap_or_else(PoisonError::into_inner).0.begun += 1;
    }

    /// Writes the footer, and compares the file with what was written.
    ///
    /// # Errors
    /// The first error since the file was created, or [`FileChange`](skysink_common::written_file::FileChange).
    pub(crate) fn finish(&self) -> Result<(), EncodeError> {
        let mut encoding = self.lock();
        encoding.attempt(Encoder::finish);
        encoding.attempt(Encoder::flush_blocking);
        match (encoding.error.take(), encoding.encoder.take()) {
            (Some(error), _) => Err(error),
            (None, Some(encoder)) => {
                let written = encoder.into_inner()?.file;
                Ok(written.map_or(Ok(()), |file| file.compare(Extent::Full))?)
            }
            (None, None) => Ok(()),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Encoding> {
        self.0.encoding.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogSink for RrdFile {
    /// Adds a message to the next batch.
    fn send(&self, message: LogMsg) {
        let mut encoding = self.lock();
        if ends_batch(&message) {
            encoding.end = Some(message);
        } else {
            encoding.attempt(|encoder| encoder.append(&message));
        }
    }

    /// Writes the batch. Never an error: rerun would log it, and [`RrdFile::finish`] returns it.
    fn flush_blocking(&self, _timeout: Duration) -> Result<(), SinkFlushError> {
        let mut encoding = self.lock();
        if let Some(end) = encoding.end.take() {
            encoding.attempt(|encoder| encoder.append(&end));
        }
        encoding.attempt(Encoder::flush_blocking);
        encoding.written += 1;
        self.0.written.notify_all();
        Ok(())
    }

    fn defers_finalization_to_shutdown(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::fd::OwnedFd;

    use re_log_types::{BlueprintActivationCommand, StoreId, StoreKind};

    use super::*;

    fn message() -> LogMsg {
        let blueprint_id = StoreId::random(StoreKind::Blueprint, "test");
        BlueprintActivationCommand { blueprint_id, make_active: true, make_default: true }.into()
    }

    #[test]
    fn the_first_error_ends_the_file_and_is_reported_at_its_end() {
        let (reader, writer) = io::pipe().unwrap();
        let file = Some(WrittenFile::new(Path::new("pipe"), File::from(OwnedFd::from(writer))));
        let file = RrdFile::new(Batches { path: PathBuf::new(), file, batch: Vec::new() }).unwrap();
        drop(reader); // every write fails from here on
        file.send(message());
        assert!(file.flush_blocking(Duration::ZERO).is_ok());
        file.send(message());
        let error = file.finish().unwrap_err().to_string();
        assert!(error.contains("Broken pipe"), "{error}");
    }

    #[test]
    fn a_file_that_another_process_has_changed_is_noticed_at_its_end() {
        let changes: [fn(&Path); 3] = [
            |path| fs::remove_file(path).unwrap(),
            |path| File::options().write(true).open(path).unwrap().set_len(10).unwrap(),
            |path| fs::write(path, fs::read(path).unwrap().to_ascii_lowercase()).unwrap(),
        ];
        for (change, is_begun) in changes.iter().zip([true; 3]).chain([(&changes[0], false)]) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("mission.rrd");
            let file = RrdFile::create(&path).unwrap();
            file.send(message());
            if is_begun {
                file.flush_blocking(Duration::ZERO).unwrap();
            }
            change(&path);
            file.send(message());
            let error = file.finish().unwrap_err();
            assert!(matches!(&error, EncodeError::Write(error) if FileChange::is_cause_of(error)), "{error}");
        }
    }

    #[test]
    fn a_pipe_and_the_target_of_a_link_are_written_too() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("link.rrd");
        std::os::unix::fs::symlink("target.rrd", &link).unwrap();
        for path in [&link, Path::new("/dev/null")] {
            let file = RrdFile::create(path).unwrap();
            file.send(message());
            file.finish().unwrap();
        }
        assert!(crate::has_footer(&folder.path().join("target.rrd")).unwrap());
    }

    #[test]
    fn a_batch_is_written_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mission.rrd");
        let file = RrdFile::create(&path).unwrap();
        let length = || std::fs::metadata(&path).unwrap().len();
        let mut before = 0;
        for _ in 0..3 {
            (0..5).for_each(|_| file.send(message()));
            assert_eq!(length(), before);
            assert!(file.flush_blocking(Duration::ZERO).is_ok());
            assert!(length() > before);
            before = length();
        }
        file.finish().unwrap();
        assert!(crate::has_footer(&path).unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no other file is left");
    }
}
