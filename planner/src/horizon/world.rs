//! What the look-ahead knows that stays the same in every slot: the sensor nodes that can lose data, in slots instead
//! of bits, and the stops that a plan is made of.

use skysink_common::channel::Uplink;
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;

use super::cycle::even_out;
use super::groups;
use crate::geometry::grid::Grid;
use crate::geometry::tour::closed_tour;
use crate::sensor_table::SensorTable;

/// Entries of the table of a channel that is in line of sight by chance, over `d²` from 0 to `d_c²`.
const TABLE: usize = 64;

/// Entries of it that an altitude is chosen for: the inner fifth of the disk, where most are served from.
const NEAR_STEPS: usize = TABLE / 5;

/// Steps between the altitudes that are compared.
const LEVELS: u32 = 16;

/// Stops that a move may put in another's place.
const NEIGHBOURS: usize = 12;

/// Least share of the sources that a tour over groups visits.
const MOSTLY: f64 = 0.9;

/// Slack of range of places that were added: that of decision D5, and of rounding, relative to the communication radius.
const WIDENED: f64 = 1e-8;

/// Share of the resource blocks from which on they are scarce, if so many are needed.
const SCARCE_BLOCKS: f64 = 0.4;

/// Share of the time in which a storage fills from which on it is scarce, if a tour takes so long.
const SCARCE_TIME: f64 = 0.75;

/// Share of the best rate that a stop for one source asks for.
const NEAR: f64 = 0.8;

/// A sensor node (SN) that can lose data, in slots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    /// Slots in which its empty storage fills, `C_i = B / (s_i τ)`.
    pub fill_slots: f64,
    /// What it samples and, when full, loses in a slot, `s_i τ` [bit], above 0.
    pub mean_bits: f64,
    /// Whether a visit from anywhere in range empties even a full queue.
    pub emptied: bool,
    /// How sure it is when the queue was empty; nothing where queues are known.
    pub doubt: Doubt,
}

/// What is not known of a queue, as half the width of the range in which it lies evenly.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Doubt {
    /// Of what it held before anybody met it [slots of sampling].
    pub initial_slots: f64,
    /// Of what has come since it was empty, as a share.
    pub rate: f64,
}

impl Source {
    /// Takes it to sample `mean_bits` per slot [bit], above 0, into a storage of `capacity_bits` from now on.
    pub(super) fn sample(&mut self, mean_bits: f64, capacity_bits: u32) {
        (self.mean_bits, self.fill_slots) = (mean_bits, f64::from(capacity_bits) / mean_bits);
    }

    /// What is expected to have overflowed [slots of sampling] at the end of `slot`, if the queue was empty in the slot
    /// `empty`, as far as is known: evenly within the doubt, so that `late` slots too many with a half width h come to
    /// `(late + h)²/4h` on average, between none and `late` themselves. The first visit, which lies behind slot 0, ends the
    /// doubt of the initial queue.
    #[inline]
    #[must_use]
    pub fn overflow_slots(&self, slot: f64, empty: f64) -> f64 {
        let gap = slot - empty;
        let late = gap - self.fill_slots;
        let half = self.doubt.rate * gap + if empty <= 0.0 { self.doubt.initial_slots } else { 0.0 };
        if late >= half {
            late
        } else if late <= -half {
            0.0
        } else {
            (late + half) * (late + half) / (4.0 * half)
        }
    }
}

/// A place to serve from: any point within `radius_m` of `centre` has all `members` in range.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Centre of the smallest circle around the members.
    pub centre: Position,
    /// What that circle leaves of the communication radius, `d_c − R` [m].
    pub radius_m: f64,
    /// Sources that are served together, at most n.
    pub members: Vec<u32>,
}

