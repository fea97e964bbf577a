//! The stops of plans that serve in passing: disks about single sensors and about groups, and the tours over them.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use skysink_common::geometry::{Position, distance_squared, within};
use skysink_common::sensors::grid::Grid;
use skysink_common::stop::Stop;

use super::groups::{self, ServiceDisk};
use super::model::PlanModel;
use super::objective::Objective;
use super::sensor::SensorModel;
use crate::geometry::disks::Disk;
use crate::geometry::turns::Turns;

/// Nearest stops that a change may substitute for a stop.
const NEIGHBOURS: usize = 12;

/// Least fraction of the sensors that a tour over groups visits.
const MOSTLY: f64 = 0.9;

/// Fraction of the resource blocks in use from which on they count as scarce.
const SCARCE_BLOCKS: f64 = 0.4;

/// Length of a tour, as a fraction of the time in which a buffer fills, from which on time counts as scarce.
const SCARCE_TIME: f64 = 0.75;

/// Capacity at the rim of a stop for one sensor, as a fraction of that from straight above.
const NEAR: f64 = 0.8;

/// Radii that are compared for such a stop.
const NEAR_RADII: u32 = 32;

/// Directions in which buildings are looked for around a sensor.
const LOOKS: u32 = 64;

impl PlanModel {
    /// Adds all stops: disks, with groups if it `may_group` and resource blocks or time are scarce, with random numbers
    /// of `seed`, and the tours over them.
    pub(super) fn add_disks<O: Objective>(&mut self, seed: u64, may_group: bool, stop: &Stop) {
        self.tours = vec![self.table.turns(stop).order.clone()];
        for index in self.table.sensors.ids() {
            let disk = self.near::<O>(index);
            self.disks.push(ServiceDisk { disk, members: vec![index] });
        }
        if may_group && (O::COUNTS_AGES || self.is_scarce::<O>()) {
            self.group::<O>(seed, stop);
        }
        let tours_slots = self.tours.iter().map(|tour| self.slots_of(tour));
        self.round_slots = tours_slots.fold(f64::INFINITY, f64::min).max(1.0);
        self.find_stops();
    }

    /// The farthest distance at which the link of `sensor` carries most of its best capacity, or of a full buffer [m].
    fn carries_most_m<O: Objective>(&self, sensor: u32) -> f64 {
        let model = &self.sensors[sensor as usize];
        let full = O::capacity(model, model.capacity_bits);
        let enough = O::capacity(model, model.best_bits).min(full) * NEAR;
        let is_enough = |radius_m: &f64| self.capacity::<O>(sensor, radius_m.powi(2), true) >= enough;
        (1..=NEAR_RADII).rev().map(|step| self.near_radius_m(step)).find(is_enough).unwrap_or(0.0)
    }

    /// The `step`th of the radii that are compared [m].
    fn near_radius_m(&self, step: u32) -> f64 {
        self.table.limits.comm_radius_m * f64::from(step) / f64::from(NEAR_RADII)
    }

    /// The disk of a single sensor: its radius is the farthest at which the link carries most, and up to which no
    /// building hides the sensor. By a map the disk is about the place in range from which the link carries most.
    fn near<O: Objective>(&self, sensor: u32) -> Disk {
        let position = *self.table.sensors.position(sensor);
        let most_m = self.carries_most_m::<O>(sensor);
        let channel = &self.table.channel;
        if !channel.depends_on_place() {
            return Disk { centre: position, radius_m: most_m };
        }
        let around = |centre: Position, step: u32| {
            let angle = |turn: u32| f64::from(turn) * TAU / f64::from(LOOKS);
            let direction = move |turn: u32| Vector2::new(angle(turn).cos(), angle(turn).sin());
            let radius_m = self.near_radius_m(step);
            (0..LOOKS).map(move |turn| centre + radius_m * direction(turn))
        };
        let is_flown = |at: &Position| self.table.airspace.contains(at);
        if channel.map().is_none() {
            let is_seen = |at: Position| self.sees(sensor, &at) || !is_flown(&at);
            let seen = (1..=NEAR_RADII).take_while(|&step| around(position, step).all(is_seen)).last();
            let radius_m = seen.map_or(0.0, |step| self.near_radius_m(step)).min(most_m);
            return Disk { centre: position, radius_m };
        }
        let capacity = |at: &Position| self.capacity_at::<O>(sensor, distance_squared(&position, at), at);
        let places = (1..=NEAR_RADII).step_by(4).flat_map(|step| around(position, step)).filter(is_flown);
        let rated = std::iter::once(position).chain(places).map(|at| (capacity(&at), at));
        let best = rated.reduce(|best, next| if next.0 > best.0 { next } else { best });
        let (most, centre) = best.expect("at least the place of the sensor");
        let enough = most * NEAR;
        let reach_m = self.table.limits.comm_radius_m;
        let is_near = |at: Position| !is_flown(&at) || within(&position, &at, reach_m) && capacity(&at) >= enough;
        let near = (1..=NEAR_RADII).take_while(|&step| around(centre, step).all(is_near)).last();
        Disk { centre, radius_m: near.map_or(0.0, |step| self.near_radius_m(step)) }
    }

