//! The floor of a slot: its messages passed around three processes, by themselves.
//!
//! The processes are this executable again. Each waits for the message of the one before it and sends its own, as large
//! as the ring's: queues, plan, flight. Nothing is planned, flown or remembered.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use skysink_common::message::{FlightReport, Plan};
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::wait::Waiting;

use super::Times;
use super::transport::Socket;
use crate::error::Error;
use skysink_mission::error::FileContext;
use skysink_mission::latency::Spread;

/// Messages on the critical path of a slot, and the processes that pass them on.
pub const HOPS: usize = 3;

/// How long a message is waited for.
const TIMEOUT: Duration = Duration::from_secs(30);

/// How often it is tried to reach a process that is not there yet.
const RETRY: Duration = Duration::from_millis(1);

/// How messages are passed on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Medium {
    /// iceoryx2's shared memory, as the ring.
    SharedMemory,
    /// UNIX sockets: every message is copied into the kernel and out of it.
    Socket,
}

impl Medium {
    /// As it is spelled in arguments.
    pub fn name(self) -> &'static str {
        match self {
            Self::SharedMemory => "shared-memory",
            Self::Socket => "socket",
        }
    }
}

/// What is passed around, and how often.
#[derive(Debug, Clone, Copy)]
pub struct Rounds {
    /// By what.
    pub medium: Medium,
    /// How the processes wait for each other.
    pub wait: Waiting,
    /// Sensor nodes, whose queues the first message holds.
    pub sensors: u32,
    /// Rounds that count.
    pub rounds: u64,
    /// Time between the beginnings of two rounds; zero if each begins with the end of the one before.
    pub period: Duration,
}

/// A process among the three.
#[derive(Debug)]
pub struct Place {
    /// The folder in which they meet.
    pub folder: PathBuf,
    /// The first begins the rounds.
    pub place: usize,
}

impl Rounds {
    /// Length of the message that the process at `place` sends.
    fn message_bytes(self, place: usize) -> usize {
        match place {
            0 => self.sensors as usize * size_of::<u32>(),
            1 => size_of::<Plan>(),
            _ => size_of::<FlightReport>(),
        }
    }

