//! What an environment observes: a registry of named quantities.

use arrayvec::ArrayVec;
use numpy::{IntoPyArray, PyArray1, PyArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use skysink_common::geometry::within;

use crate::belief::believed;
use crate::episode::Episode;
use crate::errors::refused;
use crate::rules::{Kind, Observed};

/// The shape of an observed array.
type Shape = ArrayVec<usize, 2>;

fn shape<const AXES: usize>(axes: [usize; AXES]) -> Shape {
    axes.into_iter().collect()
}

/// An observable quantity.
struct Observable {
    /// Its key in the dictionary.
    name: &'static str,
    shape: ShapeOf,
    /// Its least number; the largest is 1.
    low: f64,
    /// Whether it is the same for all UAVs.
    is_shared: bool,
    write: fn(&Episode, &mut [f32]),
}

/// The shape of a quantity for so many sensor nodes, nearest ones, and other UAVs.
type ShapeOf = fn(usize, usize, usize) -> Shape;

/// The shape of a number for each sensor node.
const PER_SENSOR: ShapeOf = |count, _, _| shape([count]);

/// A quantity of each UAV.
const fn own(name: &'static str, low: f64, shape: ShapeOf, write: fn(&Episode, &mut [f32])) -> Observable {
    Observable { name, shape, low, is_shared: false, write }
}

/// A quantity that is the same for all UAVs.
const fn shared(name: &'static str, low: f64, shape: ShapeOf, write: fn(&Episode, &mut [f32])) -> Observable {
    Observable { is_shared: true, ..own(name, low, shape, write) }
}

const KINDS: usize = 17;

/// All of them, in the order of a dictionary.
static OBSERVABLES: [Observable; KINDS] = [
    own("uav", 0.0, |_, _, _| shape([3]), uav),
    shared("queues", 0.0, PER_SENSOR, queues),
    shared("slot", 0.0, |_, _, _| shape([1]), slot),
    shared("positions", 0.0, |count, _, _| shape([count, 2]), positions),
    shared("belief", 0.0, PER_SENSOR, |episode, numbers| each(episode, numbers, belief)),
    shared("belief_spread", 0.0, PER_SENSOR, |episode, numbers| each(episode, numbers, belief_spread)),
    shared("rates", 0.0, PER_SENSOR, |episode, numbers| each(episode, numbers, rate)),
    shared("ages", 0.0, PER_SENSOR, |episode, numbers| each(episode, numbers, age)),
    shared("gains", 0.0, PER_SENSOR, gains),
    own("nearest", -1.0, |_, nearest, _| shape([nearest, NEAREST]), nearest),
    own("reach", 0.0, PER_SENSOR, |episode, numbers| each(episode, numbers, reach)),
    own("energy", -1.0, |_, _, _| shape([1]), energy),
    own("home", -1.0, |_, _, _| shape([4]), home),
    own("zones", 0.0, |_, _, _| shape([DIRECTIONS]), zones),
    own("returnable", 0.0, PER_SENSOR, |episode, numbers| each(episode, numbers, returnable)),
    own("others", -1.0, |_, _, others| shape([others, 2]), others),
    own("agent", 0.0, |_, _, others| shape([others + 1]), agent),
];

/// Writes a number for each sensor node, at most 1.
fn each(episode: &Episode, numbers: &mut [f32], of: impl Fn(&Episode, u32) -> f64) {
    let pairs = numbers.iter_mut().zip(episode.field.sensors.ids());
    pairs.for_each(|(number, id)| *number = of(episode, id).min(1.0) as f32);
}

/// What only agents observe.
const OF_AGENTS: [&str; 2] = ["others", "agent"];

/// Directions in which free distances are observed.
const DIRECTIONS: usize = 16;

/// Numbers for each of the nearest sensor nodes.
const NEAREST: usize = 5;

/// The UAV's position relative to area and altitudes.
fn uav(episode: &Episode, numbers: &mut [f32]) {
    let limits = episode.field.limits;
    let position = episode.flight().position();
    let climb_range_m = limits.max_altitude_m - limits.min_altitude_m;
    let altitude = if climb_range_m > 0.0 { (position.z - limits.min_altitude_m) / climb_range_m } else { 0.0 };
    let fractions = [position.x / limits.width_m, position.y / limits.height_m, altitude];
    numbers.iter_mut().zip(fractions).for_each(|(number, fraction)| *number = fraction.clamp(0.0, 1.0) as f32);
}

/// The queues, true or estimated, as fractions of the buffers; 0 of sensor nodes that are known to be dead or silent.
fn queues(episode: &Episode, numbers: &mut [f32]) {
    let servable_bits = episode.plant.field().servable_bits();
    let pairs = numbers.iter_mut().zip(&*servable_bits).zip(&episode.field.buffers_bits);
    pairs.for_each(|((number, &bits), buffer_bits)| *number = bits as f32 / buffer_bits);
}

/// The slot as a fraction of the mission.
fn slot(episode: &Episode, numbers: &mut [f32]) {
    numbers[0] = (episode.plant.slot() as f64 / episode.field.limits.slots as f64) as f32;
}

/// Positions of the sensor nodes, x and y, as fractions of the area.
fn positions(episode: &Episode, numbers: &mut [f32]) {
    numbers.copy_from_slice(&episode.positions);
}

/// The mean of the queue of sensor node `id` as a fraction of its buffer.
fn belief(episode: &Episode, id: u32) -> f64 {
    let field = episode.plant.field();
    let is_known_out = !field.known_answer(id).sends();
    of_buffer(episode, id, if is_known_out { 0.0 } else { field.believed_bits()[id as usize].into() })
}

/// The standard deviation of the same.
fn belief_spread(episode: &Episode, id: u32) -> f64 {
    of_buffer(episode, id, believed(&episode.plant, &episode.field).queue_sd_bits(id))
}

/// Its rate, true or learnt, as a fraction of the highest possible one.
fn rate(episode: &Episode, id: u32) -> f64 {
    let mean_bits = episode.plant.field().belief().mean_bits(&episode.field.sensors, id);
    mean_bits / episode.highest_mean_bits.max(f64::MIN_POSITIVE)
}

/// Slots since the last contact, as a fraction of the mission.
fn age(episode: &Episode, id: u32) -> f64 {
    let slot = episode.plant.slot();
    episode.contacts.age_slots(slot, id) as f64 / episode.field.limits.slots as f64
}

/// 1 for a sensor node within the reach of one slot, else 0.
fn reach(episode: &Episode, id: u32) -> f64 {
    f64::from(u8::from(episode.reaches(id)))
}

/// 1 for a sensor node that the UAV can still serve and come home from, else 0.
fn returnable(episode: &Episode, id: u32) -> f64 {
    f64::from(u8::from(episode.returns_from(id)))
}

/// Bits as a fraction of the buffer of sensor node `id`.
fn of_buffer(episode: &Episode, id: u32, bits: f64) -> f64 {
    bits / f64::from(episode.field.sensors.sampler(id).capacity_bits).max(1.0)
}

/// Reference gains as fractions of the largest.
fn gains(episode: &Episode, numbers: &mut [f32]) {
    let gains = &episode.field.sensors.gains;
    let largest = gains.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    numbers.iter_mut().zip(gains).for_each(|(number, gain)| *number = (gain / largest).min(1.0) as f32);
}

/// The nearest sensor nodes, nearest first: x and y from the UAV as fractions of the area, queue, rate, age.
fn nearest(episode: &Episode, numbers: &mut [f32]) {
    let limits = episode.field.limits;
    let uav = episode.flight().position().xy();
    for (&id, numbers) in episode.nearest(numbers.len() / NEAREST).iter().zip(numbers.chunks_mut(NEAREST)) {
        let offset = episode.field.sensors.position(id) - uav;
        let place = [offset.x / limits.width_m, offset.y / limits.height_m];
        let row = place.into_iter().chain([belief(episode, id), rate(episode, id), age(episode, id)]);
        numbers.iter_mut().zip(row).for_each(|(number, value)| *number = value.clamp(-1.0, 1.0) as f32);
    }
}

/// The energy as a fraction of the capacity; 1 without a battery.
fn energy(episode: &Episode, numbers: &mut [f32]) {
    numbers[0] = of_capacity(episode, episode.flight().energy_j);
}

/// Energy [J] as a fraction of the battery's capacity, from −1; 1 without a battery.
fn of_capacity(episode: &Episode, energy_j: f64) -> f32 {
    let battery = episode.field.motion.battery();
    if battery.is_endless() { 1.0 } else { (energy_j / battery.capacity_j).clamp(-1.0, 1.0) as f32 }
}

/// The end of the way home from the UAV, x and y as fractions of the area; the length of the way as a fraction of the
/// longer side; the energy beyond it and the reserve as a fraction of the capacity, or −1 if it takes too long. Zeros
/// and 1 where the UAV need not come home.
fn home(episode: &Episode, numbers: &mut [f32]) {
    let Some(home) = episode.field.home.way() else {
        numbers.copy_from_slice(&[0.0, 0.0, 0.0, 1.0]);
        return;
    };
    let limits = episode.field.limits;
    let flight = episode.flight();
    let uav = flight.position().xy();
    let route = home.route(episode.plant.slot(), &uav);
    let offset = route.as_ref().map_or(uav, |route| route.end()) - uav;
    let length_m = route.map_or(f64::INFINITY, |route| route.length_m());
    let row = [offset.x / limits.width_m, offset.y / limits.height_m, length_m / limits.width_m.max(limits.height_m)];
    numbers.iter_mut().zip(row).for_each(|(number, value)| *number = value.clamp(-1.0, 1.0) as f32);
    numbers[3] = match home.margin_j(episode.plant.slot(), flight.energy_j, &uav) {
        f64::NEG_INFINITY => -1.0,
        margin_j => of_capacity(episode, margin_j),
    };
}

/// How far it is to the next zone, or to the border of the area, in 16 directions from the east, counterclockwise, as a
/// fraction of the longer side.
fn zones(episode: &Episode, numbers: &mut [f32]) {
    let limits = episode.field.limits;
    let uav = episode.flight().position();
    let side_m = limits.width_m.max(limits.height_m);
    for (direction, number) in (0u8..).zip(numbers) {
        let (sine, cosine) = (f64::from(direction) * std::f64::consts::TAU / DIRECTIONS as f64).sin_cos();
        let to_border = |at_m: f64, along: f64, end_m: f64| match along.abs() < 1e-12 {
            true => f64::INFINITY,
            false => (if along > 0.0 { end_m - at_m } else { -at_m }) / along,
        };
        let border_m = to_border(uav.x, cosine, limits.width_m).min(to_border(uav.y, sine, limits.height_m));
        let end = uav.xy() + nalgebra::Vector2::new(cosine, sine) * border_m;
        let free = episode.field.airspace.entry(&uav.xy(), &end, [uav.z; 2], 0.0).unwrap_or(1.0);
        *number = (border_m * free / side_m).clamp(0.0, 1.0) as f32;
    }
}

/// The other UAVs in the order of their numbers: x and y from the UAV as fractions of the area.
fn others(episode: &Episode, numbers: &mut [f32]) {
    let limits = episode.field.limits;
    let uav = episode.flight().position();
    let flights = episode.plant.flights().iter().enumerate().filter(|(number, _)| *number != episode.uav);
    for ((_, flight), numbers) in flights.zip(numbers.chunks_mut(2)) {
        let offset = flight.position() - uav;
        let row = [offset.x / limits.width_m, offset.y / limits.height_m];
        numbers.iter_mut().zip(row).for_each(|(number, value)| *number = value.clamp(-1.0, 1.0) as f32);
    }
}

/// 1 for the UAV itself, else 0.
fn agent(episode: &Episode, numbers: &mut [f32]) {
    numbers.fill(0.0);
    numbers[episode.uav] = 1.0;
}

impl Observed {
    /// Those with the given names.
    pub fn of(py: Python<'_>, kind: Kind, names: &[String], nearest: Option<usize>) -> PyResult<Self> {
        let is_known = |name: &&str| kind == Kind::Agents || !OF_AGENTS.contains(name);
        let known: Vec<&str> = OBSERVABLES.iter().map(|kind| kind.name).filter(is_known).collect();
        if names.is_empty() || names.iter().any(|name| !known.contains(&name.as_str())) {
            return Err(refused(format!("observation = {names:?}: expected one or more of {}", known.join(", "))));
        }
        if nearest.is_none() && names.iter().any(|name| name == "nearest") {
            return Err(refused("nearest = None: expected the number of nearest sensor nodes to observe"));
        }
        let is_named = |&kind: &usize| names.iter().any(|name| name == OBSERVABLES[kind].name);
        let kinds: Vec<usize> = (0..OBSERVABLES.len()).filter(is_named).collect();
        let keys = kinds.iter().map(|&kind| PyString::intern(py, OBSERVABLES[kind].name).unbind()).collect();
        Ok(Self { kinds, keys, nearest })
    }

    /// Whether the quantity of this name is observed.
    pub fn has(&self, name: &str) -> bool {
        self.observables().any(|kind| kind.name == name)
    }

    fn observables(&self) -> impl Iterator<Item = &'static Observable> {
        self.kinds.iter().map(|&kind| &OBSERVABLES[kind])
    }
}

