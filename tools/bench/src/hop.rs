//! The lower bound of a slot: its messages passed around three processes by bare iceoryx2, and read by a fourth, which
//! in the ring records them.
//!
//! Each process waits for the message of the one before it and sends its own, as large as the ring's: queues, plan,
//! flight report. The queues grow before they are sent, as new ones must be written; nothing is planned, flown or
//! saved.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use serde::Serialize;
use skysink::run::executables;
use skysink_common::message::{FlightReport, Plan};
use skysink_common::pace::Pace;
use skysink_common::simd::{BLOCK, vectorized};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::latency::{Spread, histogram};
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::terms::Terms;
use skysink_ring::wait::Waiting;

use crate::error::BenchError;
use crate::setting::nanoseconds;

/// Messages on the critical path of a slot, and processes that pass them on; the process after them reads all.
const HOPS: usize = 3;

/// The first argument of the other processes, which are this executable. Then follow the folder of the ring, the number
/// of the process, the length of its message, the rounds, and how it waits.
pub const PROGRAM: &str = "hop";

/// Rounds before the first that is timed.
const WARM_UP: u64 = 100;

/// The buffer of a sensor node [bit].
const MOST_BITS: u32 = 30_000;

/// Longest wait for a message.
const TIMEOUT: Duration = Duration::from_secs(30);

/// The messages of a process.
type Messages = Subscriber<ipc::Service, [u8], ()>;

/// Their service.
type PubSub = publish_subscribe::PortFactory<ipc::Service, [u8], ()>;

/// What a ring flies.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct RingCase {
    /// Sensor nodes.
    pub sensors: u32,
    /// How the processes wait for each other.
    pub wait: Waiting,
    /// How fast it runs.
    pub pace: Pace,
    /// Slots.
    #[serde(skip)]
    pub slots: u64,
    /// UAVs.
    #[serde(skip)]
    pub uavs: u32,
}

/// Passes the messages of `case` around, and returns the times of the rounds.
pub fn time(case: RingCase, stop: &Stop) -> Result<Spread, BenchError> {
    stop.check()?;
    let folder = RingFolder::create(Terms { wait: case.wait, timeout_s: TIMEOUT.as_secs_f64(), ..Terms::default() })?;
    let ports = Ports::open(&folder, 0, message_bytes(case, 0))?;
    let others: Vec<Other> = (1..=HOPS).map(|index| Other::start(&folder, case, index)).collect::<Result<_, _>>()?;
    let times = ports.time_rounds(case, stop);
    others.into_iter().try_for_each(Other::end)?;
    times
}

/// Another process, killed on drop.
struct Other(Child);

impl Other {
    /// Starts the process `index`, and waits until its ports are open.
    fn start(folder: &RingFolder, case: RingCase, index: usize) -> Result<Self, BenchError> {
        let (program, words) = executables::command_of(PROGRAM).at("skysink-bench".as_ref())?;
        let mut command = Command::new(&program);
        command.args(words).arg(folder.path());
        let bytes = if index < HOPS { message_bytes(case, index) } else { 0 };
        command.args([index as u64, bytes as u64, WARM_UP + case.slots].map(|number| number.to_string()));
        command.arg(case.wait.to_string()).stdin(Stdio::null()).stdout(Stdio::piped());
        command.process_group(0); // Ctrl-C ends the measurement, which ends this process
        let mut other = Self(command.spawn().at(&program)?);
        let said = BufReader::new(other.0.stdout.take().expect("it is piped")).lines().next();
        if let Some(Ok(_)) = said { Ok(other) } else { Err(failed("a process has ended before it began")) }
    }

    /// Ends it; an error if it has failed before.
    fn end(mut self) -> Result<(), BenchError> {
        match self.0.try_wait() {
            Ok(Some(status)) if !status.success() => Err(failed(format_args!("a process has ended: {status}"))),
            _ => Ok(()),
        }
    }
}

impl Drop for Other {
    fn drop(&mut self) {
        let _ = self.0.kill(); // it may have ended
        let _ = self.0.wait();
    }
}

/// The process that `arguments`, from [`PROGRAM`] on, describe.
pub fn program(arguments: &[OsString]) -> ExitCode {
    match forward(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("skysink-bench: {error}");
            error.exit_code().into()
        }
    }
}

/// Answers each message with the next one, or reads all.
fn forward(arguments: &[OsString]) -> Result<(), BenchError> {
    const EXPECTED: &str = "hop: expected a folder, three numbers and a wait";
    let [_, folder, numbers @ .., wait] = arguments else { return Err(failed(EXPECTED)) };
    let numbers: Option<Vec<u64>> = numbers.iter().map(|word| word.to_str()?.parse().ok()).collect();
    let wait: Option<Waiting> = wait.to_str().and_then(|word| word.parse().ok());
    let (Some(&[index, bytes, rounds]), Some(wait)) = (numbers.as_deref(), wait) else { return Err(failed(EXPECTED)) };
    let folder = RingFolder::open(Path::new(folder))?;
    let index = index as usize;
    let stop = Stop::default();
    if index == HOPS {
        return read_all(&folder, wait, &stop);
    }
    let message = vec![7; bytes as usize];
    let ports = Ports::open(&folder, index, message.len())?;
    println!();
    for _ in 0..rounds {
        ports.inlet.receive(wait, &stop)?;
        ports.send(&message)?;
    }
    Ok(())
}

/// Reads the messages of all processes until it is killed. As in the ring, those of the first wake it.
fn read_all(folder: &RingFolder, wait: Waiting, stop: &Stop) -> Result<(), BenchError> {
    let node = node(folder)?;
    let first = Inlet::open(&node, 0)?;
    let others: Result<Vec<Messages>, _> = (1..HOPS).map(|index| subscriber(&node, index)).collect();
    let others = others?;
    println!();
    loop {
        first.receive(wait, stop)?;
        for other in &others {
            while other.receive().map_err(failed)?.is_some() {}
        }
    }
}

