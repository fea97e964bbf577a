//! The constant data of a mission for planning: the sensor nodes, their channel and the limits of plans.

use std::sync::{Arc, OnceLock};

use nalgebra::Point3;
use skysink_common::airspace::Airspace;
use skysink_common::arrivals::ArrivalLaw;
use skysink_common::channel::{Channel, ChannelModel, Uplink};
use skysink_common::geometry::{Position, within};
use skysink_common::message::{Limits, SensorNode};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;
use skysink_common::stop::Stop;

use crate::geometry::disks::Disk;
use crate::geometry::turns::Turns;
use crate::keys::Settings;
use crate::route::home::Home;
use crate::route::motion::Motion;

/// The sensor nodes (SNs) and the constraints on a plan.
#[derive(Debug, Clone)]
pub struct MissionTable {
    /// The SNs.
    pub sensors: Arc<Sensors>,
    /// The law of what they sample around the means of `sensors`.
    pub arrivals: ArrivalLaw,
    /// The channel of all uplinks, with the time for communication that plans reckon with.
    pub channel: Channel,
    /// The constraints on every plan.
    pub limits: Limits,
    /// Farthest flight in one slot with the wind, for bounds [m]; plans keep to `limits.reach_m`.
    pub farthest_m: f64,
    /// Where the UAV may fly.
    pub airspace: Arc<Airspace>,
    /// How it flies there.
    pub motion: Motion,
    /// The waypoint of each slot [m], where the flight is fixed (`uav.track`).
    pub track: Option<Arc<[[f64; 3]]>>,
    /// Whether zones leave no place to serve the SN from, by id; empty in an open field.
    is_hidden: Arc<[bool]>,
    /// Where the UAV has to come home to, if it has to.
    pub home: Home,
    /// Found when they are first asked for; clones share them.
    turns: Arc<OnceLock<Arc<Turns>>>,
}

