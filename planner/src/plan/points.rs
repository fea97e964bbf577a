//! Points to hover at: the links there, the routes between them, and from where to serve a sensor.

use std::f64::consts::TAU;
use std::hash::Hash;
use std::sync::Arc;

use nalgebra::Vector2;
use rand_chacha::ChaCha8Rng;
use rustc_hash::FxHashMap;
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::random::{below, fraction};

use super::groups::{PlannedStop, ServiceDisk};
use super::model::PlanModel;
use crate::geometry::disks::Disk;
use crate::mission_table::MissionTable;
use crate::route::route::Route;
use crate::route::way_home::WayHome;

/// Most kept links and routes; more are found again.
const MOST_KEPT: usize = 50_000;

/// Cells of a grid from which a sensor is served.
const CELLS: usize = 25;

/// The cells next to a sensor of which they are the best.
const NEAR_CELLS: usize = 200;

/// How near to a point a UAV is there [m].
const THERE_M: f64 = 1e-6;

/// Most hovers of a stop [moves].
pub const MOST_HOVERS: u16 = 60;

/// The sensors in range of a point that a link to it carries bits from, and their capacities in a slot [bit]; infinite
/// if a visit empties the sensor.
pub type Links = Arc<[(u32, f64)]>;

/// A point, in bits.
type Key = [u64; 2];

fn key(point: &Position) -> Key {
    [point.x.to_bits(), point.y.to_bits()]
}

/// What was found about points; all of it follows from the mission.
#[derive(Debug, Clone, Default)]
pub struct PointMemory {
    links: FxHashMap<Key, Links>,
    routes: FxHashMap<(Key, Key), Option<Route>>,
    /// Routes home with time for the least energy.
    homes: FxHashMap<Key, Option<Route>>,
    /// The best cells for a sensor; empty without a grid.
    cells: FxHashMap<u32, Arc<[Position]>>,
}

/// The kept value, or that which `find` finds; begins anew when there are too many.
fn kept<K: Eq + Hash, V: Clone>(kept: &mut FxHashMap<K, V>, key: K, find: impl FnOnce() -> V) -> V {
    if let Some(known) = kept.get(&key) {
        return known.clone();
    }
    let found = find();
    if kept.len() >= MOST_KEPT {
        kept.clear();
    }
    kept.insert(key, found.clone());
    found
}

/// Whether a UAV at `at` is at `point` [m].
#[must_use]
pub fn is_there(at: &Position, point: &Position) -> bool {
    distance_squared(at, point) <= THERE_M * THERE_M
}

impl PlanModel {
    /// The links to a UAV at `point` [m].
    pub fn links(&self, point: &Position) -> Links {
        let find = || {
            let mut links = Vec::new();
            let sensors = &self.table.sensors;
            sensors.grid.visit_within(point, self.table.limits.comm_radius_m, |node| {
                let d2_m2 = distance_squared(sensors.position(node.id), point);
                let bits = self.bits_at(node.id, d2_m2, point);
                links.extend((bits > 0.0).then_some((node.id, bits)));
            });
            links.sort_unstable_by_key(|(sensor, _)| *sensor);
            links.into()
        };
        kept(&mut self.points.borrow_mut().links, key(point), find)
    }

    /// Bits that the link of `sensor` carries to a UAV at `point` in a slot [bit].
    pub fn link_bits(&self, sensor: u32, point: &Position) -> f64 {
        self.links(point).iter().find(|(other, _)| *other == sensor).map_or(0.0, |(_, bits)| *bits)
    }

    /// The route from `from` to the point of `disk`; of no slots if the UAV is there.
    pub(super) fn route_to_point(&self, from: &Position, disk: &Disk) -> Option<Route> {
        let find = || match is_there(from, &disk.centre) {
            true => Some(self.table.motion.stay(from)),
            false => self.table.motion.enter(from, disk, &disk.centre),
        };
        kept(&mut self.points.borrow_mut().routes, (key(from), key(&disk.centre)), find)
    }

    /// The way home from `at` [m] after `slot`; `None` if there is none, or the UAV need not come back.
    pub fn route_home(&self, slot: u64, at: &Position) -> Option<Route> {
        let home = self.table.home.way()?;
        let thrifty = self.thrifty(home, at)?;
        if u64::from(thrifty.slots()) <= home.left_after(slot) { Some(thrifty) } else { home.route(slot, at) }
    }

    /// The way home from `at` [m] in any time.
    fn thrifty(&self, home: &WayHome, at: &Position) -> Option<Route> {
        kept(&mut self.points.borrow_mut().homes, key(at), || home.route_within(at, u64::MAX))
    }

