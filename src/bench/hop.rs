//! The lower bound of a slot: its messages passed around three processes, by themselves.
//!
//! The processes are this executable again. Each waits for the message of the one before it and sends its own, as large
//! as the ring's: queues, plan, flight. Nothing is planned, flown or saved.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use clap::Args;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::Builder;
use serde::{Deserialize, Serialize};
use skysink_common::message::{FlightReport, Plan};
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::latency::Spread;
use skysink_ring::folder::RingFolder;
use skysink_ring::wait::Waiting;

use super::Times;
use crate::error::Error;
use crate::programs;
use crate::report::print;

/// Messages on the critical path of a slot, and the processes that pass them on.
const HOPS: usize = 3;

/// How long a message is waited for.
const TIMEOUT: Duration = Duration::from_secs(30);

/// How often it is tried to reach a process that is not there yet.
const RETRY: Duration = Duration::from_millis(1);

/// What is passed around, and how often.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct HopRounds {
    /// How the processes wait for each other.
    pub wait: Waiting,
    /// Sensor nodes, whose queues the first message holds.
    pub sensors: u32,
    /// Rounds that count.
    pub rounds: u64,
    /// Time between the beginnings of two rounds; zero if each begins with the end of the one before.
    pub period: Duration,
}

/// A process among the three: its arguments.
#[derive(Debug, Args)]
pub struct HopProcess {
    /// The folder in which they meet.
    folder: PathBuf,
    /// Which one it is, from 0; the first begins the rounds.
    index: usize,
    /// What it takes part in, as JSON.
    #[arg(value_parser = |text: &str| serde_json::from_str::<HopRounds>(text))]
    rounds: HopRounds,
}

impl HopRounds {
    /// Length of the message that the process `index` sends.
    fn message_bytes(self, index: usize) -> usize {
        match index {
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
        let folder = RingFolder::create(Pace::Max, self.wait, TIMEOUT.as_secs_f64(), false, None)?;
        let node = node(&folder)?;
        let services = (0..HOPS).map(|index| create_services(&node, index)).collect::<Result<Vec<_>, Error>>()?;
        let (program, words) = programs::command_of("skysink").at(Path::new("skysink"))?;
        let rounds = serde_json::to_string(&self).expect("plain keys and values");
        let command = |index: usize| {
            let mut command = Command::new(&program);
            command.args(&words).arg("hop").arg(folder.path()).args([&index.to_string(), &rounds]);
            command.stdin(Stdio::null()).stdout(Stdio::null());
            command
        };
        let mut others = Vec::new();
        for index in 1..HOPS {
            others.push(command(index).spawn().at(&program)?);
        }
        let first = command(0).stdout(Stdio::piped()).output().at(&program)?;
        for other in &mut others {
            let _ = other.wait(); // where it fails the first one does, too
        }
        drop(services);
        serde_json::from_slice(&first.stdout).map_err(|error| Error::Bench(format!("hop: {}: {error}", first.status)))
    }
}

impl HopProcess {
    /// Takes part in all rounds; the first process prints their times.
    ///
    /// # Errors
    /// If another one is missing.
    pub fn run(&self, stop: &Stop) -> Result<(), Error> {
        let folder = RingFolder::open(&self.folder)?;
        let node = node(&folder)?;
        let HopRounds { wait, rounds, period, .. } = self.rounds;
        let message = vec![7; self.rounds.message_bytes(self.index)];
        let ends = Ends::open(&node, self.index, message.len(), wait)?;
        let warm_up = rounds / 10 + 1;
        let mut times = Times::new();
        let mut next = Instant::now();
        for round in 0..rounds + warm_up {
            stop.check()?;
            if self.index != 0 {
                ends.receive()?;
                ends.send(&message)?;
                continue;
            }
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            let begin = Instant::now();
            next = next.max(begin) + period;
            ends.send(&message)?;
            ends.receive()?;
            if round >= warm_up {
                times.add(begin, 1);
            }
        }
        if self.index == 0 {
            print(serde_json::to_string(&times.spread()).expect("plain keys and values"))?;
        }
        Ok(())
    }
}

/// The ends of a process: it receives from the process before it and sends to the one after it.
struct Ends {
    publisher: Publisher<ipc::Service, [u8], ()>,
    notifier: Notifier<ipc::Service>,
    subscriber: Subscriber<ipc::Service, [u8], ()>,
    listener: Listener<ipc::Service>,
    wait: Waiting,
}

impl Ends {
    /// Opens the services of the process `index`, whose messages have `message_bytes`, and of the one before it.
    fn open(node: &Node<ipc::Service>, index: usize, message_bytes: usize, wait: Waiting) -> Result<Self, Error> {
        let event = |index| node.service_builder(&name(index)?).event().open().map_err(failed);
        let before = (index + HOPS - 1) % HOPS;
        // The listener first: a message that arrives has been announced.
        let listener = event(before)?.listener_builder().create().map_err(failed)?;
        let data = publish_subscribe(node, before)?.open().map_err(failed)?;
        let subscriber = data.subscriber_builder().create().map_err(failed)?;
        let data = publish_subscribe(node, index)?.open().map_err(failed)?;
        let publisher = data.publisher_builder().initial_max_slice_len(message_bytes).max_loaned_samples(1).create();
        let notifier = event(index)?.notifier_builder().create().map_err(failed)?;
        Ok(Self { publisher: publisher.map_err(failed)?, notifier, subscriber, listener, wait })
    }

