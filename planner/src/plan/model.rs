//! The constant data of a look-ahead: the sensor nodes that can lose data, in slots instead of bits, and the stops of
//! plans, which the style adds.

use std::borrow::Cow;
use std::cell::RefCell;
use std::sync::Arc;

use skysink_common::channel::{ChannelModel, Uplink};
use skysink_common::geometry::{Position, above};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::grid::Grid;
use skysink_common::stop::Stop;

use super::capacities::{CapacityTable, entry_at};
use super::groups::ServiceDisk;
use super::objective::Objective;
use super::other_visits::OtherVisits;
use super::points::PointMemory;
use super::sensor::{SensorModel, noise_slots2};
use crate::gap_costs::GapCosts;
use crate::geometry::disks::Disk;
use crate::mission_table::MissionTable;

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
    capacities_bits: Option<Box<CapacityTable>>,
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

/// What a style says of the model of its plans.
pub trait ModelStyle<O: Objective> {
    /// The scenario that is planned for.
    fn scenario(scenario: &Scenario) -> Cow<'_, Scenario> {
        Cow::Borrowed(scenario)
    }

    /// Whether the sensor node `id`, which can be served, is a sensor of the plan.
    fn includes(mission: &MissionTable, id: u32) -> bool;

    /// What visits carry where it depends on the elevation or on the place; `None` if no table is needed.
    fn capacities_bits(_scenario: &Scenario, _table: &MissionTable) -> Option<Box<CapacityTable>> {
        None
    }

    /// Adds the stops that are known before slot 1 to a model with sensors, with random numbers of `seed`; with groups
    /// if it `may_group`.
    fn add_stops(model: &mut PlanModel, seed: u64, may_group: bool, stop: &Stop);
}

impl PlanModel {
    /// The model of a scenario with the SNs of `mission`; if it `may_group`, with groups if resource blocks
    /// or time are scarce. After `stop` it is made without search, and must not be flown.
    #[must_use]
    pub fn new<O: Objective<Style: ModelStyle<O>>>(
        scenario: &Scenario,
        mission: &MissionTable,
        costs: &GapCosts,
        may_group: bool,
        stop: &Stop,
    ) -> Self {
        let scenario = &*O::Style::scenario(scenario);
        let is_included =
            |id: &u32| O::Style::includes(mission, *id) && mission.home.may_serve(mission.sensors.position(*id));
        let ids: Vec<u32> = mission.reachable().filter(is_included).collect();
        let grid = |positions: &[Position]| Grid::over(&scenario.area, positions, scenario.link.comm_radius_m);
        let table = mission.over(scenario, Arc::new(mission.sensors.subset(&ids, grid)));
        let has_sampling = table.sensors.sampling_ids().next().is_some();
        let mut model = Self {
            altitude_m: scenario.uav.altitude_m,
            capacities_bits: O::Style::capacities_bits(scenario, &table),
            tours: Vec::new(),
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
        O::Style::add_stops(&mut model, scenario.seed, may_group, stop);
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
            let model = PlanModel::new::<crate::plan::loss::Loss>(
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
