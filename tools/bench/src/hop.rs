//! The lower bound of a slot: its messages passed around three threads by bare iceoryx2.
//!
//! Each thread waits for the message of the one before it and sends its own, as large as the ring's: queues, plan,
//! flight report. Nothing is planned, flown or saved.

use std::sync::Barrier;
use std::thread;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use serde::Serialize;
use skysink_common::message::{FlightReport, Plan};
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_mission::latency::{Spread, histogram};
use skysink_ring::error::RingError;
use skysink_ring::folder::RingFolder;
use skysink_ring::terms::Terms;
use skysink_ring::wait::Waiting;

use crate::error::BenchError;
use crate::setting::nanoseconds;

/// Messages on the critical path of a slot, and threads that pass them on.
const HOPS: usize = 3;

/// Rounds before the first that is timed.
const WARM_UP: u64 = 100;

/// Longest wait for a message.
const TIMEOUT: Duration = Duration::from_secs(30);

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
    let config = folder.config()?;
    let all_open = Barrier::new(HOPS);
    let open = |index| {
        let ports = Ports::open(&config, case, index);
        all_open.wait();
        ports
    };
    thread::scope(|scope| {
        let forward = |index| scope.spawn(move || open(index)?.forward(case, index, stop));
        let others = [forward(1), forward(2)];
        let times = open(0).and_then(|ports| ports.time_rounds(case, stop));
        others.into_iter().try_for_each(|thread| thread.join().expect("no thread panics"))?;
        times
    })
}

/// Length of the message that thread `index` sends.
fn message_bytes(case: RingCase, index: usize) -> usize {
    let uavs = case.uavs as usize;
    [case.sensors as usize * size_of::<u32>(), uavs * size_of::<Plan>(), uavs * size_of::<FlightReport>()][index]
}

/// The ports of a thread: it receives from the thread before it and sends to the one after it.
struct Ports {
    publisher: Publisher<ipc::Service, [u8], ()>,
    notifier: Notifier<ipc::Service>,
    subscriber: Subscriber<ipc::Service, [u8], ()>,
    listener: Listener<ipc::Service>,
}

impl Ports {
    fn open(config: &Config, case: RingCase, index: usize) -> Result<Self, BenchError> {
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

    /// Starts every round with the first message, and times the rounds until the last message is back.
    fn time_rounds(&self, case: RingCase, stop: &Stop) -> Result<Spread, BenchError> {
        let message = vec![7; message_bytes(case, 0)];
        let period = case.pace.period(1.0).unwrap_or(Duration::ZERO);
        let mut times = histogram();
        let mut next = Instant::now();
        for round in 0..WARM_UP + case.slots {
            stop.check()?;
            thread::sleep(next.saturating_duration_since(Instant::now()));
            let begin = Instant::now();
            self.send(&message)?;
            self.receive(case.wait)?;
            if round >= WARM_UP {
                times.saturating_record(nanoseconds(begin));
                next = next.max(begin) + period;
            }
        }
        Ok(Spread::of(&times))
    }

    /// Answers each message with the next one.
    fn forward(&self, case: RingCase, index: usize, stop: &Stop) -> Result<(), BenchError> {
        let message = vec![7; message_bytes(case, index)];
        for _ in 0..WARM_UP + case.slots {
            stop.check()?;
            self.receive(case.wait)?;
            self.send(&message)?;
        }
        Ok(())
    }

    fn send(&self, message: &[u8]) -> Result<(), BenchError> {
        let sample = self.publisher.loan_slice_uninit(message.len()).map_err(failed)?;
        sample.write_from_slice(message).send().map_err(failed)?;
        self.notifier.notify().map(drop).map_err(failed)
    }

    fn receive(&self, wait: Waiting) -> Result<(), BenchError> {
        let begin = Instant::now();
        let mut polls = 0;
        while begin.elapsed() < TIMEOUT {
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

/// The error of a port.
fn failed(error: impl std::fmt::Debug) -> BenchError {
    RingError::topic("hop", "pass messages", &error).into()
}
