//! The plant: the field and the UAVs of a mission, by the same steps as the executables.

use serde::{Deserialize, Serialize};
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::message::{FLAG_END, FlightReport, HeardLink, PathPoint, Plan, QueuesHeader, SlotHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, SlotRecord};
use skysink_common::told::{Received, Sensed};
use skysink_field_sim::Field;
use skysink_flight_sim::{Fleet, Orders};

/// What planners control: the field and the UAVs of a mission. Clones are independent.
#[derive(Debug, Clone)]
pub struct Plant {
    field: Field,
    fleet: Fleet,
    slots: u64,
    /// The last slot. It is not passed on by value: flight reports are large.
    record: SlotRecord,
}

impl Plant {
    /// The field and the UAVs before slot 1.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        let nodes = list.nodes();
        let fleet = Fleet::new(scenario, &nodes);
        let field = Field::new(scenario, list);
        let header = field.header(slot_header(0, scenario.slots));
        let record = SlotRecord::unplanned(fleet.start(), header);
        Self { field, fleet, slots: scenario.slots, record }
    }

    /// The plant with what the UAV believes before slot 1, for external planners, instead of known queues.
    #[must_use]
    pub fn with_belief(self, belief: Belief) -> Self {
        Self { field: self.field.with_belief(belief), ..self }
    }

    /// What the last slot left; before slot 1 no plans, and the UAVs at their starts.
    pub fn record(&self) -> &SlotRecord {
        &self.record
    }

    /// The ledger after the last slot flown.
    pub fn header(&self) -> QueuesHeader {
        self.record.header
    }

    /// The last flown slot; 0 before the first.
    pub fn slot(&self) -> u64 {
        self.record.slot()
    }

    /// Whether all slots are flown.
    pub fn is_over(&self) -> bool {
        self.slot() == self.slots
    }

    /// The last flight of each UAV; before slot 1 the UAV at its start.
    pub fn flights(&self) -> &ByUav<FlightReport> {
        self.record.flights()
    }

    /// The last flight of the UAV number `uav`; before slot 1 the UAV at its start.
    ///
    /// # Panics
    /// If there is no such UAV.
    pub fn flight(&self, uav: usize) -> &FlightReport {
        &self.record.flights()[uav]
    }

    /// What the UAVs hear after the last slot, by UAV and sensor node; nothing without `link.beacon_radius_m`.
    pub fn heard_links(&self) -> Vec<HeardLink> {
        self.fleet.hear(self.slot(), self.flights())
    }

    /// What the UAVs receive after the last slot beside queues and answers.
    pub fn received(&self) -> Received<'static> {
        Received { links: self.heard_links().into() }
    }

    /// What the UAVs sense after the last slot, with what they have [`received`](Self::received).
    pub fn sensed<'a>(&'a self, received: &'a Received<'a>) -> Sensed<'a> {
        Sensed { slot: self.slot(), flights: self.flights(), told: self.field.told(), received }
    }

    /// The field after the last slot.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Flies the next slot by the plan of each UAV; a UAV without one holds its position. The paths of the record are
    /// empty.
    ///
    /// # Panics
    /// If there is not one entry for each UAV.
    pub fn step(&mut self, plans: &[Option<Plan>]) -> &SlotRecord {
        let slot = self.slot() + 1;
        self.fleet.step(slot, |uav| plans[uav].as_ref(), self.record.begin(plans));
        self.end_slot(slot)
    }

    /// Flies the next slot by `orders`: plans as [`Self::step`] does, or flights that another flight-sim has reported.
    ///
    /// # Panics
    /// If there is not one for each UAV.
    pub fn fly(&mut self, orders: &Orders) -> &SlotRecord {
        let slot = self.slot() + 1;
        self.fleet.fly(slot, orders, self.record.begin(&orders.plans()));
        self.end_slot(slot)
    }

    /// Advances the field by the flights of a slot.
    fn end_slot(&mut self, slot: u64) -> &SlotRecord {
        let record = &mut self.record;
        self.field.step(slot, record.flights()).expect("flight-sim serves only known sensor nodes");
        record.header = self.field.header(slot_header(slot, self.slots));
        record
    }

    /// Adds the path that the last plan of the UAV number `uav` belongs to, for the observers.
    pub(crate) fn add_path(&mut self, uav: usize, path: impl Iterator<Item = PathPoint>) {
        self.record.add_path(uav, path);
    }
}

