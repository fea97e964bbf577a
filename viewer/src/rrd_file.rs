//! The file of a recording. A sink encodes and writes messages into it, and keeps the first error until the end: a
//! mission is flown to its end even if its recording cannot be.
//!
//! rerun's own file sink logs an error, ends its thread, and may then wait forever for that thread.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use re_build_info::CrateVersion;
use re_log_encoding::{EncodeError, Encoder, EncodingOptions};
use re_log_types::LogMsg;
use re_sdk::sink::{LogSink, SinkFlushError};

/// An open file; clones share it.
#[derive(Clone)]
pub(crate) struct RrdFile(Arc<Mutex<Encoding>>);

struct Encoding {
    encoder: Encoder<File>,
    /// The first error. Nothing is written after it, so that what precedes it can be read.
    error: Option<String>,
}

impl Encoding {
    fn attempt<T>(&mut self, action: impl FnOnce(&mut Encoder<File>) -> Result<T, EncodeError>) {
        if self.error.is_some() {
            return;
        }
        if let Err(error) = action(&mut self.encoder) {
            self.error = Some(error.to_string());
            self.encoder.do_not_emit_footer();
        }
    }
}

impl RrdFile {
    /// Creates or truncates the file, and writes its header.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        let file = File::create(path)?;
        let encoder = Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, file);
        let encoder = encoder.map_err(io::Error::other)?;
        Ok(Self(Arc::new(Mutex::new(Encoding { encoder, error: None }))))
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
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogSink for RrdFile {
    fn send(&self, message: LogMsg) {
        self.lock().attempt(|encoder| encoder.append(&message));
    }

    /// Never an error: rerun would log it, and [`RrdFile::finish`] returns it.
    fn flush_blocking(&self, _timeout: Duration) -> Result<(), SinkFlushError> {
        self.lock().attempt(Encoder::flush_blocking);
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

    #[test]
    fn the_first_error_ends_the_file_and_is_that_of_its_end() {
        let (reader, writer) = io::pipe().unwrap();
        let encoder = Encoder::new_eager(
            CrateVersion::LOCAL,
            EncodingOptions::PROTOBUF_COMPRESSED,
            File::from(OwnedFd::from(writer)),
        );
        let file = RrdFile(Arc::new(Mutex::new(Encoding { encoder: encoder.unwrap(), error: None })));
        drop(reader); // every write fails from here on
        let blueprint_id = StoreId::random(StoreKind::Blueprint, "test");
        let message = BlueprintActivationCommand { blueprint_id, make_active: true, make_default: true };
        file.send(message.clone().into());
        file.send(message.into());
        assert!(file.flush_blocking(Duration::ZERO).is_ok());
        let error = file.finish().unwrap_err().to_string();
        assert!(error.contains("Broken pipe"), "{error}");
    }
}