    /// [`WayHome::margin_j`], where the same points are asked for again.
    pub(super) fn margin_j(&self, home: &WayHome, slot: u64, energy_j: f64, at: &Position) -> f64 {
        match self.thrifty(home, at) {
            Some(route) if u64::from(route.slots()) <= home.left_after(slot) => home.margin_after_j(energy_j, &route),
            _ => home.margin_j(slot, energy_j, at), // perhaps faster
        }
    }

    /// Adds the stop at `point` [m] for `sensor`.
    pub fn add_point(&mut self, sensor: u32, point: Position, hovers: u16) -> PlannedStop {
        let disk = Disk { centre: point, radius_m: 0.0 };
        self.disks.push(ServiceDisk { disk, members: vec![sensor] });
        PlannedStop { disk: (self.disks.len() - 1) as u32, hovers }
    }

    /// Keeps only the points of `stops`, which are numbered anew.
    pub fn keep_points(&mut self, stops: &mut [PlannedStop]) {
        let kept = stops.iter().map(|stop| self.disks[stop.disk as usize].clone()).collect();
        self.disks = kept;
        stops.iter_mut().zip(0..).for_each(|(stop, disk)| stop.disk = disk);
    }

    /// A point from which to serve `sensor`, drawn at random; `None` if the draw is no such point.
    pub fn draw_point(&self, sensor: u32, random: &mut ChaCha8Rng) -> Option<Position> {
        if self.table.motion.is_by_cells() {
            let cells = self.cells(sensor);
            return (!cells.is_empty()).then(|| cells[below(random, cells.len())]);
        }
        let centre = *self.table.sensors.position(sensor);
        let radius_m = self.table.limits.comm_radius_m * fraction(random).powi(2);
        let (sin, cos) = (fraction(random) * TAU).sin_cos();
        let point = centre + Vector2::new(cos, sin) * if below(random, 3) == 0 { 0.0 } else { radius_m };
        let point = self.table.airspace.nearest(&self.table.clamp_to_area(&point));
        (self.link_bits(sensor, &point) > 0.0).then_some(point)
    }

    /// The points from which to serve `sensor` first: on a grid the best cells, otherwise as near as possible.
    pub fn first_points(&self, sensor: u32, most: usize) -> Vec<Position> {
        if self.table.motion.is_by_cells() {
            return self.cells(sensor).iter().take(most).copied().collect();
        }
        let point = self.table.airspace.nearest(self.table.sensors.position(sensor));
        if self.link_bits(sensor, &point) > 0.0 { vec![point] } else { Vec::new() }
    }

    /// A point beside `point`: a neighbouring cell of a grid, or up to a slot away.
    pub fn point_beside(&self, point: &Position, random: &mut ChaCha8Rng) -> Position {
        let MissionTable { airspace, motion, .. } = &self.table;
        let away = if motion.is_by_cells() {
            let [x, y] = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]][below(random, 4)];
            Vector2::new(x, y) * (motion.reach_m() * motion.move_slots() as f64)
        } else {
            let (sin, cos) = (fraction(random) * TAU).sin_cos();
            Vector2::new(cos, sin) * (motion.reach_m() * fraction(random))
        };
        airspace.nearest(&self.table.clamp_to_area(&(point + away)))
    }

    /// Hovers that empty a queue of `queue_bits` [bit] of `sensor` from `point`.
    pub fn hovers(&self, sensor: u32, queue_bits: f64, point: &Position) -> u16 {
        let moves = self.table.motion.move_slots() as f64;
        let queue_bits = queue_bits.max(self.sensors[sensor as usize].capacity_bits.min(1.0));
        let hovers = (queue_bits / (self.link_bits(sensor, point) * moves)).ceil();
        hovers.clamp(1.0, f64::from(MOST_HOVERS)) as u16
    }

    /// The cells from which the link of `sensor` carries most, best first.
    fn cells(&self, sensor: u32) -> Arc<[Position]> {
        if let Some(cells) = self.points.borrow().cells.get(&sensor) {
            return Arc::clone(cells);
        }
        let centre = *self.table.sensors.position(sensor);
        let mut near: Vec<Position> = self.table.airspace.cells().collect();
        near.sort_by(|a, b| distance_squared(a, &centre).total_cmp(&distance_squared(b, &centre)));
        near.truncate(NEAR_CELLS);
        let rated = near.into_iter().map(|cell| (self.link_bits(sensor, &cell), cell));
        let mut rated: Vec<(f64, Position)> = rated.filter(|(bits, _)| *bits > 0.0).collect();
        rated.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        let cells: Arc<[Position]> = rated.into_iter().take(CELLS).map(|(_, cell)| cell).collect();
        self.points.borrow_mut().cells.insert(sensor, Arc::clone(&cells));
        cells
    }
}
