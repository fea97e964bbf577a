//! An episode of the environment: a mission flown by actions.

use std::sync::Arc;

use nalgebra::Point3;
use pyo3::prelude::*;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::error::InputError;
use skysink_common::estimate::Estimate;
use skysink_common::geometry::{Position, above};
use skysink_common::message::{Mode, Plan, QueuesHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::{SensorList, Sensors};
use skysink_common::slot_record::UAV;
use skysink_mission::Plant;
use skysink_planner::settings;

use crate::errors::refused;
use crate::field::{FieldData, PyField};

/// The field and the UAV of a scenario, with the estimate of the UAV if it does not observe the
/// queues.
pub fn plant(scenario: &Scenario, list: &SensorList) -> PyResult<Plant> {
    let plant = Plant::new(scenario, list);
    Ok(match settings::estimated(scenario).map_err(refused)? {
        Some(rates) => plant.with_estimate(Estimate::new(scenario, rates, &Sensors::of(scenario, &list.nodes()))),
        None => plant,
    })
}

/// The fields of the episodes.
#[derive(Clone)]
pub struct Fields {
    /// The scenario; its seed is that of the first field.
    pub scenario: Scenario,
    /// The number of fields; `None` for unlimited.
    pub count: Option<u64>,
}

impl Fields {
    /// The seed of the episode with this number.
    fn seed(&self, number: u64) -> u64 {
        self.count.map_or(number, |count| self.scenario.seed + number % count)
    }
}

/// A running episode.
#[derive(Clone)]
pub struct Episode {
    fields: Arc<Fields>,
    number: u64,
    pub list: Arc<SensorList>,
    pub field: Arc<FieldData>,
    pub plant: Plant,
    header: QueuesHeader,
    ids: Vec<u32>,
}

/// The result of one slot of an episode.
#[derive(Clone, Copy)]
pub struct Outcome {
    /// Minus the fraction of the sampled bits that was lost; 0 if nothing was sampled.
    pub reward: f64,
    pub delivered_bits: u64,
    pub lost_bits: u64,
    /// Whether the episode is over.
    pub is_over: bool,
}

/// The saved state of an episode.
#[derive(serde::Serialize, serde::Deserialize)]
struct SavedEpisode {
    number: u64,
    plant: Vec<u8>,
}

impl Episode {
    /// The episode with this number, before its first slot.
    pub fn new(fields: Arc<Fields>, number: u64) -> PyResult<Self> {
        let scenario = seeded(&fields, number)?;
        let list = SensorList::of(&scenario).map_err(refused)?;
        let plant = plant(&scenario, &list)?;
        let PyField(field) = PyField::of(&scenario, &list);
        Ok(Self { fields, number, header: plant.header(), plant, field, list: Arc::new(list), ids: Vec::new() })
    }

    /// The episode with this number. It reuses the sensor nodes if they are the same.
    pub fn begin(&mut self, number: u64) -> PyResult<()> {
        if self.fields.seed(number) != self.seed() {
            *self = Self::new(Arc::clone(&self.fields), number)?;
            return Ok(());
        }
        self.number = number;
        self.plant = plant(&seeded(&self.fields, number)?, &self.list)?;
        self.header = self.plant.header();
        Ok(())
    }

    /// Checks that all numbers have a seed.
    pub fn check(&self, numbers: &[u64]) -> PyResult<()> {
        numbers.iter().try_for_each(|&number| seeded(&self.fields, number).map(|_| ()))
    }

    /// Its number. In a vector of n, environment i has the numbers i, i + n, i + 2n and so on, plus that of the first.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Its Skysink seed.
    pub fn seed(&self) -> u64 {
        self.fields.seed(self.number)
    }

    /// Its mission.
    pub fn scenario(&self) -> PyResult<Scenario> {
        seeded(&self.fields, self.number)
    }

    /// Number of coordinates of an action: 3 if the altitude is free, else 2.
    pub fn axes(&self) -> usize {
        if self.field.limits.climb_m > 0.0 { 3 } else { 2 }
    }

    /// The plan of an action: a displacement as a fraction of the reach of a slot. Serves the fullest queues in range.
    pub fn plan(&mut self, action: &[f64]) -> Plan {
        let limits = self.field.limits;
        let uav = self.plant.flight(UAV).position();
        let step = Position::new(action[0], action[1]).coords;
        let step = step / step.norm().max(1.0) * limits.reach_m;
        let z_m = action.get(2).map_or(uav.z, |climb| {
            let climb_m = climb.clamp(-1.0, 1.0) * limits.climb_m;
            (uav.z + climb_m).clamp(limits.min_altitude_m, limits.max_altitude_m)
        });
        let ground = self.field.clamp_to_area(uav.xy() + step);
        self.plan_to(above(&ground, z_m), None, Mode::Serve)
    }

    /// The plan to fly to a waypoint [m] and serve these SNs, or the fullest in range.
    pub fn plan_to(&mut self, waypoint: Point3<f64>, serve: Option<&[u32]>, mode: Mode) -> Plan {
        let Self { plant, field, ids, .. } = self;
        match serve {
            Some(serve) => serve.clone_into(ids),
            None => field.fill_fullest(&waypoint.xy(), plant.known_bits(), ids),
        }
        let mut plan = Plan::fly_to(waypoint, mode);
        plan.schedule(ids);
        plan
    }

    /// Flies the next slot.
    pub fn fly(&mut self, plan: &Plan) -> Outcome {
        let before_bits = self.header.totals.sampled_bits;
        self.header = self.plant.step(&[Some(*plan)]).header;
        let QueuesHeader { totals, delivered_bits, lost_bits, .. } = self.header;
        let sampled_bits = totals.sampled_bits - before_bits;
        let reward = if sampled_bits > 0 { -(lost_bits as f64 / sampled_bits as f64) } else { 0.0 };
        Outcome { reward, delivered_bits, lost_bits, is_over: self.plant.is_over() }
    }

    /// Writes the observation: the UAV's position relative to area and altitudes, the queues as fractions of the
    /// buffers, and the slot as a fraction of the mission.
    pub fn observe(&mut self, uav: &mut [f32], queues: &mut [f32], slot: &mut f32) {
        let limits = self.field.limits;
        let position = self.plant.flight(UAV).position();
        let climb_range_m = limits.max_altitude_m - limits.min_altitude_m;
        let altitude = if climb_range_m > 0.0 { (position.z - limits.min_altitude_m) / climb_range_m } else { 0.0 };
        let fractions = [position.x / limits.width_m, position.y / limits.height_m, altitude];
        uav.iter_mut().zip(fractions).for_each(|(uav, fraction)| *uav = fraction.clamp(0.0, 1.0) as f32);
        *slot = (self.plant.slot() as f64 / limits.slots as f64) as f32;
        let capacity_bits = self.field.capacity_bits() as f32;
        let pairs = queues.iter_mut().zip(self.plant.known_bits());
        pairs.for_each(|(queue, &bits)| *queue = bits as f32 / capacity_bits);
    }

    /// Writes the positions of the sensor nodes, x and y alternating, as fractions of the area.
    pub fn observe_positions(&self, positions: &mut [f32]) {
        let area_m = [self.field.limits.width_m, self.field.limits.height_m];
        for (pair, position) in positions.chunks_exact_mut(2).zip(&self.field.sensors.positions) {
            pair.iter_mut().zip([0, 1]).for_each(|(fraction, axis)| *fraction = (position[axis] / area_m[axis]) as f32);
        }
    }
}

impl Checkpoint for Episode {
    fn save(&self, bytes: &mut Vec<u8>) {
        let mut plant = Vec::new();
        self.plant.save(&mut plant);
        encode(&SavedEpisode { number: self.number, plant }, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let SavedEpisode { number, plant } = decode(bytes)?;
        let mut episode = self.clone();
        CheckpointError::ensure(episode.begin(number).is_ok(), "a field that can be made")?;
        episode.plant.restore(&plant)?;
        episode.header = episode.plant.header();
        *self = episode;
        Ok(())
    }
}

fn seeded(fields: &Fields, number: u64) -> PyResult<Scenario> {
    let mut scenario = fields.scenario.clone();
    scenario.seed = fields.seed(number);
    if i64::try_from(scenario.seed).is_err() {
        let message = format!("{}: expected 0 to {}", scenario.seed, i64::MAX);
        return Err(refused(InputError::of_argument("seed", &scenario.seed.to_string(), message)));
    }
    Ok(scenario)
}
