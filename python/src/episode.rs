//! An episode of the environment: a mission flown by actions.

use std::sync::Arc;

use numpy::{IntoPyArray, PyArray1, PyArrayMethods as _};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint as _, decode, encode};
use skysink_common::error::InputError;
use skysink_common::geometry::{Position, above};
use skysink_common::message::{Mode, Plan};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_mission::Plant;
use skysink_planner::settings;

use crate::errors::refused;
use crate::field::FieldData;
use crate::scenario::PyScenario;

/// The field and the UAV of a scenario, with what the UAV believes of the queues.
pub fn plant(scenario: &Scenario, list: &SensorList) -> PyResult<Plant> {
    let estimated = settings::estimated(scenario).map_err(refused)?;
    Ok(Plant::new(scenario, list).with_belief(Belief::of(scenario, list, estimated)))
}

/// What the episodes of an environment have in common.
struct Course {
    /// The scenario; its seed is that of the first field.
    scenario: Scenario,
    /// The number of fields; `None` for unlimited.
    fields: Option<u64>,
    /// Whether the positions of the sensor nodes are observed.
    observes_positions: bool,
}

impl Course {
    /// The seed of the episode with this number.
    fn seed(&self, number: u64) -> u64 {
        self.fields.map_or(number, |count| self.scenario.seed + number % count)
    }

    /// The mission of the episode with this number.
    fn scenario(&self, number: u64) -> PyResult<Scenario> {
        let mut scenario = self.scenario.clone();
        scenario.seed = self.seed(number);
        if i64::try_from(scenario.seed).is_err() {
            let message = format!("{}: expected 0 to {}", scenario.seed, i64::MAX);
            return Err(refused(InputError::of_argument("seed", &scenario.seed.to_string(), message)));
        }
        Ok(scenario)
    }
}

/// A running episode.
#[derive(Clone)]
pub struct Episode {
    course: Arc<Course>,
    number: u64,
    pub list: Arc<SensorList>,
    pub field: Arc<FieldData>,
    pub plant: Plant,
    /// Positions of the sensor nodes, x and y alternating, as fractions of the area; empty if they are not observed.
    positions: Arc<[f32]>,
}

/// The result of one slot of an episode.
#[derive(Clone, Copy, Default)]
pub struct Outcome {
    /// Minus the fraction of the sampled bits that was lost; 0 if nothing was sampled.
    pub reward: f64,
    pub delivered_bits: u64,
    pub lost_bits: u64,
    /// Whether the episode is over.
    pub is_over: bool,
}

impl Episode {
    /// The first episode of an environment over `fields` fields.
    pub fn first(scenario: &PyScenario, fields: Option<u64>, observes_positions: bool) -> PyResult<Self> {
        let scenario = scenario.scenario.clone();
        if fields == Some(0) {
            return Err(refused("fields = 0: expected 1 or more, or None"));
        }
        if fields.is_some_and(|count| scenario.seed.checked_add(count).is_none_or(|end| i64::try_from(end).is_err())) {
            return Err(refused(format!("fields = {}: expected fewer", fields.unwrap_or(0))));
        }
        let number = if fields.is_some() { 0 } else { scenario.seed };
        Self::new(Arc::new(Course { scenario, fields, observes_positions }), number)
    }

    /// The episode with this number, before its first slot.
    fn new(course: Arc<Course>, number: u64) -> PyResult<Self> {
        let scenario = course.scenario(number)?;
        let list = SensorList::of(&scenario).map_err(refused)?;
        let plant = plant(&scenario, &list)?;
        let field = Arc::new(FieldData::of(&scenario, &list, plant.field().belief()));
        let positions = if course.observes_positions { field.position_fractions().collect() } else { Arc::default() };
        Ok(Self { course, number, list: Arc::new(list), field, plant, positions })
    }

    /// The episode with this number. It reuses the sensor nodes if they are the same.
    pub fn begin(&mut self, number: u64) -> PyResult<()> {
        if self.course.seed(number) != self.seed() {
            *self = Self::new(Arc::clone(&self.course), number)?;
            return Ok(());
        }
        self.plant = plant(&self.course.scenario(number)?, &self.list)?;
        self.number = number;
        Ok(())
    }

    /// Checks that all numbers have a seed.
    pub fn check(&self, numbers: &[u64]) -> PyResult<()> {
        numbers.iter().try_for_each(|&number| self.course.scenario(number).map(|_| ()))
    }

    /// Its number. In a vector of n, environment i has the numbers i, i + n, i + 2n and so on, plus that of the first.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Its Skysink seed.
    pub fn seed(&self) -> u64 {
        self.course.seed(self.number)
    }

    /// Its mission.
    pub fn scenario(&self) -> PyResult<Scenario> {
        self.course.scenario(self.number)
    }

    /// Number of coordinates of an action: 3 if the altitude is free, else 2.
    pub fn axes(&self) -> usize {
        if self.field.limits.climb_m > 0.0 { 3 } else { 2 }
    }

