//! The lower bound of a slot: its messages passed around three threads by bare iceoryx2.
//!
//! Each thread waits for the message of the one before it and sends its own, as large as the ring's: queues, plan, flight
//! report. Nothing is planned, flown or saved.

use std::sync::Barrier;
use std::thread;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use skysink_common::message::{FlightReport, Plan};
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_mission::latency::{Spread, histogram};
use skysink_ring::folder::RingFolder;
use skysink_ring::wait::Waiting;

use super::nanoseconds;
use super::ring::RingCase;
use crate::error::Error;

/// Messages on the critical path of a slot, and threads that pass them on.
const HOPS: usize = 3;

/// Longest wait for a message.
const TIMEOUT: Duration = Duration::from_secs(30);

/// Passes the messages of `case` around, and returns the times of the rounds.
pub(super) fn time(case: RingCase, stop: &Stop) -> Result<Spread, Error> {
    stop.check()?;
    let folder = RingFolder::create(Pace::Max, case.wait, TIMEOUT.as_secs_f64(), false, None)?;
    let config = folder.config()?;
    let all_open = Barrier::new(HOPS);
    thread::scope(|scope| {
        let start = |index| {
            let ports = Ports::open(&config, case, index);
            all_open.wait();
            ports.and_then(|ports| run(&ports, case, index, stop))
        };
        let threads = [0, 1, 2].map(|index| scope.spawn(move || start(index)));
        let [first, second, third] = threads.map(|thread| thread.join().expect("no thread panics"));
        second.and(third).and(first)
    })
}

/// Length of the message that thread `index` sends.
fn message_bytes(case: RingCase, index: usize) -> usize {
    [case.sensors as usize * size_of::<u32>(), size_of::<Plan>(), size_of::<FlightReport>()][index]
}

/// All rounds of one thread. The first thread starts the rounds and times them.
fn run(ports: &Ports, case: RingCase, index: usize, stop: &Stop) -> Result<Spread, Error> {
    let message = vec![7; message_bytes(case, index)];
    let period = case.pace.period(1.0).unwrap_or(Duration::ZERO);
    let warm_up = case.slots / 10 + 1;
    let mut times = histogram();
    let mut next = Instant::now();
    for round in 0..case.slots + warm_up {
        stop.check()?;
        if index != 0 {
            ports.receive(case.wait)?;
            ports.send(&message)?;
            continue;
        }
        thread::sleep(next.saturating_duration_since(Instant::now()));
        let begin = Instant::now();
        next = next.max(begin) + period;
        ports.send(&message)?;
        ports.receive(case.wait)?;
        if round >= warm_up {
            times.saturating_record(nanoseconds(begin));
        }
    }
    Ok(Spread::of(&times))
}

/// The ports of a thread: it receives from the thread before it and sends to the one after it.
struct Ports {
    publisher: Publisher<ipc::Service, [u8], ()>,
    notifier: Notifier<ipc::Service>,
    subscriber: Subscriber<ipc::Service, [u8], ()>,
    listener: Listener<ipc::Service>,
}

impl Ports {
    fn open(config: &Config, case: RingCase, index: usize) -> Result<Self, Error> {
        let builder = NodeBuilder::new().config(config).signal_handling_mode(SignalHandlingMode::Disabled);
        let node = builder.create::<ipc::Service>().map_err(failed)?;
        let name = |index: usize| ServiceName::new(&format!("hop/{index}")).map_err(failed);
        let messages =
            |index| node.service_builder(&name(index)?).publish_subscribe::<[u8]>().open_or_create().map_err(failed);
        let events = |index| node.service_builder(&name(index)?).event().open_or_create().map_err(failed);
        let before = (index + HOPS - 1) % HOPS;
        let messages_sent = messages(index)?;
        let publisher = messages_sent.publisher_builder().initial_max_slice_len(message_bytes(case, index));
        Ok(Self {
            publisher: publisher.create().map_err(failed)?,
            notifier: events(index)?.notifier_builder().create().map_err(failed)?,
            subscriber: messages(before)?.subscriber_builder().create().map_err(failed)?,
            listener: events(before)?.listener_builder().create().map_err(failed)?,
        })
    }

    fn send(&self, message: &[u8]) -> Result<(), Error> {
        let sample = self.publisher.loan_slice_uninit(message.len()).map_err(failed)?;
        sample.write_from_slice(message).send().map_err(failed)?;
        self.notifier.notify().map(drop).map_err(failed)
    }

    fn receive(&self, wait: Waiting) -> Result<(), Error> {
        let begin = Instant::now();
        for polls in 0u32.. {
            if let Some(sample) = self.subscriber.receive().map_err(failed)? {
                std::hint::black_box(sample.payload().len());
                return Ok(());
            }
            wait.pause(&self.listener, polls);
            if begin.elapsed() >= TIMEOUT {
                break;
            }
        }
        Err(Error::Bench(format!("hop: no message within {} s", TIMEOUT.as_secs())))
    }
}

/// The error of a port.
fn failed(error: impl std::fmt::Debug) -> Error {
    Error::Bench(format!("hop: {error:?}"))
}
