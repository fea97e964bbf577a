//! Missions over sensor nodes in the plane, small enough for their least loss to be found by labels: served from above
//! only, one in a slot, by links that empty every queue.

use std::path::Path;

use rand::RngExt;
use skysink_common::arrivals::bits_between;
use skysink_common::random::{Purpose, Streams};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

/// Within this distance a sensor node is served [m].
const RADIUS_M: f64 = 0.01;

/// Distances are this far from whole numbers of slots [m], so that where in range the UAV is changes no leg.
const MARGIN_M: f64 = 0.1;

/// Sensor nodes in a square.
#[derive(Debug, Clone)]
pub struct Plane {
    slots: u64,
    side_m: f64,
    reach_m: f64,
    capacity_bits: u64,
    /// Where each stands [m], what it holds [bit], and what it samples per slot [bit].
    sensors: Vec<([f64; 2], u64, f64)>,
}

/// All flights that have just served the same sensor node, and left the same queues.
#[derive(Debug, Clone, PartialEq)]
struct Label {
    queues_bits: Vec<u64>,
    lost_bits: u64,
}

impl Label {
    fn dominates(&self, other: &Self) -> bool {
        self.lost_bits <= other.lost_bits
            && self.queues_bits.iter().zip(&other.queues_bits).all(|(queue, other)| queue <= other)
    }
}

impl Plane {
    /// A square with 3 to 8 sensor nodes for 12 to 24 slots, in which buffers overflow.
    pub fn random(seed: u64) -> Self {
        let mut random = Streams::new(seed).stream(Purpose::Position, 3, 0);
        let count = random.random_range(3..=8);
        let slots = random.random_range(12..=24);
        let side_m = 200.0;
        let capacity_bits = 1_000;
        let reach_m = random.random_range(30.0..120.0);
        let fastest_bits = 1_000.0 / random.random_range(2.0..0.8 * slots as f64);
        let mut sensors: Vec<([f64; 2], u64, f64)> = Vec::new();
        while sensors.len() < count {
            let mut coordinate_m = || (random.random::<f64>() * side_m * 8.0).round() / 8.0;
            let at = [coordinate_m(), coordinate_m()];
            let is_clear = |other: [f64; 2]| {
                let beyond_m = away_m(at, other) % reach_m;
                (MARGIN_M..reach_m - MARGIN_M).contains(&beyond_m)
            };
            if sensors.iter().map(|(other, ..)| *other).chain([[side_m / 2.0; 2]]).all(is_clear) {
                let mean_bits = fastest_bits * [1.0, 1.0, 0.5, 0.21][random.random_range(0..4)];
                sensors.push((at, random.random_range(0..=capacity_bits), mean_bits));
            }
        }
        Self { slots, side_m, reach_m, capacity_bits, sensors }
    }

    /// Its scenario, to which the keys of `[planner]` can be added.
    pub fn text(&self) -> String {
        let Self { slots, side_m, reach_m, capacity_bits, .. } = self;
        format!(
            "slots = {slots}\n[area]\nside_m = {side_m:?}\n[sensors]\nfile = 's.csv'\ncapacity_bits = {capacity_bits}\n\
             [uav]\nmax_speed_mps = {reach_m:?}\n[link]\ncomm_radius_m = {RADIUS_M:?}\nresource_blocks = 1\n[planner]\n"
        )
    }

    pub fn list(&self, scenario: &Scenario) -> SensorList {
        let row = |([x_m, y_m], queue_bits, mean_bits): &([f64; 2], u64, f64)| {
            format!("{x_m},{y_m},{queue_bits},-52,{mean_bits}\n")
        };
        let rows: String = self.sensors.iter().map(row).collect();
        let csv = format!("x_m,y_m,queue_bits,gain_db,sampling_bps\n{rows}");
        SensorList::parse(&csv, Path::new("s.csv"), scenario).unwrap()
    }

    /// The least loss of all flights, or `least_bits` if none loses less [bit].
    ///
    /// A flight is the order of its services, each as early as the one before allows: a service empties its queue, so
    /// one more or an earlier one loses no more. Flights are dropped that others dominate, or that have lost as much
    /// as another in all before the earliest next services.
    pub fn optimum_bits(&self, mut least_bits: u64) -> u64 {
        let count = self.sensors.len();
        let mut by_slot: Vec<Vec<Vec<Label>>> = vec![vec![Vec::new(); count]; self.slots as usize + 1];
        let first = Label { queues_bits: self.sensors.iter().map(|sensor| sensor.1).collect(), lost_bits: 0 };
        self.expand(&first, 0, [self.side_m / 2.0; 2], &mut by_slot, &mut least_bits);
        for slot in 1..=self.slots as usize {
            for sensor in 0..count {
                for label in std::mem::take(&mut by_slot[slot][sensor]) {
                    self.expand(&label, slot, self.sensors[sensor].0, &mut by_slot, &mut least_bits);
                }
            }
        }
        least_bits
    }

    /// Adds the labels of the next services after `slot`, of a UAV at `at`, and lowers `least_bits` to the loss without
    /// any.
    fn expand(&self, label: &Label, slot: usize, at: [f64; 2], by_slot: &mut [Vec<Vec<Label>>], least_bits: &mut u64) {
        let legs: Vec<usize> = self.sensors.iter().map(|sensor| self.slots_between(at, sensor.0)).collect();
        let end = self.slots as usize;
        // Until its next service at the earliest, each loses what it loses unserved.
        let unserved = |until: usize, sensor: usize| self.advanced(label.queues_bits[sensor], sensor, slot, until).1;
        let certain_bits: u64 = (0..legs.len()).map(|sensor| unserved((slot + legs[sensor]).min(end), sensor)).sum();
        if label.lost_bits + certain_bits >= *least_bits {
            return;
        }
        let without_bits: u64 = (0..legs.len()).map(|sensor| unserved(end, sensor)).sum();
        *least_bits = (*least_bits).min(label.lost_bits + without_bits);
        for (served, &leg) in legs.iter().enumerate().filter(|(_, leg)| slot + **leg <= end) {
            let mut next = label.clone();
            for (sensor, queue_bits) in next.queues_bits.iter_mut().enumerate() {
                let (held_bits, lost_bits) = self.advanced(*queue_bits, sensor, slot, slot + leg);
                *queue_bits = held_bits;
                next.lost_bits += lost_bits;
            }
            next.queues_bits[served] = 0;
            let labels = &mut by_slot[slot + leg][served];
            if !labels.iter().any(|other| other.dominates(&next)) {
                labels.retain(|other| !next.dominates(other));
                labels.push(next);
            }
        }
    }

    /// The queue of a sensor node after slot `to`, unserved since slot `from`, and what it lost [bit].
    fn advanced(&self, queue_bits: u64, sensor: usize, from: usize, to: usize) -> (u64, u64) {
        let held_bits = queue_bits + bits_between(self.sensors[sensor].2, from as u64, to as u64);
        let kept_bits = held_bits.min(self.capacity_bits);
        (kept_bits, held_bits - kept_bits)
    }

    fn slots_between(&self, from: [f64; 2], to: [f64; 2]) -> usize {
        ((away_m(from, to) / self.reach_m).ceil() as usize).max(1)
    }
}

fn away_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
