//! What it saves to cut the tour of `partition` by the time in which each UAV flies it: the loss of `horizon` with pieces
//! by time and by length, over the same fields, for fleets whose speeds differ by a factor of two.
//!
//! ```sh
//! cargo run --release -p skysink-mission --example partition -- 20    # fields
//! ```

use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;

use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_planner::strategy::rule;
use skysink_planner::{FleetPlanner, settings};

/// Fleets, by the speeds of their UAVs [m/s].
const FLEETS: [&[f64]; 3] = [&[30.0, 15.0], &[15.0, 30.0, 15.0], &[30.0, 30.0, 15.0, 15.0]];

/// The mission of a fleet over the field of a seed.
fn scenario(seed: u64, speeds_mps: &[f64]) -> Result<Scenario, Box<dyn Error>> {
    let mut text = format!(
        "name = 'partition'\nseed = {seed}\nslots = 400\n[area]\nside_m = 1000.0\n[sensors]\nsampling_bps = 200.0\n\
         [planner]\nhorizon.iterations = 300\n"
    );
    speeds_mps.iter().try_for_each(|speed_mps| writeln!(text, "[[uav.each]]\nmax_speed_mps = {speed_mps:?}"))?;
    let overrides = Overrides { strategy: Some("horizon"), ..Overrides::default() };
    Ok(Scenario::parse(&text, Path::new("partition.toml"), overrides).and_then(settings::resolve)?)
}

/// Bits that a mission loses.
fn lost_bits(scenario: &Scenario, list: &SensorList) -> Result<u64, Box<dyn Error>> {
    let last = Mission::new(scenario, list)?.last().ok_or("a mission without slots")?;
    Ok(last.header.totals.lost_bits)
}

/// Bits that a fleet loses whose pieces are as long as each other: each UAV flies over its piece alone.
fn lost_by_length(scenario: &Scenario, equal: &Scenario, list: &SensorList) -> Result<u64, Box<dyn Error>> {
    let mut pieces = Vec::new();
    let mut note = |setup: &skysink_planner::strategy::Setup<'_>| {
        pieces.push(setup.table.sensors.positions.clone());
        Ok(rule(|_| None))
    };
    FleetPlanner::by(equal, &list.nodes(), &mut note, &Stop::default())?;
    let mut lost = 0;
    for (uav, piece) in pieces.iter().enumerate() {
        let mut text = "x_m,y_m,queue_bits,gain_db,sampling_bps\n".to_owned();
        for sensor in list.sensors().iter().filter(|sensor| piece.contains(&sensor.position)) {
            let at = sensor.position;
            writeln!(text, "{},{},{},{},{}", at.x, at.y, sensor.queue_bits, sensor.gain_db, sensor.sampling_bps)?;
        }
        let alone = scenario.of_uav(uav);
        lost += lost_bits(&alone, &SensorList::parse(&text, Path::new("piece.csv"), &alone)?)?;
    }
    Ok(lost)
}

/// Mean and standard error.
fn mean(values: &[f64]) -> [f64; 2] {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    [mean, (variance / count).sqrt()]
}

fn main() -> Result<(), Box<dyn Error>> {
    let fields: u64 = std::env::args().nth(1).ok_or("expected the number of fields")?.parse()?;
    println!("| speeds [m/s] | η, by length | η, by time | paired difference |\n|---|---|---|---|");
    for speeds_mps in FLEETS {
        let [mut by_length, mut by_time, mut changes] = [Vec::new(), Vec::new(), Vec::new()];
        for seed in 1..=fields {
            let fleet = scenario(seed, speeds_mps)?;
            let equal = scenario(seed, &vec![speeds_mps[0]; speeds_mps.len()])?;
            let list = SensorList::of(&fleet)?;
            let rate = |lost_bits: u64| lost_bits as f64 / list.mission_bits(&fleet);
            by_length.push(rate(lost_by_length(&fleet, &equal, &list)?));
            by_time.push(rate(lost_bits(&fleet, &list)?));
            changes.push(by_time[by_time.len() - 1] - by_length[by_length.len() - 1]);
        }
        let speeds: Vec<String> = speeds_mps.iter().map(f64::to_string).collect();
        let cells = [&by_length, &by_time, &changes].map(|values| mean(values));
        let cells = cells.map(|[mean, error]| format!("{mean:.4} ± {error:.4}"));
        println!("| {} | {} |", speeds.join(", "), cells.join(" | "));
    }
    Ok(())
}
