//! The stream that a scene is written to: a file, a server for a live viewer, or both.

use std::net::TcpListener;
use std::num::NonZeroU64;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use re_sdk::grpc_server::GrpcServerSink;
use re_sdk::log::ChunkBatcherConfig;
use re_sdk::sink::{FileSink, FileSinkError, LogSink, SinkFlushError};
use re_sdk::{ApplicationId, RecordingStream, RecordingStreamBuilder, RecordingStreamError};

use crate::files::{NextFile, Part};

/// The timeline that counts slots.
pub const SLOT: &str = "slot";

/// The timeline of simulated seconds.
pub const SIM_TIME: &str = "sim_time";

/// Most that a killed process loses of a file.
const FILE_TICK: Duration = Duration::from_secs(10);

/// Least time from one batch to the next, and fewest slots of one that is sent before [`FILE_TICK`]: each batch makes a
/// chunk of every entity, which the file holds and, for the file's index, the memory of this process.
const MIN_TICK: Duration = Duration::from_secs(1);

/// See [`MIN_TICK`].
const MIN_SLOTS: u32 = 64;

/// A batch of so much is sent at once. The library knows nothing of slots: it would send what one entity has when that is
/// much, so that a killed process left each entity with another last slot.
const BATCH_BYTES: usize = 32 << 20;

/// About what a slot takes, beside what it takes for each sensor node.
const SLOT_BYTES: [usize; 2] = [1024, 16];

/// Least time from one batch for a live viewer to the next. A batch ends with a slot, so that a viewer never has one
/// half.
const LIVE_TICK: Duration = Duration::from_millis(150);

/// Longest wait for the last bytes at the end; a medium that takes longer does not work any more.
const FLUSH_LIMIT: Duration = Duration::from_secs(120);

/// History that the server keeps for a viewer that joins late.
const HISTORY_BYTES: u64 = 512 << 20;

/// Where the recording goes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Sinks {
    /// First file of the recording. If something was written to it already, a later one is written: `mission-2.rrd`
    /// after `mission.rrd`, and so on.
    pub save: Option<PathBuf>,
    /// Port on 127.0.0.1 where a viewer may connect at any time; 0 takes a free one.
    pub live: Option<u16>,
    /// Slots of which one is drawn, each if none. The first, the last of a whole mission and what happens in between are
    /// there at any rate.
    pub every: Option<NonZeroU64>,
}

/// Why a scene cannot be recorded; the display is one line that names the place and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// Neither a file nor a port was named.
    #[error("recording: no destination: expected a file, a port for a live viewer, or both")]
    Nowhere,
    /// The file cannot be created.
    #[error("recording {}: {source}: expected a place where a file can be created", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: FileSinkError,
    },
    /// The port is taken.
    #[error("live viewer: port {port} of 127.0.0.1: {source}: choose another port, or end what listens there")]
    Port {
        /// The port.
        port: u16,
        /// Why not.
        source: std::io::Error,
    },
    /// A slot does not fit the sensor list.
    #[error("slot {slot}: {found} queues: expected {expected}, one per sensor node of the list")]
    Queues {
        /// The slot.
        slot: u64,
        /// How many queues it has.
        found: usize,
        /// How many sensor nodes there are.
        expected: usize,
    },
    /// The recording library refused.
    #[error("recording: {0}")]
    Stream(#[from] RecordingStreamError),
    /// The end of the recording could not be written.
    #[error("recording{}: {source}: its end is missing, check the space left", at(path))]
    Unfinished {
        /// The file, if there is one.
        path: Option<PathBuf>,
        /// What happened.
        source: SinkFlushError,
    },
}

fn at(path: &Option<PathBuf>) -> String {
    path.as_ref().map_or_else(String::new, |path| format!(" {}", path.display()))
}

