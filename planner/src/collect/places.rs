//! Places: which sensor nodes (SNs) are served from there, how long the ways between them take, and from where to serve
//! an SN.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::Arc;

use nalgebra::Vector2;
use rand_chacha::ChaCha8Rng;
use skysink_common::channel::ChannelModel;
use skysink_common::geometry::{Position, above, distance_squared};
use skysink_common::random::{below, fraction};
use skysink_common::scenario::Scenario;

use crate::mission_table::MissionTable;
use crate::route::motion::SLACK_SLOTS;

/// Most kept links and ways; more are found again.
const MOST_KEPT: usize = 50_000;

/// Cells of a grid from which an SN is served.
const CELLS: usize = 25;

/// The cells next to an SN of which they are the best.
const NEAR_CELLS: usize = 200;

/// How near to a place a UAV is there [m].
const THERE_M: f64 = 1e-6;

/// The SNs in range of a place that a link to it carries bits from: id, and bits in a slot [bit].
pub type Links = Arc<[(u32, f64)]>;

/// A place, in bits.
type Key = [u64; 2];

/// The way between two places.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Way {
    /// Where its slots end [m], and the links there.
    pub slots: Vec<(Position, Links)>,
    /// What it takes [J]; 0 without a battery.
    pub energy_j: f64,
}

/// What the way home from a place takes at the speed of least energy.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Return {
    slots: f64,
    energy_j: f64,
}

/// The places of a mission. All that it keeps follows from the mission.
pub struct Places {
    /// The mission.
    pub table: MissionTable,
    altitude_m: f64,
    links: HashMap<Key, Links>,
    legs: HashMap<(Key, Key), Option<Arc<Way>>>,
    returns: HashMap<Key, Return>,
    /// Ways home with time for the least energy.
    ways_home: HashMap<Key, Arc<Way>>,
    /// The best cells for an SN, by id; empty without a grid.
    cells: HashMap<u32, Arc<[Position]>>,
}

fn key(place: &Position) -> Key {
    [place.x.to_bits(), place.y.to_bits()]
}

/// Keeps a value that can be found again; begins anew when there are too many.
fn insert<K: Eq + Hash, V>(kept: &mut HashMap<K, V>, key: K, value: V) {
    if kept.len() >= MOST_KEPT {
        kept.clear();
    }
    kept.insert(key, value);
}

/// Whether a UAV at `at` is at `place` [m].
#[must_use]
pub fn is_there(at: &Position, place: &Position) -> bool {
    distance_squared(at, place) <= THERE_M * THERE_M
}

impl Places {
    /// Those of a scenario.
    #[must_use]
    pub fn new(scenario: &Scenario, table: &MissionTable) -> Self {
        Self {
            table: table.clone(),
            altitude_m: scenario.uav.altitude_m,
            links: HashMap::new(),
            legs: HashMap::new(),
            returns: HashMap::new(),
            ways_home: HashMap::new(),
            cells: HashMap::new(),
        }
    }

    /// Number of SNs.
    #[must_use]
    pub fn count(&self) -> usize {
        self.table.sensors.count()
    }

    /// The links to a UAV at `place` [m].
    pub fn links(&mut self, place: &Position) -> Links {
        if let Some(links) = self.links.get(&key(place)) {
            return Arc::clone(links);
        }
        let Self { table, altitude_m, .. } = self;
        let uav = above(place, *altitude_m);
        let mut links = Vec::new();
        table.sensors.grid.visit_within(place, table.limits.comm_radius_m, |node| {
            let gain = table.sensors.gains[node.id as usize];
            let uplink = table.channel.uplink(gain, table.sensors.position(node.id), &uav);
            let bits = table.channel.capacity_bits(table.channel.expected_rate_bps(&uplink));
            links.extend((bits > 0).then_some((node.id, bits as f64)));
        });
        links.sort_unstable_by_key(|(id, _)| *id);
        let links: Links = links.into();
        insert(&mut self.links, key(place), Arc::clone(&links));
        links
    }

