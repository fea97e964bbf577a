//! One slot of the field: sample, overflow, upload (decision D1).

use std::mem::MaybeUninit;
use std::ops::Range;

use skysink_common::ledger::{Ledger, Totals};
use skysink_common::message::FlightReport;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::wide::BLOCK;

use crate::arrivals::{Rates, arrival_bits, block_bits};

/// The sensor field and its queues.
#[derive(Debug, Clone)]
pub struct Field {
    ledger: Ledger,
    rates: Rates,
}

/// What one slot moved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SlotBits {
    /// Uploaded, `Σ Thr_i(t)`.
    pub delivered_bits: u64,
    /// Lost, `Σ D_i(t)`.
    pub lost_bits: u64,
}

/// A flight that cannot have been.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FieldError {
    /// A link to nobody.
    #[error("flight({slot}) serves SN {sensor}: expected ids below {count}")]
    UnknownSensor {
        /// The slot.
        slot: u64,
        /// The id.
        sensor: u32,
        /// Sensor nodes in the field.
        count: usize,
    },
}

impl Field {
    /// The field before slot 1.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        let mean_bits = list.sensors().iter().map(|sensor| sensor.sampling_bps * scenario.slot_s).collect();
        Self { ledger: Ledger::new(scenario.sensors.capacity_bits, list.queues_bits()), rates: Rates::new(mean_bits) }
    }

    /// Lives through `slot`, from 1: every sensor node samples, full ones lose the excess, then the served ones upload
    /// what their links can carry, `Thr_i = min(floor(r_i τ_c), q)` (UTS eq. 7 in the order of decision D1).
    ///
    /// # Errors
    /// If the report serves a sensor node that does not exist; nothing has changed then.
    pub fn step(&mut self, slot: u64, flight: &FlightReport) -> Result<SlotBits, FieldError> {
        self.live(slot, flight, Mirror::Absent)
    }

    /// Lives through `slot` as [`Field::step`] does, and writes the new queues [bit] to `queues_bits`, too, by sensor
    /// node: into a message, as they are made.
    ///
    /// All of `queues_bits` is written, unless an error is returned.
    ///
    /// # Errors
    /// If the report serves a sensor node that does not exist; nothing has changed then.
    ///
    /// # Panics
    /// If there is not one place per sensor node.
    pub fn step_into(
        &mut self,
        slot: u64,
        flight: &FlightReport,
        queues_bits: &mut [MaybeUninit<u32>],
    ) -> Result<SlotBits, FieldError> {
        assert_eq!(queues_bits.len(), self.queues_bits().len(), "expected one place per sensor node");
        self.live(slot, flight, Mirror::Present(queues_bits))
    }

    /// The slot, block by block, so that a block is copied while it is still in the fastest cache.
    fn live(&mut self, slot: u64, flight: &FlightReport, mut mirror: Mirror) -> Result<SlotBits, FieldError> {
        let count = self.queues_bits().len();
        if let Some(link) = flight.served_links().iter().find(|link| link.sensor as usize >= count) {
            return Err(FieldError::UnknownSensor { slot, sensor: link.sensor, count });
        }
        let mut lost_bits = 0;
        for first in (0..count).step_by(BLOCK) {
            let sensors = first..count.min(first + BLOCK);
            lost_bits += self.sample(slot, sensors.clone());
            mirror.write(first, &self.ledger.queues_bits()[sensors]);
        }
        let mut delivered_bits = 0;
        for link in flight.served_links() {
            let sensor = link.sensor as usize;
            delivered_bits += self.ledger.upload(sensor, link.capacity_bits);
            mirror.write(sensor, &self.ledger.queues_bits()[sensor..=sensor]);
        }
        Ok(SlotBits { delivered_bits, lost_bits })
    }

    /// The sensor nodes of a block sample; what they lose is returned [bit].
    fn sample(&mut self, slot: u64, sensors: Range<usize>) -> u64 {
        let mean_bits = match &self.rates {
            Rates::Alike(mean_bits) => {
                return self.ledger.sample_alike(sensors, arrival_bits(*mean_bits, slot), *mean_bits);
            }
            Rates::Each(mean_bits) => &mean_bits[sensors.clone()],
        };
        match block_bits(mean_bits, slot, &mut [0; BLOCK]) {
            Some(bits) => self.ledger.sample_each(sensors.start, bits, mean_bits),
            None => {
                let sample = |(sensor, &mean)| self.ledger.sample(sensor, arrival_bits(mean, slot), mean);
                sensors.zip(mean_bits).map(sample).sum()
            }
        }
    }

    /// Takes over a state that this field was in, if it can have been; says whether it did. The mission's bits are all
    /// there; what each sensor node has delivered counts from here.
    #[must_use]
    pub fn take_over(&mut self, queues_bits: &[u32], totals: Totals) -> bool {
        self.ledger.take_over(queues_bits, totals)
    }

    /// Queue lengths [bit], by sensor node.
    #[must_use]
    pub fn queues_bits(&self) -> &[u32] {
        self.ledger.queues_bits()
    }

    /// Bits uploaded so far, by sensor node.
    #[must_use]
    pub fn delivered_bits(&self) -> &[u64] {
        self.ledger.delivered_bits()
    }

    /// Every bit since the mission's start.
    #[must_use]
    pub fn totals(&self) -> &Totals {
        self.ledger.totals()
    }
}

/// Whether new queues are written elsewhere beside the ledger.
enum Mirror<'a> {
    Absent,
    Present(&'a mut [MaybeUninit<u32>]),
}

