//! The constant data of a look-ahead: the sensor nodes that can lose data, in slots instead of bits, and the stops of
//! plans.

use std::borrow::Cow;
use std::cell::RefCell;
use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::Vector2;
use skysink_common::channel::{ChannelModel, Uplink};
use skysink_common::geometry::{Position, above, distance_squared, within};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::grid::Grid;
use skysink_common::stop::Stop;

use super::capacities::{TABLE, best_capacities_bits, entry_at, with_margin};
use super::groups::{self, ServiceDisk};
use super::objective::Objective;
use super::other_visits::OtherVisits;
use super::points::PointMemory;
use super::sensor::{SensorModel, noise_slots2};
use crate::gap_costs::GapCosts;
use crate::geometry::disks::Disk;
use crate::geometry::turns::Turns;
use crate::mission_table::MissionTable;

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

/// The constants of a mission. *Sensors* are the SNs that can lose data, where plans hover all SNs that can be served,
/// numbered from 0 in the order of their ids.
#[derive(Debug, Clone)]
pub struct PlanModel {
    /// Positions and channel of the sensors, and the limits of the UAV. The grid covers the area.
    pub table: MissionTable,
    /// The sensors.
    pub sensors: Vec<SensorModel>,
    /// Their ids in the mission.
    pub ids: Vec<u32>,
    /// What other UAVs serve in the window.
    pub others: OtherVisits,
    /// Of several bases, the slots of the window after which each has a pad for this UAV; empty if none makes it wait.
    pub pad_waits: Vec<u64>,
    /// Altitude of service where the rate depends on the distance alone [m].
    pub(super) altitude_m: f64,
    /// Where it depends on the elevation or on buildings: expected bits of a visit by `d²`, in sight and not, over an
    /// uplink of the highest gain. One altitude is used, because all sensors of a slot are served from one, and climbs
    /// are slow.
    capacities_bits: Option<Box<[[f64; TABLE + 1]; 2]>>,
    /// All disks: first those of single sensors, then groups; where plans hover, points.
    pub disks: Vec<ServiceDisk>,
    /// Short closed tours: over the single sensors, and over groups of most of them.
    pub tours: Vec<Vec<u32>>,
    /// Approximate slots of the shortest tour.
    pub round_slots: f64,
    /// The disks at which plans may stop, see `Self::is_stop`.
    pub stops: Vec<u32>,
    /// For each disk the nearest of these.
    pub neighbours: Vec<Vec<u32>>,
    /// Whether any sensor samples.
    pub has_sampling: bool,
    /// What is known of points, where plans hover.
    pub(super) points: RefCell<PointMemory>,
}

impl PlanModel {
    /// The model of a scenario with the SNs of `mission`; if it `may_group`, with groups if resource blocks
    /// or time are scarce. After `stop` it is made without search, and must not be flown.
    #[must_use]
    pub fn new<O: Objective>(
        scenario: &Scenario,
        mission: &MissionTable,
        costs: &GapCosts,
        may_group: bool,
        stop: &Stop,
    ) -> Self {
        let scenario = &*if O::HOVERS { Cow::Borrowed(scenario) } else { with_margin(scenario) };
        let is_near = |id: &u32| mission.home.may_serve(mission.sensors.position(*id));
        let samples = |id: &u32| O::HOVERS || O::COUNTS_AGES || mission.sensors.sampler(*id).mean_bits > 0.0;
        let ids: Vec<u32> = mission.servable().filter(samples).filter(is_near).collect();
        let grid = |positions: &[Position]| Grid::over(&scenario.area, positions, scenario.link.comm_radius_m);
        let table = mission.over(scenario, Arc::new(mission.sensors.subset(&ids, grid)));
        let is_tabulated = table.channel.depends_on_elevation() || table.channel.depends_on_place();
        let capacities_bits = (is_tabulated && !O::HOVERS).then(|| Box::new(best_capacities_bits(scenario, &table)));
        let has_sampling = table.sensors.sampling_ids().next().is_some();
        let tour = table.turns(stop).order.clone(); // found here, where plans hover, too: they may begin with it
        let mut model = Self {
            altitude_m: scenario.uav.altitude_m,
            capacities_bits,
            tours: if O::HOVERS { Vec::new() } else { vec![tour] },
            has_sampling,
            table,
            sensors: Vec::new(),
            others: OtherVisits::default(),
            pad_waits: Vec::new(),
            ids,
            disks: Vec::new(),
            round_slots: 1.0,
            stops: Vec::new(),
            neighbours: Vec::new(),
            points: RefCell::default(),
        };
        model.table.sensors.ids().for_each(|index| model.add_sensor(index, costs));
        if O::HOVERS {
            return model;
        }
        for index in model.table.sensors.ids() {
            let disk = model.near::<O>(index);
            model.disks.push(ServiceDisk { disk, members: vec![index] });
        }
        if may_group && (O::COUNTS_AGES || model.is_scarce::<O>()) {
            model.group::<O>(scenario.seed, stop);
        }
        let tours_slots = model.tours.iter().map(|tour| model.slots_of(tour));
        model.round_slots = tours_slots.fold(f64::INFINITY, f64::min).max(1.0);
        model.find_stops();
        model
    }