    /// Bits that the link of SN `sensor` carries to a UAV at `place` in a slot [bit].
    pub fn link_bits(&mut self, sensor: u32, place: &Position) -> f64 {
        let links = self.links(place);
        links.iter().find(|(id, _)| *id == sensor).map_or(0.0, |(_, bits)| *bits)
    }

    /// The way from `from` to `to` [m]; `None` if there is none.
    pub fn leg(&mut self, from: &Position, to: &Position) -> Option<Arc<Way>> {
        let keys = (key(from), key(to));
        if let Some(leg) = self.legs.get(&keys) {
            return leg.clone();
        }
        let leg = self.slot_ends(from, to).map(|ends| Arc::new(self.leg_along(from, &ends)));
        insert(&mut self.legs, keys, leg.clone());
        leg
    }

    /// The ends of the slots of a flight from `from` to `to` [m], which begins with a move on a grid.
    fn slot_ends(&self, from: &Position, to: &Position) -> Option<Vec<Position>> {
        let mut ends: Vec<Position> = Vec::new();
        let mut at = *from;
        while !is_there(&at, to) {
            let end = self.step(ends.len() as u64 + 1, &at, to);
            // Two slots that end in the same place lead nowhere.
            if ends.len() as u64 >= self.table.limits.slots || ends.last() == Some(&end) || end == *from {
                return None;
            }
            ends.push(end);
            at = end;
        }
        Some(ends)
    }

    /// The end of a slot from `from` to `to` [m]: a straight way is flown in equal steps. `slot` counts from the begin
    /// of a move on a grid.
    #[must_use]
    pub fn step(&self, slot: u64, from: &Position, to: &Position) -> Position {
        let MissionTable { airspace, limits, .. } = &self.table;
        if airspace.has_grid() || !airspace.is_free(from, to) {
            return match airspace.has_grid() {
                true => airspace.slot_end(slot, from, to, limits.reach_m),
                false => airspace.toward(from, to, limits.reach_m),
            };
        }
        let slots = ((to - from).norm() / limits.reach_m - SLACK_SLOTS).ceil().max(1.0);
        if slots == 1.0 { *to } else { from + (to - from) / slots }
    }

    fn leg_along(&mut self, from: &Position, ends: &[Position]) -> Way {
        let battery = self.table.home.as_ref().and_then(|home| home.battery);
        let begins = std::iter::once(from).chain(ends);
        let energy_j =
            begins.zip(ends).map(|(from, to)| battery.map_or(0.0, |battery| battery.slot_j((to - from).norm()))).sum();
        Way { slots: ends.iter().map(|end| (*end, self.links(end))).collect(), energy_j }
    }

    /// The way home from `from` after `slot`; empty in the base.
    pub fn way_home(&mut self, slot: u64, from: &Position) -> Option<Arc<Way>> {
        let home = self.table.home.as_ref()?;
        if home.battery.is_none() || self.table.airspace.has_grid() {
            let end = home.route_within(from, u64::MAX)?.end(); // one of a grid, or without energy: the same
            return self.leg(from, &end);
        }
        let is_ample = self.thrifty(from)?.slots <= self.left_after(slot);
        if let Some(way) = self.ways_home.get(&key(from)).filter(|_| is_ample) {
            return Some(Arc::clone(way));
        }
        let home = self.table.home.as_ref()?;
        let route = home.route(slot, from).filter(|route| u64::from(route.slots()) <= self.table.limits.slots)?;
        let ends: Vec<Position> = (1..=route.slots()).map(|slot| route.at(slot)).collect();
        let way = Arc::new(self.leg_along(from, &ends));
        if is_ample {
            insert(&mut self.ways_home, key(from), Arc::clone(&way));
        }
        Some(way)
    }

    /// Slots for the way home after `slot`.
    fn left_after(&self, slot: u64) -> f64 {
        self.table.home.as_ref().map_or(f64::INFINITY, |home| home.left_after(slot) as f64)
    }

