//! What shared memory is worth: the ring's messages passed around by UNIX sockets, beside the same by iceoryx2.

use std::time::Duration;

use serde::Serialize;
use skysink_common::stop::Stop;
use skysink_mission::latency::Spread;
use skysink_ring::wait::Waiting;

use super::hop::HopRounds;
use super::medium::Medium;
use super::{Effort, counts, median_spread};
use crate::error::Error;

/// The messages of a slot passed around three processes.
#[derive(Debug, Serialize)]
pub struct TransportRow {
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

/// Passes messages around by both, alternately.
///
/// # Errors
/// If a process cannot be started or fails, or on a stop.
pub fn measure(effort: Effort, stop: &Stop) -> Result<Vec<TransportRow>, Error> {
    let mut rows = Vec::new();
    for &sensors in counts(effort) {
        for wait in [Waiting::Event, Waiting::Poll] {
            let rounds = effort.choose(if sensors < 100_000 { 6_000 } else { 500 }, 20);
            let of = |medium| HopRounds { medium, wait, sensors, rounds, period: Duration::ZERO };
            let (mut shared_memory, mut socket) = (Vec::new(), Vec::new());
            for _ in 0..effort.choose(3, 1) {
                shared_memory.push(of(Medium::SharedMemory).time(stop)?);
                socket.push(of(Medium::Socket).time(stop)?);
            }
            let (shared_memory, socket) = (median_spread(&shared_memory), median_spread(&socket));
            let socket_over_shared_memory = socket.p50_us / shared_memory.p50_us;
            rows.push(TransportRow { sensors, wait, shared_memory, socket, socket_over_shared_memory });
        }
    }
    Ok(rows)
}
