//! The file of a recording. A sink encodes messages and writes them batch by batch; it keeps the first error until the
//! end: a mission is flown to its end even if its recording cannot be.
//!
//! Batches end with a slot. A process that is killed while it writes one leaves a part of it, which [`ends_batch`] tells
//! from a whole one; the first batch comes into the file as a whole.
//!
//! rerun's own file sink logs an error, ends its thread, and may then wait forever for that thread.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use re_build_info::CrateVersion;
use re_log_encoding::{EncodeError, Encoder, EncodingOptions};
use re_log_types::{EntityPath, LogMsg};
use re_sdk::sink::{LogSink, SinkFlushError};

use crate::files::begin_file;

/// An open file; clones share it.
#[derive(Clone)]
pub(crate) struct RrdFile(Arc<Shared>);

struct Shared {
    encoding: Mutex<Encoding>,
    /// Notified when a batch has been written.
    written: Condvar,
}

struct Encoding {
    encoder: Encoder<Batches>,
    /// The message that ends the next batch.
    end: Option<LogMsg>,
    /// Number of batches that were begun, and written.
    begun: u64,
    written: u64,
    /// The first error. Nothing is written after it, so that what precedes it can be read.
    error: Option<String>,
}

impl Encoding {
    fn attempt<T>(&mut self, action: impl FnOnce(&mut Encoder<Batches>) -> Result<T, EncodeError>) {
        if self.error.is_some() {
            return;
        }
        if let Err(error) = action(&mut self.encoder) {
            self.error = Some(error.to_string());
            self.encoder.do_not_emit_footer();
        }
    }
}

/// Whether a message ends a batch: it names the recording, as a static property, which changes nothing.
pub(crate) fn ends_batch(message: &LogMsg) -> bool {
    let LogMsg::ArrowMsg(store, message) = message else { return false };
    let schema = message.batch.schema();
    let entity = schema.metadata().get("rerun:entity_path");
    store.is_recording() && entity.is_some_and(|entity| *entity == EntityPath::properties().to_string())
}

/// A file to which a batch is written when it is flushed.
struct Batches {
    path: PathBuf,
    /// `None` before the first batch.
    file: Option<File>,
    /// The bytes of the next batch.
    batch: Vec<u8>,
    /// The bytes of those before.
    length: u64,
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
            None => self.file = Some(begin_file(&self.path, &batch)?),
            Some(file) => file.write_all(&batch).inspect_err(|_| drop(file.set_len(self.length)))?,
        }
        self.length += batch.len() as u64;
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
        Self::new(Batches {
            path: path.to_owned(),
            file: Some(file).filter(|_| !is_replaced),
            batch: Vec::new(),
            length: 0,
        })
    }

    fn new(batches: Batches) -> io::Result<Self> {
        let encoder = Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, batches);
        let encoder = encoder.map_err(io::Error::other)?;
        let encoding = Mutex::new(Encoding { encoder, end: None, begun: 0, written: 0, error: None });
        Ok(Self(Arc::new(Shared { encoding, written: Condvar::new() })))
    }

    /// Waits, at most for `limit`, until the last batch has been written, so that it has no part of the next one.
    pub(crate) fn begin_batch(&self, limit: Duration) {
        let encoding = self.lock();
        let waited = self.0.written.wait_timeout_while(encoding, limit, |encoding| encoding.written < encoding.begun);
        waited.unwrap_or_else(PoisonError::into_inner).0.begun += 1;
    }

    /// Writes the footer.
    ///
    /// # Errors
    /// The first error since the file was created.
    pub(crate) fn finish(&self) -> Result<(), SinkFlushError> {
        let mut encoding = self.lock();
        encoding.attempt(Encoder::finish);
        encoding.attempt(Encoder::flush_blocking);
        encoding.error.as_ref().map_or(Ok(()), |error| Err(SinkFlushError::failed(error)))
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
    use std::os::fd::OwnedFd;

    use re_log_types::{BlueprintActivationCommand, StoreId, StoreKind};

    use super::*;

    fn message() -> LogMsg {
        let blueprint_id = StoreId::random(StoreKind::Blueprint, "test");
        BlueprintActivationCommand { blueprint_id, make_active: true, make_default: true }.into()
    }

    #[test]
    fn the_first_error_ends_the_file_and_is_that_of_its_end() {
        let (reader, writer) = io::pipe().unwrap();
        let file = Some(File::from(OwnedFd::from(writer)));
        let file = RrdFile::new(Batches { path: PathBuf::new(), file, batch: Vec::new(), length: 0 }).unwrap();
        drop(reader); // every write fails from here on
        file.send(message());
        assert!(file.flush_blocking(Duration::ZERO).is_ok());
        file.send(message());
        let error = file.finish().unwrap_err().to_string();
        assert!(error.contains("Broken pipe"), "{error}");
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
