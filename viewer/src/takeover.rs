//! Going on with a recording that another process began and perhaps did not end, so that a run has one file.
//!
//! The new file grows beside the old one, hidden, until it holds everything of it and all that stays; then it takes
//! its place in one step. Whenever a process is killed, one whole file has all that was ever written: before that step
//! the old one, and a rest beside it that the next take-over overwrites; afterwards the new one.
//!
//! What stays and the layout are drawn anew and left out of what is taken over, so that a file does not grow by being
//! continued. A message that is cut or spoilt is left out; a file without a recording of this program is replaced.

use std::fs::{self, File};
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rerun::external::re_log_encoding::{DecodeError, DecoderApp, DecoderIterator};
use rerun::log::{Chunk, LogMsg};
use rerun::sink::SinkFlushError;
use rerun::{RecordingStream, StoreId};

use crate::history::History;
use crate::recording::{APPLICATION, SceneError};

/// Bytes of the old file after which a take-over waits for the new one, so that memory holds no whole recording.
const STRIDE_BYTES: u64 = 8 << 20;

/// What to do with a file that is there already.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Existing {
    /// Begin anew.
    #[default]
    Replace,
    /// Keep what it holds, and its recording id; begin anew where there is nothing to keep.
    Continue,
}

/// What a file holds before it is written to.
pub(crate) enum Found {
    /// It is not there, or is to be replaced.
    Nothing,
    /// Something, but no recording of this program.
    NoRecording,
    /// A recording.
    Begun(Begun),
}

/// A recording that another process began.
pub(crate) struct Begun {
    path: PathBuf,
    store: StoreId,
}

/// What came over from the file.
pub(crate) enum Past {
    /// There was none, or it was to be replaced.
    Nothing,
    /// No recording of this program was in it.
    NoRecording,
    /// All that could be read.
    Recording(History),
}

impl Found {
    /// Looks into a file.
    pub(crate) fn at(path: &Path, existing: Existing) -> Result<Self, SceneError> {
        if existing == Existing::Replace || !path.is_file() {
            return Ok(Self::Nothing);
        }
        let begun = || -> io::Result<Option<Begun>> {
            let path = path.canonicalize()?; // a link stays one
            let mut messages = Messages::of(&path)?;
            while let Some(message) = messages.next()? {
                let store = message.store_id();
                if store.is_recording() && store.application_id().as_str() == APPLICATION {
                    return Ok(Some(Begun { path, store: store.clone() }));
                }
            }
            Ok(None)
        };
        let begun = begun().map_err(|source| unusable(path, source))?;
        Ok(begun.map_or(Self::NoRecording, Self::Begun))
    }

    /// The recording, if there is one.
    pub(crate) fn begun(&self) -> Option<&Begun> {
        match self {
            Self::Begun(begun) => Some(begun),
            Self::Nothing | Self::NoRecording => None,
        }
    }
}

impl Begun {
    /// The recording's id, which is its name.
    pub(crate) fn name(&self) -> &str {
        self.store.recording_id().as_str()
    }

    /// Where the new file grows.
    pub(crate) fn draft(&self) -> PathBuf {
        let mut name = std::ffi::OsString::from(".");
        name.push(self.path.file_name().unwrap_or_default());
        name.push(".part");
        self.path.with_file_name(name)
    }

    /// Forwards all that has a time to `stream`, which writes the draft, and puts that in the place of the old file.
    /// On an error the old file is as it was.
    pub(crate) fn take_over(&self, stream: &RecordingStream, limit: Duration) -> Result<History, SceneError> {
        let replaced = || -> Result<History, SceneError> {
            let history = self.forward(stream, limit)?;
            let replace = File::open(self.draft()).and_then(|draft| draft.sync_all());
            replace.and_then(|()| fs::rename(self.draft(), &self.path)).map_err(|error| unusable(&self.path, error))?;
            Ok(history)
        };
        replaced().inspect_err(|_| {
            let _ = fs::remove_file(self.draft()); // if that fails, too, the next take-over overwrites it
        })
    }

    fn forward(&self, stream: &RecordingStream, limit: Duration) -> Result<History, SceneError> {
        let unusable = |source| unusable(&self.path, source);
        let flush = || stream.flush_with_timeout(limit).map_err(|source| self.unfinished(source));
        let (mut history, mut flushed_bytes) = (History::default(), 0);
        let mut messages = Messages::of(&self.path).map_err(unusable)?;
        while let Some(message) = messages.next().map_err(unusable)? {
            let (store, is_layout) = (message.store_id(), !message.store_id().is_recording());
            match &message {
                _ if is_layout => continue,
                LogMsg::SetStoreInfo(_) if *store == self.store => continue,
                LogMsg::SetStoreInfo(_) | LogMsg::BlueprintActivationCommand(_) => {}
                LogMsg::ArrowMsg(..) if *store != self.store => {} // somebody has merged files
                LogMsg::ArrowMsg(_, arrow) => match Chunk::from_arrow_msg(arrow) {
                    Ok(chunk) if chunk.is_static() => continue,
                    Ok(chunk) => history.add(&chunk),
                    Err(_) => {
                        messages.spoilt += 1;
                        continue;
                    }
                },
            }
            stream.record_msg(message);
            if messages.decoded_bytes() >= flushed_bytes + STRIDE_BYTES {
                flush()?;
                flushed_bytes = messages.decoded_bytes();
            }
        }
        flush()?;
        history.spoilt = messages.spoilt;
        Ok(history)
    }

    fn unfinished(&self, source: SinkFlushError) -> SceneError {
        SceneError::Unfinished { path: Some(self.path.clone()), source }
    }
}

fn unusable(path: &Path, source: io::Error) -> SceneError {
    SceneError::Unusable { path: path.to_owned(), source }
}

/// The whole messages of a file, one at a time.
struct Messages {
    decoder: DecoderIterator<LogMsg, BufReader<File>>,
    /// Messages that could not be decoded.
    spoilt: u64,
}

impl Messages {
    fn of(path: &Path) -> io::Result<Self> {
        let file = BufReader::with_capacity(1 << 16, File::open(path)?);
        Ok(Self { decoder: DecoderApp::decode_lazy(file), spoilt: 0 })
    }

    /// The next one; `None` at the end, or where nothing makes sense any more.
    fn next(&mut self) -> io::Result<Option<LogMsg>> {
        loop {
            let before_bytes = self.decoded_bytes();
            match self.decoder.next() {
                None => return Ok(None),
                Some(Ok(message)) => return Ok(Some(message)),
                Some(Err(DecodeError::Read(error))) => return Err(error),
                Some(Err(DecodeError::Codec(_))) if self.decoded_bytes() == before_bytes => return Ok(None),
                Some(Err(DecodeError::Codec(_))) => self.spoilt += 1,
            }
        }
    }

    fn decoded_bytes(&self) -> u64 {
        self.decoder.num_bytes_processed()
    }
}
