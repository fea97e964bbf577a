//! The stops of a plan: sensors that are served together, and the disk from which all of them are in range. A partition
//! of the field into few groups is found by annealing.
//!
//! In dense fields, where the resource blocks are the bottleneck, a cycle of full groups loses least.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::random::{Purpose, Streams, below, fraction};
use skysink_common::stop::Stop;

use crate::geometry::circle::Circle;
use crate::geometry::disks::Disk;
use crate::mission_table::MissionTable;

/// Nearest sensors that a sensor may be grouped with.
const NEIGHBOURS: usize = 24;

/// Steps per sensor.
const STEPS: u64 = 4_000;

/// Most steps in all.
const MOST_STEPS: u64 = 4_000_000;

/// Energy of a group whose radius is twice the allowed one; a full group has −1.
const EXCESS: f64 = 4.0;

/// Steps between two checks for a stop.
const CHECK_STEPS: u64 = 1024;

/// Temperature at the start and at the end, in energies of a full group.
const TEMPERATURES: [f64; 2] = [0.3, 0.015];

/// Largest radius of a group as a fraction of the communication radius, with a margin for rounding.
const FILL: f64 = 1.0 - 1e-9;

/// Energies that differ by less are equal up to rounding.
const EQUAL_ENERGY: f64 = 1e-9;

/// A stop of a plan, also in checkpoints: its fields and their order are those of their bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedStop {
    /// The disk of the model that it is served from.
    pub disk: u32,
    /// The most hovers there [moves], where plans hover; a move takes one slot, or more on a grid.
    pub hovers: u16,
}

impl PlannedStop {
    /// A stop without hovers.
    #[must_use]
    pub fn at(disk: u32) -> Self {
        Self { disk, hovers: 0 }
    }
}

/// Sensors that are served together from any point of a disk.
#[derive(Debug, Clone, PartialEq)]
pub struct ServiceDisk {
    /// The points from which the links of all members carry most. About their smallest enclosing circle of radius R,
    /// its radius is the least range of theirs less R [m].
    pub disk: Disk,
    /// The sensors by their numbers in the model, at most n.
    pub members: Vec<u32>,
}

impl ServiceDisk {
    /// The disk about the smallest circle around `members`, whose links carry most within `ranges_m` [m] by sensor.
    #[must_use]
    pub fn around(table: &MissionTable, ranges_m: &[f64], members: Vec<u32>) -> Self {
        let points: Vec<Position> = members.iter().map(|&member| *table.sensors.position(member)).collect();
        let circle = Circle::around(&points);
        let radius_m = (least_m(ranges_m, &members) - circle.radius_m2.sqrt()).max(0.0);
        Self { disk: Disk { centre: circle.centre, radius_m }, members }
    }
}

/// Sensors in groups, some of which may be too wide during the search.
#[derive(Debug, Clone)]
struct Partition<'a> {
    table: &'a MissionTable,
    ranges_m: &'a [f64],
    groups: Vec<Vec<u32>>,
    /// The group of each sensor.
    home: Vec<usize>,
    points: Vec<Position>,
}

/// A partition of all sensors of `table` into groups that can be served together; empty if no two sensors can, and
/// after `stop`. The links of sensors carry most within `ranges_m` [m].
pub(crate) fn cover(table: &MissionTable, ranges_m: &[f64], seed: u64, stop: &Stop) -> Vec<ServiceDisk> {
    let neighbours: Vec<Vec<u32>> = table.sensors.ids().map(|sensor| near(table, ranges_m, sensor)).collect();
    if table.limits.blocks() < 2 || neighbours.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let mut partition = Partition {
        table,
        ranges_m,
        groups: table.sensors.ids().map(|sensor| vec![sensor]).collect(),
        home: (0..table.sensors.positions.len()).collect(),
        points: Vec::new(),
    };
    partition.anneal(&neighbours, &mut Streams::new(seed).stream(Purpose::Groups, 0, 0), stop);
    partition.split(stop);
    if stop.requested().is_some() {
        return Vec::new();
    }
    partition.groups.into_iter().map(|members| ServiceDisk::around(table, ranges_m, members)).collect()
}

/// The sensors nearest to `sensor` that can be served together with it.
fn near(table: &MissionTable, ranges_m: &[f64], sensor: u32) -> Vec<u32> {
    let at = table.sensors.position(sensor);
    let apart_m = |other: u32| 2.0 * least_m(ranges_m, &[sensor, other]) * FILL;
    let mut near = table.sensors.grid.nearest(at, NEIGHBOURS + 1);
    near.retain(|&other| {
        other != sensor && distance_squared(table.sensors.position(other), at) <= apart_m(other).powi(2)
    });
    near.truncate(NEIGHBOURS);
    near
}

/// The least range of `members` [m].
fn least_m(ranges_m: &[f64], members: &[u32]) -> f64 {
    members.iter().map(|&member| ranges_m[member as usize]).fold(f64::INFINITY, f64::min)
}

