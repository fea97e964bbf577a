//! A mission in one process, by the same steps as the executables.

use std::time::Instant;

use bytemuck::{bytes_of, try_pod_read_unaligned};
use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::error::InputError;
use skysink_common::estimate::Estimate;
use skysink_common::message::{FLAG_END, FlightReport, Plan, QueuesHeader, SlotHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_field_sim::Field;
use skysink_flight_sim::Flight;
use skysink_planner::Planner;
use skysink_planner::strategies::Strategy;

/// The plant that a planner controls: the field and the UAV of a mission. Clones are independent.
#[derive(Debug, Clone)]
pub struct Plant {
    field: Field,
    flight: Flight,
    slot: u64,
    slots: u64,
    report: FlightReport,
}

impl Plant {
    /// The field and the UAV before slot 1.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        let flight = Flight::new(scenario, &list.nodes());
        Self { field: Field::new(scenario, list), report: flight.start(), flight, slot: 0, slots: scenario.slots }
    }

    /// Also maintains the UAV's estimate of the queues, for external planners.
    #[must_use]
    pub fn with_estimate(mut self, estimate: Estimate) -> Self {
        self.field = self.field.with_estimate(estimate);
        self
    }

    /// The ledger after the last slot flown.
    #[must_use]
    pub fn header(&self) -> QueuesHeader {
        let flags = if self.is_over() { FLAG_END } else { 0 };
        self.field.header(SlotHeader { slot: self.slot, flags, ..SlotHeader::default() })
    }

    /// The last flown slot; 0 before the first.
    #[must_use]
    pub fn slot(&self) -> u64 {
        self.slot
    }

    /// Whether all slots are flown.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.slot == self.slots
    }

    /// The last flight; before slot 1 the UAV at its start.
    #[must_use]
    pub fn last_flight(&self) -> &FlightReport {
        &self.report
    }

    /// The field after the last slot.
    #[must_use]
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// The queues as known to the UAV after the last slot [bit], by sensor node: its estimate if it is maintained, else
    /// the true queues.
    pub fn known_bits(&mut self) -> &[u32] {
        if self.field.has_estimate() {
            return self.field.estimated_bits().unwrap_or_default();
        }
        self.field.queues_bits()
    }

    /// Flies the next slot by `plan`, or holds without one, and returns the ledger after it.
    ///
    /// # Panics
    /// Never: flight-sim serves only known sensor nodes.
    pub fn fly(&mut self, plan: Option<&Plan>) -> QueuesHeader {
        self.slot += 1;
        self.report = self.flight.step(self.slot, plan);
        self.field.step(self.slot, &self.report).expect("flight-sim serves only known sensor nodes");
        self.header()
    }
}

/// The checkpoint of a plant.
#[derive(Serialize, Deserialize)]
struct SavedPlant {
    slot: u64,
    #[serde(with = "serde_bytes")]
    report: Vec<u8>,
    #[serde(with = "serde_bytes")]
    field: Vec<u8>,
}

impl Checkpoint for Plant {
    fn save(&self, bytes: &mut Vec<u8>) {
        let mut field = Vec::new();
        self.field.save(&mut field);
        encode(&SavedPlant { slot: self.slot, report: bytes_of(&self.report).to_vec(), field }, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let SavedPlant { slot, report, field } = decode(bytes)?;
        let report: Option<FlightReport> = try_pod_read_unaligned(&report).ok();
        let report = report.filter(|_| slot <= self.slots);
        CheckpointError::ensure(report.is_some(), "a slot and a flight of the mission")?;
        let mut restored = self.field.clone();
        restored.restore(&field)?;
        CheckpointError::ensure(restored.slot() == slot, "a field after the same slot")?;
        self.field = restored;
        self.slot = slot;
        self.report = report.unwrap_or(self.report);
        self.flight.restore(&self.report);
        Ok(())
    }
}

/// A mission, as an iterator over its slots.
pub struct Mission {
    plant: Plant,
    planner: Planner,
}

/// The messages of one slot, as the processes would have published them.
#[derive(Debug, Clone, Copy)]
pub struct FlownSlot {
    /// The plan.
    pub plan: Plan,
    /// The flight.
    pub flight: FlightReport,
    /// The ledger after it.
    pub header: QueuesHeader,
}

impl Mission {
    /// The mission before slot 1.
    ///
    /// # Errors
    /// If `[planner]` of the scenario is refused; never for one that [`skysink_planner::settings::resolve`] returned.
    pub fn new(scenario: &Scenario, list: &SensorList) -> Result<Self, InputError> {
        Ok(Self { planner: Planner::new(scenario, &list.nodes())?, plant: Plant::new(scenario, list) })
    }

    /// The mission before slot 1, planned by `strategy` instead of the scenario's.
    ///
    /// # Errors
    /// As [`Mission::new`].
    pub fn with_strategy(
        scenario: &Scenario,
        list: &SensorList,
        strategy: Box<dyn Strategy>,
    ) -> Result<Self, InputError> {
        let planner = Planner::with_strategy(scenario, &list.nodes(), strategy)?;
        Ok(Self { planner, plant: Plant::new(scenario, list) })
    }

    /// Also maintains the UAV's estimate of the queues, for external planners.
    #[must_use]
    pub fn with_estimate(mut self, estimate: Estimate) -> Self {
        self.plant = self.plant.with_estimate(estimate);
        self
    }