/// Numbers below which NumPy copies an array faster than it takes over a vector.
const FEW: usize = 1000;

/// Room for the observations of episodes: an array for each observed quantity, with the episodes one after another.
pub struct Observations {
    arrays: ArrayVec<Vec<f32>, KINDS>,
    episodes: usize,
}

impl Observations {
    /// Room for those of `episodes`, all of the same shape.
    pub fn of(episodes: &[Episode]) -> Self {
        let width = |shape: Shape| shape.iter().product::<usize>();
        let arrays = episodes[0].shapes().map(|shape| vec![0.0; width(shape) * episodes.len()]).collect();
        Self { arrays, episodes: episodes.len() }
    }

    /// The rows of each episode, one after another, and how many rows each has.
    pub fn rows(&mut self) -> (Vec<&mut [f32]>, usize) {
        let kinds = self.arrays.len();
        let mut rows: Vec<&mut [f32]> = Vec::new();
        rows.resize_with(kinds * self.episodes, Default::default);
        for (kind, array) in self.arrays.iter_mut().enumerate() {
            let of_kind = rows[kind..].iter_mut().step_by(kinds);
            let width = array.len() / self.episodes;
            of_kind.zip(array.chunks_mut(width)).for_each(|(row, numbers)| *row = numbers);
        }
        (rows, kinds)
    }