impl Partition<'_> {
    /// The radius of the smallest circle around `members` [m].
    fn radius_m(&mut self, members: &[u32]) -> f64 {
        self.points.clear();
        self.points.extend(members.iter().map(|&member| self.table.sensors.position(member)));
        Circle::around(&self.points).radius_m2.sqrt()
    }

    fn is_too_wide(&mut self, members: &[u32]) -> bool {
        self.radius_m(members) > least_m(self.ranges_m, members) * FILL
    }

    fn energy(&mut self, members: &[u32]) -> f64 {
        let full = members.len() as f64 / self.table.limits.blocks() as f64;
        let excess = self.radius_m(members) / (least_m(self.ranges_m, members) * FILL) - 1.0;
        EXCESS * excess.max(0.0) - full * full
    }

    fn anneal(&mut self, neighbours: &[Vec<u32>], random: &mut ChaCha8Rng, stop: &Stop) {
        let count = self.home.len();
        let most = self.table.limits.blocks();
        let steps = (STEPS * count as u64).min(MOST_STEPS);
        let rest = (count % most) as f64 / most as f64;
        let least = -((count / most) as f64) - rest * rest;
        let mut energies = vec![-1.0 / (most * most) as f64; count];
        let mut energy: f64 = energies.iter().sum();
        let mut best = energy;
        let mut best_groups = self.groups.clone();
        let mut changed: [Vec<u32>; 2] = [Vec::new(), Vec::new()];
        for step in 0..steps {
            if step.is_multiple_of(CHECK_STEPS) && stop.requested().is_some() {
                break;
            }
            let temperature = TEMPERATURES[0] * (TEMPERATURES[1] / TEMPERATURES[0]).powf(step as f64 / steps as f64);
            let sensor = below(random, count) as u32;
            let near = &neighbours[sensor as usize];
            if near.is_empty() {
                continue;
            }
            let other = near[below(random, near.len())];
            let from = self.home[sensor as usize];
            let to = self.home[other as usize];
            if from == to {
                continue;
            }
            changed[0].clone_from(&self.groups[from]);
            changed[0].retain(|&member| member != sensor);
            changed[1].clone_from(&self.groups[to]);
            if self.groups[to].len() == most || random.next_u32() & 1 == 0 {
                let back = below(random, self.groups[to].len());
                let swapped = changed[1].swap_remove(back);
                changed[0].push(swapped);
            }
            changed[1].push(sensor);
            let changed_energies = [self.energy(&changed[0]), self.energy(&changed[1])];
            let rise = changed_energies[0] + changed_energies[1] - energies[from] - energies[to];
            if rise > -temperature * fraction(random).ln() {
                continue;
            }
            energy += rise;
            [energies[from], energies[to]] = changed_energies;
            self.groups[from].clone_from(&changed[0]);
            self.groups[to].clone_from(&changed[1]);
            changed[0].iter().for_each(|&member| self.home[member as usize] = from);
            self.home[sensor as usize] = to;
            if energy < best - EQUAL_ENERGY {
                best = energy;
                best_groups.clone_from(&self.groups);
                if best <= least + EQUAL_ENERGY {
                    break;
                }
            }
        }
        self.groups = best_groups;
    }

    /// Splits groups that are too wide: removes the member without which the circle is smallest, until the rest fits. A
    /// removed sensor joins the first group in which it fits, or becomes a group of its own.
    fn split(&mut self, stop: &Stop) {
        let mut removed: Vec<u32> = Vec::new();
        let mut groups = std::mem::take(&mut self.groups);
        for group in &mut groups {
            while stop.requested().is_none() && self.is_too_wide(group) {
                let without = |index: usize| [&group[..index], &group[index + 1..]].concat();
                let radii_m: Vec<f64> = (0..group.len()).map(|index| self.radius_m(&without(index))).collect();
                let worst = (0..group.len()).min_by(|&a, &b| radii_m[a].total_cmp(&radii_m[b]));
                removed.push(group.remove(worst.expect("a wide group has members")));
            }
        }
        groups.retain(|group| !group.is_empty());
        for sensor in removed {
            if stop.requested().is_some() {
                return;
            }
            let fits = |group: &Vec<u32>| {
                group.len() < self.table.limits.blocks() && !self.is_too_wide(&[&group[..], &[sensor]].concat())
            };
            match groups.iter().position(fits) {
                Some(index) => groups[index].push(sensor),
                None => groups.push(vec![sensor]),
            }
        }
        groups.iter_mut().for_each(|group| group.sort_unstable());
        self.groups = groups;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;
    use crate::plan::loss::Loss;
    use crate::plan::tests::model_of;

    #[test]
    fn a_stop_signal_ends_the_search_for_groups_and_tours() {
        let sensors: Vec<_> =
            (0..40).map(|i| ([150.0 + f64::from(i * 7 % 40), 150.0 + f64::from(i * 13 % 40)], 500.0)).collect();
        let stop = Stop::default();
        let mut model = model_of(&sensors, 4, 5e6);
        let tours = model.tours.len();
        model.group::<Loss>(1, &stop);
        assert!(model.disks.len() > 40 && model.tours.len() > tours, "there are groups");
        stop.flag().store(2, Ordering::Relaxed);
        model.disks.truncate(40);
        model.tours.truncate(tours);
        model.group::<Loss>(1, &stop);
        assert_eq!((model.disks.len(), model.tours.len()), (40, tours));
    }
}
