//! The round trip as plain calls: a whole mission in one process, by the same steps as the executables.

use std::time::Instant;

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

/// A mission under way, as an iterator over its slots.
pub struct Mission {
    field: Field,
    planner: Planner,
    flight: Flight,
    slot: u64,
    slots: u64,
    report: FlightReport,
}

/// What one slot was, as the processes would have published it.
#[derive(Debug, Clone, Copy)]
pub struct FlownSlot {
    /// The schedule and the waypoint.
    pub plan: Plan,
    /// What was flown.
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
        let nodes = list.nodes();
        let flight = Flight::new(scenario, &nodes);
        Ok(Self {
            field: Field::new(scenario, list),
            planner: Planner::new(scenario, &nodes)?,
            report: flight.start(),
            flight,
            slot: 0,
            slots: scenario.slots,
        })
    }

    /// The mission before slot 1, planned by `strategy`, whatever the scenario names.
    ///
    /// # Errors
    /// As [`Mission::new`].
    pub fn with_strategy(
        scenario: &Scenario,
        list: &SensorList,
        strategy: Box<dyn Strategy>,
    ) -> Result<Self, InputError> {
        let planner = Planner::with_strategy(scenario, &list.nodes(), strategy)?;
        Ok(Self { planner, ..Self::new(scenario, list)? })
    }

    /// The mission before slot 1 with an account of what the UAV knows of the queues, for planners that are not
    /// Skysink's.
    #[must_use]
    pub fn telling(mut self, estimate: Estimate) -> Self {
        self.field = self.field.telling(estimate);
        self
    }

    /// The ledger after the last slot flown.
    #[must_use]
    pub fn header(&self) -> QueuesHeader {
        let flags = if self.slot == self.slots { FLAG_END } else { 0 };
        self.field.header(SlotHeader { slot: self.slot, flags, ..SlotHeader::default() })
    }

    /// Queue lengths [bit], by sensor node.
    #[must_use]
    pub fn queues_bits(&self) -> &[u32] {
        self.field.queues_bits()
    }

    /// The last flight; before slot 1 the UAV at its start.
    #[must_use]
    pub fn last_flight(&self) -> &FlightReport {
        &self.report
    }

    /// The last slot flown; 0 before the first.
    #[must_use]
    pub fn slot(&self) -> u64 {
        self.slot
    }

    /// The field after the last slot.
    #[must_use]
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// The planner after the last slot.
    #[must_use]
    pub fn planner(&self) -> &Planner {
        &self.planner
    }

    /// The planner, to restore a checkpoint or to set its timing before the next slot.
    pub fn planner_mut(&mut self) -> &mut Planner {
        &mut self.planner
    }

    /// Has the mission end early, between two slots or in a search before one, once `stop` is requested.
    pub fn set_stop(&mut self, stop: &Stop) {
        self.planner.set_stop(stop);
    }

    /// Plans the next slot, from the flight and the queues after the last; to be done once, before [`Mission::fly`].
    pub fn plan(&mut self) -> Plan {
        let begin = Instant::now();
        self.planner.observe(self.slot, &self.report, self.field.queues_bits());
        let mut plan = self.planner.step(self.slot + 1, self.report.position(), self.field.queues_bits());
        plan.plan_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        plan
    }

    /// Flies the next slot by a plan, whoever made it, or holds where there is none, and returns the ledger after it.
    pub fn fly(&mut self, plan: Option<&Plan>) -> QueuesHeader {
        self.slot += 1;
        self.report = self.flight.step(self.slot, plan);
        self.field.step(self.slot, &self.report).expect("flight-sim serves known sensor nodes alone");
        self.header()
    }
}

impl Iterator for Mission {
    type Item = FlownSlot;

    /// Flies the next slot: plan, fly, account. `None` after the last, and once a stop is requested.
    fn next(&mut self) -> Option<FlownSlot> {
        if self.slot == self.slots {
            return None;
        }
        let plan = self.plan();
        if self.planner.stop().requested().is_some() {
            return None; // the plan may be cut short
        }
        let header = self.fly(Some(&plan));
        Some(FlownSlot { plan, flight: self.report, header })
    }
}