/// An open stream, and what is needed to name and end it.
pub(crate) struct Recording {
    pub(crate) stream: RecordingStream,
    /// Name and id.
    pub(crate) name: String,
    /// Application id, one for each scenario and strategy: the rerun viewer keeps one layout per application.
    pub(crate) application: ApplicationId,
    /// Port of the live viewer.
    pub(crate) port: Option<u16>,
    /// Whether its file begins it.
    pub(crate) part: Part,
    /// When the last batch was sent.
    sent: Instant,
    /// Slots since then.
    slots: u32,
    /// About what they take.
    bytes: usize,
    /// Whether a slot was sent.
    is_begun: bool,
    /// Slots of which one is drawn.
    pub(crate) every: NonZeroU64,
    /// Its file, held locked.
    file: Option<NextFile>,
}

impl Recording {
    /// Opens the sinks. The recording's id is its name, unless earlier files have begun it with another. Nothing in it
    /// depends on the clock.
    ///
    /// # Errors
    /// If there is no sink, the file cannot be created, or the port is taken.
    pub(crate) fn open(sinks: &Sinks, application: &ApplicationId, name: &str) -> Result<Self, SceneError> {
        let mut open: Vec<Box<dyn LogSink>> = Vec::new();
        let live = sinks.live.map(free_port).transpose()?; // before the file: a refusal must not truncate one
        let next = sinks.save.as_deref().map(|first| NextFile::find(first, application));
        if let Some(NextFile { path, .. }) = &next {
            let file = FileSink::new(path).map_err(|source| SceneError::File { path: path.clone(), source })?;
            open.push(Box::new(file));
        }
        if let Some(port) = live {
            open.push(Box::new(server(port)?));
        }
        if open.is_empty() {
            return Err(SceneError::Nowhere);
        }
        let begun = next.as_ref().and_then(|next| next.recording_id.as_deref());
        let part = if begun.is_some() { Part::Later } else { Part::First };
        let name = begun.unwrap_or(name).to_owned();
        let flush_tick = if live.is_some() { MIN_TICK } else { FILE_TICK };
        let every = sinks.every.unwrap_or(NonZeroU64::MIN);
        let stream = RecordingStreamBuilder::new(application.clone())
            .recording_id(name.as_str())
            .send_properties(false) // they would hold the wall clock
            .enabled(true) // whatever the environment says: a recording was asked for
            .batcher_config(ChunkBatcherConfig {
                flush_tick,
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
            file: next,
        })
    }

    /// Sets the time of what is logged next.
    pub(crate) fn set_slot(&self, slot: u64, slot_s: f64) {
        self.stream.set_time_sequence(SLOT, i64::try_from(slot).unwrap_or(i64::MAX));
        self.stream.set_duration_secs(SIM_TIME, slot as f64 * slot_s);
    }

    /// Ends a slot of so many sensor nodes, and sends what was logged if it is time. What cannot be sent is reported by
    /// [`Recording::close`].
    ///
    /// The first slot is sent at once, with all that stays: without them a file shows nothing.
    pub(crate) fn end_slot(&mut self, sensors: usize) {
        let [base, each] = SLOT_BYTES;
        self.slots += 1;
        self.bytes += base + each * sensors;
        let is_timely = match self.port {
            Some(_) => self.sent.elapsed() >= LIVE_TICK,
            None => self.slots >= MIN_SLOTS && self.sent.elapsed() >= MIN_TICK,
        };
        if is_timely || self.bytes >= BATCH_BYTES || !self.is_begun {
            self.is_begun = true;
            self.sent = Instant::now();
            self.slots = 0;
            self.bytes = 0;
            let _ = self.stream.flush_async();
        }
    }

    /// Writes what is still under way and ends the file with its footer.
    ///
    /// # Errors
    /// If something could not be written, now or earlier.
    pub(crate) fn close(self) -> Result<(), SceneError> {
        let flushed = self.stream.flush_with_timeout(FLUSH_LIMIT);
        drop(self.stream);
        flushed.map_err(|source| SceneError::Unfinished { path: self.file.map(|file| file.path), source })
    }
}

/// The port, or a free one for 0. The server itself binds in the background and would only log a refusal.
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
