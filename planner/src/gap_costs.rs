//! What gaps between the visits of a sensor cost, by their lengths.

use crate::keys::{ObjectiveWeights, PEAK_EXPONENT};

/// What a gap of g slots between two visits costs a sensor of weight 1. After k slots its age is k, 0 in a slot with a
/// visit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GapCosts {
    /// Of a bit that is lost.
    pub(crate) loss: f64,
    /// Of an age of a slot for a slot: `age · g (g − 1)/2`.
    age: f64,
    /// `peak_age · (g − 1)^8`.
    peak_age: f64,
    /// Of each slot with an age above the limit: `deadline · max(0, g − 1 − D)`.
    deadline: f64,
    /// The limit, D [slots].
    deadline_slots: f64,
}

impl GapCosts {
    /// Lost bits alone.
    pub const LOSS: Self = Self { loss: 1.0, age: 0.0, peak_age: 0.0, deadline: 0.0, deadline_slots: f64::INFINITY };

    /// The costs of an objective, with slots of `slot_s` [s] and ages up to `deadline_slots` [slots].
    #[must_use]
    pub fn new(weights: &ObjectiveWeights, slot_s: f64, deadline_slots: Option<u64>) -> Self {
        Self {
            loss: weights.of_bits(),
            age: weights.age * slot_s,
            peak_age: weights.peak_age * slot_s.powi(PEAK_EXPONENT),
            deadline: weights.deadline,
            deadline_slots: deadline_slots.map_or(f64::INFINITY, |slots| slots as f64),
        }
    }

    /// Whether nothing but visits counts, whatever they take.
    pub fn is_by_visits(&self) -> bool {
        self.loss == 0.0
    }

    /// Whether only lost bits count.
    pub fn is_by_bits(&self) -> bool {
        self.age == 0.0 && self.peak_age == 0.0 && self.deadline == 0.0
    }

    /// Of the ages in a gap of `gap` slots.
    #[inline]
    pub(crate) fn of_ages(&self, gap: f64) -> f64 {
        let peak = (gap - 1.0).max(0.0);
        let late = if self.deadline > 0.0 { (peak - self.deadline_slots).max(0.0) * self.deadline } else { 0.0 };
        self.age * 0.5 * gap * (gap - 1.0) + self.peak_age * peak.powi(PEAK_EXPONENT) + late
    }

    /// What the slot costs after which the age is `age` slots.
    fn of_slot(&self, age: f64) -> f64 {
        self.of_ages(age + 1.0) - self.of_ages(age)
    }

    /// Lower bound on what the ages cost in `slots` slots, if at most `most(K)` sensors, of these `weights`, are served
    /// in any K slots in a row.
    ///
    /// So at most `most(K)` sensors have an age below K, from slot K on. What a slot costs grows with the age by the
    /// steps `c(K) − c(K − 1)`, as costs of gaps are convex; each is paid by all but `most(K)` sensors, the heaviest
    /// ones.
    pub fn least_of_ages(&self, mut weights: Vec<f64>, slots: u64, most: impl Fn(u64) -> usize) -> f64 {
        weights.sort_by(|a, b| b.total_cmp(a));
        let mut rest: f64 = weights.iter().sum();
        let mut bound = 0.0;
        let mut served = 0;
        for age in 1..=slots {
            let young = most(age);
            if weights.len() <= young {
                break;
            }
            rest -= weights[served..young.max(served)].iter().sum::<f64>();
            served = young.max(served);
            let step = self.of_slot(age as f64) - self.of_slot(age as f64 - 1.0);
            bound += step * rest.max(0.0) * (slots - age + 1) as f64;
        }
        bound
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AGES: ObjectiveWeights = ObjectiveWeights { loss: 0.0, age: 1.0, peak_age: 0.0, deadline: 0.0, expiry: 0.0 };

    #[test]
    fn gaps_cost_what_their_slots_cost() {
        let sums = [
            (AGES, None),
            (ObjectiveWeights { age: 0.0, deadline: 2.0, ..AGES }, Some(3)),
            (ObjectiveWeights { age: 0.5, deadline: 1.0, ..AGES }, Some(2)),
        ];
        for (weights, limit) in sums {
            let costs = GapCosts::new(&weights, 2.0, limit);
            for gap in 1..20 {
                // Slot by slot: the ages 1 to g − 1.
                let ages = (1..gap).map(f64::from);
                let late = |age: f64| f64::from(u8::from(limit.is_some_and(|limit: u64| age > limit as f64)));
                let expected: f64 = ages.map(|age| weights.age * 2.0 * age + weights.deadline * late(age)).sum();
                assert!((costs.of_ages(f64::from(gap)) - expected).abs() < 1e-9, "{weights:?}, {gap}");
            }
        }
    }

    #[test]
    fn the_bound_of_a_cycle_is_its_mean_age() {
        // 12 sensors, 3 served in a slot, in turns: after the first round the mean age is (4 − 1)/2.
        let costs = GapCosts::new(&AGES, 1.0, None);
        let slots = 1_000;
        let most = |slots: u64| 3 * slots as usize;
        let least = costs.least_of_ages(vec![1.0; 12], 1_000, most);
        let served = |sensor: i32| {
            let first = sensor / 3 + 1;
            let last = first + (slots - first) / 4 * 4;
            let gaps = f64::from((last - first) / 4);
            let [begin, end] = [first, slots + 1 - last].map(|gap| costs.of_ages(f64::from(gap)));
            begin + gaps * costs.of_ages(4.0) + end
        };
        let flown: f64 = (0..12).map(served).sum();
        assert!(least <= flown && least > flown * 0.995, "{least} {flown}");
        assert!((flown / f64::from(12 * slots) - 1.5).abs() < 0.01);
        let weighted = costs.least_of_ages((1..=12).map(f64::from).collect(), 1_000, most);
        assert!(weighted < 6.5 * least, "the heaviest may be served more often");
    }
}