    /// The plan of an action: a displacement as a fraction of the reach of a slot. Serves the fullest queues in range.
    pub fn plan(&self, action: &[f32]) -> Plan {
        let limits = self.field.limits;
        let uav = self.plant.flight(UAV).position();
        let step = Position::new(action[0].into(), action[1].into()).coords;
        let step = step / step.norm().max(1.0) * limits.reach_m;
        let z_m = action.get(2).map_or(uav.z, |&climb| {
            let climb_m = f64::from(climb).clamp(-1.0, 1.0) * limits.climb_m;
            (uav.z + climb_m).clamp(limits.min_altitude_m, limits.max_altitude_m)
        });
        let ground = self.field.clamp_to_area(uav.xy() + step);
        self.field.plan(above(&ground, z_m), None, self.plant.field().believed_bits(), Mode::Serve)
    }

    /// Flies the next slot.
    pub fn fly(&mut self, plan: &Plan) -> Outcome {
        let before_bits = self.plant.header().totals.sampled_bits;
        let header = self.plant.step(&[Some(*plan)]).header;
        let sampled_bits = header.totals.sampled_bits - before_bits;
        let reward = if sampled_bits > 0 { -(header.lost_bits as f64 / sampled_bits as f64) } else { 0.0 };
        let is_over = self.plant.is_over();
        Outcome { reward, delivered_bits: header.delivered_bits, lost_bits: header.lost_bits, is_over }
    }

    /// Writes the observation: the UAV's position relative to area and altitudes, the queues as fractions of the
    /// buffers, and the slot as a fraction of the mission.
    pub fn observe(&self, uav: &mut [f32], queues: &mut [f32], slot: &mut f32) {
        let limits = self.field.limits;
        let position = self.plant.flight(UAV).position();
        let climb_range_m = limits.max_altitude_m - limits.min_altitude_m;
        let altitude = if climb_range_m > 0.0 { (position.z - limits.min_altitude_m) / climb_range_m } else { 0.0 };
        let fractions = [position.x / limits.width_m, position.y / limits.height_m, altitude];
        uav.iter_mut().zip(fractions).for_each(|(uav, fraction)| *uav = fraction.clamp(0.0, 1.0) as f32);
        *slot = (self.plant.slot() as f64 / limits.slots as f64) as f32;
        let capacity_bits = self.field.capacity_bits() as f32;
        let pairs = queues.iter_mut().zip(self.plant.field().believed_bits());
        pairs.for_each(|(queue, &bits)| *queue = bits as f32 / capacity_bits);
    }

    /// Its state as bytes.
    pub fn save(&self) -> Vec<u8> {
        let mut plant = Vec::new();
        self.plant.save(&mut plant);
        let mut bytes = Vec::new();
        encode(&(self.number, plant), &mut bytes);
        bytes
    }

    /// Restores a state that [`Episode::save`] returned for the same environment. Refuses any other.
    pub fn restore(&mut self, bytes: &[u8]) -> PyResult<()> {
        let (number, plant): (u64, Vec<u8>) = decode(bytes).map_err(refused)?;
        let mut episode = self.clone();
        episode.begin(number)?;
        episode.plant.restore(&plant).map_err(refused)?;
        *self = episode;
        Ok(())
    }
}

/// Numbers below which NumPy copies an array faster than it takes over a vector.
const FEW: usize = 1000;

/// The observations of episodes, one after another.
pub struct Observations {
    /// Sensor nodes of each.
    sensors: usize,
    pub uav: Vec<f32>,
    pub queues: Vec<f32>,
    pub slot: Vec<f32>,
}

impl Observations {
    /// Room for those of `count` episodes of `sensors` sensor nodes.
    pub fn new(count: usize, sensors: usize) -> Self {
        Self { sensors, uav: vec![0.0; 3 * count], queues: vec![0.0; sensors * count], slot: vec![0.0; count] }
    }

    /// As a dictionary of arrays, with the positions of `episodes` if they are observed. `count` is the first dimension
    /// of the arrays of a vector; those of a single environment have none.
    pub fn into_dict<'py>(
        self,
        py: Python<'py>,
        episodes: &[Episode],
        count: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let Self { sensors, uav, queues, slot } = self;
        let observation = PyDict::new(py);
        let set = |name: &Bound<'py, PyString>, values: Vec<f32>, shape: &[usize]| {
            let array = match values.len() {
                ..FEW => PyArray1::from_slice(py, &values),
                _ => values.into_pyarray(py),
            };
            if count.is_none() && shape.len() == 1 {
                return observation.set_item(name, array);
            }
            let shape: Vec<usize> = count.into_iter().chain(shape.iter().copied()).collect();
            observation.set_item(name, array.reshape(shape)?)
        };
        set(intern!(py, "uav"), uav, &[3])?;
        set(intern!(py, "queues"), queues, &[sensors])?;
        set(intern!(py, "slot"), slot, &[1])?;
        if episodes[0].course.observes_positions {
            let positions: Vec<&[f32]> = episodes.iter().map(|episode| &episode.positions[..]).collect();
            set(intern!(py, "positions"), positions.concat(), &[sensors, 2])?;
        }
        Ok(observation)
    }
}