impl Mirror<'_> {
    /// Writes the queues [bit] of the sensor nodes from `first`.
    fn write(&mut self, first: usize, queues_bits: &[u32]) {
        if let Self::Present(copy) = self {
            copy[first..first + queues_bits.len()].write_copy_of_slice(queues_bits);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use skysink_common::message::{LinkReport, Mode};
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    fn field(queue_bits: u32) -> Field {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let list = format!("x_m,y_m,queue_bits\n10,10,{queue_bits}\n20,20,5\n");
        let list = SensorList::parse(&list, Path::new("list.csv"), &scenario).unwrap();
        Field::new(&scenario, &list)
    }

    fn serving(sensor: u32, capacity_bits: u64) -> FlightReport {
        let mut report = FlightReport::at([10.0, 10.0, 20.0], Mode::Serve);
        report.links[0] = LinkReport { sensor, capacity_bits, ..LinkReport::default() };
        report.served = 1;
        report
    }

    #[test]
    fn an_overflow_is_lost_even_in_the_slot_of_the_visit() {
        let mut field = field(29_950);
        let bits = field.step(1, &serving(0, 6_000_000)).unwrap();
        // sample: 29 950 + 100 = 30 050; overflow: 50 lost; upload: all of the 30 000
        assert_eq!(bits, SlotBits { delivered_bits: 30_000, lost_bits: 50 });
        assert_eq!(field.queues_bits(), [0, 105]);
        assert!(field.totals().balanced());
    }

    #[test]
    fn a_narrow_link_leaves_the_rest_in_the_queue() {
        let mut field = field(10_000);
        assert_eq!(field.step(1, &serving(0, 6_000)).unwrap().delivered_bits, 6_000);
        assert_eq!(field.queues_bits()[0], 4_100); // 10 000 + 100 − 6 000
    }

    #[test]
    fn a_link_to_nobody_is_refused_and_changes_nothing() {
        let mut field = field(10_000);
        let error = field.step(1, &serving(2, 1)).unwrap_err();
        assert_eq!(error.to_string(), "flight(1) serves SN 2: expected ids below 2");
        assert_eq!(field.queues_bits(), [10_000, 5]);
    }

    /// More SNs than a block holds, at their own rates [bit/s] or at one, with storages that some fill.
    fn lists() -> impl Strategy<Value = (Scenario, SensorList)> {
        let rates = prop_oneof![
            prop::collection::vec(prop_oneof![Just(100.0), Just(2.5), 0.0..1e3, 0.0..4e9], 1..1_500),
            (prop_oneof![Just(100.0), Just(2.5), Just(4e9)], 1usize..3_000).prop_map(|(rate, count)| vec![rate; count]),
        ];
        (rates, prop_oneof![Just(u32::MAX), Just(30_000), 1u32..3_000]).prop_map(|(rates_bps, capacity_bits)| {
            let text = format!("name = 'a'\n[sensors]\ncapacity_bits = {capacity_bits}\n");
            let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
            let row =
                |(id, rate_bps): (u32, &f64)| format!("1,2,{},{rate_bps}\n", id.wrapping_mul(977) % capacity_bits);
            let rows: String = (0..).zip(&rates_bps).map(row).collect();
            let list = format!("x_m,y_m,queue_bits,sampling_bps\n{rows}");
            let list = SensorList::parse(&list, Path::new("list.csv"), &scenario).unwrap();
            (scenario, list)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]

        /// Down to the last bit of the one total that is no integer.
        #[test]
        fn a_field_lives_as_its_sensor_nodes_would_one_by_one((scenario, list) in lists(), served in 0u32..3_000) {
            let (count, capacity_bits) = (list.sensors().len(), scenario.sensors.capacity_bits);
            let mean_bits: Vec<f64> = list.sensors().iter().map(|sensor| sensor.sampling_bps * scenario.slot_s).collect();
            let mut singly = Ledger::new(capacity_bits, list.queues_bits());
            let (mut in_place, mut into_message) = (Field::new(&scenario, &list), Field::new(&scenario, &list));
            let report = serving(served % count as u32, 700);
            for slot in 1..=6 {
                let sample = |(sensor, &mean)| singly.sample(sensor, arrival_bits(mean, slot), mean);
                let lost_bits = mean_bits.iter().enumerate().map(sample).sum();
                let delivered_bits = singly.upload(served as usize % count, 700);
                let mut message = vec![MaybeUninit::new(u32::MAX); count];
                let bits = in_place.step(slot, &report).unwrap();
                prop_assert_eq!(bits, SlotBits { delivered_bits, lost_bits });
                prop_assert_eq!(into_message.step_into(slot, &report, &mut message).unwrap(), bits);
                prop_assert_eq!(&in_place.ledger, &singly);
                prop_assert_eq!(&into_message.ledger, &singly);
                prop_assert_eq!(singly.totals().lost_slots.to_bits(), in_place.totals().lost_slots.to_bits());
                // SAFETY: all of it was initialised above.
                let written = message.iter().map(|queue_bits| unsafe { queue_bits.assume_init() });
                prop_assert_eq!(written.collect::<Vec<u32>>(), singly.queues_bits());
            }
        }
    }

    #[test]
    #[should_panic(expected = "expected one place per sensor node")]
    fn a_message_of_another_length_is_refused() {
        let _ = field(10_000).step_into(1, &serving(0, 1), &mut [MaybeUninit::uninit(); 3]);
    }
}
