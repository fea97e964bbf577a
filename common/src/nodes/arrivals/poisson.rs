//! Poisson arrivals: packets at random times.

use rand_distr::Distribution;

use super::DrawnArrivals;
use crate::random::{Purpose, Streams};

/// Packets of `L` bits: an SN samples `L · Poisson(s τ / L)` bits in a slot, independently of all other slots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Poisson {
    packet_bits: f64,
    streams: Streams,
}

impl Poisson {
    /// Packets of `packet_bits` [bit], at least 1 and whole, drawn from `streams`.
    #[must_use]
    pub fn new(packet_bits: f64, streams: Streams) -> Self {
        Self { packet_bits, streams }
    }
}

impl DrawnArrivals for Poisson {
    fn bits(&self, slot: u64, sensor: u32, mean_bits: f64) -> u64 {
        let Ok(packets) = rand_distr::Poisson::new(mean_bits / self.packet_bits) else { return 0 }; // the mean is 0
        let drawn: f64 = packets.sample(&mut self.streams.stream(Purpose::Arrivals, slot, sensor));
        (drawn * self.packet_bits) as u64
    }
}