    /// Whether no sensor of a disk can be served.
    pub(super) fn is_out(&self, disk: u32) -> bool {
        self.disks[disk as usize].members.iter().all(|&member| self.sensors[member as usize].weight == 0.0)
    }

    /// Whether all sensors of a disk are dead.
    pub(super) fn is_dead(&self, disk: u32) -> bool {
        self.disks[disk as usize].members.iter().all(|&member| self.sensors[member as usize].is_dead)
    }

    /// Adds the sensor `index`, whose gaps cost `costs`.
    fn add_sensor(&mut self, index: u32, costs: &GapCosts) {
        let sampler = self.table.sensors.sampler(index);
        let rim_m2 = self.table.limits.comm_radius_m * self.table.limits.comm_radius_m;
        let weight = self.table.sensors.weights.factor(index as usize);
        let is_emptied = costs.is_by_visits()
            || self.capacity_bits(index, rim_m2, !self.table.channel.depends_on_place())
                >= f64::from(sampler.capacity_bits);
        self.sensors.push(SensorModel {
            fill_slots: sampler.lossless_slots(),
            mean_bits: sampler.mean_bits,
            cost_bits: weight * sampler.mean_bits,
            weight,
            is_dead: false,
            capacity_bits: sampler.capacity_bits.into(),
            is_emptied,
            initial_half_slots: 0.0,
            rate_half_fraction: 0.0,
            left_slots: 0.0,
            overdue_slots: 0.0,
            noise_slots2: noise_slots2(self.table.arrivals, sampler.mean_bits, sampler.lossless_slots()),
            noise_before_slots2: 0.0,
            best_bits: if is_emptied { f64::INFINITY } else { self.capacity_bits(index, 0.0, true) },
            costs: *costs,
        });
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

    /// What the visits of other UAVs to `sensor` cost up to the end of `slot`, after `level`, and the buffer after
    /// them.
    #[inline]
    pub fn until<O: Objective>(&self, sensor: usize, slot: f64, level: O::Level) -> (f64, O::Level) {
        if self.others.is_empty() {
            return (0.0, level);
        }
        let visits = &self.others.slots[sensor];
        let since = O::since(level);
        let after = visits.partition_point(|visit| *visit <= since);
        let mut reached = (0.0, level);
        for &visit in visits[after..].iter().take_while(|visit| **visit <= slot) {
            let (units, left) = O::visit(&self.sensors[sensor], reached.1, visit, f64::INFINITY);
            reached = (reached.0 + units, left);
        }
        reached
    }

    /// The buffer of `sensor` at the end of `slot`, after the visits of other UAVs.
    #[inline]
    pub fn level_at<O: Objective>(&self, sensor: usize, slot: f64, level: O::Level) -> O::Level {
        self.until::<O>(sensor, slot, level).1
    }

    /// What the gap up to the end of `slot` costs, with the visits of other UAVs in it.
    #[inline]
    pub fn rest<O: Objective>(&self, sensor: usize, slot: f64, level: O::Level) -> f64 {
        let (before, reached) = self.until::<O>(sensor, slot, level);
        before + O::rest(&self.sensors[sensor], reached, slot)
    }

    /// The disk from which `stop` is served.
    #[inline]
    pub fn disk(&self, stop: u32) -> &Disk {
        &self.disks[stop as usize].disk
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

    /// Capacity of a visit of `sensor` at the squared distance `d2_m2` [m²], in its sight or not [bit].
    pub(super) fn capacity_bits(&self, sensor: u32, d2_m2: f64, in_sight: bool) -> f64 {
        if let Some(capacities_bits) = &self.capacities_bits {
            let rim_m2 = self.table.limits.comm_radius_m * self.table.limits.comm_radius_m;
            return capacities_bits[usize::from(!in_sight)][entry_at(d2_m2, rim_m2)];
        }
        let channel = &self.table.channel;
        let uplink = channel.uplink_at(self.table.sensors.gains[sensor as usize], d2_m2, self.altitude_m);
        channel.capacity_bits(channel.expected_rate_bps(&Uplink { in_sight, ..uplink })) as f64
    }

    /// Whether no building is between `sensor` and the UAV above `at` [m].
    #[inline]
    pub fn sees(&self, sensor: u32, at: &Position) -> bool {
        let Some(buildings) = self.table.channel.buildings() else { return true };
        buildings.sees(self.table.sensors.position(sensor), &above(at, self.altitude_m))
    }

    /// Capacity of a visit of `sensor` at the squared distance `d2_m2` [m²], in its sight or not, in the unit of the
    /// objective; infinite if any visit empties it.
    #[inline]
    pub fn capacity<O: Objective>(&self, sensor: u32, d2_m2: f64, in_sight: bool) -> f64 {
        let model = &self.sensors[sensor as usize];
        if model.is_emptied {
            return f64::INFINITY;
        }
        O::capacity(model, self.capacity_bits(sensor, d2_m2, in_sight))
    }

    /// Capacity of a visit of `sensor` from above `at`, at the squared distance `d2_m2` [m²] [bit].
    pub(super) fn bits_at(&self, sensor: u32, d2_m2: f64, at: &Position) -> f64 {
        let MissionTable { channel, sensors, .. } = &self.table;
        if !self.table.has_levels() {
            return self.capacity_bits(sensor, d2_m2, self.sees(sensor, at));
        }
        let uplink = self.table.uplink(sensor, &above(at, self.altitude_m));
        let buffer_bits = u64::from(sensors.sampler(sensor).capacity_bits);
        channel.mean_over_draws(&uplink, &|rate_bps| channel.capacity_bits(rate_bps).min(buffer_bits) as f64)
    }

    /// The same in the unit of the objective; infinite if a visit from anywhere empties the sensor.
    #[inline]
    pub fn capacity_at<O: Objective>(&self, sensor: u32, d2_m2: f64, at: &Position) -> f64 {
        if !self.table.has_levels() {
            return self.capacity::<O>(sensor, d2_m2, self.sees(sensor, at));
        }
        let model = &self.sensors[sensor as usize];
        let bits = self.bits_at(sensor, d2_m2, at);
        if model.is_emptied && bits > 0.0 { f64::INFINITY } else { O::capacity(model, bits) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::SensorNode;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    #[test]
    fn visits_are_planned_inside_the_range_by_a_margin_for_position_errors() {
        let radius_m = |uav: &str| {
            let text = format!("name = 'a'\n[uav]\n{uav}");
            let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
            let node = SensorNode {
                x_m: 9.0,
                y_m: 9.0,
                sampling_bps: 90.0,
                capacity_bits: 900,
                gain: 1e-5,
                ..SensorNode::default()
            };
            let model = PlanModel::new::<crate::plan::objective::Loss>(
                &scenario,
                &MissionTable::of(&scenario, &[node]),
                &GapCosts::LOSS,
                true,
                &Stop::default(),
            );
            (model.table.limits.comm_radius_m, model.disks[0].disk.radius_m)
        };
        assert_eq!(radius_m(""), (10.0, 10.0));
        assert_eq!(radius_m("position_error_m = 2.0\n"), (7.0, 7.0)); // 10 − 1.5 · 2
        assert_eq!(radius_m("position_error_m = 9.0\n"), (5.0, 5.0));
    }
}
