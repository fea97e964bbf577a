//! The arrivals of an imagined mission, drawn from their law by a planner that looks ahead.

use std::ops::Range;

use rand_distr::{Distribution, StandardNormal};

use super::{ArrivalLaw, DrawnArrivals, OnOff};
use crate::per_sensor::PerSensor;
use crate::random::{Purpose, Streams};

/// Arrivals by their law. Nobody else has to draw the same, so a block of sensor nodes (SNs) shares a random stream,
/// and packets are normal numbers with their mean and variance, rounded: some 20 times as fast as
/// [`Poisson`](super::Poisson).
#[derive(Debug, Clone, PartialEq)]
pub enum Imagined {
    /// Packets of this size [bit].
    Packets(f64, Streams),
    /// On or off, begun in the stationary law.
    OnOff(OnOff),
}

impl Imagined {
    /// Arrivals of `count` SNs in `slots` by `law`, from `streams`; `None` if they are constant.
    #[must_use]
    pub fn new(law: ArrivalLaw, streams: Streams, count: usize, slots: Range<u64>) -> Option<Self> {
        match law {
            ArrivalLaw::Constant => None,
            ArrivalLaw::Packets { packet_bits } => Some(Self::Packets(packet_bits, streams)),
            ArrivalLaw::OnOff { on_slots, off_slots } => {
                Some(Self::OnOff(OnOff::new([on_slots, off_slots], streams, count, slots)))
            }
        }
    }
}

impl DrawnArrivals for Imagined {
    fn bits(&self, slot: u64, sensor: u32, mean_bits: f64) -> u64 {
        let mut bits = [0];
        self.fill(slot, sensor as usize..sensor as usize + 1, &PerSensor::Equal(mean_bits), &mut bits);
        bits[0]
    }

    fn fill(&self, slot: u64, sensors: Range<usize>, mean_bits: &PerSensor<f64>, bits: &mut [u64]) {
        match self {
            Self::OnOff(chains) => chains.fill(slot, sensors, mean_bits, bits),
            Self::Packets(packet_bits, streams) => {
                let mut random = streams.stream(Purpose::Arrivals, slot, sensors.start as u32);
                for (bits, sensor) in bits.iter_mut().zip(sensors) {
                    let packets = mean_bits.of(sensor) / packet_bits;
                    let normal: f64 = StandardNormal.sample(&mut random);
                    *bits = ((packets + packets.sqrt() * normal).round().max(0.0) * packet_bits) as u64;
                }
            }
        }
    }
}
