//! The two media that pass messages on: iceoryx2's shared memory and UNIX sockets. A process has the ends of one of them.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::Builder;
use serde::{Deserialize, Serialize};
use skysink_mission::error::FileContext;
use skysink_ring::folder::RingFolder;
use skysink_ring::wait::Waiting;

use crate::error::Error;

/// Messages on the critical path of a slot, and the processes that pass them on.
pub const HOPS: usize = 3;

/// How long a message is waited for.
pub const TIMEOUT: Duration = Duration::from_secs(30);

/// How often it is tried to reach a process that is not there yet.
const RETRY: Duration = Duration::from_millis(1);

/// Reads in a row before the core is offered to others, where a process polls.
const POLLS: u32 = 64;

/// How messages are passed on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Medium {
    /// iceoryx2's shared memory, as the ring.
    SharedMemory,
    /// UNIX sockets: every message is copied into the kernel and out of it.
    Socket,
}

/// A process's ends: it receives from the process before it and sends to the one after it.
pub trait Ends {
    /// Sends a message, as soon as its receiver is there.
    fn send(&mut self, message: &[u8]) -> Result<(), Error>;

    /// Receives the whole next message.
    fn receive(&mut self) -> Result<(), Error>;
}

/// A process's ends of the shared memory.
pub struct SharedEnds {
    publisher: Publisher<ipc::Service, [u8], ()>,
    notifier: Notifier<ipc::Service>,
    subscriber: Subscriber<ipc::Service, [u8], ()>,
    listener: Listener<ipc::Service>,
    wait: Waiting,
}

impl SharedEnds {
    /// Opens the services of the process `index`, whose messages have `message_bytes`, and of the one before it.
    pub fn open(node: &Node<ipc::Service>, index: usize, message_bytes: usize, wait: Waiting) -> Result<Self, Error> {
        let event = |index| node.service_builder(&name(index)?).event().open().map_err(failed);
        let before = (index + HOPS - 1) % HOPS;
        // The listener first: a message that arrives has been announced.
        let listener = event(before)?.listener_builder().create().map_err(failed)?;
        let data = data(node, before)?.open().map_err(failed)?;
        let subscriber = data.subscriber_builder().create().map_err(failed)?;
        let data = self::data(node, index)?.open().map_err(failed)?;
        let publisher = data.publisher_builder().initial_max_slice_len(message_bytes).max_loaned_samples(1).create();
        let notifier = event(index)?.notifier_builder().create().map_err(failed)?;
        Ok(Self { publisher: publisher.map_err(failed)?, notifier, subscriber, listener, wait })
    }
}

impl Ends for SharedEnds {
    fn send(&mut self, message: &[u8]) -> Result<(), Error> {
        let send = || {
            let sample = self.publisher.loan_slice_uninit(message.len()).map_err(failed)?;
            let receivers = sample.write_from_slice(message).send().map_err(failed)?;
            Ok((receivers > 0).then_some(()))
        };
        until(send, |_| std::thread::sleep(RETRY))?;
        self.notifier.notify().map(drop).map_err(failed)
    }

    fn receive(&mut self) -> Result<(), Error> {
        let receive = || self.subscriber.receive().map_err(failed);
        let sample = until(receive, |polls| self.wait.pause(&self.listener, polls))?;
        std::hint::black_box(sample.payload().len());
        Ok(())
    }
}

/// A node in the ring of `folder`.
pub fn node(folder: &RingFolder) -> Result<Node<ipc::Service>, Error> {
    let builder = NodeBuilder::new().config(&folder.config()?).signal_handling_mode(SignalHandlingMode::Disabled);
    builder.create().map_err(failed)
}

/// Creates the services of the process `index`; they exist as long as what is returned.
pub fn create_services(node: &Node<ipc::Service>, index: usize) -> Result<impl Sized, Error> {
    let data = data(node, index)?.max_publishers(1).max_subscribers(2).create().map_err(failed)?;
    let event = node.service_builder(&name(index)?).event().create().map_err(failed)?;
    Ok((data, event))
}

fn data(node: &Node<ipc::Service>, index: usize) -> Result<Builder<[u8], (), ipc::Service>, Error> {
    Ok(node.service_builder(&name(index)?).publish_subscribe::<[u8]>())
}

fn name(index: usize) -> Result<ServiceName, Error> {
    ServiceName::new(&format!("hop/{index}")).map_err(failed)
}

/// A process's ends of the sockets.
pub struct SocketEnds {
    to: UnixStream,
    from: UnixStream,
    message: Vec<u8>,
}

impl SocketEnds {
    /// Connects the process `index` in `folder` to the one before it, which sends messages of `received_bytes`, and to the
    /// one after it.
    pub fn open(folder: &RingFolder, index: usize, received_bytes: usize, wait: Waiting) -> Result<Self, Error> {
        let address = |index: usize| folder.path().join(format!("hop-{index}.sock"));
        let own = address(index);
        let listener = UnixListener::bind(&own).at(&own)?;
        let next = address((index + 1) % HOPS);
        let to = until(|| Ok(UnixStream::connect(&next).ok()), |_| std::thread::sleep(RETRY))?;
        let (from, _) = listener.accept().at(&own)?;
        from.set_nonblocking(wait == Waiting::Poll).at(&own)?;
        Ok(Self { to, from, message: vec![0; received_bytes] })
    }
}

impl Ends for SocketEnds {
    fn send(&mut self, message: &[u8]) -> Result<(), Error> {
        self.to.write_all(message).map_err(failed)
    }

    fn receive(&mut self) -> Result<(), Error> {
        let mut taken = 0;
        let receive = || match self.from.read(&mut self.message[taken..]) {
            Ok(0) => Err(failed(ErrorKind::UnexpectedEof)),
            Ok(bytes) => {
                taken += bytes;
                Ok((taken == self.message.len()).then_some(()))
            }
            Err(error) if matches!(error.kind(), ErrorKind::Interrupted | ErrorKind::WouldBlock) => Ok(None),
            Err(error) => Err(failed(error)),
        };
        let pause = |polls: u32| match polls % POLLS {
            0 => std::thread::yield_now(),
            _ => std::hint::spin_loop(),
        };
        until(receive, pause)?;
        std::hint::black_box(&self.message);
        Ok(())
    }
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

/// A medium fails.
fn failed(error: impl std::fmt::Debug) -> Error {
    Error::Bench(format!("hop: {error:?}"))
}
