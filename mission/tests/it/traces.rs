//! Traces that a redesign must keep: the hashes of missions by strategy and model, in `traces.txt`.
//!
//! After a change that is meant to change them: `UPDATE_EXPECT=1 cargo test -p skysink-mission --test it traces`.

use std::path::Path;

use crate::support::scenario_of;
use rayon::prelude::*;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_mission::trace::TraceHash;

/// A name, a strategy, and keys of `[planner]`.
type Strategy = (&'static str, &'static str, &'static str);

/// A name, keys before the first table, and keys of `[area]`.
type Model = (&'static str, &'static [&'static str], &'static str);

/// The strategies, with an objective of their own.
const STRATEGIES: [Strategy; 7] = [
    ("gfs", "gfs", ""),
    ("edf", "edf", ""),
    ("mes", "mes", ""),
    ("tour", "tour", ""),
    ("horizon", "horizon", ""),
    ("offline", "offline", ""),
    ("collect", "horizon", "objective = 'collect'\n"),
];

/// Objectives of the planners that look ahead, over SNs with batteries and a deadline.
const OBJECTIVES: [Strategy; 8] = [
    ("horizon, age", "horizon", "objective = 'age'\n"),
    ("offline, age", "offline", "objective = 'age'\n"),
    ("horizon, peak age", "horizon", "objective = 'peak-age'\n"),
    ("offline, peak age", "offline", "objective = 'peak-age'\n"),
    ("horizon, deadline", "horizon", "objective = 'deadline'\n"),
    ("offline, deadline", "offline", "objective = 'deadline'\n"),
    ("horizon, sum", "horizon", "objective = { loss = 1.0, age = 0.2 }\n"),
    ("offline, sum", "offline", "objective = { loss = 1.0, age = 0.2 }\n"),
];

/// No-fly zones: a wall, and a hook.
const ZONES: &str = "no_fly = [{ polygon_m = [[70, 40], [90, 40], [90, 160], [70, 160]] }, \
                     { polygon_m = [[120, 60], [180, 60], [180, 80], [140, 80], [140, 130], [120, 130]] }]\n";

/// A battery that has to be charged, and a base where the UAV has to land.
const BATTERY: &str =
    "base.radius_m = 10.0\nbase.charge_w = 2000.0\nuav.battery.capacity_j = 12000.0\nuav.must_land = true\n";

/// Two bases, one with a charger and one pad, the other with a swap of batteries.
const SITES: &str = "uav.battery.capacity_j = 9000.0\nuav.must_land = true\nuav.starts_m = [[50, 100], [150, 100], [55, 100]]\n\
                     base.site = [{ position_m = [50, 100], radius_m = 10.0, charge_w = 1000.0, pads = 1 }, \
                     { area_m = [[140, 90], [160, 90], [160, 110], [140, 110]], swap_s = 4.0, pads = 1 }]\n";

/// SNs whose batteries last for some 40 slots.
const NODE_ENERGY: &str = "sensors.energy.capacity_j = 2.0\nsensors.energy.sleep_w = 0.01\nsensors.energy.harvest_w = 0.005\n\
                           sensors.energy.sample_j_per_bit = 8e-5\nsensors.energy.wake = 'scheduled'\n\
                           sensors.energy.listen_w = 0.05\nsensors.energy.tx_w = 50.0\n";

/// Links so narrow that SNs use up their duty cycle, and that the setup of a contact counts.
const DUTY_CYCLE: &str = "link.bandwidth_hz = 2e3\nlink.duty_cycle = 1e-4\nlink.duty_window_s = 40.0\nlink.setup_s = 0.02\n\
                          link.sharing = 'equal'\n";

/// Several UAVs that keep apart.
const FLEET: &str = "uav.count = 3\nuav.separation_m = 5.0\n";

/// The models.
const MODELS: [Model; 19] = [
    ("open", &[], ""),
    ("battery", &[BATTERY], ""),
    ("zones", &[], ZONES),
    ("zones and battery", &[BATTERY], ZONES),
    ("grid", &["uav.moves = 'grid'\nuav.cell_m = 20.0\nuav.max_speed_mps = 20.0\n"], ZONES),
    (
        "grid of four slots a move, battery",
        &[
            "uav.moves = 'grid'\nuav.cell_m = 20.0\nuav.max_speed_mps = 5.0\nbase.areas_m = [[[80, 0], [120, 0], [120, 30], [80, 30]]]\n\
         uav.start_m = [90, 10]\nbase.charge_w = 2000.0\nuav.battery.capacity_j = 12000.0\nuav.must_land = true\n",
        ],
        "",
    ),
    ("estimated", &["planner.knowledge = 'estimated'\nplanner.rates = 'learnt'\n"], ""),
    ("fleet", &[FLEET], ""),
    ("fleet, zones and battery", &[FLEET, BATTERY], ZONES),
    ("fleet, sites with pads", &[FLEET, SITES], ""),
    (
        "line of sight, free altitude",
        &[
            "uav.altitude = 'free'\nuav.altitude_m = 50.0\nlink.model = 'probabilistic-los'\nlink.environment = 'dense-urban'\n\
           link.bandwidth_hz = 5e3\nlink.noise_dbm = -109.0\nlink.comm_radius_m = 60.0\n",
        ],
        "",
    ),
    ("expiry", &["sensors.expiry_s = 25.0\n"], ""),
    (
        "expiry, oldest, estimated",
        &["sensors.expiry_s = 25.0\nsensors.overflow = 'oldest'\nplanner.knowledge = 'estimated'\n"],
        "",
    ),
    ("node energy", &[NODE_ENERGY], ""),
    (
        "node energy, estimated, learnt",
        &[NODE_ENERGY, "planner.knowledge = 'estimated'\nplanner.rates = 'learnt'\n"],
        "",
    ),
    ("node energy, expiry", &[NODE_ENERGY, "sensors.expiry_s = 25.0\n"], ""),
    ("duty cycle, time of contacts", &[DUTY_CYCLE], ""),
    (
        "links by place",
        &[
            "link.model = 'map'\nlink.residual_db = 3.0\nlink.residual_m = 40.0\n",
            concat!("link.file = '", env!("CARGO_MANIFEST_DIR"), "/tests/it/links.csv'\n"),
            concat!("link.rates = '", env!("CARGO_MANIFEST_DIR"), "/tests/it/rates.csv'\n"),
        ],
        "",
    ),
    (
        "links by their law, fleet",
        &[
            FLEET,
            "link.model = 'map'\nlink.residual_db = 3.0\nlink.residual_m = 40.0\nlink.law_snr_db = 45.0\n",
            concat!("link.file = '", env!("CARGO_MANIFEST_DIR"), "/tests/it/links.csv'\n"),
            concat!("link.rates = '", env!("CARGO_MANIFEST_DIR"), "/tests/it/rates.csv'\n"),
            "link.beacon_radius_m = 50.0\nplanner.links = 'law'\n",
        ],
        "",
    ),
];

/// The scenario of a strategy with a model.
fn text((_, _, planner): Strategy, (_, keys, area): Model) -> String {
    let keys = keys.concat();
    let slots = if keys.contains("battery") || keys.contains("energy") { 80 } else { 40 }; // until it is empty
    format!(
        "name = 'trace'\nseed = 5\nslots = {slots}\narea.side_m = 200.0\n{}sensors.count = 60\n\
         sensors.sampling_bps = [100.0, 900.0]\nplanner.horizon.iterations = 200\nplanner.offline.steps = 4000\n{}{}",
        area.lines().map(|line| format!("area.{line}\n")).collect::<String>(),
        keys,
        planner.lines().map(|line| format!("planner.{line}\n")).collect::<String>(),
    )
}

/// The loss and the hash of a mission, in a line.
fn line(strategy: Strategy, model: Model, coordination: &str) -> String {
    let keys = if coordination.is_empty() { String::new() } else { format!("uav.coordination = '{coordination}'\n") };
    let scenario = scenario_of(&(text(strategy, model) + &keys), strategy.1);
    let mut mission = Mission::new(&scenario, &SensorList::of(&scenario).unwrap()).unwrap();
    let mut hash = TraceHash::default();
    mission.drive(&mut [&mut hash], &Stop::default()).unwrap();
    let coordination = if coordination.is_empty() { String::new() } else { format!(" {coordination}") };
    format!(
        "{:016x} {:>8} {} | {}{coordination}\n",
        hash.value(),
        mission.header().totals.lost_bits,
        strategy.0,
        model.0
    )
}

/// The other strategies, the objectives, links that carry little, and a fleet that lands in one base, over few models
/// each.
fn further() -> impl Iterator<Item = (Strategy, Model, &'static str)> {
    const ENERGY: Model = ("node energy, deadline", &[NODE_ENERGY, "sensors.deadline_s = 20.0\n"], "");
    const NARROW: Model = ("narrow link", &["link.bandwidth_hz = 2e3\nlink.resource_blocks = 2\n"], "");
    const LANDING: Model = ("fleet that lands", &[FLEET, "base.radius_m = 10.0\nuav.must_land = true\n"], "");
    let is_further = |name: &&str| STRATEGIES.iter().all(|(_, strategy, _)| strategy != name);
    let others = skysink_planner::strategies::names().into_iter().filter(is_further).map(|name| (name, name, ""));
    let others: Vec<Strategy> = others.collect();
    let all = others.iter().copied().chain(STRATEGIES);
    let narrow: Vec<_> = all.map(|strategy| (strategy, NARROW, "")).collect();
    let landing = STRATEGIES.map(|strategy| (strategy, LANDING, "sequential"));
    let open = others.into_iter().map(|strategy| (strategy, MODELS[0], ""));
    open.chain(OBJECTIVES.map(|strategy| (strategy, ENERGY, ""))).chain(narrow).chain(landing)
}

#[test]
fn traces_are_the_recorded_ones() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/traces.txt");
    let cases: Vec<_> = MODELS
        .iter()
        .flat_map(|&model| {
            let fleets = ["sequential", "partition", "independent"].as_slice();
            let coordinations = if model.0.starts_with("fleet") { fleets } else { &[""] };
            let strategies = move |coordination| STRATEGIES.map(|strategy| (strategy, model, coordination));
            coordinations.iter().flat_map(move |coordination| strategies(*coordination))
        })
        .chain(further())
        .collect();
    let lines = cases.into_par_iter().map(|(strategy, model, coordination)| line(strategy, model, coordination));
    let found: String = lines.collect::<Vec<_>>().concat();
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(path, found).unwrap();
        return;
    }
    let expected = std::fs::read_to_string(path).unwrap();
    let differing: Vec<_> = found.lines().zip(expected.lines()).filter(|(found, expected)| found != expected).collect();
    assert!(
        differing.is_empty() && found.lines().count() == expected.lines().count(),
        "(found, expected): {differing:#?}"
    );
}