/// The constants of a mission. *Sources* are the SNs that can lose data, numbered from 0 in the order of their ids.
#[derive(Debug, Clone)]
pub struct World {
    pub(super) field: SensorTable,
    /// Where the UAV is when it serves [m]; where altitude matters, the altitude that is best for sources nearby: all that
    /// a slot serves are served from one altitude, and the next slot's is near to it.
    altitude_m: f64,
    /// What a visit from there takes, over `d²` [bit], where all uplinks have one gain and a rate is dear to compute.
    capacities_bits: Option<Box<[f64; TABLE + 1]>>,
    /// The sources.
    pub sources: Vec<Source>,
    /// Their ids in the field.
    pub ids: Vec<u32>,
    /// Where they stand.
    pub positions: Vec<Position>,
    /// The same, by place.
    pub grid: Grid,
    /// Stops of a plan: first each source by itself, then groups, then what was added.
    pub places: Vec<Place>,
    /// How many of them were added.
    added: usize,
    /// Places in the order of short closed tours: over the single sources, and over groups that hold most of them.
    pub tours: Vec<Vec<u32>>,
    /// Slots of the quickest of them, about.
    pub round_slots: f64,
    /// Places that a plan may stop at: where a single source has more than n in range, a group says who is served.
    pub stops: Vec<u32>,
    /// For each place the nearest of them.
    pub neighbours: Vec<Vec<u32>>,
}

