//! The trajectory maps of `skysink figures`: the flights of the strategies over the same field.

use std::path::Path;

use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_planner::settings;
use skysink_planner::strategies::{Registered, STRATEGIES, horizon, round_robin};

use super::choice::Choice;
use super::map::{MapSensor, MapSheet, TrajectoryMap};
use super::page::Look;
use super::study::AT_ONCE;
use crate::error::LabError;

/// The fields of the maps: the paper's, and one that is too large for Algorithm 1.
const FIELDS: [(&str, &str); 2] = [("map-letter", ""), ("map-sparse", "[area]\nside_m = 300.0\n")];

/// A named sheet for each field, with a map per strategy.
pub(super) fn sheets(choice: &Choice, stop: &Stop) -> Result<Vec<(&'static str, MapSheet)>, LabError> {
    // Eight maps and the key fill the sheet; round-robin is omitted, because its flight has no pattern.
    let is_shown = |strategy: &&Registered| {
        **strategy == horizon::STRATEGY || AT_ONCE.contains(strategy) && **strategy != round_robin::STRATEGY
    };
    let sheet = |(name, change)| {
        let shown = STRATEGIES.into_iter().filter(is_shown);
        let maps = shown.map(|strategy| map(change, strategy, choice, stop)).collect::<Result<Vec<_>, _>>()?;
        let side_m = maps[0].width_m;
        let sheet = MapSheet {
            look: Look {
                title: format!("Trajectories over 500 slots · {side_m} m × {side_m} m"),
                description: format!("seed 1, the paper's mission · {}", choice.command()),
                ..Look::default()
            },
            maps,
            fraction_label: "queue fill at the end".to_owned(),
        };
        Ok((name, sheet))
    };
    FIELDS.into_iter().map(sheet).collect()
}

/// The flight of a strategy in the paper's mission with the keys `change`.
fn map(change: &str, strategy: &Registered, choice: &Choice, stop: &Stop) -> Result<TrajectoryMap, LabError> {
    let steps = choice.horizon_iterations;
    let text = format!("name = \"map\"\nslots = 500\n{change}[planner]\nhorizon.iterations = {steps}\n");
    let overrides = Overrides { strategy: Some(strategy.name), seed: Some(1), ..Overrides::default() };
    let scenario = Scenario::parse(&text, Path::new("map (built in)"), overrides).and_then(settings::resolve)?;
    let list = SensorList::of(&scenario)?;
    let mut mission = Mission::new(&scenario, &list)?;
    mission.set_stop(stop);
    let path_m = mission.by_ref().map(|flown| [flown.flight.x_m, flown.flight.y_m]).collect();
    stop.check()?;
    let totals = mission.header().totals;
    let loss_rate = totals.lost_bits as f64 / totals.sampled_bits as f64;
    let capacity_bits = f64::from(scenario.sensors.capacity_bits);
    let sensors = list.sensors().iter().zip(mission.queues_bits()).map(|(sensor, &queue_bits)| MapSensor {
        position_m: sensor.position.coords.into(),
        fraction: f64::from(queue_bits) / capacity_bits,
    });
    Ok(TrajectoryMap {
        title: format!("{}: η = {loss_rate:.3}", strategy.name),
        width_m: scenario.area.width_m(),
        height_m: scenario.area.height_m(),
        sensors: sensors.collect(),
        start_m: scenario.start().xy().coords.into(),
        path_m,
    })
}
