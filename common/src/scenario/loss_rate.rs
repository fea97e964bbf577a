//! The data loss rate η: bits lost over bits sampled (decisions D3 and D24).

use crate::ledger::Totals;
use crate::scenario::Scenario;

/// Of what a loss of a mission is a fraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LossRate {
    /// Mean bits that the sensor nodes sample in a slot, `Σ_i s_i τ`; `None` if arrivals are drawn, and so counted.
    slot_bits: Option<f64>,
    /// Whether initial queues count as sampled.
    counts_initial: bool,
}

impl LossRate {
    /// That of a scenario with sensor nodes that sample `means_bits` [bit] per slot.
    #[must_use]
    pub fn of(scenario: &Scenario, means_bits: impl Iterator<Item = f64>) -> Self {
        Self {
            slot_bits: (!scenario.arrival_law().is_random()).then(|| means_bits.sum()),
            counts_initial: scenario.node_traits().loses_initial,
        }
    }

    /// Bits that count as sampled after `slots` slots: the mean of constant arrivals (decision D3), otherwise the
    /// `counted_bits` (decision D24); with the `initial_bits` of queues that are lost when bits expire or nodes die.
    pub fn sampled_bits(&self, slots: u64, initial_bits: f64, counted_bits: impl FnOnce() -> f64) -> f64 {
        let sampled_bits = self.slot_bits.map_or_else(counted_bits, |slot_bits| slot_bits * slots as f64);
        if self.counts_initial { sampled_bits + initial_bits } else { sampled_bits }
    }

    /// The loss rate `η` after `slots` slots with these `totals`; 0 of nothing.
    pub fn after(&self, slots: u64, totals: &Totals) -> f64 {
        let sampled_bits = self.sampled_bits(slots, totals.initial_bits as f64, || totals.sampled_bits as f64);
        fraction(totals.lost_bits as f64, sampled_bits)
    }
}

/// The part `lost_bits` of `sampled_bits`; 0 of nothing.
pub fn fraction(lost_bits: f64, sampled_bits: f64) -> f64 {
    if sampled_bits > 0.0 { lost_bits / sampled_bits } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Overrides;
    use std::path::Path;

    /// η after 4 slots of 1 s of 3 SNs with 0.3 bit/s each, of which 40 of 150 initial bits, and 3 sampled bits, are
    /// lost.
    fn rate(keys: &str) -> f64 {
        let text = format!("name = 'x'\nslots = 9\n[sensors]\ncount = 3\n{keys}");
        let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
        let totals = Totals { initial_bits: 150, sampled_bits: 6, lost_bits: 43, ..Totals::default() };
        LossRate::of(&scenario, [0.3; 3].into_iter()).after(4, &totals)
    }

    #[test]
    fn the_bits_sampled_are_the_mean_unless_arrivals_are_drawn() {
        // D3: 3 · 0.3 · 4 = 3.6 bit, of which whole bits are 3; D24: the 6 that were drawn.
        assert!((rate("") - 43.0 / 3.6).abs() < 1e-12, "{}", rate(""));
        assert_eq!(rate("[sensors.arrivals]\nmodel = 'poisson'\n"), 43.0 / 6.0);
    }

    #[test]
    fn initial_queues_count_where_bits_expire_or_sensor_nodes_die() {
        for keys in ["expiry_s = 5.0\n", "[sensors.energy]\ncapacity_j = 9.0\n"] {
            assert!((rate(keys) - 43.0 / 153.6).abs() < 1e-12, "{keys}");
        }
        assert_eq!(rate("expiry_s = 5.0\n[sensors.arrivals]\nmodel = 'poisson'\n"), 43.0 / 156.0);
        assert_eq!(rate("[link]\nduty_cycle = 0.5\nduty_window_s = 9.0\n"), rate(""), "nothing of them is lost");
    }

    #[test]
    fn a_loss_of_nothing_is_0() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        assert_eq!(LossRate::of(&scenario, [9.0].into_iter()).after(0, &Totals::default()), 0.0);
    }
}
