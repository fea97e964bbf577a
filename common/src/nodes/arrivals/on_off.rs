//! On-off arrivals: bursts and silence.

use std::ops::Range;
use std::sync::Arc;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::{DrawnArrivals, sampled_bits};
use crate::random::{Purpose, Streams, fraction};

/// A two-state Markov chain for each SN, begun in its stationary law. On, an SN samples at `s (on + off)/on`, whole
/// bits without drift (decision D2) counted over its slots on.
#[derive(Debug, Clone, PartialEq)]
pub struct OnOff {
    /// Rate while on, as a multiple of the mean rate.
    peak: f64,
    chains: Arc<[Chain]>,
}

/// The times of an SN on and off.
#[derive(Debug, Clone, PartialEq)]
struct Chain {
    is_on_first: bool,
    /// The slots before which the state changes, ascending, each with the slots on before it.
    changes: Vec<(u64, u64)>,
    first: u64,
}

impl OnOff {
    /// The chains of `count` SNs over `slots`, of mean times `[on, off]` [slots], each at least 1.
    #[must_use]
    pub fn new(mean_slots: [f64; 2], streams: Streams, count: usize, slots: Range<u64>) -> Self {
        let [on_slots, off_slots] = mean_slots;
        let chain = |id: u32| Chain::draw(mean_slots, streams.stream(Purpose::Arrivals, 0, id), &slots);
        Self { peak: (on_slots + off_slots) / on_slots, chains: (0..count as u32).map(chain).collect() }
    }
}

impl Chain {
    fn draw([on_slots, off_slots]: [f64; 2], mut random: ChaCha8Rng, slots: &Range<u64>) -> Self {
        let is_on_first = random.random::<f64>() < on_slots / (on_slots + off_slots);
        let mut changes = Vec::new();
        let mut is_on = is_on_first;
        let mut slot = slots.start;
        let mut on = 0;
        loop {
            // A geometric time: its end is decided anew in each slot.
            let change = 1.0 / if is_on { on_slots } else { off_slots };
            let further = if change < 1.0 { (fraction(&mut random).ln() / (-change).ln_1p()) as u64 } else { 0 };
            let lasts = further.saturating_add(1);
            slot = slot.saturating_add(lasts);
            on = if is_on { lasts.saturating_add(on) } else { on };
            if slot >= slots.end {
                break Self { is_on_first, changes, first: slots.start };
            }
            changes.push((slot, on));
            is_on = !is_on;
        }
    }

    /// Slots on, of those before `slot`.
    fn slots_on(&self, slot: u64) -> u64 {
        let changed = self.changes.partition_point(|(change, _)| *change <= slot);
        let (since, on) = if changed == 0 { (self.first, 0) } else { self.changes[changed - 1] };
        let is_on = self.is_on_first == changed.is_multiple_of(2);
        on + if is_on { slot.saturating_sub(since) } else { 0 }
    }
}

impl DrawnArrivals for OnOff {
    fn bits(&self, slot: u64, sensor: u32, mean_bits: f64) -> u64 {
        let chain = &self.chains[sensor as usize];
        let counted = |before: u64| sampled_bits(mean_bits * self.peak, chain.slots_on(before));
        counted(slot + 1) - counted(slot)
    }
}
