//! What the UAV can know of the queues: what it was told on contact, and what must have come since.
//!
//! A contact is a slot whose flight serves the sensor node (SN). The SN then says what it holds as the slot begins,
//! `B_i(t−1)`, and what it still holds at its end, `B_i(t)`. How contacts become a checkpoint is left to `saved`,
//! what is made of the believed queues to the strategies.

mod saved;

pub use saved::{BYTES_EACH, Saved};

use crate::arrivals::bits_between;
use crate::message::{FlightReport, SensorNode};
use crate::scenario::{Interval, Scenario};
use serde::{Deserialize, Serialize};

/// What the planner knows of the sampling rates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rates {
    /// Each sensor node's own.
    Known,
    /// The mean over all of them, until contacts tell more.
    Learnt,
}

/// The queues of a mission as the UAV believes them to be.
///
/// At the end of slot t it takes SN i, told of last in slot t0, to hold `min(B, B_i(t0) + A_i(t) − A_i(t0))`, where A
/// counts whole bits as the SN does (decision D2): where the rate is known that is what it holds. Before the first
/// contact t0 is 0, and `B_i(0)` the mean of the scenario's initial queues.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    rates: Rates,
    /// Mean of the initial queues [bit].
    initial_bits: u32,
    /// Half-width of their uniform distribution [bit].
    initial_half_bits: f64,
    /// Half the width of the range of the rates, as a fraction of their mean.
    rate_half_fraction: f64,
    beliefs: Vec<Belief>,
    /// The last slot whose flight was observed; nobody is served before slot 1.
    observed: u64,
    /// Of the contacts since this slot none was missed.
    whole_since: u64,
    /// The slot planned last.
    announced_slot: u64,
    /// The SNs scheduled in it, each with what it holds as that slot begins [bit].
    announced: Vec<(u32, u32)>,
    /// What the SNs are believed to hold [bit].
    queues_bits: Vec<u32>,
}

/// How far an SN may be from what is believed of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertainty {
    /// What it would hold if its buffer had no end [bit].
    pub endless_bits: f64,
    /// Half-width of the uniform distribution of its initial queue [bit]; 0 after the first contact.
    pub initial_bits: f64,
    /// Half-width of the uniform distribution of its rate, as a fraction of what is believed; 0 once contacts told it.
    pub rate: f64,
    /// What it is believed to have sampled since the last contact, or since the mission's start [bit]: the part of
    /// `endless_bits` that depends on the rate.
    pub since_bits: f64,
}

/// Half-width [bit] of the uniform distribution with the variance of a Poisson variable whose mean is uniform on a
/// range.
fn half_bits([lowest, highest]: [f64; 2]) -> f64 {
    let half_bits = (highest - lowest) / 2.0;
    (half_bits * half_bits + 3.0 * Interval::Range([lowest, highest]).mean()).sqrt()
}

/// Half the width of a range as a fraction of its mean; 0 where the mean is 0.
fn half_fraction([lowest, highest]: [f64; 2]) -> f64 {
    if highest > 0.0 { (highest - lowest) / (highest + lowest) } else { 0.0 }
}

/// What is believed of an SN.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Belief {
    /// Buffer `B` [bit].
    capacity_bits: u32,
    /// Sampled per slot, `s_i τ` [bit], as far as is known before any contact.
    prior_mean_bits: f64,
    contact: Contact,
}

/// The last contact with an SN, or its queue before slot 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Contact {
    id: u32,
    /// Its slot; 0 before the first contact.
    slot: u64,
    /// What it left in the queue [bit].
    left_bits: u32,
    /// What the gaps between contacts tell of the rate, where rates are learnt.
    learnt: Option<Learnt>,
}

impl Contact {
    /// Whether there was any.
    fn is_past(&self) -> bool {
        self.slot > 0
    }
}

