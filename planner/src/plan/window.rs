//! The planning window: what a plan begins with, and how long it is.

use skysink_common::geometry::Position;

use super::model::PlanModel;
use super::objective::Objective;
use super::sensor::SensorModel;

/// The planning window of a forecast.
#[derive(Debug, Clone)]
pub struct PlanningWindow<O: Objective> {
    /// Initial position of the UAV.
    pub start: Position,
    /// The buffers at its beginning, by sensor.
    pub levels: Vec<O::Level>,
    /// Slots of the window.
    pub slots: i32,
    /// Slots of the mission after the window.
    pub beyond_slots: f64,
    /// Slots of the mission before the window.
    pub flown_slots: u64,
    /// Energy in the battery at its beginning [J]; infinite without one.
    pub energy_j: f64,
    /// The point that the UAV is on its way to, where plans hover: it then flies on, also if the sensor was served in
    /// passing. Otherwise the flight would differ from the plan.
    pub under_way: Option<u32>,
}

impl<O: Objective> PlanningWindow<O> {
    /// A window of `slots` slots, followed by `beyond_slots` slots of the mission, with the UAV at `start` and the
    /// queues `queues_bits` [bit], by id; `age_slots` is the age of an SN [slots], by its id.
    ///
    /// # Panics
    /// If there are more slots than an `i32` holds; a mission has at most 10^9.
    #[must_use]
    pub fn new(
        model: &PlanModel,
        start: Position,
        queues_bits: &[u32],
        age_slots: impl Fn(u32) -> f64,
        slots: u64,
        beyond_slots: u64,
    ) -> Self {
        let level =
            |(sensor, &id): (&SensorModel, &u32)| O::begin(sensor, f64::from(queues_bits[id as usize]), age_slots(id));
        Self {
            start,
            levels: model.sensors.iter().zip(&model.ids).map(level).collect(),
            slots: i32::try_from(slots).expect("a mission has at most 10^9 slots"),
            beyond_slots: beyond_slots as f64,
            flown_slots: 0,
            energy_j: f64::INFINITY,
            under_way: None,
        }
    }

    /// The window after `flown_slots` slots, with `energy_j` [J] in the battery.
    #[must_use]
    pub fn with_battery(self, flown_slots: u64, energy_j: f64) -> Self {
        Self { flown_slots, energy_j, ..self }
    }

    /// Lower bound on the cost of every plan over this window.
    pub fn least(&self, model: &PlanModel) -> f64 {
        if !model.others.is_empty() {
            return 0.0; // the bounds are those of one UAV
        }
        O::least(&model.sensors, &self.levels, self.slots, model.table.limits.blocks())
    }
}
