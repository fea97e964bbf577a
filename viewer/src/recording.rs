//! The stream of a scene: written to a file, a server for live viewers, or both.

use std::net::TcpListener;
use std::num::NonZeroU64;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use re_log_encoding::EncodeError;
use re_sdk::grpc_server::GrpcServerSink;
use re_sdk::log::ChunkBatcherConfig;
use re_sdk::sink::{LogSink, SinkFlushError};
use re_sdk::{ApplicationId, RecordingStream, RecordingStreamBuilder, RecordingStreamError};
use skysink_common::written_file::FileChange;

use crate::files::{NextFile, Part};
use crate::rrd_file::RrdFile;
use crate::slot::{SIM_TIME, SLOT};

/// Time between two batches of a file, with the slot in which it ends: what a killed process loses at most.
const FILE_TICK: Duration = Duration::from_secs(10);

/// Minimum time between two batches, and minimum number of slots of a batch that is sent before [`FILE_TICK`]. Each
/// batch adds a chunk per entity to the file and, for its index, to the memory of this process.
const MIN_TICK: Duration = Duration::from_secs(1);

/// See [`MIN_TICK`].
const MIN_SLOTS: u32 = 64;

/// A batch of this size is sent immediately. rerun's own batching does not respect slots and is not used: after a kill,
/// entities would end with different slots.
const BATCH_BYTES: usize = 32 << 20;

/// Approximate size of a slot [byte]: a constant, and per sensor node.
const SLOT_BYTES: [usize; 2] = [1024, 16];

/// Minimum time between two batches for a live viewer. A batch contains complete slots only.
const LIVE_TICK: Duration = Duration::from_millis(150);

/// Timeout for writing the last bytes. A disk that takes longer is considered broken.
const FLUSH_LIMIT: Duration = Duration::from_secs(120);

/// Size of the history that the server keeps for late viewers [byte].
const HISTORY_BYTES: u64 = 512 << 20;

/// The destinations of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Sinks {
    /// First file of the recording. If it is not empty, the next free one is written: `mission-2.rrd` after
    /// `mission.rrd`, and so on.
    pub save: Option<PathBuf>,
    /// Port on 127.0.0.1 for live viewers; 0 selects a free port.
    pub live: Option<u16>,
    /// K of the recording, which contains every K-th slot; `None` for 1. The first and the last slot of a complete
    /// mission and all events are always contained.
    pub every: Option<NonZeroU64>,
}

/// The error of recording a scene. Its `Display` is one line that names the location and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// Neither a file nor a port is given.
    #[error("recording: no destination: expected a file, a port for a live viewer, or both")]
    Nowhere,
    /// The file cannot be created.
    #[error("recording {}: {source}: expected a path where a file can be created", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The port is in use.
    #[error("live viewer: port {port} of 127.0.0.1: {source}: choose another port, or stop the process that uses it")]
    Port {
        /// The port.
        port: u16,
        /// The error of the system.
        source: std::io::Error,
    },
    /// A slot does not fit the sensor list.
    #[error("slot {slot}: {found} queues: expected {expected}, one per sensor node of the list")]
    Queues {
        /// The slot.
        slot: u64,
        /// Number of queues.
        found: usize,
        /// Number of sensor nodes.
        expected: usize,
    },
    /// rerun has failed.
    #[error("recording: {0}")]
    Stream(#[from] RecordingStreamError),
    /// Another process has changed the file.
    #[error("recording {}: {source}: skysink replay RUN makes a new one", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
        /// The change.
        source: std::io::Error,
    },
    /// The end of the recording could not be written.
    #[error("recording{}: {source}: its end is missing: check the free disk space and ulimit -f", at(path))]
    Unfinished {
        /// The file, if there is one.
        path: Option<PathBuf>,
        /// The error of the system.
        source: SinkFlushError,
    },
}

fn at(path: &Option<PathBuf>) -> String {
    path.as_ref().map_or_else(String::new, |path| format!(" {}", path.display()))
}

/// An open stream.
pub(crate) struct Recording {
    pub(crate) stream: RecordingStream,
    /// Name and id.
    pub(crate) name: String,
    /// Application id, one for each scenario and strategy: the rerun viewer keeps one layout per application.
    pub(crate) application: ApplicationId,
    /// Port of the live viewer.
    pub(crate) port: Option<u16>,
    /// Whether its file is the first one.
    pub(crate) part: Part,
    /// Time of the last batch.
    sent: Instant,
    /// Slots since the last batch.
    slots: u32,
    /// Approximate size of these slots [byte].
    bytes: usize,
    /// Whether a slot was sent.
    is_begun: bool,
    /// K of the recording, which contains every K-th slot.
    pub(crate) every: NonZeroU64,
    /// The locked file, and what is written to it.
    file: Option<(NextFile, RrdFile)>,
}

