//! The small scenarios in which messages, lists and journals are tried.

use std::path::Path;
use std::sync::LazyLock;

use skysink_common::message::SensorNode;
use skysink_common::scenario::{Count, Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::settings::{self, Knowledge, Rates, Settings};
use skysink_planner::strategies::horizon::{self, HorizonKeys};
use skysink_planner::strategies::offline::{self, OfflineKeys};

/// A scenario and its sensor nodes, also as they are published.
#[derive(Debug)]
pub struct World {
    pub scenario: Scenario,
    pub list: SensorList,
    pub nodes: Vec<SensorNode>,
}

/// All of them.
pub static WORLDS: LazyLock<[World; 3]> = LazyLock::new(|| {
    let free_space = include_str!("../worlds/free-space.toml");
    let texts = [free_space, include_str!("../worlds/origin.toml"), include_str!("../worlds/line-of-sight.toml")];
    texts.map(|text| {
        let scenario = Scenario::parse(text, Path::new("worlds"), Overrides::default()).expect("a valid scenario");
        let list = SensorList::of(&scenario).expect("its sensor nodes are drawn, not read");
        let nodes = list.nodes();
        World { scenario, list, nodes }
    })
});

/// What a planner may know.
pub const SEEN: [(Knowledge, Rates); 3] =
    [(Knowledge::Oracle, Rates::Known), (Knowledge::Estimated, Rates::Known), (Knowledge::Estimated, Rates::Learnt)];

/// A scenario by `strategy`, with short searches.
pub fn planned(scenario: &Scenario, strategy: &'static str, (knowledge, rates): (Knowledge, Rates)) -> Scenario {
    let mut scenario = scenario.clone();
    strategy.clone_into(&mut scenario.planner.strategy);
    horizon::STRATEGY.set_keys(&mut scenario, HorizonKeys { iterations: Count::clamped(20), budget_ms: None });
    offline::STRATEGY.set_keys(&mut scenario, OfflineKeys { steps: Count::clamped(200) });
    let change = |settings: &mut Settings| (settings.knowledge, settings.rates) = (knowledge, rates);
    settings::change(scenario, change).expect("any of these may be chosen")
}
