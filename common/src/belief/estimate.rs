//! The UAV's estimate of the queues, from the reports on contact and the sampling rates.
//!
//! A contact is a slot in which the UAV serves the sensor node (SN). The SN reports its queue at the beginning of the
//! slot, `B_i(t−1)`, and at its end, `B_i(t)`. The checkpoint of an estimate is left to `saved_estimate`.

mod rate_posterior;
mod saved_estimate;

pub use saved_estimate::{BYTES_PER_SENSOR, SavedEstimate};

use crate::arrivals::{ArrivalLaw, bits_between, mean_bits};
use crate::message::FlightReport;
use crate::nodes::Answer;
use crate::reported::ReportedQueues;
use crate::scenario::{Interval, Scenario};
use crate::sensors::Sensors;
use crate::slot_record::uploads;
use crate::told::Told;

use rate_posterior::{Gained, RatePosterior};
use serde::{Deserialize, Serialize};
use strum::VariantNames;

/// What the planner knows of the sampling rates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Rates {
    /// The rate of each sensor node.
    Known,
    /// The mean rate of all sensor nodes, and what contacts reveal of each.
    Learnt,
}

/// The queues of a mission as estimated by the UAV.
///
/// After slot t the estimate of SN i, last contacted in slot t0, is `min(B, B_i(t0) + A_i(t) − A_i(t0))`, where `A_i`
/// counts whole bits as the SN does (decision D2). With a known rate and constant arrivals it is exact after the first
/// contact. Before, t0 is 0, and `B_i(0)` the mean of the scenario's initial queues. Arrivals at random are estimated
/// by their mean, and their rates are learnt as a Gamma distribution.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    rates: Rates,
    law: ArrivalLaw,
    /// Mean of the initial queues [bit].
    initial_bits: u32,
    /// Half-width of their uniform distribution [bit].
    initial_half_bits: f64,
    /// Half the width of the range of the rates, as a fraction of their mean.
    rate_half_fraction: f64,
    /// Whether SNs may be dead or without airtime, and whether that may cut what a link carries (decision D33).
    may_refuse: bool,
    has_duty: bool,
    /// By id.
    sensors: Vec<SensorEstimate>,
    /// The last observed slot; 0 before the first.
    observed: u64,
    /// No contact was missed since this slot.
    gapless_since: u64,
    /// The estimated queues [bit] at the end of the slot `predicted`.
    queues_bits: Vec<u32>,
    /// `None` if the queues were not estimated since the last contacts.
    predicted: Option<u64>,
}

/// Uncertainty of the estimate of an SN.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Uncertainty {
    /// The estimated queue if the buffer were unbounded [bit].
    pub unbounded_bits: f64,
    /// Half-width of the uniform distribution of its initial queue [bit]; 0 after the first contact.
    pub initial_bits: f64,
    /// Half-width of the uniform distribution of its rate, as a fraction of the estimate; 0 once contacts revealed it.
    pub rate: f64,
    /// Standard deviation [bit] of what it sampled since the last contact, at its rate; 0 for constant arrivals.
    pub arrivals_bits: f64,
    /// Estimate of the bits sampled since the last contact, or since the mission's start: the part of `unbounded_bits`
    /// that depends on the rate.
    pub since_contact_bits: f64,
}

impl Uncertainty {
    /// The uncertainty of a known queue [bit] and rate.
    #[must_use]
    pub fn none(queue_bits: u32) -> Self {
        Self { unbounded_bits: queue_bits.into(), ..Self::default() }
    }

    /// Standard deviation of the queue in a buffer of `capacity_bits` [bit]: the unbounded queue is taken as uniform,
    /// with the variances of its initial queue, its rate and its arrivals, and capped at 0 and the buffer.
    pub fn queue_sd_bits(&self, capacity_bits: u32) -> f64 {
        let half_bits =
            self.initial_bits.hypot(self.rate * self.since_contact_bits).hypot(3f64.sqrt() * self.arrivals_bits);
        if half_bits == 0.0 {
            return 0.0;
        }
        let capped = |bits: f64| bits.clamp(0.0, capacity_bits.into());
        let [low, high] = [self.unbounded_bits - half_bits, self.unbounded_bits + half_bits];
        let [least, most] = [capped(low), capped(high)];
        let within = if high > least && most > low { (most - least) / (2.0 * half_bits) } else { 0.0 };
        let full = ((high - f64::from(capacity_bits)) / (2.0 * half_bits)).clamp(0.0, 1.0);
        let middle = (least + most) / 2.0;
        let mean = within * middle + full * f64::from(capacity_bits);
        let variance_within = (most - least).powi(2) / 12.0 + (middle - mean).powi(2);
        let empty = (1.0 - within - full).max(0.0);
        (within * variance_within + full * (f64::from(capacity_bits) - mean).powi(2) + empty * mean * mean).sqrt()
    }
}