/// The header of a slot of a mission of `slots` slots.
fn slot_header(slot: u64, slots: u64) -> SlotHeader {
    SlotHeader { slot, flags: if slot == slots { FLAG_END } else { 0 }, ..SlotHeader::default() }
}

/// The checkpoint of a plant.
#[derive(Serialize, Deserialize)]
struct SavedPlant {
    slot: u64,
    #[serde(with = "serde_bytes")]
    flights: Vec<u8>,
    #[serde(with = "serde_bytes")]
    field: Vec<u8>,
}

impl Checkpoint for Plant {
    fn save(&self, bytes: &mut Vec<u8>) {
        let mut flights = Vec::new();
        let mut field = Vec::new();
        self.record.flights().save(&mut flights);
        self.field.save(&mut field);
        encode(&SavedPlant { slot: self.slot(), flights, field }, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let SavedPlant { slot, flights, field } = decode(bytes)?;
        CheckpointError::ensure(slot <= self.slots, "a slot of the mission")?;
        let mut flown = self.record.flights().clone();
        flown.restore(&flights)?;
        let mut restored = self.field.clone();
        restored.restore(&field)?;
        CheckpointError::ensure(restored.slot() == slot, "a field after the same slot")?;
        self.fleet.restore(&flown);
        let header = restored.header(slot_header(slot, self.slots));
        self.field = restored;
        self.record = SlotRecord::unplanned(flown, header);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mission;
    use skysink_common::estimate::Rates;
    use skysink_common::message::Mode;
    use skysink_common::scenario::Overrides;
    use skysink_common::slot_record::{Plans, UAV};
    use skysink_planner::settings;

    /// A plant over a field with losses, and the plans of its slots.
    fn plant(knowledge: Option<Rates>) -> (Plant, Vec<Plans>) {
        let text = "name = 'x'\nslots = 40\n[sensors]\nsampling_bps = [50.0, 900.0]\n[uav]\nmax_speed_mps = 9.0\n";
        let path = std::path::Path::new("x.toml");
        let scenario = Scenario::parse(text, path, Overrides::default()).and_then(settings::resolve).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let plans = Mission::new(&scenario, &list).unwrap().map(|record| record.plans().clone()).collect();
        (Plant::new(&scenario, &list).with_belief(Belief::of(&scenario, &list, knowledge)), plans)
    }

    fn saved(plant: &Plant) -> Vec<u8> {
        let mut bytes = Vec::new();
        plant.save(&mut bytes);
        bytes
    }

    #[test]
    fn a_restored_plant_and_a_clone_continue_like_the_original() {
        for knowledge in [None, Some(Rates::Learnt)] {
            let (mut plant, plans) = plant(knowledge);
            for plans in &plans[..25] {
                plant.step(plans);
            }
            let mut clone = plant.clone();
            let (mut restored, _) = self::plant(knowledge);
            restored.restore(&saved(&plant)).unwrap();
            for plans in &plans[25..] {
                plant.step(plans);
                let record = plant.record();
                assert!(record.header.totals.lost_bits > 0, "nothing to compare");
                for other in [&mut clone, &mut restored] {
                    assert_eq!(other.step(plans).header, record.header);
                    assert!(other.flights() == plant.flights());
                    assert!(other.field().queues_bits() == plant.field().queues_bits());
                    assert!(other.field().believed_bits() == plant.field().believed_bits());
                }
            }
            assert!(plant.is_over() && restored.is_over());
        }
    }

    #[test]
    fn an_impossible_state_is_refused_and_changes_nothing() {
        let (mut flown, plans) = plant(None);
        flown.step(&plans[0]);
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
        assert_eq!((plant.slot(), plant.flight(UAV).mode), (0, Mode::Hold as u32));
    }
}
