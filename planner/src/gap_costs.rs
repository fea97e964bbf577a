//! What gaps between the visits of a sensor cost, by their lengths.

use skysink_common::scenario::Scenario;

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
    /// Of the energy that the sensor takes for a visit, and of that for sending in all of its time.
    wake: f64,
    send: f64,
}

impl GapCosts {
    /// Lost bits alone.
    pub const LOSS: Self =
        Self { loss: 1.0, age: 0.0, peak_age: 0.0, deadline: 0.0, deadline_slots: f64::INFINITY, wake: 0.0, send: 0.0 };

    /// The costs of an objective, with slots of `slot_s` [s] and ages up to `deadline_slots` [slots].
    #[must_use]
    pub fn new(weights: &ObjectiveWeights, slot_s: f64, deadline_slots: Option<u64>) -> Self {
        Self {
            loss: weights.of_bits(),
            age: weights.age * slot_s,
            peak_age: weights.peak_age * slot_s.powi(PEAK_EXPONENT),
            deadline: weights.deadline,
            deadline_slots: deadline_slots.map_or(f64::INFINITY, |slots| slots as f64),
            ..Self::LOSS
        }
    }

    /// These costs with that of the energy of visits, `wake_j + tx_w τ_c` of a link that sends all the time.
    #[must_use]
    pub fn with_energy(self, weights: &ObjectiveWeights, scenario: &Scenario) -> Self {
        let Some(energy) = &scenario.sensors.energy else { return self };
        let sent_j = energy.tx_w * scenario.link.planned().comm_s;
        Self { wake: weights.energy_j * energy.wake_j.unwrap_or_default(), send: weights.energy_j * sent_j, ..self }
    }

    /// These costs for a sensor whose costs are multiplied by `weight`, except those of its energy.
    pub(crate) fn weighted(self, weight: f64) -> Self {
        Self { wake: self.wake / weight, send: self.send / weight, ..self }
    }

    /// Whether visits cost energy, so that not all that are possible are worth it.
    pub fn has_visit_costs(&self) -> bool {
        self.wake > 0.0 || self.send > 0.0
    }

    /// Of the energy of a visit that finds `stored` units where the link carries `capacity`.
    #[inline]
    pub(crate) fn of_visit(&self, stored: f64, capacity: f64) -> f64 {
        self.wake + if self.send > 0.0 && stored > 0.0 { self.send * (stored / capacity).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Whether nothing but visits counts, whatever they take.
    pub fn is_by_visits(&self) -> bool {
        self.loss == 0.0 && self.send == 0.0
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

    /// Lower bound on what the ages cost in `slots` slots, if at most `most(K)` sensors, of these `weights`, are served in
    /// any K slots in a row.
    ///
    /// So at most `most(K)` sensors have an age below K, from slot K on. What a slot costs grows with the age by the steps
    /// `c(K) − c(K − 1)`, as costs of gaps are convex; each is paid by all but `most(K)` sensors, the heaviest ones.
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
    use skysink_common::scenario::Overrides;

    const AGES: ObjectiveWeights =
        ObjectiveWeights { loss: 0.0, age: 1.0, peak_age: 0.0, deadline: 0.0, expiry: 0.0, energy_j: 0.0 };

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
    fn a_visit_costs_a_wake_up_and_the_part_of_a_slot_in_which_it_sends() {
        let costs = GapCosts { wake: 2.0, send: 3.0, ..GapCosts::new(&AGES, 1.0, None) };
        let energies = [0.0, 5.0, 10.0, 20.0].map(|stored| costs.of_visit(stored, 10.0));
        assert_eq!(energies, [2.0, 3.5, 5.0, 5.0]);
        let neither_sends = [GapCosts { send: 0.0, ..costs }.of_visit(5.0, 10.0), costs.of_visit(0.0, 0.0)];
        assert_eq!(neither_sends, [2.0; 2]);
    }

    #[test]
    fn energies_of_visits_are_weighted() {
        let text =
            "name = 'x'\nsensors.energy.capacity_j = 9.0\nsensors.energy.wake_j = 0.5\nsensors.energy.tx_w = 2.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        let weights = ObjectiveWeights { energy_j: 4.0, ..AGES };
        let costs = GapCosts::new(&weights, 1.0, None).with_energy(&weights, &scenario);
        assert_eq!((costs.wake, costs.send), (2.0, 8.0 * scenario.link.comm_s));
        let plain = Scenario::parse("name = 'x'\n", std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        assert_eq!(
            GapCosts::new(&weights, 1.0, None).with_energy(&weights, &plain),
            GapCosts::new(&weights, 1.0, None)
        );
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