/// Standard deviation of a uniform distribution of this half-width.
#[must_use]
pub fn uniform_sd(half_width: f64) -> f64 {
    half_width / 3f64.sqrt()
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

/// The estimate of one SN.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SensorEstimate {
    /// Buffer `B` [bit].
    capacity_bits: u32,
    /// Bits sampled per slot, `s_i τ`, as known before any contact.
    prior_mean_bits: f64,
    contact: Contact,
}

/// The last contact with an SN, or its queue before slot 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Contact {
    id: u32,
    /// Its slot; 0 before the first contact.
    slot: u64,
    /// What it answered: its queue, or that it is dead.
    answer: Answer,
    /// The queue at the end of that slot [bit]; 0 of a dead SN.
    left_bits: u32,
    /// What the gaps between contacts reveal of the rate, if rates are learnt.
    learnt: Option<Learnt>,
}

impl Contact {
    /// Whether there was a contact.
    fn has_happened(&self) -> bool {
        self.slot > 0
    }
}

/// What is learnt of a rate in the gaps between contacts. A gap lasts from the end of a contact to the beginning of the
/// next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Learnt {
    /// Of constant arrivals.
    Counted(LearntRate),
    /// Of arrivals at random.
    Random(RatePosterior),
}

/// The rate of constant arrivals as observed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct LearntRate {
    /// Bits sampled in the gaps that ended with room in the buffer.
    bits: u64,
    /// Total length of these gaps [slots].
    slots: u64,
    /// Lower bound on the mean [bit per slot], from the gaps that ended with a full buffer.
    least_mean_bits: f64,
}

impl LearntRate {
    /// Adds a gap of `slots` slots that began with `left_bits` and ended with `found_bits` in a buffer of
    /// `capacity_bits`.
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

impl Learnt {
    /// As [`LearntRate::add`], of arrivals by `law`.
    fn add(&mut self, slots: u64, left_bits: u32, found_bits: u32, capacity_bits: u32, law: ArrivalLaw) {
        match self {
            Self::Counted(counted) => counted.add(slots, left_bits, found_bits, capacity_bits),
            Self::Random(posterior) if slots > 0 => {
                let gained_bits = f64::from(found_bits.saturating_sub(left_bits));
                let is_full = found_bits >= capacity_bits;
                let gained = if is_full { Gained::AtLeast(gained_bits) } else { Gained::Exactly(gained_bits) };
                // At least the variance of single bits: chains that alternate have nearly none.
                let dispersion_bits = law.dispersion_bits(posterior.mean_bits()).max(1.0);
                posterior.add(slots, gained, dispersion_bits);
            }
            Self::Random(_) => {}
        }
    }
}

impl SensorEstimate {
    /// Estimate of the bits sampled per slot.
    fn mean_bits(&self) -> f64 {
        let LearntRate { bits, slots, least_mean_bits } = match self.contact.learnt {
            Some(Learnt::Random(posterior)) => return posterior.mean_bits(),
            Some(Learnt::Counted(counted)) => counted,
            None => LearntRate::default(),
        };
        let counted = if slots == 0 { self.prior_mean_bits } else { bits as f64 / slots as f64 };
        counted.max(least_mean_bits)
    }

    /// Whether it was dead at the last contact.
    fn is_dead(&self) -> bool {
        self.contact.answer == Answer::Dead
    }

