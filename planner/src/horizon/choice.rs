//! The schedule of a slot with more sensors in range than resource blocks: those whose visits save most.

use std::cmp::Ordering;

use skysink_common::geometry::Position;

use super::model::PlanningModel;

/// Expected loss [slots of sampling] of a sensor with `left` slots of room, until its next visit at a time that is
/// uniform within `until` slots: `max(0, until − left)²/(2 until)`.
#[inline]
#[must_use]
pub fn late_slots(left: f64, until: f64) -> f64 {
    let late = (until - left).max(0.0);
    late * late / (2.0 * until)
}

/// A sensor in range at the end of a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The sensor.
    pub sensor: u32,
    /// The most that a visit takes [slots of sampling].
    pub capacity_slots: f64,
    /// Expected loss [bit] that a visit saves; infinite for the members of the stop.
    pub saved_bits: f64,
    /// Slots until its buffer is full, at least 0: the planner of the next slot sees only that a queue is full, and has
    /// to make the same choice.
    left_slots: f64,
}

impl Candidate {
    /// The candidate `sensor` at the squared distance `d2_m2` [m²] from the UAV above `at`, before [`Self::weigh`].
    #[inline]
    #[must_use]
    pub fn new(model: &PlanningModel, sensor: u32, d2_m2: f64, at: &Position) -> Self {
        let in_sight = model.sees(sensor, at);
        Self { sensor, capacity_slots: model.capacity_slots(sensor, d2_m2, in_sight), saved_bits: 0.0, left_slots: 0.0 }
    }

    /// Sets the loss that a visit saves, `gap_slots` after the sensor was or would have been empty: the difference of
    /// [`late_slots`] with and without it, for a next visit within a round.
    #[inline]
    pub fn weigh(&mut self, model: &PlanningModel, gap_slots: f64) {
        let sensor = &model.sensors[self.sensor as usize];
        let stored = gap_slots.min(sensor.fill_slots);
        let rest = (stored - self.capacity_slots).max(0.0);
        let late = |stored: f64| late_slots(sensor.fill_slots - stored, model.round_slots);
        self.saved_bits = (late(stored) - late(rest)) * sensor.cost_bits;
        self.left_slots = sensor.fill_slots - stored;
    }

    /// Most saved first; ties by the least room, then by the lowest number.
    #[must_use]
    pub fn order(a: &Self, b: &Self) -> Ordering {
        b.saved_bits.total_cmp(&a.saved_bits).then(a.left_slots.total_cmp(&b.left_slots)).then(a.sensor.cmp(&b.sensor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::horizon::tests::model_of;

    /// Two SNs at rest beside each other that fill within 30 slots; a round over them takes a slot, but `until` is set.
    fn model(width_hz: f64, until: f64) -> PlanningModel {
        let mut model = model_of(&[([200.0, 200.0], 1_000.0), ([201.0, 200.0], 1_000.0)], 1, width_hz);
        model.round_slots = until;
        model
    }

    fn saved_bits(model: &PlanningModel, gap_slots: f64) -> f64 {
        let mut candidate = Candidate::new(model, 0, 0.0, &Position::origin());
        candidate.weigh(model, gap_slots);
        candidate.saved_bits
    }

    #[test]
    fn a_visit_saves_what_would_overflow_before_the_next_one() {
        // Full in 30 slots, next visit evenly within 50. With 10 slots of room 40²/100 = 16 slots are lost on average,
        // after it was emptied 20²/100 = 4.
        let model = model(5e6, 50.0);
        assert_eq!((late_slots(10.0, 50.0), late_slots(60.0, 50.0)), (16.0, 0.0));
        assert!((saved_bits(&model, 20.0) - 12_000.0).abs() < 1e-9);
    }

    #[test]
    fn savings_are_limited_by_the_link() {
        let model = model(5e3, 50.0);
        let carried = model.capacity_slots(0, 0.0, true);
        assert!((6.0..7.0).contains(&carried), "{carried} slots of 1000 bit");
        // From a full buffer: 50²/100 − (50 − c)²/100 slots.
        let expected_bits = (25.0 - (50.0 - carried).powi(2) / 100.0) * 1_000.0;
        assert!((saved_bits(&model, 30.0) - expected_bits).abs() < 1e-9 && expected_bits < carried * 1_000.0);
    }

    #[test]
    fn the_savings_of_a_full_queue_do_not_depend_on_its_age() {
        let model = model(5e6, 50.0);
        let weighed = |gap_slots| {
            let mut candidate = Candidate::new(&model, 0, 0.0, &Position::origin());
            candidate.weigh(&model, gap_slots);
            candidate
        };
        assert_eq!(weighed(30.0), weighed(75.0));
        let mut fuller = Candidate::new(&model, 1, 0.0, &Position::origin());
        fuller.weigh(&model, 29.0);
        assert_eq!(Candidate::order(&weighed(30.0), &fuller), Ordering::Less);
        fuller.saved_bits = f64::INFINITY;
        assert_eq!(Candidate::order(&weighed(30.0), &fuller), Ordering::Greater);
    }

    #[test]
    fn ties_of_savings_go_to_the_least_room_then_the_lowest_number() {
        // With 25 or 20 slots of room nothing is lost before a visit within 10 slots.
        let model = model(5e6, 10.0);
        let weighed = |sensor: u32, gap_slots: f64| {
            let mut candidate = Candidate::new(&model, sensor, 0.0, &Position::origin());
            candidate.weigh(&model, gap_slots);
            assert_eq!(candidate.saved_bits, 0.0);
            candidate
        };
        assert_eq!(Candidate::order(&weighed(1, 10.0), &weighed(0, 5.0)), Ordering::Less);
        assert_eq!(Candidate::order(&weighed(1, 10.0), &weighed(0, 10.0)), Ordering::Greater);
    }
}
