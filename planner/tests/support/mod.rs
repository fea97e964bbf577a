//! What the tests of whole missions share: field, flight and planner together, as the ring flies them.
#![allow(dead_code)] // each test program uses its part

use std::path::Path;

use skysink_common::checkpoint::Checkpoint;
use skysink_common::message::{FlightReport, Plan, SensorNode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;
use skysink_flight_sim::Flight;
use skysink_planner::Planner;
use skysink_planner::estimate::Estimate;

/// A mission under way, as the ring flies it.
pub struct Mission {
    pub scenario: Scenario,
    pub nodes: Vec<SensorNode>,
    pub field: Field,
    pub flight: Flight,
    pub planner: Planner,
    pub report: FlightReport,
}

impl Mission {
    pub fn new(scenario: &Scenario) -> Self {
        let list = SensorList::of(scenario).unwrap();
        Self::over(scenario, &list)
    }

    pub fn over(scenario: &Scenario, list: &SensorList) -> Self {
        let nodes = list.nodes();
        let flight = Flight::new(scenario, &nodes);
        Self {
            scenario: scenario.clone(),
            field: Field::new(scenario, list),
            planner: Planner::new(scenario, &nodes).unwrap(),
            report: flight.start(),
            flight,
            nodes,
        }
    }

    /// Observes and plans as the planner's process does.
    pub fn plan(&mut self, slot: u64) -> Plan {
        let queues_bits = self.field.queues_bits();
        self.planner.observe(slot - 1, &self.report, queues_bits);
        self.planner.step(slot, self.report.position(), queues_bits)
    }

    pub fn fly(&mut self, slot: u64, plan: Option<&Plan>) {
        self.report = self.flight.step(slot, plan);
        self.field.step(slot, &self.report).unwrap();
    }

    pub fn turn(&mut self, slot: u64) -> Plan {
        let plan = self.plan(slot);
        self.fly(slot, Some(&plan));
        plan
    }

    pub fn estimate(&self) -> &Estimate {
        self.planner.estimate().unwrap()
    }

    /// Bits that SN `id` samples per slot.
    pub fn mean_bits(&self, id: u32) -> f64 {
        self.nodes[id as usize].sampling_bps * self.scenario.slot_s
    }

    /// The checkpoint of the planner.
    pub fn saved(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.planner.save(&mut bytes);
        bytes
    }

    /// A planner that knows only what the one before it has saved.
    pub fn restart(&mut self) {
        let saved = self.saved();
        self.planner = Planner::new(&self.scenario, &self.nodes).unwrap();
        self.planner.restore(&saved).unwrap();
    }

    /// Bits lost so far.
    pub fn lost_bits(&self) -> u64 {
        self.field.totals().lost_bits
    }

    /// Loss rate of the whole mission (decision D3).
    pub fn loss_rate(mut self) -> f64 {
        (1..=self.scenario.slots).for_each(|slot| {
            self.turn(slot);
        });
        let sampled_bits: f64 = (0..self.nodes.len() as u32).map(|id| self.mean_bits(id)).sum();
        self.lost_bits() as f64 / (sampled_bits * self.scenario.slots as f64)
    }
}

/// The scenario of these lines.
pub fn scenario_of(text: &str, strategy: &'static str, seed: u64) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), seed: Some(seed), slots: None };
    Scenario::parse(&format!("name = 'case'\n{text}"), Path::new("case.toml"), overrides).unwrap()
}