    /// As a dictionary of arrays. Their first dimension in a vector is the number of episodes, all of the shapes of
    /// `episode`; those of a single environment have none.
    pub fn into_dict<'py>(self, py: Python<'py>, episode: &Episode) -> PyResult<Bound<'py, PyDict>> {
        let count = (episode.rules().kind != Kind::One).then_some(self.episodes);
        let observation = PyDict::new(py);
        for ((key, numbers), shape) in episode.observed().keys.iter().zip(self.arrays).zip(episode.shapes()) {
            let array = match numbers.len() {
                ..FEW => PyArray1::from_slice(py, &numbers),
                _ => numbers.into_pyarray(py),
            };
            if count.is_none() && shape.len() == 1 {
                observation.set_item(key, array)?;
                continue;
            }
            let shape: Vec<usize> = count.into_iter().chain(shape).collect();
            observation.set_item(key, array.reshape(shape)?)?;
        }
        Ok(observation)
    }
}

impl Episode {
    pub fn observed(&self) -> &Observed {
        &self.rules().observed
    }

    /// The shapes of what it observes.
    fn shapes(&self) -> impl Iterator<Item = Shape> {
        let [count, nearest] = [self.field.count(), self.observed().nearest.unwrap_or(0)];
        let others = self.plant.flights().len() - 1;
        self.observed().observables().map(move |kind| (kind.shape)(count, nearest, others))
    }