/// What the gaps between contacts tell of a rate. A gap lasts from the end of a contact to the beginning of the next.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Learnt {
    /// Sampled in the gaps that ended with room in the buffer [bit].
    bits: u64,
    /// How long these were [slots].
    slots: u64,
    /// Least mean [bit per slot] that the gaps that ended with a full buffer allow.
    least_mean_bits: f64,
}

impl Learnt {
    /// A gap of `slots` slots that began with `left_bits` and ended with `found_bits` in a buffer of `capacity_bits`.
    fn add(&mut self, slots: u64, left_bits: u32, found_bits: u32, capacity_bits: u32) {
        if slots == 0 {
            return;
        }
        let gained_bits = found_bits.saturating_sub(left_bits);
        if found_bits < capacity_bits {
            self.bits += u64::from(gained_bits);
            self.slots += slots;
        } else {
            self.least_mean_bits = self.least_mean_bits.max(f64::from(gained_bits) / slots as f64);
        }
    }
}

impl Belief {
    /// Sampled per slot [bit], as far as is known now.
    fn mean_bits(&self) -> f64 {
        let Learnt { bits, slots, least_mean_bits } = self.contact.learnt.unwrap_or_default();
        let counted = if slots == 0 { self.prior_mean_bits } else { bits as f64 / slots as f64 };
        counted.max(least_mean_bits)
    }

    /// What the SN would hold at the end of `slot` if its buffer had no end [bit].
    fn endless_bits(&self, slot: u64) -> u64 {
        bits_between(self.mean_bits(), self.contact.slot, slot).saturating_add(self.contact.left_bits.into())
    }
}

impl Estimate {
    /// What is believed before slot 1 of a scenario with these SNs, by a planner that knows `rates` of their sampling.
    #[must_use]
    pub fn new(scenario: &Scenario, rates: Rates, sensors: &[SensorNode]) -> Self {
        let mut estimate = Self {
            rates,
            initial_bits: scenario.sensors.initial_queue_mean_bits.mean() as u32,
            initial_half_bits: half_bits(scenario.sensors.initial_queue_mean_bits.ends()),
            rate_half_fraction: half_fraction(scenario.sensors.sampling_bps.ends()),
            beliefs: Vec::with_capacity(sensors.len()),
            observed: 0,
            whole_since: 0,
            announced_slot: 0,
            announced: Vec::with_capacity(scenario.link.resource_blocks),
            queues_bits: vec![0; sensors.len()],
        };
        for (id, sensor) in (0..).zip(sensors) {
            let mean_bps = match rates {
                Rates::Known => sensor.sampling_bps,
                Rates::Learnt => scenario.sensors.sampling_bps.mean(),
            };
            let capacity_bits = sensor.capacity_bits;
            let contact = estimate.before_any_contact(id, capacity_bits);
            estimate.beliefs.push(Belief { capacity_bits, prior_mean_bits: mean_bps * scenario.slot_s, contact });
        }
        estimate
    }

    fn before_any_contact(&self, id: u32, capacity_bits: u32) -> Contact {
        let learnt = self.has_learnt_rates().then(Learnt::default);
        Contact { id, slot: 0, left_bits: self.initial_bits.min(capacity_bits), learnt }
    }

    /// Whether rates are learnt.
    #[must_use]
    pub fn has_learnt_rates(&self) -> bool {
        self.rates == Rates::Learnt
    }

    /// What SN `id` is believed to sample per slot [bit].
    #[must_use]
    pub fn mean_bits(&self, id: u32) -> f64 {
        self.beliefs[id as usize].mean_bits()
    }

    /// How far SN `id` may be from what is believed of it at the end of `slot`.
    #[must_use]
    pub fn uncertainty(&self, slot: u64, id: u32) -> Uncertainty {
        let belief = &self.beliefs[id as usize];
        let is_unlearnt = belief.contact.learnt.is_some_and(|learnt| learnt.slots == 0);
        let endless_bits = belief.endless_bits(slot) as f64;
        Uncertainty {
            endless_bits,
            since_bits: endless_bits - f64::from(belief.contact.left_bits),
            initial_bits: if belief.contact.is_past() { 0.0 } else { self.initial_half_bits },
            rate: if is_unlearnt { self.rate_half_fraction } else { 0.0 },
        }
    }