    /// The ledger after the last slot flown.
    #[must_use]
    pub fn header(&self) -> QueuesHeader {
        self.plant.header()
    }

    /// Queue lengths [bit], by sensor node.
    #[must_use]
    pub fn queues_bits(&self) -> &[u32] {
        self.plant.field.queues_bits()
    }

    /// The last flight; before slot 1 the UAV at its start.
    #[must_use]
    pub fn last_flight(&self) -> &FlightReport {
        &self.plant.report
    }

    /// The last flown slot; 0 before the first.
    #[must_use]
    pub fn slot(&self) -> u64 {
        self.plant.slot
    }

    /// The field after the last slot.
    #[must_use]
    pub fn field(&self) -> &Field {
        &self.plant.field
    }

    /// The planner after the last slot.
    #[must_use]
    pub fn planner(&self) -> &Planner {
        &self.planner
    }

    /// Mutable access to the planner, to restore a checkpoint or to set its timing.
    pub fn planner_mut(&mut self) -> &mut Planner {
        &mut self.planner
    }

    /// Ends the mission early, between two slots or in a search, once `stop` is requested.
    pub fn set_stop(&mut self, stop: &Stop) {
        self.planner.set_stop(stop);
    }

    /// Plans the next slot from the last flight and the queues. Must be called once, before [`Mission::fly`].
    pub fn plan(&mut self) -> Plan {
        let begin = Instant::now();
        let Self { planner, plant } = self;
        planner.observe(plant.slot, &plant.report, plant.field.queues_bits());
        let mut plan = planner.step(plant.slot + 1, plant.report.position(), plant.field.queues_bits());
        plan.plan_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        plan
    }

    /// Flies the next slot by any `plan`, or holds without one, and returns the ledger after it.
    pub fn fly(&mut self, plan: Option<&Plan>) -> QueuesHeader {
        self.plant.fly(plan)
    }
}

impl Iterator for Mission {
    type Item = FlownSlot;

    /// Plans and flies the next slot; `None` after the last, and once a stop is requested.
    fn next(&mut self) -> Option<FlownSlot> {
        if self.plant.is_over() {
            return None;
        }
        let plan = self.plan();
        if self.planner.stop().requested().is_some() {
            return None; // the search may be incomplete
        }
        let header = self.fly(Some(&plan));
        Some(FlownSlot { plan, flight: self.plant.report, header })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::Mode;
    use skysink_common::scenario::Overrides;
    use skysink_planner::settings;

    /// A plant over a field with losses, and one plan for each of its first slots.
    fn plant(knowledge: Option<skysink_common::estimate::Rates>) -> (Plant, Vec<Plan>) {
        let text = "name = 'x'\nslots = 40\n[sensors]\nsampling_bps = [50.0, 900.0]\n[uav]\nmax_speed_mps = 9.0\n";
        let path = std::path::Path::new("x.toml");
        let scenario = Scenario::parse(text, path, Overrides::default()).and_then(settings::resolve).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let plans = Mission::new(&scenario, &list).unwrap().map(|flown| flown.plan).collect();
        let plant = Plant::new(&scenario, &list);
        let estimate = knowledge.map(|rates| Estimate::new(&scenario, rates, &list.nodes()));
        (estimate.into_iter().fold(plant, Plant::with_estimate), plans)
    }

    fn saved(plant: &Plant) -> Vec<u8> {
        let mut bytes = Vec::new();
        plant.save(&mut bytes);
        bytes
    }

    #[test]
    fn a_restored_plant_and_a_clone_continue_like_the_original() {
        for knowledge in [None, Some(skysink_common::estimate::Rates::Learnt)] {
            let (mut plant, plans) = plant(knowledge);
            for plan in &plans[..25] {
                plant.fly(Some(plan));
            }
            let mut clone = plant.clone();
            let (mut restored, _) = self::plant(knowledge);
            restored.restore(&saved(&plant)).unwrap();
            for plan in &plans[25..] {
                let header = plant.fly(Some(plan));
                assert!(header.totals.lost_bits > 0, "nothing to compare");
                for other in [&mut clone, &mut restored] {
                    assert_eq!(other.fly(Some(plan)), header);
                    assert!(other.last_flight() == plant.last_flight());
                    assert!(other.field().queues_bits() == plant.field().queues_bits());
                    assert!(other.known_bits() == plant.known_bits());
                }
            }
            assert!(plant.is_over() && restored.is_over());
        }
    }

    #[test]
    fn an_impossible_state_is_refused_and_changes_nothing() {
        let (mut flown, plans) = plant(None);
        flown.fly(Some(&plans[0]));
        let bytes = saved(&flown);
        let (mut plant, _) = plant(None);
        for bytes in [&bytes[..bytes.len() - 1], &[], &[&bytes[..], &[0]].concat()] {
            assert!(plant.restore(bytes).is_err());
        }
        let mut other_slot = bytes.clone();
        other_slot[0] = 2; // not the slot of the field
        assert!(plant.restore(&other_slot).is_err());
        other_slot[0] = 41; // beyond the mission
        assert!(plant.restore(&other_slot).is_err());
        assert_eq!((plant.slot(), plant.last_flight().mode), (0, Mode::Hold as u32));
    }
}