    /// Names, shapes and least numbers of what it observes.
    pub fn boxes(&self) -> Vec<(&'static str, Vec<usize>, f64)> {
        let boxes = self.observed().observables().zip(self.shapes());
        boxes.map(|(kind, shape)| (kind.name, shape.to_vec(), kind.low)).collect()
    }

    pub fn width(&self) -> usize {
        self.shapes().map(|shape| shape.iter().product::<usize>()).sum()
    }

    /// Writes what each UAV observes into `numbers`, UAV by UAV, one quantity after another.
    pub fn observe_flat(&mut self, numbers: &mut [f32]) {
        let width = self.width();
        for uav in 0..numbers.len() / width {
            self.act_as(uav);
            let first = uav * width;
            let mut begin = first;
            for (kind, shape) in self.observed().observables().zip(self.shapes()) {
                let end = begin + shape.iter().product::<usize>();
                if kind.is_shared && uav > 0 {
                    numbers.copy_within(begin - first..end - first, begin);
                } else {
                    (kind.write)(self, &mut numbers[begin..end]);
                }
                begin = end;
            }
        }
    }

    /// Writes the observation into the rows of this episode.
    pub fn observe(&self, rows: &mut [&mut [f32]]) {
        self.observed().observables().zip(rows).for_each(|(kind, row)| (kind.write)(self, row));
    }

