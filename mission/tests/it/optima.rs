//! Small fields whose optima are known by enumeration: the look-ahead reaches them, and no bound exceeds them (decision
//! D36).

use std::collections::HashMap;

use crate::support::scenario_of;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_mission::origin::RunMode;
use skysink_mission::tally::Tally;
use skysink_planner::bound::{cost_bound, mission_bound};
use skysink_planner::settings::{ObjectiveWeights, Settings};

/// Distance that the UAV flies in a slot [m].
const REACH_M: f64 = 20.0;

/// Side of the field [m], from whose centre the UAV starts.
const SIDE_M: f64 = 110.0;

/// Age above which slots are late [slots].
const LIMIT: f64 = 4.0;

/// Sensor nodes as points: one at a time is in range.
struct Field {
    positions: Vec<[f64; 2]>,
    /// Bits sampled in a slot, in the buffer, and in the queue before slot 1.
    bits: Vec<[u32; 3]>,
    slots: u32,
}

impl Field {
    /// A field without flights that only just take one slot less.
    fn draw(random: &mut ChaCha8Rng) -> Self {
        loop {
            let sensors = random.random_range(2..=4);
            let positions = (0..sensors).map(|_| [0, 1].map(|_| random.random_range(2.0..SIDE_M - 2.0))).collect();
            let bits = |_| {
                let capacity_bits = random.random_range(300..2_000);
                [random.random_range(50..600), capacity_bits, random.random_range(0..=capacity_bits)]
            };
            let bits = (0..sensors).map(bits).collect();
            let field = Self { positions, bits, slots: random.random_range(8..=12) };
            let starts = (0..=sensors).flat_map(|from| (0..sensors).map(move |to| (from, to)));
            let mut legs = starts.filter(|(from, to)| from != to).map(|(from, to)| field.leg_slots(from, to));
            if legs.all(|slots| (0.1..0.9).contains(&slots.fract())) {
                return field;
            }
        }
    }

    /// Slots of the flight to a sensor node from another, or from the start, which has the number after them.
    fn leg_slots(&self, from: usize, to: usize) -> f64 {
        let [from, to] = [from, to].map(|stop| self.positions.get(stop).copied().unwrap_or([SIDE_M / 2.0; 2]));
        (from[0] - to[0]).hypot(from[1] - to[1]) / REACH_M
    }

    /// What the gap of a sensor node costs from the visit in slot `from`, 0 for the start, to that in slot `to`, or to
    /// the end.
    fn gap_cost(&self, weights: &ObjectiveWeights, sensor: usize, from: u32, to: u32) -> f64 {
        let [slot_bits, capacity_bits, first_bits] = self.bits[sensor];
        let held_bits = if from == 0 { first_bits } else { 0 };
        let sampled_bits = slot_bits * (to.min(self.slots) - from);
        let lost_bits = f64::from((held_bits + sampled_bits).saturating_sub(capacity_bits));
        let gap = f64::from(to - from);
        weights.loss * lost_bits
            + weights.age * gap * (gap - 1.0) / 2.0
            + weights.peak_age * (gap - 1.0).powi(8)
            + weights.deadline * (gap - 1.0 - LIMIT).max(0.0)
    }

    /// The least cost of the slots after `slot`, from a stop, after these last visits.
    fn least(
        &self,
        weights: &ObjectiveWeights,
        at: (u32, usize, Vec<u32>),
        known: &mut HashMap<(u32, usize, Vec<u32>), f64>,
    ) -> f64 {
        if let Some(cost) = known.get(&at) {
            return *cost;
        }
        let (slot, stop, last) = &at;
        let rest = |(sensor, from): (usize, &u32)| self.gap_cost(weights, sensor, *from, self.slots + 1);
        let mut best: f64 = last.iter().enumerate().map(rest).sum();
        for to in 0..self.positions.len() {
            let end = slot + (self.leg_slots(*stop, to).ceil() as u32).max(1);
            if end <= self.slots {
                let mut next = last.clone();
                next[to] = end;
                let visit = self.gap_cost(weights, to, last[to], end);
                best = best.min(visit + self.least(weights, (end, to, next), known));
            }
        }
        known.insert(at, best);
        best
    }

    fn text(&self, objective: &str) -> String {
        format!(
            "name = 'optima'\nslots = {}\narea.side_m = {SIDE_M}\nsensors.file = 's.csv'\nsensors.deadline_s = {LIMIT}\n\
             uav.max_speed_mps = {REACH_M}\nlink.comm_radius_m = 0.5\nlink.bandwidth_hz = 5e6\n\
             planner.objective = {objective}\nplanner.horizon.iterations = 3000\n",
            self.slots
        )
    }

    fn csv(&self) -> String {
        let row = |([x_m, y_m], [slot_bits, capacity_bits, first_bits]): (&[f64; 2], &[u32; 3])| {
            format!("{x_m},{y_m},{slot_bits},{capacity_bits},{first_bits}\n")
        };
        let rows: String = self.positions.iter().zip(&self.bits).map(row).collect();
        format!("x_m,y_m,sampling_bps,capacity_bits,queue_bits\n{rows}")
    }
}

#[test]
fn the_look_ahead_reaches_the_optima_of_small_fields_for_every_objective() {
    for objective in [
        "'loss'",
        "'age'",
        "'peak-age'",
        "'deadline'",
        "{ loss = 1.0, age = 90.0 }",
        "{ loss = 0.01, peak_age = 1e-4, deadline = 2.0 }",
    ] {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut reached = 0;
        for case in 0..50 {
            let field = Field::draw(&mut random);
            let scenario = scenario_of(&field.text(objective), "horizon");
            let list = SensorList::parse(&field.csv(), "s.csv".as_ref(), &scenario).unwrap();
            let weights = Settings::of(&scenario).unwrap().objective.weights().unwrap();
            let sensors = field.positions.len();
            let optimum = field.least(&weights, (0, sensors, vec![0; sensors]), &mut HashMap::new());

            let mut mission = Mission::new(&scenario, &list).unwrap();
            let mut tally = Tally::new(&scenario, &list, &RunMode::default());
            mission.drive(&mut [&mut tally], &Stop::default()).unwrap();
            let flown = tally.sums.objective().unwrap_or(tally.sums.lost_bits());
            let places = list.sensors_of(&scenario);
            let bound = mission_bound(&scenario, &places, &list.queues_bits(), u64::MAX);
            let bound = cost_bound(&scenario, &places, &weights, bound.loss_bits);

            let rounding = 1e-9 * (1.0 + optimum);
            assert!(flown >= optimum - rounding, "{objective}, field {case}: {flown} below the optimum {optimum}");
            assert!(bound <= optimum + rounding, "{objective}, field {case}: bound {bound}, optimum {optimum}");
            // Of peak ages only the largest matters: a search does not end with the smallest differences.
            let nearly = if weights.peak_age > 0.0 { 1e-3 * optimum } else { rounding };
            reached += usize::from(flown <= optimum + nearly);
        }
        assert!(reached >= 49, "{objective}: {reached} of 50 optima");
    }
}