    /// Whether a cycle of full groups may lose least: most visits empty the buffer, or carry as much from anywhere in
    /// range, and loss is hard to avoid, because many resource blocks are needed for the sampled bits, or a tour takes
    /// most of the time in which a buffer fills. Otherwise groups would only take time.
    fn is_scarce<O: Objective>(&self) -> bool {
        let is_filled = |index: &u32| {
            let sensor = &self.sensors[*index as usize];
            sensor.best_bits >= sensor.capacity_bits
                || self.carries_most_m::<O>(*index) >= self.table.limits.comm_radius_m
        };
        if 2 * self.table.sensors.ids().filter(is_filled).count() < self.sensors.len() {
            return false;
        }
        let visits = |sensor: &SensorModel| sensor.mean_bits / sensor.best_bits.min(sensor.capacity_bits);
        let needed: f64 = self.sensors.iter().map(visits).sum();
        let fills = self.sensors.iter().map(|sensor| sensor.fill_slots);
        needed >= SCARCE_BLOCKS * self.table.limits.blocks() as f64
            || self.slots_of(&self.tours[0]) >= SCARCE_TIME * fills.fold(f64::INFINITY, f64::min)
    }

    /// Adds the groups of a partition of the field, with random numbers of `seed`, and for every size a tour over the
    /// groups of at least that size, if it skips few sensors: without a partition into full groups, skipping some may
    /// lose less.
    pub(crate) fn group<O: Objective>(&mut self, seed: u64, stop: &Stop) {
        let first = self.disks.len();
        let ranges_m: Vec<f64> = self.table.sensors.ids().map(|index| self.carries_most_m::<O>(index)).collect();
        self.disks.extend(groups::cover(&self.table, &ranges_m, seed, stop));
        let size = |group: u32| self.disks[group as usize].members.len();
        let groups = first as u32..self.disks.len() as u32;
        let mut sizes: Vec<usize> = groups.clone().map(size).collect();
        sizes.sort_unstable();
        sizes.dedup();
        for least in sizes {
            let large: Vec<u32> = groups.clone().filter(|&group| size(group) >= least).collect();
            let served: usize = large.iter().map(|&group| size(group)).sum();
            if (served as f64) < MOSTLY * self.sensors.len() as f64 {
                continue;
            }
            let centres: Vec<Position> = large.iter().map(|&group| self.disk(group).centre).collect();
            let least_m = large.iter().map(|&group| self.disk(group).radius_m).fold(f64::INFINITY, f64::min);
            let mut turns = Turns::new(&centres, least_m, stop);
            turns.shorten_within(&self.table.airspace, stop);
            self.tours.push(turns.order.into_iter().map(|index| large[index as usize]).collect());
        }
    }

    /// Slots of a tour, with the shortest legs between its disks, and fractions of slots.
    fn slots_of(&self, tour: &[u32]) -> f64 {
        let leg = |(&from, &to): (&u32, &u32)| {
            let from = self.disk(from);
            let to = self.disk(to);
            let [begin, end] = [from, to].map(|disk| self.table.airspace.nearest(&disk.centre));
            let away_m = self.table.motion.distance_m(&begin, &end) - from.radius_m - to.radius_m;
            (away_m / self.table.limits.reach_m).max(1.0)
        };
        tour.iter().zip(tour.iter().cycle().skip(1)).map(leg).sum()
    }

    /// Determines the stops, and the nearest stops of each disk.
    fn find_stops(&mut self) {
        self.stops = (0..self.disks.len() as u32).filter(|&stop| self.is_stop(stop)).collect();
        let centres: Vec<Position> = self.stops.iter().map(|&stop| self.disk(stop).centre).collect();
        let grid = Grid::new(&centres, self.table.limits.comm_radius_m);
        let nearest = |index: u32| {
            let near = grid.nearest(&self.disk(index).centre, NEIGHBOURS + 1);
            let mut others: Vec<u32> = near.into_iter().map(|stop| self.stops[stop as usize]).collect();
            others.retain(|&other| other != index);
            others.truncate(NEIGHBOURS);
            if others.len() < NEIGHBOURS {
                others.push(index); // of few stops, each may be made again at once
            }
            others
        };
        self.neighbours = (0..self.disks.len() as u32).map(nearest).collect();
    }

    /// Whether plans may stop at `stop`: at all groups, and at a single sensor unless more than n sensors are in range
    /// and a visit from anywhere empties it, because then a group determines the schedule.
    fn is_stop(&self, stop: u32) -> bool {
        let Some(sensor) = self.sensors.get(stop as usize) else {
            return true;
        };
        let mut in_range = 0;
        self.table.sensors.grid.visit(&self.disk(stop).centre, self.table.limits.comm_radius_m, |_, _| in_range += 1);
        !sensor.is_emptied || in_range <= self.table.limits.blocks() || self.disks.len() == self.sensors.len()
    }
}
