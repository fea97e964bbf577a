//! One slot of the field: sample, overflow, upload (decision D1).

use skysink_common::ledger::{Ledger, Totals};
use skysink_common::message::FlightReport;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

use crate::arrivals::arrival_bits;

/// The sensor field and its queues.
#[derive(Debug, Clone)]
pub struct Field {
    ledger: Ledger,
    /// What each sensor node samples in a slot on average, `s_i τ` [bit].
    mean_bits: Vec<f64>,
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
        Self { ledger: Ledger::new(scenario.sensors.capacity_bits, list.queues_bits()), mean_bits }
    }

    /// Lives through `slot`, from 1: every sensor node samples, full ones lose the excess, then the served ones upload
    /// what their links can carry, `Thr_i = min(floor(r_i τ_c), q)` (UTS eq. 7 in the order of decision D1).
    ///
    /// # Errors
    /// If the report serves a sensor node that does not exist; nothing has changed then.
    pub fn step(&mut self, slot: u64, flight: &FlightReport) -> Result<SlotBits, FieldError> {
        let count = self.mean_bits.len();
        if let Some(link) = flight.served_links().iter().find(|link| link.sensor as usize >= count) {
            return Err(FieldError::UnknownSensor { slot, sensor: link.sensor, count });
        }
        let mut bits = SlotBits::default();
        for (sensor, &mean_bits) in self.mean_bits.iter().enumerate() {
            bits.lost_bits += self.ledger.sample(sensor, arrival_bits(mean_bits, slot), mean_bits);
        }
        for link in flight.served_links() {
            bits.delivered_bits += self.ledger.upload(link.sensor as usize, link.capacity_bits);
        }
        Ok(bits)
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

#[cfg(test)]
mod tests {
    use super::*;
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
        let mut report = FlightReport::at(10.0, 10.0, 20.0, Mode::Serve);
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
}
