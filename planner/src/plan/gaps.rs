//! Objectives of ages: what a plan costs by the slots between the visits of a sensor, beside the bits it loses.

use super::in_passing::InPassing;
use super::loss::Loss;
use super::objective::{EQUAL_SLOTS, Objective, Reached};
use super::sensor::SensorModel;
use crate::gap_costs::GapCosts;

/// The sum of what gaps cost, by [`GapCosts`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaps;

/// The buffer of a sensor, and its last visit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GapLevel {
    /// The slot in which it would have been empty, as for [`Loss`].
    empty: f64,
    /// The slot of the last visit.
    last: f64,
}

impl Gaps {
    /// What a gap of `gap` slots costs that ends with so much overflow.
    #[inline]
    fn cost(sensor: &SensorModel, overflow_slots: f64, gap: f64) -> f64 {
        let GapCosts { loss, .. } = sensor.costs;
        (if loss > 0.0 { loss * overflow_slots * sensor.mean_bits } else { 0.0 }) + sensor.costs.of_ages(gap)
    }
}

impl Objective for Gaps {
    type Level = GapLevel;
    type Style = InPassing;

    const COUNTS_AGES: bool = true;

    fn begin(sensor: &SensorModel, queue_bits: f64, age_slots: f64) -> GapLevel {
        let empty = if sensor.mean_bits > 0.0 { Loss::begin(sensor, queue_bits, age_slots) } else { 0.0 };
        GapLevel { empty, last: -age_slots }
    }

    #[inline]
    fn price(sensor: &SensorModel) -> f64 {
        sensor.weight
    }

    #[inline]
    fn capacity(sensor: &SensorModel, bits: f64) -> f64 {
        if sensor.mean_bits > 0.0 { Loss::capacity(sensor, bits) } else { f64::INFINITY }
    }

    #[inline]
    fn visit(sensor: &SensorModel, level: GapLevel, slot: f64, capacity: f64) -> (f64, GapLevel) {
        let (overflow_slots, empty) = Loss::visit(sensor, level.empty, slot, capacity);
        (Self::cost(sensor, overflow_slots, slot - level.last), GapLevel { empty, last: slot })
    }

    fn visit_bits(sensor: &SensorModel, units: f64, capacity: f64) -> f64 {
        if sensor.costs.is_by_visits() { f64::INFINITY } else { Loss::visit_bits(sensor, units, capacity) }
    }

    /// The age of the last slot counts, too: as if there was a visit after it.
    #[inline]
    fn rest(sensor: &SensorModel, level: GapLevel, end: f64) -> f64 {
        Self::cost(sensor, Loss::rest(sensor, level.empty, end), end + 1.0 - level.last)
    }

    fn beyond(sensor: &SensorModel, level: GapLevel, end: f64, round_slots: f64, slots: f64) -> f64 {
        let GapCosts { loss, .. } = sensor.costs;
        let bits = Loss::beyond(sensor, level.empty, end, round_slots, slots) * sensor.mean_bits;
        let gap = end + 1.0 - level.last;
        let more = (0.5 * round_slots).min(slots);
        (if loss > 0.0 { loss * bits } else { 0.0 }) + sensor.costs.of_ages(gap + more) - sensor.costs.of_ages(gap)
    }

    /// For ages the difference, after a round without another visit, between a gap with and without the visit.
    #[inline]
    fn saving(sensor: &SensorModel, level: GapLevel, slot: f64, capacity: f64, round_slots: f64) -> (f64, f64) {
        let GapCosts { loss, .. } = sensor.costs;
        let (bits, left) = Loss::saving(sensor, level.empty, slot, capacity, round_slots);
        let gap = slot - level.last;
        let of = |gap: f64| sensor.costs.of_ages(gap);
        let ages = (of(gap + round_slots) - of(gap) - of(round_slots)) * sensor.weight;
        if loss > 0.0 { (loss * bits + ages, left) } else { (ages, 0.0) }
    }

    #[inline]
    fn since(level: GapLevel) -> f64 {
        level.last
    }

    #[inline]
    fn later(level: GapLevel, slots: f64) -> GapLevel {
        GapLevel { empty: level.empty + slots, last: level.last + slots }
    }

    #[inline]
    fn agree(sensor: &SensorModel, now: &Reached<GapLevel>, then: &Reached<GapLevel>) -> bool {
        let age = |reached: &Reached<GapLevel>| reached.slot - reached.level.last;
        let buffer = |reached: &Reached<GapLevel>| Reached { slot: reached.slot, level: reached.level.empty };
        (age(now) - age(then)).abs() <= EQUAL_SLOTS
            && (sensor.costs.is_by_visits() || Loss::agree(sensor, &buffer(now), &buffer(then)))
    }

    fn least(sensors: &[SensorModel], levels: &[GapLevel], slots: i32, blocks: usize) -> f64 {
        let Some(SensorModel { costs, .. }) = sensors.first() else { return 0.0 };
        let weights = sensors.iter().map(|sensor| sensor.weight).collect();
        let most = |slots| usize::try_from(slots).unwrap_or(usize::MAX).saturating_mul(blocks);
        let ages = costs.least_of_ages(weights, slots.max(0) as u64, most);
        if costs.is_by_visits() {
            return ages;
        }
        let sampling = sensors.iter().zip(levels).filter(|(sensor, _)| sensor.mean_bits > 0.0);
        let (sampling, empties): (Vec<SensorModel>, Vec<f64>) =
            sampling.map(|(sensor, level)| (*sensor, level.empty)).unzip();
        ages + costs.loss * Loss::least(&sampling, &empties, slots, blocks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::tests::model_of;
    use crate::settings::ObjectiveWeights;

    #[test]
    fn a_visit_saves_what_a_gap_costs_more_than_its_two_parts() {
        let mut sensor = model_of(&[([200.0, 200.0], 500.0)], 1, 5e6).sensors[0];
        let weights = ObjectiveWeights { loss: 0.0, age: 2.0, peak_age: 0.0, deadline: 0.0, expiry: 0.0 };
        sensor.costs = GapCosts::new(&weights, 1.0, None);
        sensor.weight = 3.0;
        let level = GapLevel { empty: 2.0, last: 2.0 };
        // After 8 and 7 slots more: 2 (15·14 − 8·7 − 7·6)/2 = 112.
        let (saved, left) = Gaps::saving(&sensor, level, 10.0, f64::INFINITY, 7.0);
        assert_eq!((saved, left), (112.0 * 3.0, 0.0));
        sensor.mean_bits = 0.0;
        assert_eq!(Gaps::begin(&sensor, 9.0, 4.0), GapLevel { empty: 0.0, last: -4.0 }, "it samples nothing");
    }
}