    /// Estimate of the queue at the end of `slot` if the buffer were unbounded [bit].
    fn unbounded_bits(&self, slot: u64) -> u64 {
        if self.is_dead() {
            return 0;
        }
        bits_between(self.mean_bits(), self.contact.slot, slot).saturating_add(self.contact.left_bits.into())
    }
}

impl Estimate {
    /// The estimate before slot 1, for a scenario with these SNs and a planner that knows `rates` of their sampling.
    #[must_use]
    pub fn new(scenario: &Scenario, rates: Rates, sensors: &Sensors) -> Self {
        let mut estimate = Self {
            rates,
            law: scenario.arrival_law(),
            initial_bits: scenario.sensors.initial_queue_mean_bits.mean() as u32,
            initial_half_bits: half_bits(scenario.sensors.initial_queue_mean_bits.ends()),
            rate_half_fraction: half_fraction(scenario.sensors.sampling_bps.ends()),
            may_refuse: sensors.may_refuse,
            has_duty: scenario.link.duty_cycle.is_some(),
            sensors: Vec::with_capacity(sensors.count()),
            observed: 0,
            gapless_since: 0,
            queues_bits: vec![0; sensors.count()],
            predicted: None,
        };
        let expected_mean_bits = mean_bits(scenario.sensors.sampling_bps.mean(), scenario.slot_s);
        for id in sensors.ids() {
            let sampler = sensors.sampler(id);
            let capacity_bits = sampler.stored_bits();
            let prior_mean_bits = match rates {
                Rates::Known => sampler.mean_bits,
                Rates::Learnt => expected_mean_bits,
            };
            let contact = estimate.without_contact(id, capacity_bits, prior_mean_bits);
            estimate.sensors.push(SensorEstimate { capacity_bits, prior_mean_bits, contact });
        }
        estimate
    }

    fn without_contact(&self, id: u32, capacity_bits: u32, prior_mean_bits: f64) -> Contact {
        let learnt = match (self.rates, self.law) {
            (Rates::Known, _) => None,
            (Rates::Learnt, ArrivalLaw::Constant) => Some(Learnt::Counted(LearntRate::default())),
            (Rates::Learnt, _) => RatePosterior::prior(prior_mean_bits, self.rate_half_fraction).map(Learnt::Random),
        };
        let left_bits = self.initial_bits.min(capacity_bits);
        Contact { id, slot: 0, answer: Answer::Queue, left_bits, learnt }
    }

    /// Whether rates are learnt.
    pub fn has_learnt_rates(&self) -> bool {
        self.rates == Rates::Learnt
    }

    /// Whether SN `id` was dead at the last contact.
    pub fn is_dead(&self, id: u32) -> bool {
        self.sensors[id as usize].is_dead()
    }

    /// Estimate of the bits that SN `id` samples per slot.
    pub fn mean_bits(&self, id: u32) -> f64 {
        self.sensors[id as usize].mean_bits()
    }

    /// Estimate of the bits per slot of all SNs, by id.
    pub fn means_bits(&self) -> impl Iterator<Item = f64> {
        self.sensors.iter().map(SensorEstimate::mean_bits)
    }

    /// Uncertainty of the estimate of SN `id` at the end of `slot`.
    pub fn uncertainty(&self, slot: u64, id: u32) -> Uncertainty {
        let sensor = &self.sensors[id as usize];
        let rate = match sensor.contact.learnt {
            Some(Learnt::Counted(LearntRate { slots: 0, .. })) => self.rate_half_fraction,
            Some(Learnt::Random(posterior)) => (3f64.sqrt() * posterior.sd_bits() / posterior.mean_bits()).min(1.0),
            Some(Learnt::Counted(_)) | None => 0.0,
        };
        let slots = slot.saturating_sub(sensor.contact.slot);
        let unbounded_bits = sensor.unbounded_bits(slot) as f64;
        Uncertainty {
            unbounded_bits,
            since_contact_bits: (unbounded_bits - f64::from(sensor.contact.left_bits)).max(0.0),
            initial_bits: if sensor.contact.has_happened() { 0.0 } else { self.initial_half_bits },
            rate,
            arrivals_bits: self.law.variance_bits2(sensor.mean_bits(), slots as f64).sqrt(),
        }
    }

