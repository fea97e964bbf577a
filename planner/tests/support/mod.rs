//! What the tests of whole missions share: field, flight and planner together, as the ring flies them.
#![allow(dead_code)] // each test program uses its part

use std::ops::{Deref, DerefMut};
use std::path::Path;

use skysink_common::belief::Belief;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::estimate::Estimate;
use skysink_common::message::{FlightReport, Plan, SensorNode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_mission::Mission;
use skysink_planner::Planner;

/// A mission in progress, with the queries of its tests.
pub struct TestMission {
    pub scenario: Scenario,
    pub nodes: Vec<SensorNode>,
    mission: Mission,
}

impl Deref for TestMission {
    type Target = Mission;

    fn deref(&self) -> &Mission {
        &self.mission
    }
}

impl DerefMut for TestMission {
    fn deref_mut(&mut self) -> &mut Mission {
        &mut self.mission
    }
}

impl TestMission {
    pub fn new(scenario: &Scenario) -> Self {
        Self::over(scenario, &SensorList::of(scenario).unwrap())
    }

    pub fn over(scenario: &Scenario, list: &SensorList) -> Self {
        let mission = Mission::new(scenario, list).unwrap();
        Self { scenario: scenario.clone(), nodes: list.nodes(), mission }
    }

    /// The plan of the next slot, without the time that it took.
    pub fn plan(&mut self) -> Plan {
        Plan { plan_ns: 0, ..self.mission.plan() }
    }

    /// The last flight.
    pub fn last_flight(&self) -> &FlightReport {
        self.plant().flight(UAV)
    }

    /// Queue lengths [bit], by id.
    pub fn queues_bits(&self) -> &[u32] {
        self.plant().field().queues_bits()
    }

    /// Plans and flies the next slot.
    pub fn advance(&mut self) -> Plan {
        let plan = self.plan();
        self.fly(Some(&plan));
        plan
    }

    pub fn estimate(&self) -> &Estimate {
        match self.planner.belief() {
            Belief::Estimated(estimate) => estimate,
            Belief::Known => panic!("the queues are known"),
        }
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
        self.planner = Planner::new(&self.scenario, &self.nodes).unwrap().into();
        self.planner.restore(&saved).unwrap();
    }

    /// Bits lost so far.
    pub fn lost_bits(&self) -> u64 {
        self.plant().field().totals().lost_bits
    }

    /// Loss rate of the whole mission (decision D3).
    pub fn loss_rate(mut self) -> f64 {
        self.mission.by_ref().for_each(drop);
        let sampled_bits: f64 = (0..self.nodes.len() as u32).map(|id| self.mean_bits(id)).sum();
        self.lost_bits() as f64 / (sampled_bits * self.scenario.slots as f64)
    }
}

/// The scenario of these lines.
pub fn scenario_of(text: &str, strategy: &'static str, seed: u64) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), seed: Some(seed), ..Overrides::default() };
    Scenario::parse(&format!("name = 'case'\n{text}"), Path::new("case.toml"), overrides).unwrap()
}