impl MissionTable {
    /// The table of a scenario with these SNs.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: Arc<Sensors>) -> Self {
        Self::within(scenario, sensors, Arc::new(scenario.airspace()))
    }

    fn within(scenario: &Scenario, sensors: Arc<Sensors>, airspace: Arc<Airspace>) -> Self {
        let radius_m = scenario.link.comm_radius_m;
        let is_hidden = |position: &Position| {
            let nearest = airspace.nearest(position);
            !within(&nearest, position, radius_m) || !airspace.is_reachable(&nearest)
        };
        let hidden = sensors.positions.iter().filter(|_| !airspace.is_open()).map(is_hidden);
        Self {
            is_hidden: hidden.collect(),
            home: Home::of(scenario, &airspace),
            motion: Motion::of(scenario, &airspace),
            airspace,
            sensors,
            arrivals: scenario.arrival_law(),
            channel: Settings::channel(scenario),
            limits: Limits::of(scenario),
            farthest_m: scenario.farthest_m(),
            track: scenario.uav.waypoints_m.as_deref().map(Arc::from),
            turns: Arc::default(),
        }
    }

    /// The table of a scenario over the same area with other SNs, or other rates; it shares the airspace, and the turns
    /// if positions and range are the same.
    #[must_use]
    pub fn over(&self, scenario: &Scenario, sensors: Arc<Sensors>) -> Self {
        let mut other = Self::within(scenario, sensors, Arc::clone(&self.airspace));
        let has_range = other.limits.comm_radius_m == self.limits.comm_radius_m;
        if has_range && other.sensors.positions == self.sensors.positions {
            other.turns = Arc::clone(&self.turns);
        }
        other
    }

    /// The turns of the SNs that can be reached, in a closed round that touches the disks of radius `d_c` about them,
    /// around zones. `stop` ends the search for a shorter one.
    pub fn turns(&self, stop: &Stop) -> Arc<Turns> {
        let find = || {
            let mut turns = Turns::new(&self.sensors.positions, self.limits.comm_radius_m, stop);
            turns.retain(|id| self.is_reachable(id));
            turns.shorten_within(&self.airspace, stop);
            Arc::new(turns)
        };
        let found = self.turns.get().map_or_else(find, Arc::clone);
        match stop.requested() {
            Some(_) => found, // not kept: it may have been stopped early
            None => Arc::clone(self.turns.get_or_init(|| found)),
        }
    }

    /// The table of a scenario with the published SNs `nodes`.
    #[must_use]
    pub fn of(scenario: &Scenario, nodes: &[SensorNode]) -> Self {
        Self::new(scenario, Arc::new(Sensors::of(scenario, nodes)))
    }

    /// Whether there is a place in range of SN `id` that the UAV can fly to.
    #[inline]
    pub fn is_reachable(&self, id: u32) -> bool {
        self.is_hidden.get(id as usize).is_none_or(|is_hidden| !is_hidden)
    }

    /// Whether `ground` [m] lies in the base; true if the UAV need not come back.
    pub fn is_home(&self, ground: &Position) -> bool {
        self.home.contains(ground)
    }

    /// The SNs with a place in range that the UAV can fly to, by id.
    pub fn reachable(&self) -> impl Iterator<Item = u32> + '_ {
        self.sensors.ids().filter(|&id| self.is_reachable(id))
    }

    /// Whether one slot, or a move on a grid, leads from `from` into the range of an SN at `sensor` [m], around zones,
    /// and so may serve it.
    pub fn may_serve_next(&self, from: &Position, sensor: &Position) -> bool {
        let range = Disk { centre: *sensor, radius_m: self.limits.comm_radius_m };
        self.airspace.is_open() || self.motion.slots_into(from, &range) <= self.motion.move_slots() as f64
    }

    /// The value of a queue of `queue_bits` [bit] of SN `id`, by which strategies compare queues: its bits where all
    /// weights are equal ([`Weights::value`](skysink_common::weights::Weights::value), decision D25); 0 if zones hide
    /// it.
    ///
    /// # Panics
    /// If the SN is unknown.
    #[inline]
    pub fn value(&self, id: u32, queue_bits: u32) -> u32 {
        if self.is_reachable(id) { self.sensors.weights.value(id, queue_bits) } else { 0 }
    }

    /// Whether zones hide an SN.
    #[inline]
    pub fn has_hidden(&self) -> bool {
        self.is_hidden.contains(&true)
    }

    /// The uplink of SN `id` to the UAV at `uav`.
    #[inline]
    pub fn uplink(&self, id: u32, uav: &Point3<f64>) -> Uplink {
        self.channel.uplink(self.sensors.gains[id as usize], self.sensors.position(id), uav)
    }

    /// Whether links of the same length have levels of their own, by a map.
    #[inline]
    pub fn has_levels(&self) -> bool {
        self.channel.map().is_some()
    }

    /// Expected bits collected from the SNs `ids` with the UAV at `uav`: `Σ min(floor(r_i τ_c), B_i(t−1))`, with the
    /// expected rates `r_i`.
    pub fn expected_bits(&self, uav: &Point3<f64>, ids: &[u32], queues_bits: &[u32]) -> u64 {
        ids.iter().map(|&id| self.capacity_bits(id, uav).min(u64::from(queues_bits[id as usize]))).sum()
    }

    /// Bits that the link of SN `id` to the UAV at `uav` is expected to carry in a slot, `floor(r_i τ_c)`.
    pub fn capacity_bits(&self, id: u32, uav: &Point3<f64>) -> u64 {
        self.channel.capacity_bits(self.channel.expected_rate_bps(&self.uplink(id, uav)))
    }

    /// The point of the area nearest to `position`.
    ///
    /// The area is convex and contains the SNs and the UAV, so the result is nearer to each of them: a waypoint that
    /// rounding put outside stays in range and in reach.
    pub fn clamp_to_area(&self, position: &Position) -> Position {
        Position::new(position.x.clamp(0.0, self.limits.width_m), position.y.clamp(0.0, self.limits.height_m))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;

    /// The paper's field (d_c = 10 m, V τ = 30 m, n = 4) of 100 m × 100 m with SNs of gain −52 dB at `positions_m` [m].
    pub(crate) fn table_of(positions_m: &[[f64; 2]]) -> MissionTable {
        let sensor = |&[x_m, y_m]: &[f64; 2]| SensorNode { x_m, y_m, gain: 10f64.powf(-5.2), ..SensorNode::default() };
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let nodes: Vec<SensorNode> = positions_m.iter().map(sensor).collect();
        MissionTable::of(&scenario, &nodes)
    }

    #[test]
    fn a_visit_is_expected_to_collect_the_queue_or_what_the_link_carries() {
        let mut table = table_of(&[[50.0, 50.0], [50.0, 60.0]]);
        let waypoint = Point3::new(50.0, 50.0, 20.0);
        // The letter's links carry about 6 Mbit in a slot: both queues are emptied.
        assert_eq!(table.expected_bits(&waypoint, &[0, 1], &[9_000, 12_000]), 21_000);
        // W = 5 kHz, γ = 10^−5.2 · 0.05/10^−13 = 3.1548e6. SN 0: x = 400, 500 · log2(1 + 7886.98) = 500 · 12.94545 =
        // 6472.7 bit; SN 1: x = 500, 500 · log2(1 + 6309.57) = 500 · 12.62357 = 6311.8 bit, but it holds only 100.
        let Channel::FreeSpace(model) = &mut table.channel else { panic!("the letter's channel is free space") };
        model.bandwidth_hz = 5e3;
        assert_eq!(table.expected_bits(&waypoint, &[0, 1], &[9_000, 12_000]), 6_472 + 6_311);
        assert_eq!(table.expected_bits(&waypoint, &[0, 1], &[9_000, 100]), 6_472 + 100);
    }

    #[test]
    fn a_point_outside_the_area_moves_to_its_border() {
        let table = table_of(&[[50.0, 50.0]]);
        assert_eq!(table.clamp_to_area(&Position::new(-1e-9, 100.1)), Position::new(0.0, 100.0));
        assert_eq!(table.clamp_to_area(&Position::new(3.0, 4.0)), Position::new(3.0, 4.0));
    }
}