    /// Buffer of SN `id` [bit].
    #[must_use]
    pub fn capacity_bits(&self, id: u32) -> u32 {
        self.beliefs[id as usize].capacity_bits
    }

    /// What the SNs are believed to hold at the end of `slot` [bit], by id. Takes time in proportion to their number.
    pub fn believe(&mut self, slot: u64) -> &[u32] {
        for (queue_bits, belief) in self.queues_bits.iter_mut().zip(&self.beliefs) {
            *queue_bits = belief.endless_bits(slot).min(belief.capacity_bits.into()) as u32;
        }
        &self.queues_bits
    }

    /// What was last believed, see [`Estimate::believe`].
    #[must_use]
    pub fn queues_bits(&self) -> &[u32] {
        &self.queues_bits
    }

    /// Keeps what the `scheduled` SNs will say when the contact of `slot` begins: their queues `queues_bits` [bit]
    /// before it, by id.
    pub fn announce(&mut self, slot: u64, scheduled: &[u32], queues_bits: &[u32]) {
        self.announced_slot = slot;
        self.announced.clear();
        self.announced.extend(scheduled.iter().map(|&id| (id, queues_bits[id as usize])));
    }

    /// Takes in the contacts of `slot`: its flight, and the queues after it [bit], by id, of which only those of the
    /// served SNs are looked at. A slot that is not later than the last one observed says nothing new.
    ///
    /// Slots may be left out. What is believed then is only older, and gaps that began before them, in which there may
    /// have been contacts that nobody knows of, teach nothing.
    pub fn observe(&mut self, slot: u64, flight: &FlightReport, queues_bits: &[u32]) {
        if slot <= self.observed || queues_bits.len() != self.beliefs.len() {
            return;
        }
        if slot != self.observed + 1 {
            self.whole_since = slot;
        }
        self.observed = slot;
        for link in flight.served_links() {
            let found_bits = self.found_bits(slot, link.sensor);
            let Some(Belief { contact, capacity_bits, .. }) = self.beliefs.get_mut(link.sensor as usize) else {
                continue;
            };
            let left_bits = queues_bits[link.sensor as usize].min(*capacity_bits);
            if let Some(learnt) = &mut contact.learnt
                && let Some(found_bits) = found_bits.map(|found_bits| found_bits.min(*capacity_bits))
            {
                if contact.slot > 0 && contact.slot >= self.whole_since {
                    let gap = (slot - 1).saturating_sub(contact.slot);
                    learnt.add(gap, contact.left_bits, found_bits, *capacity_bits);
                }
                // A link that leaves something has carried all that it can, so what the slot brought is known, too.
                let held_bits = link.capacity_bits.saturating_add(left_bits.into()).min((*capacity_bits).into()) as u32;
                if left_bits > 0 && held_bits >= found_bits {
                    learnt.add(1, found_bits, held_bits, *capacity_bits);
                }
            }
            contact.slot = slot;
            contact.left_bits = left_bits;
        }
    }

