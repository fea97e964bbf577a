//! The scenarios of the tests, by name: files of `scenarios/`, and texts that several tests use.

use std::fs;
use std::path::Path;

use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::settings;

/// The file of `smoke`: 60 slots of 1 s, 40 sensor nodes, some data lost.
pub const SMOKE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/smoke.toml");

/// Takes long enough in lock-step for kills: 3000 slots of 0.1 s.
const LONG: &str = "name = \"long\"\nslots = 3000\nslot_s = 0.1\n[uav]\nendurance_s = 1e8\n";

/// Short slots for many of them in a second: 3000 slots of 10 ms.
const FINE: &str = "name = \"fine\"\nslots = 3000\nslot_s = 0.01\n[link]\ncomm_s = 0.01\n";

/// Never ends: slots of 1 µs.
const ENDLESS: &str = "name = \"endless\"\nslots = 100000000\nslot_s = 1e-6\n[link]\ncomm_s = 1e-6\n";

/// For paced runs: 160 slots of 0.5 s.
const PACED: &str = "name = \"paced\"\nslots = 160\nslot_s = 0.5\n";

/// A field of 60 sensor nodes in which strategies differ: 250 slots of 1 s.
const SMALL: &str = "name = \"small\"\nslots = 250\n[area]\nside_m = 200.0\n[sensors]\ncount = 60\n";

/// All defaults: the mission of `letter`, whose file has every key.
const SHORT: &str = "name = \"short\"\n";

/// The text of a scenario: one of those above, or a file of `scenarios/`.
pub fn text(name: &str) -> String {
    match name {
        "long" => LONG.to_owned(),
        "fine" => FINE.to_owned(),
        "endless" => ENDLESS.to_owned(),
        "paced" => PACED.to_owned(),
        "small" => SMALL.to_owned(),
        "short" => SHORT.to_owned(),
        _ => {
            let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenarios/{name}.toml"));
            fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()))
        }
    }
}

/// A scenario file as the executables read it, with its strategy's settings.
pub fn read(file: &Path, overrides: Overrides) -> Scenario {
    Scenario::read(file, overrides).and_then(settings::resolve).unwrap()
}

/// `smoke`, flown by this strategy.
pub fn smoke(strategy: &'static str) -> Scenario {
    read(Path::new(SMOKE), Overrides { strategy: Some(strategy), ..Overrides::default() })
}

/// The same, with its sensor nodes.
pub fn smoke_with_sensors(strategy: &'static str) -> (Scenario, SensorList) {
    let scenario = smoke(strategy);
    let list = SensorList::of(&scenario).unwrap();
    (scenario, list)
}