    /// Estimates the queues at the end of `slot` [bit], by id. Takes O(N), but no time for the last estimated slot.
    pub fn predict(&mut self, slot: u64) -> &[u32] {
        if self.predicted != Some(slot) {
            for (queue_bits, sensor) in self.queues_bits.iter_mut().zip(&self.sensors) {
                *queue_bits = sensor.unbounded_bits(slot).min(sensor.capacity_bits.into()) as u32;
            }
            self.predicted = Some(slot);
        }
        &self.queues_bits
    }

    /// The result of the last [`Estimate::predict`].
    pub fn queues_bits(&self) -> &[u32] {
        &self.queues_bits
    }

    /// Advances by the contacts of `slot`: its flights, the queues that the served SNs report `before` it, and what is
    /// told `after` it, of which only queues and answers of the served SNs are read. A slot that was observed already,
    /// or a later one was, is ignored.
    ///
    /// Slots may be skipped. The estimate is then older, and gaps that began before a skipped slot are not learnt from,
    /// because they may hold an unknown contact.
    pub fn advance<'t>(
        &mut self,
        slot: u64,
        flights: &[FlightReport],
        before: &ReportedQueues,
        after: impl Into<Told<'t>>,
    ) {
        let after = after.into();
        if slot <= self.observed || after.queues_bits.len() != self.sensors.len() {
            return;
        }
        self.predicted = None;
        if slot != self.observed + 1 {
            self.gapless_since = slot;
        }
        self.observed = slot;
        for link in uploads(flights) {
            let found_bits = before.queue_bits(slot, link.sensor);
            let Some(SensorEstimate { contact, capacity_bits, .. }) = self.sensors.get_mut(link.sensor as usize) else {
                continue;
            };
            if after.answer(link.sensor) == Answer::Dead {
                *contact = Contact { slot, answer: Answer::Dead, left_bits: 0, ..*contact };
                continue;
            }
            if self.may_refuse && before.was_out(slot, link.sensor) {
                continue;
            }
            let left_bits = after.queues_bits[link.sensor as usize].min(*capacity_bits);
            if let Some(learnt) = &mut contact.learnt
                && let Some(found_bits) = found_bits.map(|found_bits| found_bits.min(*capacity_bits))
            {
                if contact.slot > 0 && contact.slot >= self.gapless_since {
                    let gap = slot.saturating_sub(contact.slot).saturating_sub(1);
                    learnt.add(gap, contact.left_bits, found_bits, *capacity_bits, self.law);
                }
                // A link that leaves data carried its full capacity, so the bits sampled in this slot are known, too.
                let held_bits = link.capacity_bits.saturating_add(left_bits.into()).min((*capacity_bits).into()) as u32;
                // Of arrivals at random only those count that could not have been uploaded as a whole: the others are a
                // selection of many bits.
                let is_fair = matches!(learnt, Learnt::Counted(_)) || u64::from(found_bits) >= link.capacity_bits;
                let is_fair = is_fair && !self.has_duty;
                if left_bits > 0 && held_bits >= found_bits && is_fair {
                    learnt.add(1, found_bits, held_bits, *capacity_bits, self.law);
                }
            }
            *contact = Contact { slot, answer: Answer::Queue, left_bits, ..*contact };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{LinkReport, Mode, SensorNode};
    use crate::scenario::Overrides;
    use std::path::Path;

    /// Three SNs that sample 2.5, 100 and 0 bit/s into buffers of 1 000 bit. The means of the scenario are initial
    /// queues of 300 bit and rates of 100 bit/s.
    fn estimate_of(rates: Rates) -> Estimate {
        let text = "name = 'x'\n[sensors]\nsampling_bps = [50.0, 150.0]\ninitial_queue_mean_bits = [0.0, 600.0]\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let sensor = |sampling_bps: f64| SensorNode { sampling_bps, capacity_bits: 1_000, ..SensorNode::default() };
        Estimate::new(&scenario, rates, &Sensors::of(&scenario, &[2.5, 100.0, 0.0].map(sensor)))
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

    /// Slot `slot` serves SN 0, with the queue `found` [bit] before it and `left` after it, over a link of 0 bit. If
    /// less is left than was found, the link contradicts it, and the rate in the slot itself is not learnt.
    fn contact(estimate: &mut Estimate, slot: u64, found: u32, left: u32) {
        let before = ReportedQueues::at(slot, [0], &[found, 0, 0]);
        estimate.advance(slot, &[serving(&[0])], &before, &[left, 0, 0]);
    }

    /// Slots without a contact.
    fn pass(estimate: &mut Estimate, slots: std::ops::RangeInclusive<u64>) {
        slots.for_each(|slot| estimate.advance(slot, &[serving(&[])], &ReportedQueues::default(), &[7; 3]));
    }

    #[test]
    fn the_mean_queue_grows_to_the_buffer_before_the_first_contact() {
        let mut estimate = estimate_of(Rates::Known);
        assert_eq!(estimate.predict(0), [300, 300, 300]);
        assert_eq!(estimate.predict(3), [307, 600, 300]); // floor(2.5 · 3) = 7
        assert_eq!(estimate.predict(8), [320, 1_000, 300]); // 300 + 800 is more than 1 000
        assert!(estimate.uncertainty(8, 1).initial_bits > 0.0, "no contact");
        assert_eq!(estimate_of(Rates::Learnt).predict(3), [600, 600, 600], "at the mean of unknown rates");
    }

    #[test]
    fn the_deviation_of_a_queue_is_that_of_draws_capped_at_the_buffer() {
        let sd_bits = |unbounded_bits, initial_bits, rate| {
            let since_contact_bits = 300.0;
            Uncertainty { unbounded_bits, initial_bits, rate, since_contact_bits, arrivals_bits: 0.0 }
                .queue_sd_bits(1_000)
        };
        let at_random = Uncertainty { arrivals_bits: 50.0, ..Uncertainty::none(500) };
        assert!((at_random.queue_sd_bits(1_000) - 50.0).abs() < 1e-9);
        assert_eq!(sd_bits(400.0, 0.0, 0.0), 0.0);
        assert!((sd_bits(500.0, 240.0, 0.6) - 300.0 / 3f64.sqrt()).abs() < 1e-9, "hypot(240, 180)");
        assert_eq!([-700.0, 1_700.0].map(|bits| sd_bits(bits, 240.0, 0.6)), [0.0; 2], "empty or full for certain");
        for unbounded_bits in [-100.0, 100.0, 850.0, 1_000.0, 1_200.0] {
            let draws = (0..100_000).map(|draw| {
                let bits: f64 = unbounded_bits - 400.0 + 800.0 * (f64::from(draw) + 0.5) / 1e5;
                bits.clamp(0.0, 1_000.0)
            });
            let draws: Vec<f64> = draws.collect();
            let mean = draws.iter().sum::<f64>() / 1e5;
            let variance = draws.iter().map(|bits| (bits - mean).powi(2)).sum::<f64>() / 1e5;
            assert!((sd_bits(unbounded_bits, 400.0, 0.0) - variance.sqrt()).abs() < 0.01, "{unbounded_bits}");
        }
    }

    #[test]
    fn whole_bits_since_a_contact_match_the_sensor_node() {
        let mut estimate = estimate_of(Rates::Known);
        estimate.advance(1, &[serving(&[0, 2])], &ReportedQueues::default(), &[40, 999, 60]);
        // A(1) = 2, A(2) = 5, A(3) = 7, A(4) = 10: 3, 5 and 8 since slot 1.
        assert_eq!(estimate.predict(1), [40, 400, 60], "no contact with SN 1");
        assert_eq!([2, 3, 4].map(|slot| estimate.predict(slot)[0]), [43, 45, 48]);
        assert_eq!(
            [0, 1].map(|id| estimate.uncertainty(1, id).initial_bits == 0.0),
            [true, false],
            "a contact ends it"
        );
        assert_eq!(estimate.predict(5_000), [1_000, 1_000, 60]);
    }

    #[test]
    fn a_learnt_rate_is_total_bits_over_total_gap_length() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 1, 500, 100);
        assert_eq!(estimate.mean_bits(0), 100.0, "one contact reveals no rate");
        pass(&mut estimate, 2..=10);
        contact(&mut estimate, 11, 280, 0); // 9 slots, 180 bit
        assert_eq!(estimate.mean_bits(0), 20.0);
        contact(&mut estimate, 12, 40, 20); // right after a contact: no slot between them, nothing learnt
        assert_eq!(estimate.mean_bits(0), 20.0);
        contact(&mut estimate, 14, 50, 0); // 1 slot, 30 bit
        assert_eq!(estimate.mean_bits(0), 20.0, "slot 13 was skipped, so it may have had a contact");
        pass(&mut estimate, 15..=15);
        contact(&mut estimate, 16, 40, 0); // 1 slot, 40 bit
        assert_eq!(estimate.mean_bits(0), 22.0, "(180 + 40) / (9 + 1)");
        assert_eq!(estimate.predict(20)[0], 88, "since slot 16");
        assert_eq!(estimate.mean_bits(1), 100.0, "the prior of SN 1");
    }

    #[test]
    fn a_contact_that_leaves_data_reveals_the_bits_sampled_in_its_slot() {
        let mut estimate = estimate_of(Rates::Learnt);
        let contact = |estimate: &mut Estimate, slot: u64, found: u32, left: u32| {
            let mut flight = serving(&[0]);
            flight.links[0].capacity_bits = 60;
            let before = ReportedQueues::at(slot, [0], &[found, 0, 0]);
            estimate.advance(slot, &[flight], &before, &[left, 0, 0]);
        };
        contact(&mut estimate, 1, 500, 470); // 500 + 30 − 60: the first contact reveals the rate
        assert_eq!((estimate.mean_bits(0), estimate.uncertainty(1, 0).rate), (30.0, 0.0));
        contact(&mut estimate, 2, 470, 460); // right after it, 50 more
        assert_eq!(estimate.mean_bits(0), 40.0);
        contact(&mut estimate, 3, 40, 0); // the queue is emptied: the bits of the slot are unknown
        assert_eq!(estimate.mean_bits(0), 40.0);
        contact(&mut estimate, 4, 900, 940); // full before the upload: at least 100 came
        assert_eq!(estimate.mean_bits(0), 100.0);
    }

    #[test]
    fn a_rate_is_not_learnt_from_the_reports_of_another_slot() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 1, 500, 100);
        pass(&mut estimate, 2..=6);
        let before = ReportedQueues::at(6, [0], &[900, 0, 0]);
        estimate.advance(7, &[serving(&[0])], &before, &[0; 3]); // the queue of SN 0 at the beginning of slot 7 is unknown
        assert_eq!(estimate.mean_bits(0), 100.0);
    }

    #[test]
    fn a_gap_with_a_full_buffer_only_raises_the_rate() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 1, 500, 100);
        pass(&mut estimate, 2..=6);
        contact(&mut estimate, 7, 1_000, 0); // at least 900 bit in 5 slots
        assert_eq!(estimate.mean_bits(0), 180.0);
        pass(&mut estimate, 8..=27);
        contact(&mut estimate, 28, 1_000, 0); // at least 1 000 bit in 20 slots, a weaker bound
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
    fn the_estimate_of_an_idle_sensor_node_is_constant() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 1, 500, 30);
        pass(&mut estimate, 2..=9);
        contact(&mut estimate, 10, 30, 30);
        assert_eq!((estimate.mean_bits(0), estimate.predict(1_000)[0]), (0.0, 30));
    }

    #[test]
    fn impossible_observations_change_nothing() {
        let mut estimate = estimate_of(Rates::Learnt);
        contact(&mut estimate, 5, 500, 30);
        let believed_bits = estimate.predict(9).to_vec();
        let none = ReportedQueues::default();
        estimate.advance(5, &[serving(&[1])], &none, &[9; 3]); // observed before
        estimate.advance(4, &[serving(&[1])], &none, &[9; 3]);
        estimate.advance(6, &[serving(&[1])], &none, &[9; 2]); // queues of another field
        estimate.advance(6, &[serving(&[3, u32::MAX])], &none, &[9; 3]); // unknown SNs
        assert_eq!(estimate.predict(9), believed_bits);
        let before = ReportedQueues::at(7, [0], &[500, 0, 0]);
        estimate.advance(7, &[serving(&[0, 0])], &before, &[2_000, 0, 0]); // twice, and more than the buffer
        // (500 − 30)/1 before slot 7, and at least 1 000 − 500 in it
        assert_eq!((estimate.predict(7)[0], estimate.mean_bits(0)), (1_000, 500.0));
    }
}