    /// What the way home from `place` takes; `None` if the UAV need not come back.
    fn thrifty(&mut self, place: &Position) -> Option<Return> {
        let home = self.table.home.as_ref()?;
        if let Some(found) = self.returns.get(&key(place)) {
            return Some(*found);
        }
        let found =
            home.route_within(place, u64::MAX).map_or(Return { slots: f64::INFINITY, energy_j: 0.0 }, |route| Return {
                slots: route.slots().into(),
                energy_j: route.energy_j(),
            });
        insert(&mut self.returns, key(place), found);
        Some(found)
    }

    /// Whether a UAV with `energy_j` at `place` after `slot` comes home in time and with its reserve.
    pub fn is_in_reach(&mut self, slot: u64, energy_j: f64, place: &Position) -> bool {
        let Some(Return { slots, energy_j: way_j }) = self.thrifty(place) else { return true };
        let is_ample = slots <= self.left_after(slot);
        let home = self.table.home.as_ref();
        home.is_none_or(|home| match home.battery {
            None => is_ample,
            Some(battery) if is_ample => energy_j - way_j - battery.reserve_j >= 0.0,
            Some(_) => home.is_in_reach(slot, energy_j, place), // perhaps faster
        })
    }

    /// A place from which to serve SN `sensor`, drawn by chance; `None` if the draw is no such place.
    pub fn draw(&mut self, sensor: u32, random: &mut ChaCha8Rng) -> Option<Position> {
        if self.table.airspace.has_grid() {
            let cells = self.cells(sensor);
            return (!cells.is_empty()).then(|| cells[below(random, cells.len())]);
        }
        let centre = *self.table.sensors.position(sensor);
        let radius_m = self.table.limits.comm_radius_m * fraction(random).powi(2);
        let (sin, cos) = (fraction(random) * std::f64::consts::TAU).sin_cos();
        let place = centre + Vector2::new(cos, sin) * if below(random, 3) == 0 { 0.0 } else { radius_m };
        let place = self.table.airspace.nearest(&self.table.clamp_to_area(&place));
        (self.link_bits(sensor, &place) > 0.0).then_some(place)
    }

    /// The places from which to serve SN `sensor` first: on a grid the best cells, otherwise as near as possible.
    pub fn first(&mut self, sensor: u32, most: usize) -> Vec<Position> {
        if self.table.airspace.has_grid() {
            return self.cells(sensor).iter().take(most).copied().collect();
        }
        let place = self.table.airspace.nearest(self.table.sensors.position(sensor));
        if self.link_bits(sensor, &place) > 0.0 { vec![place] } else { Vec::new() }
    }

    /// A place beside `place`: a neighbouring cell of a grid, or up to a slot away.
    #[must_use]
    pub fn beside(&self, place: &Position, random: &mut ChaCha8Rng) -> Position {
        let MissionTable { airspace, limits, .. } = &self.table;
        let away = if airspace.has_grid() {
            let [x, y] = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]][below(random, 4)];
            Vector2::new(x, y) * (limits.reach_m * airspace.move_slots() as f64)
        } else {
            let (sin, cos) = (fraction(random) * std::f64::consts::TAU).sin_cos();
            Vector2::new(cos, sin) * (limits.reach_m * fraction(random))
        };
        airspace.nearest(&self.table.clamp_to_area(&(place + away)))
    }

    /// The cells from which the link of SN `sensor` carries most, best first.
    fn cells(&mut self, sensor: u32) -> Arc<[Position]> {
        if let Some(cells) = self.cells.get(&sensor) {
            return Arc::clone(cells);
        }
        let centre = *self.table.sensors.position(sensor);
        let mut near: Vec<Position> = self.table.airspace.cells().collect();
        near.sort_by(|a, b| distance_squared(a, &centre).total_cmp(&distance_squared(b, &centre)));
        near.truncate(NEAR_CELLS);
        let mut rated: Vec<(f64, Position)> = near
            .into_iter()
            .map(|cell| (self.link_bits(sensor, &cell), cell))
            .filter(|(bits, _)| *bits > 0.0)
            .collect();
        rated.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        let cells: Arc<[Position]> = rated.into_iter().take(CELLS).map(|(_, cell)| cell).collect();
        self.cells.insert(sensor, Arc::clone(&cells));
        cells
    }
}