    /// Sends a message, as soon as its receiver is there.
    fn send(&self, message: &[u8]) -> Result<(), Error> {
        let send = || {
            let sample = self.publisher.loan_slice_uninit(message.len()).map_err(failed)?;
            let receivers = sample.write_from_slice(message).send().map_err(failed)?;
            Ok((receivers > 0).then_some(()))
        };
        until(send, |_| std::thread::sleep(RETRY))?;
        self.notifier.notify().map(drop).map_err(failed)
    }

    /// Receives the next message.
    fn receive(&self) -> Result<(), Error> {
        let receive = || self.subscriber.receive().map_err(failed);
        let sample = until(receive, |polls| self.wait.pause(&self.listener, polls))?;
        std::hint::black_box(sample.payload().len());
        Ok(())
    }
}

/// A node in the ring of `folder`.
fn node(folder: &RingFolder) -> Result<Node<ipc::Service>, Error> {
    let builder = NodeBuilder::new().config(&folder.config()?).signal_handling_mode(SignalHandlingMode::Disabled);
    builder.create().map_err(failed)
}

/// Creates the services of the process `index`; they exist as long as what is returned.
fn create_services(node: &Node<ipc::Service>, index: usize) -> Result<impl Sized, Error> {
    let data = publish_subscribe(node, index)?.max_publishers(1).max_subscribers(2).create().map_err(failed)?;
    let event = node.service_builder(&name(index)?).event().create().map_err(failed)?;
    Ok((data, event))
}

fn publish_subscribe(node: &Node<ipc::Service>, index: usize) -> Result<Builder<[u8], (), ipc::Service>, Error> {
    Ok(node.service_builder(&name(index)?).publish_subscribe::<[u8]>())
}

fn name(index: usize) -> Result<ServiceName, Error> {
    ServiceName::new(&format!("hop/{index}")).map_err(failed)
}

/// Tries until there is something, with a pause after each of the first, second ... tries.
fn until<T>(mut attempt: impl FnMut() -> Result<Option<T>, Error>, pause: impl Fn(u32)) -> Result<T, Error> {
    let begin = Instant::now();
    for polls in 0u32.. {
        if let Some(result) = attempt()? {
            return Ok(result);
        }
        pause(polls);
        if begin.elapsed() >= TIMEOUT {
            break;
        }
    }
    Err(Error::Bench(format!("hop: waited {} s for another process", TIMEOUT.as_secs())))
}

/// A hop fails.
fn failed(error: impl std::fmt::Debug) -> Error {
    Error::Bench(format!("hop: {error:?}"))
}
