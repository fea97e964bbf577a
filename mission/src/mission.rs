//! A mission in one process: a plant and its planner.

use skysink_common::error::InputError;
use skysink_common::message::{Plan, QueuesHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{SlotRecord, UAV};
use skysink_common::stop::Stop;
use skysink_planner::FleetPlanner;
use skysink_planner::strategy::MakeStrategy;

use crate::drive::{End, Observer, drive, plan_next, step};
use crate::error::MissionError;
use crate::plant::Plant;

/// A mission, as an iterator over its slots.
///
/// ```
/// use skysink_common::{scenario::Scenario, sensors::SensorList};
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let mission = skysink_mission::Mission::new(&scenario, &SensorList::of(&scenario).unwrap()).unwrap();
/// let totals = mission.last().unwrap().header.totals;
/// assert!(totals.is_balanced() && totals.delivered_bits > totals.lost_bits);
/// ```
pub struct Mission {
    plant: Plant,
    /// The planner after the last slot.
    pub planner: FleetPlanner,
}

/// ```
/// use skysink_common::{scenario::Scenario, sensors::SensorList, stop::Stop};
/// use skysink_mission::{Mission, drive::End};
/// use skysink_planner::strategy::rule;
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let list = SensorList::of(&scenario).unwrap();
/// let mut mission = Mission::until(&scenario, &list, &Stop::default()).unwrap();
/// assert_eq!(mission.plant().flight(0).position(), scenario.start());
/// let plan = mission.plan();
/// assert_eq!(mission.fly(Some(&plan)).flights()[0].position(), plan.waypoint());
/// assert_eq!((mission.slot(), mission.drive(&mut [], &Stop::default()).unwrap()), (1, End::Complete));
///
/// let mut transit = Mission::by(&scenario, &list, &mut |_| Ok(rule(|_| None)), &Stop::default()).unwrap();
/// transit.drive(&mut [], &Stop::default()).unwrap();
/// assert!(transit.header().totals.delivered_bits < mission.header().totals.delivered_bits);
/// ```
impl Mission {
    /// The mission before slot 1.
    ///
    /// # Errors
    /// If `[planner]` of the scenario is refused; never for one that [`skysink_planner::settings::resolve`] returned.
    pub fn new(scenario: &Scenario, list: &SensorList) -> Result<Self, InputError> {
        Self::until(scenario, list, &Stop::default())
    }

    /// The mission before slot 1. `stop` ends its long preparations, after which it flies nothing, and the iterator.
    ///
    /// # Errors
    /// As [`Mission::new`].
    pub fn until(scenario: &Scenario, list: &SensorList, stop: &Stop) -> Result<Self, InputError> {
        Ok(Self { planner: FleetPlanner::until(scenario, &list.nodes(), stop)?, plant: Plant::new(scenario, list) })
    }

    /// The mission with the strategies that `make` makes, one for each UAV, instead of the scenario's.
    ///
    /// # Errors
    /// As [`Mission::new`], and those of `make`.
    pub fn by(
        scenario: &Scenario,
        list: &SensorList,
        make: &mut MakeStrategy<'_>,
        stop: &Stop,
    ) -> Result<Self, InputError> {
        let planner = FleetPlanner::by(scenario, &list.nodes(), make, stop)?;
        Ok(Self { planner, plant: Plant::new(scenario, list) })
    }

    /// The plant after the last slot.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The ledger after the last slot.
    pub fn header(&self) -> QueuesHeader {
        self.plant.header()
    }

    /// The last flown slot; 0 before the first.
    pub fn slot(&self) -> u64 {
        self.plant.slot()
    }

    /// Drives the mission to its end, or until `stop`, which also ends a search.
    ///
    /// # Errors
    /// If an observer fails, or the waypoint of a strategy has NaN or infinity.
    pub fn drive(&mut self, observers: &mut [&mut dyn Observer], stop: &Stop) -> Result<End, MissionError> {
        self.planner.set_stop(stop);
        drive(&mut self.plant, &mut self.planner, observers, stop)
    }

    /// Plans the next slot of the only UAV. Must be called once, before [`Mission::fly`].
    pub fn plan(&mut self) -> Plan {
        plan_next(&mut self.planner, &self.plant)[UAV]
    }

    /// Flies the next slot of the only UAV by any `plan`, or holds without one.
    pub fn fly(&mut self, plan: Option<&Plan>) -> &SlotRecord {
        self.plant.step(&[plan.copied()])
    }
}

impl Iterator for Mission {
    type Item = SlotRecord;

    /// Plans and flies the next slot; `None` after the last, once a stop is requested, and at a waypoint with NaN,
    /// where [`Mission::drive`] fails.
    fn next(&mut self) -> Option<SlotRecord> {
        let stop = self.planner.stop().clone();
        step(&mut self.plant, &mut self.planner, &stop).ok()?;
        Some(self.plant.record().clone())
    }
}
