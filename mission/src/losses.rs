//! What the sensor nodes (SNs) of a mission lose by weight, and the states of their features, which the totals of its
//! messages do not say.

use skysink_common::geometry::Position;
use skysink_common::ledger::Ledger;
use skysink_common::loss_rate::LossRate;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{SlotRecord, beacons, uploads};
use skysink_common::weights::Weights;

/// A ledger beside that of the field, from the flights.
#[derive(Debug)]
pub(crate) struct Losses {
    pub(crate) ledger: Ledger,
    weights: Weights,
    slot: u64,
    /// The loss rate by weight (decision D25).
    rate: LossRate,
    /// The initial queues, weighted [bit].
    initial_bits: f64,
}

impl Losses {
    /// The losses before slot 1; `None` where all weights are equal, and the SNs have no features.
    pub(crate) fn new(scenario: &Scenario, list: &SensorList) -> Option<Self> {
        let sampling = list.sampling(scenario);
        let weights = list.weights(&sampling);
        let means_bits = (0..list.sensors().len()).map(|id| sampling.of(id).mean_bits);
        let rate = LossRate::of(scenario, std::iter::once(weights.sum(means_bits)));
        let is_needed = !weights.are_equal() || scenario.node_keys().rows().next().is_some();
        let initial_bits = weights.sum(list.sensors().iter().map(|sensor| f64::from(sensor.queue_bits)));
        is_needed.then(|| Self { ledger: list.ledger(scenario), weights, slot: 0, rate, initial_bits })
    }

    /// Adds a slot in the order of decision D1.
    pub(crate) fn add(&mut self, record: &SlotRecord) {
        self.slot = record.slot();
        self.ledger.sample(self.slot);
        for link in uploads(record.flights()) {
            let _ = self.ledger.serve(self.slot, link.sensor as usize, link.capacity_bits, link.rate_bps);
        }
        self.ledger.end_slot(self.slot, &beacons(record.flights()).collect::<Vec<Position>>());
    }

    /// Bits lost so far by weight (decision D25); `None` where all weights are equal.
    pub(crate) fn weighted_bits(&self) -> Option<f64> {
        let lost_bits = || self.ledger.lost_bits(self.slot).map(|lost_bits| lost_bits as f64);
        (!self.weights.are_equal()).then(|| self.weights.sum(lost_bits()))
    }

    /// Bits that count as sampled so far by weight.
    pub(crate) fn weighted_sampled_bits(&self) -> f64 {
        self.rate.sampled_bits(self.slot, self.initial_bits, || {
            let sampled_bits = (0..self.ledger.queues_bits().len()).map(|id| self.ledger.sampled_bits(id, self.slot));
            self.weights.sum(sampled_bits.map(|sampled_bits| sampled_bits as f64))
        })
    }
}
