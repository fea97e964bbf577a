//! Legs between sensors [slots], with surcharges that account for the flight across the disks.
//!
//! A leg between two sensors takes at least the slots from rim to rim of their disks. But a path that enters a disk on
//! one side and leaves it on the other has to cross it. So disks are divided into cells, and legs run from cell to
//! cell. Each cell has a surcharge, which is added to the leg toward one sensor, the favourite, and subtracted from all
//! other legs. A path has two different legs at each inner sensor, from the same cell, so the sum of their surcharges
//! is at most 0: the legs with surcharges weigh at most as much as the path, up to the surcharges at its ends.

use skysink_common::geometry::Position;

use crate::bound::margins::LENGTH_MARGIN;
use crate::mission_table::MissionTable;

/// Cells of a disk in each direction.
const GRID: usize = 4;

const CELLS: usize = GRID * GRID;

/// Nearest sensors of each sensor, to which legs run from cell to cell; other legs run from rim to rim.
const NEAREST: usize = 12;

/// Margin of a number of slots [slots] against rounding, and for the slack of range and reach (decision D5).
const SLOTS_MARGIN: f64 = 1e-6;

/// A leg with its price and ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PricedLeg {
    /// Slots with surcharges, less the prices of both ends.
    pub priced: f64,
    /// Its sensors.
    pub ends: [u32; 2],
    /// The cells of their disks; `None` from rim to rim.
    pub cells: Option<[u8; 2]>,
}

/// Slots of a leg from each cell of its second end (outer index) to each of its first.
type CellLegs = [[f64; CELLS]; CELLS];

/// The legs between all sensors.
#[derive(Debug, Clone)]
pub struct Legs {
    near: Vec<([u32; 2], Box<CellLegs>)>,
    /// From rim to rim, without surcharges.
    far: Vec<([u32; 2], f64)>,
    /// By sensor and cell: the sensor toward which the surcharge is added.
    favourites: Vec<[u32; CELLS]>,
    /// By sensor and cell: the surcharge [slots], at least 0.
    surcharges: Vec<[f64; CELLS]>,
}

impl Legs {
    /// The legs between the sensors of `table`, without surcharges.
    #[must_use]
    pub fn new(table: &MissionTable) -> Self {
        let count = table.sensors.positions.len();
        let mut is_near = vec![false; count * count];
        for sensor in table.sensors.ids() {
            for other in table.sensors.grid.nearest(table.sensors.position(sensor), NEAREST + 1) {
                is_near[sensor as usize * count + other as usize] = true;
                is_near[other as usize * count + sensor as usize] = true;
            }
        }
        let mut legs = Self {
            near: Vec::new(),
            far: Vec::new(),
            favourites: vec![[u32::MAX; CELLS]; count],
            surcharges: vec![[0.0; CELLS]; count],
        };
        for first in table.sensors.ids() {
            for second in 0..first {
                if is_near[first as usize * count + second as usize] {
                    legs.near.push(([first, second], Box::new(cell_legs(table, first, second))));
                } else {
                    legs.far.push(([first, second], rim_slots(table, first, second)));
                }
            }
        }
        legs
    }

    /// Largest surcharge of `sensor` [slots], which has no counterpart at the end of a path.
    pub fn end_slots(&self, sensor: u32) -> f64 {
        self.surcharges[sensor as usize].iter().copied().fold(0.0, f64::max)
    }

    /// The legs between near sensors, each between its cheapest cells, less the `prices` [slots] of its ends.
    pub fn near(&self, prices: &[f64]) -> impl Iterator<Item = PricedLeg> {
        self.near.iter().map(|&([first, second], ref slots)| {
            let first_slots = self.toward(first, second);
            let second_slots = self.toward(second, first);
            let mut cheapest = [f64::INFINITY; CELLS];
            for (slots, second_slots) in slots.iter().zip(second_slots) {
                for (cheapest, slots) in cheapest.iter_mut().zip(slots) {
                    let sum = slots + second_slots;
                    *cheapest = if sum < *cheapest { sum } else { *cheapest };
                }
            }
            cheapest.iter_mut().zip(first_slots).for_each(|(cheapest, first_slots)| *cheapest += first_slots);
            let from = least(&cheapest);
            let to = least(&std::array::from_fn(|cell| slots[cell][from] + second_slots[cell]));
            let priced = cheapest[from] - prices[first as usize] - prices[second as usize];
            PricedLeg { priced, ends: [first, second], cells: Some([from as u8, to as u8]) }
        })
    }

    /// Lower bounds on the other legs that are below `below` [slots], with the least surcharges of any cells.
    pub fn far(&self, prices: &[f64], below: f64) -> impl Iterator<Item = PricedLeg> {
        let ids = 0..self.surcharges.len() as u32;
        let ends: Vec<f64> = ids.map(|id| prices[id as usize] + self.end_slots(id)).collect();
        let leg = move |&(sensors, slots): &([u32; 2], f64)| {
            let [first, second] = sensors.map(|sensor| ends[sensor as usize]);
            PricedLeg { priced: slots - first - second, ends: sensors, cells: None }
        };
        self.far.iter().map(leg).filter(move |leg| leg.priced < below)
    }

    /// The surcharges of the cells of `sensor` on a leg toward `other` [slots].
    fn toward(&self, sensor: u32, other: u32) -> [f64; CELLS] {
        let favourites = &self.favourites[sensor as usize];
        let surcharges = &self.surcharges[sensor as usize];
        std::array::from_fn(|cell| if favourites[cell] == other { surcharges[cell] } else { -surcharges[cell] })
    }