    /// Passes the messages around, and returns the times of the rounds.
    ///
    /// # Errors
    /// If a process cannot be started or fails.
    pub fn time(self, stop: &Stop) -> Result<Spread, Error> {
        stop.check()?;
        let folder = RingFolder::create(Pace::Max, self.wait, TIMEOUT.as_secs_f64(), false)?;
        let node = node(&folder)?;
        let services = (0..HOPS)
            .map(|place| {
                let data = builder(&node, place)?.max_publishers(1).max_subscribers(2).create().map_err(refused)?;
                let event = node.service_builder(&name(place)?).event().create().map_err(refused)?;
                Ok((data, event))
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let program = std::env::current_exe().at(Path::new("skysink"))?;
        let command = |place: usize| {
            let mut command = Command::new(&program);
            command.arg("hop").arg(folder.path()).arg(place.to_string());
            command.args([self.medium.name(), &self.wait.to_string(), &self.sensors.to_string()]);
            command.args([self.rounds.to_string(), self.period.as_micros().to_string()]);
            command.stdin(Stdio::null()).stdout(Stdio::null());
            command
        };
        let mut others = Vec::new();
        for place in 1..HOPS {
            others.push(command(place).spawn().at(&program)?);
        }
        let first = command(0).stdout(Stdio::piped()).output().at(&program)?;
        for other in &mut others {
            let _ = other.wait(); // where it fails the first one does, too
        }
        drop(services);
        serde_json::from_slice(&first.stdout).map_err(|error| Error::Bench(format!("hop: {}: {error}", first.status)))
    }
}

impl Place {
    /// Takes its part in all rounds; the first prints their times.
    ///
    /// # Errors
    /// If another one is missing.
    pub fn hop(&self, rounds: Rounds, stop: &Stop) -> Result<(), Error> {
        let folder = RingFolder::open(&self.folder)?;
        let message = vec![7; rounds.message_bytes(self.place)];
        let received_bytes = rounds.message_bytes((self.place + HOPS - 1) % HOPS);
        let mut times = Times::new();
        match rounds.medium {
            Medium::SharedMemory => {
                let node = node(&folder)?;
                let mut shared = Shared::join(&node, self.place, message.len())?;
                self.turn(rounds, &mut times, stop, |turn| match turn {
                    Turn::Send => shared.send(&message),
                    Turn::Receive => shared.receive(rounds.wait),
                })?;
            }
            Medium::Socket => {
                let mut socket = Socket::join(folder.path(), self.place, received_bytes, rounds.wait)?;
                self.turn(rounds, &mut times, stop, |turn| match turn {
                    Turn::Send => socket.send(&message),
                    Turn::Receive => socket.receive(),
                })?;
            }
        }
        if self.place == 0 {
            println!("{}", serde_json::to_string(&times.spread()).expect("plain keys and values"));
        }
        Ok(())
    }

    /// All rounds, in the order of this place.
    fn turn(
        &self,
        rounds: Rounds,
        times: &mut Times,
        stop: &Stop,
        mut act: impl FnMut(Turn) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let warm_up = rounds.rounds / 10 + 1;
        let mut next = Instant::now();
        for round in 0..rounds.rounds + warm_up {
            stop.check()?;
            if self.place != 0 {
                act(Turn::Receive)?;
                act(Turn::Send)?;
                continue;
            }
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            let begin = Instant::now();
            next = next.max(begin) + rounds.period;
            act(Turn::Send)?;
            act(Turn::Receive)?;
            if round >= warm_up {
                times.add(begin, 1);
            }
        }
        Ok(())
    }
}

/// What a process does next.
enum Turn {
    Send,
    Receive,
}

/// A process's ends of the shared memory.
struct Shared {
    publisher: Publisher<ipc::Service, [u8], ()>,
    notifier: Notifier<ipc::Service>,
    subscriber: Subscriber<ipc::Service, [u8], ()>,
    listener: Listener<ipc::Service>,
}

impl Shared {
    fn join(node: &Node<ipc::Service>, place: usize, message_bytes: usize) -> Result<Self, Error> {
        let event = |place| node.service_builder(&name(place)?).event().open().map_err(refused);
        let before = (place + HOPS - 1) % HOPS;
        // The bell first: a message that arrives has been announced.
        let listener = event(before)?.listener_builder().create().map_err(refused)?;
        let data = builder(node, before)?.open().map_err(refused)?;
        let subscriber = data.subscriber_builder().create().map_err(refused)?;
        let data = builder(node, place)?.open().map_err(refused)?;
        let publisher = data.publisher_builder().initial_max_slice_len(message_bytes).max_loaned_samples(1).create();
        let notifier = event(place)?.notifier_builder().create().map_err(refused)?;
        Ok(Self { publisher: publisher.map_err(refused)?, notifier, subscriber, listener })
    }

    /// Writes the message into a sample and sends it, as soon as somebody is there.
    fn send(&mut self, message: &[u8]) -> Result<(), Error> {
        let begin = Instant::now();
        loop {
            let sample = self.publisher.loan_slice_uninit(message.len()).map_err(refused)?;
            if sample.write_from_slice(message).send().map_err(refused)? > 0 {
                break;
            }
            missing_after(begin)?;
            std::thread::sleep(RETRY);
        }
        self.notifier.notify().map_err(refused)?;
        Ok(())
    }

    fn receive(&mut self, wait: Waiting) -> Result<(), Error> {
        let look = |shared: &mut Self| {
            let received = shared.subscriber.receive().map_err(refused)?;
            Ok::<_, Error>(received.map(|sample| std::hint::black_box(sample.payload().len())))
        };
        let begin = Instant::now();
        let mut found = look(self)?;
        while found.is_none() {
            found = wait.poll(self, |shared| &shared.listener, look)?;
            missing_after(begin)?;
        }
        Ok(())
    }
}

/// Fails if somebody has been waited for since `begin` for too long.
pub(super) fn missing_after(begin: Instant) -> Result<(), Error> {
    if begin.elapsed() < TIMEOUT {
        return Ok(());
    }
    let (what, from) = ("a message".to_owned(), "skysink hop");
    Err(NodeError::TimedOut { what, from, seconds: TIMEOUT.as_secs_f64() }.into())
}

/// The message of a place as a service.
type Builder = iceoryx2::service::builder::publish_subscribe::Builder<[u8], (), ipc::Service>;

fn builder(node: &Node<ipc::Service>, place: usize) -> Result<Builder, Error> {
    Ok(node.service_builder(&name(place)?).publish_subscribe::<[u8]>())
}

fn node(folder: &RingFolder) -> Result<Node<ipc::Service>, Error> {
    let builder = NodeBuilder::new().config(&folder.config()?).signal_handling_mode(SignalHandlingMode::Disabled);
    builder.create().map_err(refused)
}

fn name(place: usize) -> Result<ServiceName, Error> {
    ServiceName::new(&format!("hop/{place}")).map_err(refused)
}

/// iceoryx2 refuses.
fn refused(error: impl std::fmt::Debug) -> Error {
    RingError::Topic { topic: "hop", action: "pass messages", detail: format!("{error:?}") }.into()
}
