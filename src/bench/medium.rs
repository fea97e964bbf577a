//! The two media that pass messages on: iceoryx2's shared memory and UNIX sockets. A process has the ends of one of them.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::Builder;
use skysink_mission::error::FileContext;
use skysink_ring::error::{NodeError, RingError};
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Medium {
    /// iceoryx2's shared memory, as the ring.
    SharedMemory,
    /// UNIX sockets: every message is copied into the kernel and out of it.
    Socket,
}

impl Medium {
    /// Both.
    pub const ALL: [Self; 2] = [Self::SharedMemory, Self::Socket];

    /// As it is spelled in arguments.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SharedMemory => "shared-memory",
            Self::Socket => "socket",
        }
    }
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
        let event = |index| node.service_builder(&name(index)?).event().open().map_err(refused);
        let before = (index + HOPS - 1) % HOPS;
        // The listener first: a message that arrives has been announced.
        let listener = event(before)?.listener_builder().create().map_err(refused)?;
        let data = data(node, before)?.open().map_err(refused)?;
        let subscriber = data.subscriber_builder().create().map_err(refused)?;
        let data = self::data(node, index)?.open().map_err(refused)?;
        let publisher = data.publisher_builder().initial_max_slice_len(message_bytes).max_loaned_samples(1).create();
        let notifier = event(index)?.notifier_builder().create().map_err(refused)?;
        Ok(Self { publisher: publisher.map_err(refused)?, notifier, subscriber, listener, wait })
    }
}

impl Ends for SharedEnds {
    fn send(&mut self, message: &[u8]) -> Result<(), Error> {
        let begin = Instant::now();
        loop {
            let sample = self.publisher.loan_slice_uninit(message.len()).map_err(refused)?;
            if sample.write_from_slice(message).send().map_err(refused)? > 0 {
                break;
            }
            check_timeout(begin)?;
            std::thread::sleep(RETRY);
        }
        self.notifier.notify().map_err(refused)?;
        Ok(())
    }

    fn receive(&mut self) -> Result<(), Error> {
        let begin = Instant::now();
        let mut polls = 0;
        loop {
            if let Some(sample) = self.subscriber.receive().map_err(refused)? {
                std::hint::black_box(sample.payload().len());
                return Ok(());
            }
            self.wait.pause(&self.listener, polls);
            polls = polls.wrapping_add(1);
            check_timeout(begin)?;
        }
    }
}

/// A node in the ring of `folder`.
pub fn node(folder: &RingFolder) -> Result<Node<ipc::Service>, Error> {
    let builder = NodeBuilder::new().config(&folder.config()?).signal_handling_mode(SignalHandlingMode::Disabled);
    builder.create().map_err(refused)
}

/// Creates the services of the process `index`; they exist as long as what is returned.
pub fn create_services(node: &Node<ipc::Service>, index: usize) -> Result<impl Sized, Error> {
    let data = data(node, index)?.max_publishers(1).max_subscribers(2).create().map_err(refused)?;
    let event = node.service_builder(&name(index)?).event().create().map_err(refused)?;
    Ok((data, event))
}

fn data(node: &Node<ipc::Service>, index: usize) -> Result<Builder<[u8], (), ipc::Service>, Error> {
    Ok(node.service_builder(&name(index)?).publish_subscribe::<[u8]>())
}

fn name(index: usize) -> Result<ServiceName, Error> {
    ServiceName::new(&format!("hop/{index}")).map_err(refused)
}

/// iceoryx2 refuses.
fn refused(error: impl std::fmt::Debug) -> Error {
    RingError::Topic { topic: "hop", action: "pass messages", detail: format!("{error:?}") }.into()
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
        let to = connect(address((index + 1) % HOPS))?;
        let (from, _) = listener.accept().at(&own)?;
        from.set_nonblocking(wait == Waiting::Poll).at(&own)?;
        Ok(Self { to, from, message: vec![0; received_bytes] })
    }
}

impl Ends for SocketEnds {
    fn send(&mut self, message: &[u8]) -> Result<(), Error> {
        self.to.write_all(message).map_err(broken)
    }

    fn receive(&mut self) -> Result<(), Error> {
        let (mut taken, mut polls, begin) = (0, 0, Instant::now());
        while taken < self.message.len() {
            match self.from.read(&mut self.message[taken..]) {
                Ok(0) => return Err(broken(ErrorKind::UnexpectedEof.into())),
                Ok(bytes) => taken += bytes,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    std::hint::spin_loop();
                    polls += 1;
                    if polls % POLLS == 0 {
                        check_timeout(begin)?;
                        std::thread::yield_now();
                    }
                }
                Err(error) => return Err(broken(error)),
            }
        }
        std::hint::black_box(&self.message);
        Ok(())
    }
}

/// Connects to the socket at `address` as soon as it is there.
fn connect(address: PathBuf) -> Result<UnixStream, Error> {
    let begin = Instant::now();
    loop {
        if let Ok(stream) = UnixStream::connect(&address) {
            return Ok(stream);
        }
        check_timeout(begin)?;
        std::thread::sleep(RETRY);
    }
}

fn broken(error: std::io::Error) -> Error {
    Error::Bench(format!("hop: socket: {error}"))
}

/// Fails if a process has been waited for since `begin` for too long.
fn check_timeout(begin: Instant) -> Result<(), Error> {
    if begin.elapsed() < TIMEOUT {
        return Ok(());
    }
    let (what, from) = ("a message".to_owned(), "skysink hop");
    Err(NodeError::TimedOut { what, from, seconds: TIMEOUT.as_secs_f64() }.into())
}