impl Recording {
    /// Opens the sinks. The id of the recording is its name, or that of earlier files. The content does not depend on
    /// the clock.
    ///
    /// # Errors
    /// If there is no sink, the file cannot be created, or the port is in use.
    pub(crate) fn open(sinks: &Sinks, application: &ApplicationId, name: &str) -> Result<Self, SceneError> {
        let mut open: Vec<Box<dyn LogSink>> = Vec::new();
        let live = sinks.live.map(free_port).transpose()?; // before the file, so that an error does not truncate it
        let create = |first: &PathBuf| {
            let next = NextFile::find(first, application);
            match RrdFile::create(&next.path) {
                Ok(file) => Ok((next, file)),
                Err(source) => Err(SceneError::File { path: next.path, source }),
            }
        };
        let file = sinks.save.as_ref().map(create).transpose()?;
        if let Some((_, file)) = &file {
            open.push(Box::new(file.clone()));
        }
        if let Some(port) = live {
            open.push(Box::new(server(port)?));
        }
        if open.is_empty() {
            return Err(SceneError::Nowhere);
        }
        let begun = file.as_ref().and_then(|(next, _)| next.recording_id.as_deref());
        let part = if begun.is_some() { Part::Later } else { Part::First };
        let name = begun.unwrap_or(name).to_owned();
        let every = sinks.every.unwrap_or(NonZeroU64::MIN);
        let stream = RecordingStreamBuilder::new(application.clone())
            .recording_id(name.as_str())
            .send_properties(false) // they would contain the wall-clock time
            .enabled(true) // regardless of the environment variable RERUN
            .batcher_config(ChunkBatcherConfig {
                flush_tick: Duration::MAX,
                flush_num_bytes: u64::MAX,
                flush_num_rows: u64::MAX,
                ..ChunkBatcherConfig::default()
            })
            .set_sinks(open)?;
        stream.set_log_time_enabled(false);
        stream.set_log_tick_enabled(false);
        stream.send_recording_name(name.as_str())?;
        let application = application.clone();
        Ok(Self {
            stream,
            name,
            application,
            port: live,
            part,
            sent: Instant::now(),
            slots: 0,
            bytes: 0,
            is_begun: false,
            every,
            file,
        })
    }

    /// Sets the current time of the recording.
    pub(crate) fn set_slot(&self, slot: u64, slot_s: f64) {
        self.stream.set_time_sequence(SLOT, i64::try_from(slot).unwrap_or(i64::MAX));
        self.stream.set_duration_secs(SIM_TIME, slot as f64 * slot_s);
    }

    /// Ends a slot with this number of sensor nodes; whether the batch is then due, see [`Recording::send_batch`].
    ///
    /// The first slot is due immediately, with all static data: without them, a file would be empty.
    pub(crate) fn is_batch_due(&mut self, sensors: usize) -> bool {
        let [base, each] = SLOT_BYTES;
        self.slots += 1;
        self.bytes += base + each * sensors;
        let elapsed = self.sent.elapsed();
        let is_timely = match self.port {
            Some(_) => elapsed >= LIVE_TICK,
            None => elapsed >= FILE_TICK || self.slots >= MIN_SLOTS && elapsed >= MIN_TICK,
        };
        is_timely || self.bytes >= BATCH_BYTES || !self.is_begun
    }

    /// Sends the slots since the last batch. [`Recording::close`] reports errors.
    pub(crate) fn send_batch(&mut self) {
        self.begin_batch();
        self.is_begun = true;
        self.sent = Instant::now();
        self.slots = 0;
        self.bytes = 0;
        let _ = self.stream.flush_async();
    }

    /// Begins to send a batch to the file: ends it with the name of the recording. The first one already has it.
    fn begin_batch(&self) {
        if let Some((_, file)) = &self.file {
            file.begin_batch(FLUSH_LIMIT);
            if self.is_begun {
                let _ = self.stream.send_recording_name(self.name.as_str());
            }
        }
    }

    /// Writes the last batch and the footer of the file.
    ///
    /// # Errors
    /// If data could not be written, now or earlier, or another process has changed the file.
    pub(crate) fn close(self) -> Result<(), SceneError> {
        self.begin_batch();
        let flushed = self.stream.flush_with_timeout(FLUSH_LIMIT);
        drop(self.stream);
        let path = self.file.as_ref().map(|(next, _)| next.path.clone());
        flushed.map_err(|source| SceneError::Unfinished { path: path.clone(), source })?;
        let Some((NextFile { path, .. }, file)) = self.file else { return Ok(()) };
        file.finish().map_err(|error| match error {
            EncodeError::Write(source) if FileChange::is_cause_of(&source) => SceneError::Changed { path, source },
            error => SceneError::Unfinished { path: Some(path), source: SinkFlushError::failed(error.to_string()) },
        })
    }
}

/// The port, or a free one for 0. Checks that it can be bound, because the server binds in the background and only logs
/// failures.
fn free_port(port: u16) -> Result<u16, SceneError> {
    let probe = TcpListener::bind(("127.0.0.1", port)).and_then(|listener| listener.local_addr());
    probe.map(|address| address.port()).map_err(|source| SceneError::Port { port, source })
}

fn server(port: u16) -> Result<GrpcServerSink, SceneError> {
    let options = re_sdk::ServerOptions {
        playback_behavior: re_sdk::PlaybackBehavior::OldestFirst,
        memory_limit: re_sdk::MemoryLimit::from_bytes(HISTORY_BYTES),
        ..re_sdk::ServerOptions::default()
    };
    let sink = GrpcServerSink::new("127.0.0.1", port, options);
    sink.map_err(|error| SceneError::Stream(RecordingStreamError::InvalidAddress(error)))
}
