//! Plans that were not flown as they were decided: a mission in which they are many says so.

use std::fmt;

use skysink_common::scenario::Scenario;

use crate::figures::Summary;
use crate::metrics::{Metric, MetricValues};

/// More slots than one in this many are named.
const FEW: u64 = 100;

/// The held slots and the refused requests of a mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnflownPlans {
    /// Slots in which a UAV held its position, without a plan in time or because its waypoint was refused.
    pub held_slots: u64,
    /// Requests of plans that were refused.
    pub refused: u64,
    /// The slots of all UAVs.
    pub uav_slots: u64,
}

impl UnflownPlans {
    /// Those of a mission, if it has held more than 1 % of its slots, or, with one UAV, refused more requests than 1 %
    /// of its slots. Fleets share sensor nodes, so refusals belong to them; so do waits for a pad.
    #[must_use]
    pub fn of_summary(summary: &Summary, scenario: &Scenario) -> Option<Self> {
        let pad_wait_s = summary.energy.and_then(|energy| energy.pad_wait_s);
        let counts = [summary.held_slots, summary.refused];
        Self::of(scenario, summary.slots, counts, pad_wait_s)
    }

    /// The same of a complete mission with these metrics.
    #[must_use]
    pub fn of_values(values: &MetricValues, scenario: &Scenario) -> Option<Self> {
        let [held_slots, refused, pad_wait_s] =
            [Metric::HeldSlots, Metric::Refused, Metric::PadWaitS].map(|metric| values[metric as usize]);
        let pad_wait_s = Some(pad_wait_s).filter(|wait_s| !wait_s.is_nan());
        Self::of(scenario, scenario.slots, [held_slots as u64, refused as u64], pad_wait_s)
    }

    /// The same of so many slots, with these slots held and requests refused, and this time of waiting for a pad [s].
    #[must_use]
    pub fn of(
        scenario: &Scenario,
        slots: u64,
        [held_slots, refused]: [u64; 2],
        pad_wait_s: Option<f64>,
    ) -> Option<Self> {
        let uavs = scenario.uav.uavs() as u64;
        let pad_waits = (pad_wait_s.unwrap_or(0.0) / scenario.slot_s).round() as u64;
        let of_plans = if uavs == 1 { refused.saturating_sub(pad_waits) } else { 0 };
        let uav_slots = slots * uavs;
        let is_named = held_slots.max(of_plans) * FEW > uav_slots;
        is_named.then_some(Self { held_slots, refused, uav_slots })
    }

    /// Whether a mission with these metrics has flown all its plans.
    #[must_use]
    pub fn has_none(values: &MetricValues) -> bool {
        [Metric::HeldSlots, Metric::Refused].iter().all(|metric| values[*metric as usize] == 0.0)
    }

    /// By how much it is worse than others.
    #[must_use]
    pub fn severity(&self) -> u64 {
        self.held_slots.max(self.refused)
    }
}

impl fmt::Display for UnflownPlans {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { held_slots, refused, uav_slots } = self;
        write!(formatter, "{held_slots} of {uav_slots} slots held, {refused} requests refused")
    }
}

/// Why plans are not flown, and where that is explained; it follows the figures.
pub const REASONS: &str = "a UAV holds without a plan in time, and where its waypoint is out of reach, outside the \
                           area or behind a zone; a sensor node out of range is not served \
                           (docs/src/metrics.md#refusals)";

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;
    use std::path::Path;
    use strum::EnumCount as _;

    fn of(keys: &str, held_slots: u64, refused: u64, pad_wait_s: f64) -> Option<String> {
        let text = format!("name = 'a'\nslots = 250\nslot_s = 2.0\n{keys}");
        let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
        let mut values: MetricValues = [f64::NAN; Metric::COUNT];
        values[Metric::HeldSlots as usize] = held_slots as f64;
        values[Metric::Refused as usize] = refused as f64;
        values[Metric::PadWaitS as usize] = pad_wait_s;
        UnflownPlans::of_values(&values, &scenario).map(|unflown| unflown.to_string())
    }

    #[test]
    fn more_than_one_slot_in_a_hundred_is_named() {
        assert_eq!(of("", 2, 2, f64::NAN), None);
        assert_eq!(of("", 3, 0, f64::NAN).unwrap(), "3 of 250 slots held, 0 requests refused");
        assert_eq!(of("", 0, 3, f64::NAN).unwrap(), "0 of 250 slots held, 3 requests refused");
        // 5 of 500 slots of two UAVs; what they refuse each other does not count.
        let fleet = "[uav]\ncount = 2\n";
        assert_eq!(of(fleet, 5, 900, f64::NAN), None);
        assert_eq!(of(fleet, 6, 900, f64::NAN).unwrap(), "6 of 500 slots held, 900 requests refused");
    }

    #[test]
    fn waits_for_a_pad_are_no_refusals() {
        assert_eq!(of("", 0, 42, 80.0), None); // 40 slots of 2 s
        assert_eq!(of("", 0, 43, 80.0).unwrap(), "0 of 250 slots held, 43 requests refused");
    }
}