impl World {
    /// The world of a scenario with these SNs; with groups where resource blocks are scarce.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &[SensorNode]) -> Self {
        let field = SensorTable::new(scenario, sensors);
        let altitude_m = if field.channel.depends_on_elevation() {
            best_altitude_m(scenario, &field)
        } else {
            scenario.uav.altitude_m
        };
        let mut world = Self {
            altitude_m,
            capacities_bits: field.channel.depends_on_elevation().then(|| capacities_bits(&field, altitude_m)),
            sources: Vec::new(),
            ids: Vec::new(),
            positions: Vec::new(),
            grid: Grid::over(field.area, &[], field.comm_radius_m),
            places: Vec::new(),
            added: 0,
            tours: Vec::new(),
            round_slots: 1.0,
            stops: Vec::new(),
            neighbours: Vec::new(),
            field,
        };
        for (id, sensor) in (0..).zip(sensors) {
            let mean_bits = sensor.sampling_bps * scenario.slot_s;
            if mean_bits > 0.0 {
                world.add_source(id, mean_bits, sensor.capacity_bits);
            }
        }
        world.grid = Grid::over(world.field.area, &world.positions, world.field.comm_radius_m);
        let single = |(&centre, source): (&Position, u32)| Place {
            centre,
            radius_m: world.near_m(source),
            members: vec![source],
        };
        world.places = world.positions.iter().zip(0..).map(single).collect();
        world.tours = vec![closed_tour(world.field.area, &world.positions)];
        if world.is_scarce() {
            world.group(scenario.seed);
        }
        world.find_stops();
        world
    }

    /// Whether loss may be hard to avoid, because most resource blocks are needed to take what is sampled, or a tour takes
    /// most of the time in which a storage fills. Where it is not, to make groups would only take time.
    fn is_scarce(&self) -> bool {
        let visits = |(source, index): (&Source, u32)| 1.0 / self.capacity_slots(index, 0.0).min(source.fill_slots);
        let needed: f64 = self.sources.iter().zip(0..).map(visits).sum();
        let fills = self.sources.iter().map(|source| source.fill_slots);
        let tour_slots = self.tours.first().map_or(0.0, |tour| self.slots_of(tour));
        needed >= SCARCE_BLOCKS * self.blocks() as f64
            || tour_slots >= SCARCE_TIME * fills.fold(f64::INFINITY, f64::min)
    }

    /// Makes the groups of a cover of the field, with random numbers of `seed`, and tours over them.
    pub(super) fn group(&mut self, seed: u64) {
        let groups = groups::cover(self, seed);
        self.add_tours(&groups);
        self.places.extend(groups);
    }

    /// Finds out where plans may stop, what is near to each place, and how long a round takes.
    fn find_stops(&mut self) {
        self.round_slots = self.tours.iter().map(|tour| self.slots_of(tour)).fold(f64::INFINITY, f64::min).max(1.0);
        self.stops = (0..self.places.len() as u32).filter(|&place| self.is_stop(place)).collect();
        self.neighbours = self.nearest_places();
    }

    /// The places that were added.
    #[must_use]
    pub fn added(&self) -> &[Place] {
        &self.places[self.places.len() - self.added..]
    }

    /// The place to serve `members` from at and around `centre`; `None` unless these are 1 to n sources, ascending, and all
    /// in range of it.
    #[must_use]
    pub fn place_at(&self, centre: Position, members: Vec<u32>) -> Option<Place> {
        let position = |&member: &u32| self.positions.get(member as usize);
        let away_m = members.iter().map(|member| Some((position(member)? - centre).norm()));
        let farthest_m = away_m.collect::<Option<Vec<f64>>>()?.into_iter().fold(0.0, f64::max);
        let is_set = (1..=self.blocks()).contains(&members.len()) && members.is_sorted_by(|a, b| a < b);
        let radius_m = (self.radius_m() - farthest_m).max(0.0);
        (is_set && farthest_m <= self.radius_m() * (1.0 + WIDENED)).then_some(Place { centre, radius_m, members })
    }

    /// Adds places.
    pub fn add(&mut self, places: Vec<Place>) {
        self.added += places.len();
        self.places.extend(places);
        self.find_stops();
    }

    /// Takes the places away that were added; no plan may stop at them any more.
    pub fn forget_added(&mut self) {
        if self.added > 0 {
            self.places.truncate(self.places.len() - self.added);
            self.added = 0;
            self.find_stops();
        }
    }

    /// Adds tours over the groups of at least a size, for every size that leaves out few sources: where no cover by full
    /// groups exists, it may lose less to leave some alone.
    fn add_tours(&mut self, groups: &[Place]) {
        let first = self.places.len();
        let mut sizes: Vec<usize> = groups.iter().map(|group| group.members.len()).collect();
        sizes.sort_unstable();
        sizes.dedup();
        let most = |size: usize| {
            groups.iter().filter(|group| group.members.len() >= size).map(|group| group.members.len()).sum::<usize>()
        };
        sizes.retain(|&size| most(size) as f64 >= MOSTLY * self.sources.len() as f64);
        for size in sizes {
            let large: Vec<usize> = (0..groups.len()).filter(|&group| groups[group].members.len() >= size).collect();
            let centres: Vec<Position> = large.iter().map(|&group| groups[group].centre).collect();
            let place = |index: u32| (first + large[index as usize]) as u32;
            let mut tour: Vec<u32> = closed_tour(self.field.area, &centres).into_iter().map(place).collect();
            let excess = |a: u32, b: u32| {
                let (a, b) = (&groups[a as usize - first], &groups[b as usize - first]);
                let away_m = distance_squared(&a.centre, &b.centre).sqrt() - (a.radius_m + b.radius_m) / 2.0;
                (away_m / self.field.reach_m - 1.0).max(0.0)
            };
            even_out(&mut tour, excess);
            self.tours.push(tour);
        }
    }

    fn add_source(&mut self, id: u32, mean_bits: f64, capacity_bits: u32) {
        let rim_m2 = self.field.comm_radius_m * self.field.comm_radius_m;
        let emptied = self.capacity_bits(id, rim_m2) >= f64::from(capacity_bits);
        let fill_slots = f64::from(capacity_bits) / mean_bits;
        self.sources.push(Source { fill_slots, mean_bits, emptied, doubt: Doubt::default() });
        self.ids.push(id);
        self.positions.push(*self.field.position(id));
    }

    /// Slots of a tour, if every leg is as short as its ends allow, and parts of slots count.
    fn slots_of(&self, tour: &[u32]) -> f64 {
        let leg = |(a, b): (&u32, &u32)| {
            let (a, b) = (&self.places[*a as usize], &self.places[*b as usize]);
            let away_m = distance_squared(&a.centre, &b.centre).sqrt() - a.radius_m - b.radius_m;
            (away_m / self.field.reach_m).max(1.0)
        };
        tour.iter().zip(tour.iter().cycle().skip(1)).map(leg).sum()
    }

    /// Whether plans may stop at `place`: at a group, and at a source alone unless so many stand around it that it does
    /// not say who is served, and a visit would empty it anyway.
    fn is_stop(&self, place: u32) -> bool {
        let Some(source) = self.sources.get(place as usize) else {
            return true;
        };
        let mut met = 0;
        let centre = &self.places[place as usize].centre;
        self.grid.visit(centre, self.field.comm_radius_m, |_, _| met += 1);
        !source.emptied || met <= self.blocks() || self.places.len() == self.sources.len()
    }

    /// How far from a source a stop for it alone may be [m]: as far as the link carries most of what it carries from
    /// straight above, or empties a full storage.
    fn near_m(&self, source: u32) -> f64 {
        let enough_slots = self.capacity_slots(source, 0.0).min(self.sources[source as usize].fill_slots) * NEAR;
        let radius_m = |step: u32| self.field.comm_radius_m * f64::from(step) / 32.0;
        let holds = |step: &u32| self.capacity_slots(source, radius_m(*step).powi(2)) >= enough_slots;
        (1..=32).rev().find(holds).map_or(0.0, radius_m)
    }

    fn nearest_places(&self) -> Vec<Vec<u32>> {
        let centres: Vec<Position> = self.stops.iter().map(|&stop| self.places[stop as usize].centre).collect();
        let grid = Grid::new(&centres, self.field.comm_radius_m);
        let nearest = |(index, place): (u32, &Place)| {
            let near = grid.nearest(&place.centre, NEIGHBOURS + 1);
            let mut others: Vec<u32> = near.into_iter().map(|stop| self.stops[stop as usize]).collect();
            others.retain(|&other| other != index);
            others.truncate(NEIGHBOURS);
            others
        };
        (0..).zip(&self.places).map(nearest).collect()
    }

    /// What a visit at the squared distance `d2_m2` [m²] takes from SN `id` in a slot [bit].
    fn capacity_bits(&self, id: u32, d2_m2: f64) -> f64 {
        if let Some(capacities_bits) = &self.capacities_bits {
            let fraction = d2_m2 / (self.field.comm_radius_m * self.field.comm_radius_m);
            return capacities_bits[((fraction * TABLE as f64).round() as usize).min(TABLE)];
        }
        let uplink = Uplink { gain: self.field.gains[id as usize], d2_m2, z_m: self.altitude_m };
        self.field.channel.capacity_bits(self.field.channel.expected_rate_bps(&uplink)) as f64
    }

    /// What a visit at the squared distance `d2_m2` [m²] takes from `source` [slots of sampling].
    #[inline]
    #[must_use]
    pub fn capacity_slots(&self, source: u32, d2_m2: f64) -> f64 {
        let facts = &self.sources[source as usize];
        if facts.emptied {
            return f64::INFINITY;
        }
        self.capacity_bits(self.ids[source as usize], d2_m2) / facts.mean_bits
    }

    /// Farthest flight in one slot [m].
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        self.field.reach_m
    }

    /// Communication radius [m].
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        self.field.comm_radius_m
    }

    /// Most SNs served in a slot, n.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.field.resource_blocks
    }
}