    /// What SN `id` held as `slot` began [bit], if it was to be served in it.
    fn found_bits(&self, slot: u64, id: u32) -> Option<u32> {
        let found = self.announced.iter().find(|(announced_id, _)| *announced_id == id)?;
        (self.announced_slot == slot).then_some(found.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{LinkReport, Mode};
    use crate::scenario::Overrides;
    use std::path::Path;

    /// Three SNs that sample 2.5, 100 and 0 bit/s into 1 000 bit, with initial queues of 300 bit and rates of 100 bit/s
    /// in the mean.
    fn estimate_of(rates: Rates) -> Estimate {
        let text = "name = 'x'\n[sensors]\nsampling_bps = [50.0, 150.0]\ninitial_queue_mean_bits = [0.0, 600.0]\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let sensor = |sampling_bps: f64| SensorNode { sampling_bps, capacity_bits: 1_000, ..SensorNode::default() };
        Estimate::new(&scenario, rates, &[2.5, 100.0, 0.0].map(sensor))
    }

    /// A flight that serves these SNs.
    fn serving(ids: &[u32]) -> FlightReport {
        let mut report = FlightReport::at([0.0, 0.0, 20.0], Mode::Serve);
        for (link, &sensor) in report.links.iter_mut().zip(ids) {
            *link = LinkReport { sensor, ..LinkReport::default() };
        }
        report.served = u32::try_from(ids.len()).unwrap();
        report
    }

    /// Slot `slot` serves SN 0, which holds `found` [bit] before it and `left` after it, over a link of 0 bit: where less
    /// is left than was found, that cannot have been, and tells nothing of the slot itself.
    fn contact(estimate: &mut Estimate, slot: u64, found: u32, left: u32) {
        estimate.announce(slot, &[0], &[found, 0, 0]);
        estimate.observe(slot, &serving(&[0]), &[left, 0, 0]);
    }

    /// Slots that serve nobody.
    fn pass(estimate: &mut Estimate, slots: std::ops::RangeInclusive<u64>) {
        slots.for_each(|slot| estimate.observe(slot, &serving(&[]), &[7; 3]));
    }

    #[test]
    fn before_the_first_contact_the_mean_queue_grows_at_the_rate_up_to_the_buffer() {
        let mut estimate = estimate_of(Rates::Known);
        assert_eq!(estimate.believe(0), [300, 300, 300]);
        assert_eq!(estimate.believe(3), [307, 600, 300]); // floor(2.5 · 3) = 7
        assert_eq!(estimate.believe(8), [320, 1_000, 300]); // 300 + 800 is more than 1 000
        assert!(estimate.uncertainty(8, 1).initial_bits > 0.0, "no contact");
        assert_eq!(estimate_of(Rates::Learnt).believe(3), [600, 600, 600], "of unknown rates the mean");
    }

    #[test]
    fn since_a_contact_whole_bits_are_counted_as_the_sensor_node_counts_them() {
        let mut estimate = estimate_of(Rates::Known);
        estimate.observe(1, &serving(&[0, 2]), &[40, 999, 60]);
        // A(1) = 2, A(2) = 5, A(3) = 7, A(4) = 10: what came since slot 1 is 3, 5, 8.
        assert_eq!(estimate.believe(1), [40, 400, 60], "SN 1 was not asked");
        assert_eq!([2, 3, 4].map(|slot| estimate.believe(slot)[0]), [43, 45, 48]);
        assert_eq!(
            [0, 1].map(|id| estimate.uncertainty(1, id).initial_bits == 0.0),
            [true, false],
            "a contact ends it"
        );
        assert_eq!(estimate.believe(5_000), [1_000, 1_000, 60]);
    }

    #[test]
    fn a_rate_is_what_came_in_all_gaps_over_how_long_they_were() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 1, 500, 100);
        assert_eq!(estimate.mean_bits(0), 100.0, "one contact tells no rate");
        pass(&mut estimate, 2..=10);
        contact(&mut estimate, 11, 280, 0); // 9 slots, 180 bit
        assert_eq!(estimate.mean_bits(0), 20.0);
        contact(&mut estimate, 12, 40, 20); // right after a contact: no slot between them, nothing learnt
        assert_eq!(estimate.mean_bits(0), 20.0);
        contact(&mut estimate, 14, 50, 0); // 1 slot, 30 bit
        assert_eq!(estimate.mean_bits(0), 20.0, "slot 13 was left out, so it may have seen a contact");
        pass(&mut estimate, 15..=15);
        contact(&mut estimate, 16, 40, 0); // 1 slot, 40 bit
        assert_eq!(estimate.mean_bits(0), 22.0, "(180 + 40) / (9 + 1)");
        assert_eq!(estimate.believe(20)[0], 88, "since slot 16");
        assert_eq!(estimate.mean_bits(1), 100.0, "SN 1 is the prior's");
    }

