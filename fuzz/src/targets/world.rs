//! The small scenarios in which messages, lists and journals are tried.

use skysink_planner::strategies::horizon::{self, HorizonKeys};
use skysink_planner::strategies::offline::{self, OfflineKeys};
use std::path::Path;
use std::sync::LazyLock;

use skysink_common::message::SensorNode;
use skysink_common::scenario::{Count, Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::settings::{self, Knowledge, Rates, Settings};

/// The letter's channel over ten sensor nodes.
const FREE_SPACE: &str = "name = \"free\"\nslots = 20\n[area]\nside_m = 60.0\n[sensors]\ncount = 10\n\
    initial_queue_mean_bits = 25000.0\n[link]\ncomm_radius_m = 12.0\nresource_blocks = 3\n";

/// The same on the Earth, with a gain that is redrawn.
const ORIGIN: &str = "name = \"origin\"\nslots = 20\n[area]\nwidth_m = 80.0\nheight_m = 50.0\n\
    origin_lat_deg = 41.65\norigin_lon_deg = -87.81\n[sensors]\ncount = 10\n[link]\ngain = \"per-slot\"\n";

/// Line of sight by chance, at an altitude that is chosen.
const LINE_OF_SIGHT: &str = "name = \"los\"\nslots = 20\n[area]\nside_m = 200.0\n[sensors]\ncount = 10\n\
    [uav]\naltitude = \"free\"\naltitude_m = 50.0\n[link]\nmodel = \"probabilistic-los\"\nbandwidth_hz = 5e3\n\
    comm_radius_m = 60.0\nresource_blocks = 3\n";

/// A scenario and its sensor nodes.
#[derive(Debug)]
pub(super) struct World {
    pub scenario: Scenario,
    pub list: SensorList,
    /// The same as they are published.
    pub nodes: Vec<SensorNode>,
}

/// All of them, the letter's channel first.
pub(super) static WORLDS: LazyLock<[World; 3]> = LazyLock::new(|| [FREE_SPACE, ORIGIN, LINE_OF_SIGHT].map(world));

/// What a planner may know.
pub(super) const SEEN: [(Knowledge, Rates); 3] =
    [(Knowledge::Oracle, Rates::Known), (Knowledge::Estimated, Rates::Known), (Knowledge::Estimated, Rates::Learnt)];

/// A scenario by `strategy`, with short searches.
pub(super) fn planned(scenario: &Scenario, strategy: &'static str, (knowledge, rates): (Knowledge, Rates)) -> Scenario {
    let mut scenario = scenario.clone();
    strategy.clone_into(&mut scenario.planner.strategy);
    horizon::STRATEGY.set_keys(&mut scenario, HorizonKeys { iterations: Count::clamped(20), budget_ms: None });
    offline::STRATEGY.set_keys(&mut scenario, OfflineKeys { steps: Count::clamped(200) });
    let change = |settings: &mut Settings| (settings.knowledge, settings.rates) = (knowledge, rates);
    settings::change(scenario, change).expect("any of these may be chosen")
}

fn world(text: &str) -> World {
    let scenario = Scenario::parse(text, Path::new("world.toml"), Overrides::default());
    let scenario = scenario.expect("the scenarios above are valid");
    let list = SensorList::of(&scenario).expect("its sensor nodes are drawn, not read");
    let nodes = list.nodes();
    World { scenario, list, nodes }
}