/// The altitude [m] of some that may be flown from which a sensor node nearby is expected to send most.
fn best_altitude_m(scenario: &Scenario, field: &SensorTable) -> f64 {
    let altitudes_m =
        scenario.uav.climb().map_or([scenario.uav.altitude_m; 2], |climb| [climb.min_altitude_m, climb.max_altitude_m]);
    let altitude_m =
        |level: u32| altitudes_m[0] + (altitudes_m[1] - altitudes_m[0]) * f64::from(level) / f64::from(LEVELS);
    let near_bps = |level: u32| -> f64 {
        (0..=NEAR_STEPS).map(|step| field.channel.expected_rate_bps(&uplink_at(field, step, altitude_m(level)))).sum()
    };
    let better = |a: &u32, b: &u32| near_bps(*a).total_cmp(&near_bps(*b)).then(b.cmp(a));
    altitude_m((0..=LEVELS).max_by(better).expect("at least one level"))
}

/// What a visit takes at `altitude_m` [m] [bit], over `d²`.
fn capacities_bits(field: &SensorTable, altitude_m: f64) -> Box<[f64; TABLE + 1]> {
    let channel = &field.channel;
    let bits = |step| channel.capacity_bits(channel.expected_rate_bps(&uplink_at(field, step, altitude_m))) as f64;
    Box::new(std::array::from_fn(bits))
}

/// The uplink at step `step` of the table.
fn uplink_at(field: &SensorTable, step: usize, altitude_m: f64) -> Uplink {
    let rim_m2 = field.comm_radius_m * field.comm_radius_m;
    Uplink { gain: 1.0, d2_m2: rim_m2 * step as f64 / TABLE as f64, z_m: altitude_m }
}