    /// The state of the mission: x and y of all UAVs, the queues and the slot, as fractions.
    pub fn state(&mut self) -> Vec<f32> {
        let uavs = self.plant.flights().len();
        let sensors = self.field.count();
        let mut numbers = vec![0.0; 2 * uavs + sensors + 1];
        let (positions, others) = numbers.split_at_mut(2 * uavs);
        for (number, position) in positions.chunks_mut(2).enumerate() {
            self.act_as(number);
            uav(self, position);
        }
        queues(self, &mut others[..sensors]);
        slot(self, &mut others[sensors..]);
        numbers
    }

    /// The ids of the `count` sensor nodes nearest to the UAV, nearest first.
    pub fn nearest(&self, count: usize) -> Vec<u32> {
        self.field.sensors.grid.nearest(&self.flight().position().xy(), count)
    }

    /// Whether the UAV can fly into the range of sensor node `id`, around zones at full speed, and home from there in
    /// time and with its reserve.
    pub fn returns_from(&self, id: u32) -> bool {
        let field = &self.field;
        let flight = self.flight();
        let from = flight.position().xy();
        let sensor = field.sensors.position(id);
        let Some(route) = field.route_into(&from, sensor, field.limits.comm_radius_m) else { return false };
        let after = self.plant.slot() + u64::from(route.slots()).max(1);
        let energy_j = flight.energy_j - route.energy_j();
        field.home.is_in_reach(after, energy_j, &route.end())
    }

    /// Whether the UAV reaches sensor node `id` in one slot, and does not know that it cannot be served.
    pub fn reaches(&self, id: u32) -> bool {
        let uav = self.flight().position().xy();
        let is_near = within(self.field.sensors.position(id), &uav, self.field.limits.reach_m);
        is_near && self.plant.field().known_answer(id).sends()
    }
}
