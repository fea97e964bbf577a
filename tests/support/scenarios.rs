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

/// Sensor nodes of [`list`].
const LISTED: &str = "name = 'listed'\nslots = 60\n[sensors]\nfile = 'list.csv'\n";

/// A base and a zone between it and sensor nodes; the battery is charged within 80 slots.
const HOME: &str = "name = 'home'\nslots = 80\n[area]\nside_m = 400.0\n\
    no_fly = [{ polygon_m = [[230, 100], [260, 100], [260, 300], [230, 300]] }]\n[base]\ncharge_w = 500.0\n\
    [uav]\nmust_land = true\n[uav.battery]\ncapacity_j = 9000.0\n";

/// Three UAVs with position errors.
const FLEET: &str = "name = 'fleet'\nslots = 60\n[area]\nside_m = 250.0\norigin_lat_deg = 47.0\norigin_lon_deg = 8.0\n\
    [sensors]\ncount = 60\nsampling_bps = [100.0, 900.0]\n[planner]\nhorizon.iterations = 60\n\
    [uav]\ncount = 3\nposition_error_m = 0.5\nseparation_m = 5.0\nstarts_m = [[20, 30], [220, 100], [125, 200]]\n";

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
        "listed" => LISTED.to_owned(),
        "home" => HOME.to_owned(),
        "fleet" => FLEET.to_owned(),
        "short" => SHORT.to_owned(),
        _ => {
            let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenarios/{name}.toml"));
            fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()))
        }
    }
}

/// `list.csv` of `listed`: 30 SNs with rates, buffers and the weights `weight_of(id)`.
pub fn list(weight_of: impl Fn(u32) -> Option<u32>) -> String {
    let rows = (0..30u32).map(|id| {
        let place_m = [id * 37 % 100, id * 61 % 100];
        let buffer_bits = 2_000 + id * 700;
        let weight = weight_of(id).map_or_else(String::new, |weight| format!(",{weight}"));
        format!("{},{},{},{buffer_bits}{weight}\n", place_m[0], place_m[1], 150 + id * 20)
    });
    let column = if weight_of(0).is_some() { ",weight" } else { "" };
    format!("x_m,y_m,sampling_bps,capacity_bits{column}\n{}", rows.collect::<String>())
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
