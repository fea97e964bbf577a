//! What shared memory is worth: the ring's messages passed around by UNIX sockets, beside the same by iceoryx2.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::stop::Stop;
use skysink_ring::wait::Waiting;

use super::hop::{HOPS, Medium, Rounds, missing_after};
use super::{Effort, counts, median_spread};
use crate::error::Error;
use skysink_mission::error::FileContext;
use skysink_mission::latency::Spread;

/// Reads in a row before the core is offered to others, where a process polls.
const LOOKS: u32 = 64;

/// The messages of a slot passed around three processes.
#[derive(Debug, Serialize)]
pub struct Row {
    /// Sensor nodes.
    pub sensors: u32,
    /// How the processes wait for each other.
    pub wait: Waiting,
    /// By shared memory.
    pub shared_memory: Spread,
    /// By UNIX sockets.
    pub socket: Spread,
    /// Median by sockets over that by shared memory.
    pub socket_over_shared_memory: f64,
}

/// Passes messages around by both, in turns.
///
/// # Errors
/// If a process cannot be started or fails, or on a stop.
pub fn measure(effort: Effort, stop: &Stop) -> Result<Vec<Row>, Error> {
    let mut rows = Vec::new();
    for &sensors in counts(effort) {
        for wait in [Waiting::Event, Waiting::Poll] {
            let rounds = effort.choose(if sensors < 100_000 { 6_000 } else { 500 }, 20);
            let of = |medium| Rounds { medium, wait, sensors, rounds, period: Duration::ZERO };
            let (mut shared_memory, mut socket) = (Vec::new(), Vec::new());
            for _ in 0..effort.choose(3, 1) {
                shared_memory.push(of(Medium::SharedMemory).time(stop)?);
                socket.push(of(Medium::Socket).time(stop)?);
            }
            let (shared_memory, socket) = (median_spread(&shared_memory), median_spread(&socket));
            let socket_over_shared_memory = socket.p50_us / shared_memory.p50_us;
            rows.push(Row { sensors, wait, shared_memory, socket, socket_over_shared_memory });
        }
    }
    Ok(rows)
}

/// A process's ends of the sockets.
pub(super) struct Socket {
    to: UnixStream,
    from: UnixStream,
    message: Vec<u8>,
}

impl Socket {
    /// Meets the process before this one and the one after it in `folder`; the former sends messages of
    /// `received_bytes`.
    pub(super) fn join(folder: &Path, place: usize, received_bytes: usize, wait: Waiting) -> Result<Self, Error> {
        let address = |place: usize| folder.join(format!("hop-{place}.sock"));
        let own = address(place);
        let listener = UnixListener::bind(&own).at(&own)?;
        let to = connect(address((place + 1) % HOPS))?;
        let (from, _) = listener.accept().at(&own)?;
        from.set_nonblocking(wait == Waiting::Poll).at(&own)?;
        Ok(Self { to, from, message: vec![0; received_bytes] })
    }

    pub(super) fn send(&mut self, message: &[u8]) -> Result<(), Error> {
        self.to.write_all(message).map_err(broken)
    }

    /// Takes the whole message: asleep until it comes, or looking again and again.
    pub(super) fn receive(&mut self) -> Result<(), Error> {
        let (mut taken, mut looks, begin) = (0, 0, Instant::now());
        while taken < self.message.len() {
            match self.from.read(&mut self.message[taken..]) {
                Ok(0) => return Err(broken(ErrorKind::UnexpectedEof.into())),
                Ok(bytes) => taken += bytes,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    std::hint::spin_loop();
                    looks += 1;
                    if looks % LOOKS == 0 {
                        missing_after(begin)?;
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
        missing_after(begin)?;
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn broken(error: std::io::Error) -> Error {
    Error::Bench(format!("hop: socket: {error}"))
}