/// Length of the message that process `index` sends.
fn message_bytes(case: RingCase, index: usize) -> usize {
    let uavs = case.uavs as usize;
    [case.sensors as usize * size_of::<u32>(), uavs * size_of::<Plan>(), uavs * size_of::<FlightReport>()][index]
}

/// Opens a node of the ring.
fn node(folder: &RingFolder) -> Result<Node<ipc::Service>, BenchError> {
    let config = folder.config()?;
    let builder = NodeBuilder::new().config(&config).signal_handling_mode(SignalHandlingMode::Disabled);
    builder.create::<ipc::Service>().map_err(failed)
}

fn messages(node: &Node<ipc::Service>, index: usize) -> Result<PubSub, BenchError> {
    let name = ServiceName::new(&format!("hop/{index}")).map_err(failed)?;
    node.service_builder(&name).publish_subscribe::<[u8]>().open_or_create().map_err(failed)
}

fn events(node: &Node<ipc::Service>, index: usize) -> Result<event::PortFactory<ipc::Service>, BenchError> {
    let name = ServiceName::new(&format!("hop/{index}")).map_err(failed)?;
    node.service_builder(&name).event().open_or_create().map_err(failed)
}

fn subscriber(node: &Node<ipc::Service>, index: usize) -> Result<Messages, BenchError> {
    messages(node, index)?.subscriber_builder().create().map_err(failed)
}

/// The messages of a process, as they arrive.
struct Inlet {
    subscriber: Messages,
    listener: Listener<ipc::Service>,
}

impl Inlet {
    /// Those of process `index`.
    fn open(node: &Node<ipc::Service>, index: usize) -> Result<Self, BenchError> {
        Ok(Self {
            subscriber: subscriber(node, index)?,
            listener: events(node, index)?.listener_builder().create().map_err(failed)?,
        })
    }

    fn receive(&self, wait: Waiting, stop: &Stop) -> Result<(), BenchError> {
        let begin = Instant::now();
        let mut polls = 0;
        while begin.elapsed() < TIMEOUT {
            stop.check()?;
            if let Some(sample) = self.subscriber.receive().map_err(failed)? {
                std::hint::black_box(sample.payload().len());
                return Ok(());
            }
            wait.pause(&self.listener, polls);
            polls += 1;
        }
        Err(BenchError::Hop { seconds: TIMEOUT.as_secs() })
    }
}

/// The ports of a process: it receives from the one before it and sends to the one after it.
struct Ports {
    publisher: Publisher<ipc::Service, [u8], ()>,
    notifier: Notifier<ipc::Service>,
    inlet: Inlet,
}

impl Ports {
    /// Those of process `index`, which sends `bytes` bytes.
    fn open(folder: &RingFolder, index: usize, bytes: usize) -> Result<Self, BenchError> {
        let node = node(folder)?;
        let sent = messages(&node, index)?;
        let publisher = sent.publisher_builder().initial_max_slice_len(bytes);
        Ok(Self {
            publisher: publisher.create().map_err(failed)?,
            notifier: events(&node, index)?.notifier_builder().create().map_err(failed)?,
            inlet: Inlet::open(&node, (index + HOPS - 1) % HOPS)?,
        })
    }

    /// Starts every round with the first message, and times the rounds until the last message is back.
    fn time_rounds(&self, case: RingCase, stop: &Stop) -> Result<Spread, BenchError> {
        let mut queues_bits = vec![0; case.sensors as usize];
        let period = case.pace.period(1.0).unwrap_or(Duration::ZERO);
        let mut times = histogram();
        let mut next = Instant::now();
        for round in 0..WARM_UP + case.slots {
            stop.check()?;
            thread::sleep(next.saturating_duration_since(Instant::now()));
            let begin = Instant::now();
            self.send_grown(&mut queues_bits)?;
            self.inlet.receive(case.wait, stop)?;
            if round >= WARM_UP {
                times.saturating_record(nanoseconds(begin));
                next = next.max(begin) + period;
            }
        }
        Ok(Spread::of(&times))
    }

    fn send(&self, message: &[u8]) -> Result<(), BenchError> {
        let sample = self.publisher.loan_slice_uninit(message.len()).map_err(failed)?;
        sample.write_from_slice(message).send().map_err(failed)?;
        self.notify()
    }

    /// Lets the queues grow, and sends them: block by block, as the field does.
    fn send_grown(&self, queues_bits: &mut [u32]) -> Result<(), BenchError> {
        let mut sample = self.publisher.loan_slice_uninit(size_of_val(queues_bits)).map_err(failed)?;
        let messages = sample.payload_mut().chunks_mut(BLOCK * size_of::<u32>());
        for (queues_bits, message) in queues_bits.chunks_mut(BLOCK).zip(messages) {
            vectorized(|| queues_bits.iter_mut().for_each(|bits| *bits = (*bits + 1).min(MOST_BITS)));
            message.write_copy_of_slice(bytemuck::cast_slice(queues_bits));
        }
        // SAFETY: every element is written, as both have as many blocks.
        unsafe { sample.assume_init() }.send().map_err(failed)?;
        self.notify()
    }

    fn notify(&self) -> Result<(), BenchError> {
        self.notifier.notify().map(drop).map_err(failed)
    }
}

/// The error of a port.
fn failed(error: impl std::fmt::Debug) -> BenchError {
    RingError::topic("hop", "pass messages", &error).into()
}
