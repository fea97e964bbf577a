//! Sums over the gaps between the services of sensor nodes (SNs), and what they cost by an objective of ages (decision
//! D36).

use std::ops::Range;

use skysink_common::per_sensor::PerSensor;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_planner::settings::{ObjectiveWeights, PEAK_EXPONENT};

use crate::ages::{AgeRun, sum};

/// Sums over the gaps between the services of all SNs, each with a weight; the end of the mission ends the last ones.
#[derive(Debug, Clone)]
pub struct ServiceGaps {
    runs: Vec<AgeRun>,
    weights: PerSensor<f64>,
    /// The age above which a slot is late [slots].
    limit: u64,
    sums: GapSums,
}

/// Sums over gaps.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GapSums {
    /// Number of gaps.
    pub gaps: u64,
    /// Sum of the ages before their ends [slots].
    pub peaks: u64,
    /// The largest of these ages [slots].
    pub highest: u64,
    /// Weighted sum of the eighth powers of these ages [slots^8].
    pub powers: f64,
    /// Weighted sum of the ages after all slots [slots²].
    pub ages: f64,
    /// Weighted number of the slots with an age above the limit.
    pub late: f64,
}

impl GapSums {
    /// Adds the ages in a gap.
    fn add(&mut self, ages: &Range<u64>, weight: f64, limit: u64) {
        let peak = ages.end.saturating_sub(1);
        self.gaps += 1;
        self.peaks += peak;
        self.highest = self.highest.max(peak);
        self.powers += weight * (peak as f64).powi(PEAK_EXPONENT);
        self.ages += weight * sum(ages) as f64;
        self.late += weight * peak.saturating_sub(limit.max(ages.start.saturating_sub(1))) as f64;
    }
}

impl ServiceGaps {
    /// The sums before slot 1, for SNs with these weights; ages above `limit` [slots] are late.
    #[must_use]
    pub fn new(weights: Vec<f64>, limit: u64) -> Self {
        Self {
            runs: vec![AgeRun::FIRST; weights.len()],
            weights: PerSensor::new(weights),
            limit,
            sums: GapSums::default(),
        }
    }

    /// The sums before slot 1 of a mission.
    #[must_use]
    pub fn of(scenario: &Scenario, list: &SensorList) -> Self {
        let weights = list.weights(&list.sampling(scenario));
        let weights = (0..list.sensors().len()).map(|id| weights.factor(id)).collect();
        Self::new(weights, scenario.deadline_slots().unwrap_or(u64::MAX))
    }

    /// Adds a service of an SN in `slot`.
    pub fn serve(&mut self, sensor: usize, slot: u64) {
        let ages = self.runs[sensor].refresh(slot, slot);
        self.sums.add(&ages, self.weights.of(sensor), self.limit);
    }

    /// The sums up to the end of `slot`.
    pub fn sums(&self, slot: u64) -> GapSums {
        let mut sums = self.sums;
        for (run, weight) in self.runs.iter().zip(self.weights()) {
            sums.add(&run.ages(slot + 1), weight, self.limit);
        }
        sums
    }

    /// The sum of numbers by SN, by weight.
    pub fn weigh(&self, numbers: impl Iterator<Item = f64>) -> f64 {
        self.weights().zip(numbers).map(|(weight, number)| weight * number).sum()
    }

    /// What they cost up to the end of `slot`, beside lost bits, in slots of `slot_s` [s] (decision D36).
    pub fn cost(&self, objective: &ObjectiveWeights, slot: u64, slot_s: f64) -> f64 {
        let GapSums { ages, powers, late, .. } = self.sums(slot);
        objective.age * ages * slot_s
            + objective.peak_age * powers * slot_s.powi(PEAK_EXPONENT)
            + objective.deadline * late
    }

    /// The sum of the weights.
    pub fn weight(&self) -> f64 {
        self.weights().sum()
    }

    /// The weights, by id.
    fn weights(&self) -> impl Iterator<Item = f64> {
        (0..self.runs.len()).map(|sensor| self.weights.of(sensor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_sum_to_what_their_slots_cost() {
        // Served in slots 2 and 5 of 7: ages 1, 0, 1, 2, 0, 1, 2. Never served: 1 to 7.
        let mut gaps = ServiceGaps::new(vec![1.0, 0.5], 1);
        gaps.serve(0, 2);
        gaps.serve(0, 5);
        let powers = 1.0 + 2f64.powi(8) * 2.0 + 0.5 * 7f64.powi(8);
        let expected = GapSums { gaps: 4, peaks: 12, highest: 7, powers, ages: 7.0 + 14.0, late: 2.0 + 3.0 };
        assert_eq!(gaps.sums(7), expected);
        assert_eq!(gaps.weight(), 1.5);
    }
}