    #[test]
    fn a_contact_that_leaves_something_tells_what_its_slot_brought() {
        let mut estimate = estimate_of(Rates::Learnt);
        let contact = |estimate: &mut Estimate, slot: u64, found: u32, left: u32| {
            let mut flight = serving(&[0]);
            flight.links[0].capacity_bits = 60;
            estimate.announce(slot, &[0], &[found, 0, 0]);
            estimate.observe(slot, &flight, &[left, 0, 0]);
        };
        contact(&mut estimate, 1, 500, 470); // 500 + 30 − 60: the first contact tells the rate
        assert_eq!((estimate.mean_bits(0), estimate.uncertainty(1, 0).rate), (30.0, 0.0));
        contact(&mut estimate, 2, 470, 460); // right after it, 50 more
        assert_eq!(estimate.mean_bits(0), 40.0);
        contact(&mut estimate, 3, 40, 0); // all is taken: how much that was is not told
        assert_eq!(estimate.mean_bits(0), 40.0);
        contact(&mut estimate, 4, 900, 940); // full before the upload: at least 100 came
        assert_eq!(estimate.mean_bits(0), 100.0);
    }

    #[test]
    fn what_was_announced_for_another_slot_teaches_nothing() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 1, 500, 100);
        pass(&mut estimate, 2..=6);
        estimate.announce(6, &[0], &[900, 0, 0]);
        estimate.observe(7, &serving(&[0]), &[0; 3]); // what SN 0 held as slot 7 began is not known
        assert_eq!(estimate.mean_bits(0), 100.0);
    }

    #[test]
    fn a_gap_that_ended_full_only_raises_a_rate() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 1, 500, 100);
        pass(&mut estimate, 2..=6);
        contact(&mut estimate, 7, 1_000, 0); // at least 900 bit in 5 slots
        assert_eq!(estimate.mean_bits(0), 180.0);
        pass(&mut estimate, 8..=27);
        contact(&mut estimate, 28, 1_000, 0); // at least 1 000 bit in 20 slots, which says less
        assert_eq!(estimate.mean_bits(0), 180.0);
        pass(&mut estimate, 29..=30);
        contact(&mut estimate, 31, 400, 0); // 2 slots, 400 bit
        assert_eq!(estimate.mean_bits(0), 200.0);
        let mut slow = estimate_of(Rates::Learnt);
        contact(&mut slow, 1, 0, 0);
        pass(&mut slow, 2..=51);
        contact(&mut slow, 52, 1_000, 0); // at least 20 a slot, less than the prior
        assert_eq!(slow.mean_bits(0), 100.0);
    }

    #[test]
    fn one_that_does_not_sample_is_believed_not_to() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 1, 500, 30);
        pass(&mut estimate, 2..=9);
        contact(&mut estimate, 10, 30, 30);
        assert_eq!((estimate.mean_bits(0), estimate.believe(1_000)[0]), (0.0, 30));
    }

    #[test]
    fn what_does_not_belong_here_changes_nothing() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 5, 500, 30);
        let before = estimate.believe(9).to_vec();
        estimate.observe(5, &serving(&[1]), &[9; 3]); // a slot that is known
        estimate.observe(4, &serving(&[1]), &[9; 3]);
        estimate.observe(6, &serving(&[1]), &[9; 2]); // queues of another field
        estimate.observe(6, &serving(&[3, u32::MAX]), &[9; 3]); // nobody
        assert_eq!(estimate.believe(9), before);
        estimate.announce(7, &[0], &[500, 0, 0]);
        estimate.observe(7, &serving(&[0, 0]), &[2_000, 0, 0]); // twice, and more than the buffer
        // (500 − 30)/1 before slot 7, and at least 1 000 − 500 in it
        assert_eq!((estimate.believe(7)[0], estimate.mean_bits(0)), (1_000, 500.0));
    }
}
