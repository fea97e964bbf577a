//! Missions over sensor nodes on a line, small enough for their least loss to be computed by dynamic programming.

use std::path::Path;

use rand::RngExt;
use skysink_common::arrivals::bits_between;
use skysink_common::random::{Purpose, Streams};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

/// The altitude of the area [m]: the UAV flies along the line y = 0.
const HEIGHT_M: f64 = 1.0;

/// Sensor nodes on a line whose links empty every queue.
#[derive(Debug, Clone)]
pub struct Line {
    slots: u64,
    length_m: f64,
    start_m: f64,
    reach_m: f64,
    radius_m: f64,
    blocks: usize,
    capacity_bits: u64,
    /// Where each stands [m], what it holds [bit], and what it samples per slot [bit].
    sensors: Vec<(f64, u64, f64)>,
}

/// All flights that have served the same, as far as it matters: they end a slot anywhere between two points.
#[derive(Debug, Clone, PartialEq)]
struct Flights {
    west_m: f64,
    east_m: f64,
    queues_bits: Vec<u64>,
    lost_bits: u64,
}

impl Flights {
    /// Whether these flights are as good as `other` for whatever comes.
    fn dominate(&self, other: &Self) -> bool {
        self.lost_bits <= other.lost_bits
            && self.west_m <= other.west_m
            && self.east_m >= other.east_m
            && self.queues_bits.iter().zip(&other.queues_bits).all(|(queue, other)| queue <= other)
    }
}

impl Line {
    /// A line of 2 to 5 sensor nodes for 8 to 20 slots.
    pub fn random(seed: u64) -> Self {
        let mut random = Streams::new(seed).stream(Purpose::Position, 2, 0);
        let length_m = random.random_range(60.0..400.0);
        let capacity_bits = 1_000;
        let fastest_bits = 1_000.0 / random.random_range(2.0..8.0);
        let count = random.random_range(2..=5);
        let mut sensor = || {
            let x_m = (random.random::<f64>() * length_m * 8.0).round() / 8.0;
            let mean_bits = fastest_bits * [1.0, 1.0, 0.5, 0.21][random.random_range(0..4)];
            (x_m, random.random_range(0..=1_000), mean_bits)
        };
        let sensors = (0..count).map(|_| sensor()).collect();
        Self {
            slots: random.random_range(8..=20),
            length_m,
            start_m: length_m / 2.0,
            reach_m: 30.0,
            radius_m: 10.0,
            blocks: random.random_range(1..=3),
            capacity_bits,
            sensors,
        }
    }

    /// Its scenario, to which the keys of `[planner]` can be added.
    pub fn text(&self) -> String {
        let Self { slots, length_m, start_m, reach_m, radius_m, blocks, capacity_bits, .. } = self;
        format!(
            "slots = {slots}\n[area]\nwidth_m = {length_m:?}\nheight_m = {HEIGHT_M:?}\n[sensors]\nfile = 's.csv'\n\
             capacity_bits = {capacity_bits}\n[uav]\nmax_speed_mps = {reach_m:?}\nstart_m = [{start_m:?}, 0.0]\n[link]\n\
             comm_radius_m = {radius_m:?}\nresource_blocks = {blocks}\n[planner]\nhorizon.iterations = 500\n"
        )
    }

    pub fn list(&self, scenario: &Scenario) -> SensorList {
        let row = |(x_m, queue_bits, mean_bits): &(f64, u64, f64)| format!("{x_m},0,{queue_bits},-52,{mean_bits}\n");
        let rows: String = self.sensors.iter().map(row).collect();
        let csv = format!("x_m,y_m,queue_bits,gain_db,sampling_bps\n{rows}");
        SensorList::parse(&csv, Path::new("s.csv"), scenario).unwrap()
    }

    /// The least loss of all flights [bit].
    ///
    /// Who is served in a slot keeps the UAV between two points, from which it reaches all that lies within a slot of
    /// them. Flights that others dominate are dropped.
    pub fn optimum_bits(&self) -> u64 {
        let queues_bits = self.sensors.iter().map(|(_, queue_bits, _)| *queue_bits).collect();
        let mut all = vec![Flights { west_m: self.start_m, east_m: self.start_m, queues_bits, lost_bits: 0 }];
        for slot in 1..=self.slots {
            let mut next: Vec<Flights> = all.iter().flat_map(|flights| self.advanced(flights, slot)).collect();
            next.sort_by_key(|flights| (flights.lost_bits, flights.queues_bits.iter().sum::<u64>()));
            all.clear();
            for flights in next {
                if !all.iter().any(|other: &Flights| other.dominate(&flights)) {
                    all.push(flights);
                }
            }
        }
        all.iter().map(|flights| flights.lost_bits).min().unwrap()
    }

    /// The flights after `slot`, by the SNs served in it: sample, overflow, upload.
    fn advanced(&self, before: &Flights, slot: u64) -> Vec<Flights> {
        let mut flown = before.clone();
        flown.west_m = (before.west_m - self.reach_m).max(0.0);
        flown.east_m = (before.east_m + self.reach_m).min(self.length_m);
        for (queue_bits, (_, _, mean_bits)) in flown.queues_bits.iter_mut().zip(&self.sensors) {
            let held_bits = *queue_bits + bits_between(*mean_bits, slot - 1, slot);
            *queue_bits = held_bits.min(self.capacity_bits);
            flown.lost_bits += held_bits - *queue_bits;
        }
        let mut served = vec![flown];
        // Each sensor node is served or not, as long as a block is free and some point is in range of all.
        let mut counts = vec![0];
        for (index, (x_m, _, _)) in self.sensors.iter().enumerate() {
            for option in 0..served.len() {
                let mut with = served[option].clone();
                with.west_m = with.west_m.max(x_m - self.radius_m);
                with.east_m = with.east_m.min(x_m + self.radius_m);
                with.queues_bits[index] = 0;
                if with.west_m <= with.east_m && counts[option] < self.blocks {
                    served.push(with);
                    counts.push(counts[option] + 1);
                }
            }
        }
        served
    }
}