    /// Makes a subgradient step of `step` [slots] on the surcharges. `used` are the legs of a tree.
    pub fn adjust(&mut self, used: &[PricedLeg], step: f64) {
        let mut uses: Vec<(u32, u8, u32)> = Vec::with_capacity(2 * used.len());
        for leg in used {
            if let Some([from, to]) = leg.cells {
                let [first, second] = leg.ends;
                uses.extend([(first, from, second), (second, to, first)]);
            }
        }
        uses.sort_unstable();
        for uses in uses.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (sensor, cell, other) = uses[0];
            let favourite = &mut self.favourites[sensor as usize][cell as usize];
            let surcharge = &mut self.surcharges[sensor as usize][cell as usize];
            if *surcharge > 0.0 {
                let toward = uses.iter().filter(|&&(_, _, other)| other == *favourite).count();
                *surcharge = (*surcharge + step * (toward as f64 - uses.len() as f64 / 2.0)).max(0.0);
            } else if uses.len() == 1 {
                *favourite = other;
                *surcharge = step / 2.0;
            }
        }
    }
}

/// The first index of the least of `values`.
fn least(values: &[f64; CELLS]) -> usize {
    let mut least = 0;
    for (index, value) in values.iter().enumerate() {
        if *value < values[least] {
            least = index;
        }
    }
    least
}

/// The fewest slots in which a UAV flies `away_m` [m], `reach_m` [m] in each.
#[must_use]
pub fn fewest_slots(reach_m: f64, away_m: f64) -> f64 {
    (away_m * (1.0 - LENGTH_MARGIN) / reach_m - SLOTS_MARGIN).ceil().max(0.0)
}

/// The fewest slots from range of one sensor into range of another.
fn rim_slots(table: &MissionTable, first: u32, second: u32) -> f64 {
    let between_m = (table.sensors.position(first) - table.sensors.position(second)).norm();
    fewest_slots(table.farthest_m, between_m - 2.0 * table.limits.comm_radius_m * (1.0 + LENGTH_MARGIN))
}

/// The fewest slots from each cell to each. Cells are squares over the whole square around the disk.
fn cell_legs(table: &MissionTable, first: u32, second: u32) -> CellLegs {
    let rim_slots = rim_slots(table, first, second);
    let half_m = table.limits.comm_radius_m * (1.0 + LENGTH_MARGIN);
    let side_m = 2.0 * half_m / GRID as f64;
    let corner = |sensor: u32, cell: usize| {
        let at = table.sensors.position(sensor);
        let step = |index: usize| index as f64 * side_m - half_m;
        Position::new(at.x + step(cell % GRID), at.y + step(cell / GRID))
    };
    std::array::from_fn(|to| {
        let to = corner(second, to);
        std::array::from_fn(|from| {
            let apart = (corner(first, from) - to).map(|along_m| (along_m.abs() - side_m).max(0.0));
            fewest_slots(table.farthest_m, apart.norm()).max(rim_slots)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;

    #[test]
    fn a_leg_takes_the_slots_from_rim_to_rim() {
        // d_c = 10 m, V τ = 30 m: 50 m apart are 30 m from rim to rim, one slot; a millimetre more takes two.
        let table = table_of(&[[0.0, 0.0], [50.0, 0.0], [100.001, 0.0], [10.0, 0.0]]);
        assert_eq!([[1, 0], [2, 1], [2, 0], [3, 0]].map(|[a, b]| rim_slots(&table, a, b)), [1.0, 2.0, 3.0, 0.0]);
    }

    #[test]
    fn a_leg_from_the_far_side_of_a_disk_takes_longer() {
        // Cells are 5 m wide: from the westernmost of one disk to the easternmost of the other 50 + 20 − 10 = 60 m.
        let legs = cell_legs(&table_of(&[[0.0, 0.0], [50.0, 0.0]]), 0, 1);
        assert_eq!([legs[0][0], legs[0][3], legs[3][0]], [2.0, 1.0, 2.0]); // 45 m, 30 m, 60 m
    }

    #[test]
    fn the_sum_of_the_surcharges_of_two_legs_at_a_sensor_is_at_most_0() {
        let table = table_of(&[[0.0, 0.0], [50.0, 0.0], [100.0, 0.0], [50.0, 45.0]]);
        let mut legs = Legs::new(&table);
        for round in 0..50 {
            let prices = [0.3, 0.1 * f64::from(round % 7), -0.2, 0.4];
            let used: Vec<PricedLeg> = legs.near(&prices).take(3 + round as usize % 4).collect();
            legs.adjust(&used, 0.1);
            for sensor in table.sensors.ids() {
                let toward =
                    table.sensors.ids().filter(|other| *other != sensor).map(|other| legs.toward(sensor, other));
                for cell in 0..CELLS {
                    let mut surcharges: Vec<f64> = toward.clone().map(|surcharges| surcharges[cell]).collect();
                    surcharges.sort_by(|a, b| b.total_cmp(a));
                    assert!(surcharges[0] + surcharges[1] <= 0.0 && surcharges[0] <= legs.end_slots(sensor));
                }
            }
        }
        assert!(table.sensors.ids().any(|sensor| legs.end_slots(sensor) > 0.0));
    }
}
