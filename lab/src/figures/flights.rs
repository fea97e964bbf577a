//! Trajectory maps: the flights of the strategies over one field.

use std::path::Path;

use skysink_common::scenario::{Overrides, Scenario, Strategy};
use skysink_common::sensors::SensorList;

use super::campaign::Campaign;
use super::study::AT_ONCE;
use super::{MapSensor, MapSheet, TrajectoryMap};
use crate::error::LabError;
use skysink_mission::mission::Mission;

/// The flights of all strategies over the letter's mission, changed.
pub(super) fn map_sheet(change: &str, campaign: &Campaign) -> Result<MapSheet, LabError> {
    let mut maps = Vec::new();
    // Eight maps and the key fill the sheet; round-robin crosses the field without a pattern.
    let shown = AT_ONCE.into_iter().filter(|strategy| *strategy != Strategy::RoundRobin).chain([Strategy::Horizon]);
    for strategy in shown {
        let steps = campaign.choice.horizon_iterations;
        let text = format!("name = \"map\"\nslots = 500\n{change}[planner]\nhorizon_iterations = {steps}\n");
        let overrides = Overrides { strategy: Some(strategy), seed: Some(1), slots: None };
        let scenario = Scenario::parse(&text, Path::new("map (built in)"), overrides)?;
        let list = SensorList::of(&scenario)?;
        let mut mission = Mission::new(&scenario, &list);
        let (mut path_m, mut loss_rate) = (Vec::new(), 0.0);
        for turn in &mut mission {
            path_m.push([turn.flight.x_m, turn.flight.y_m]);
            let totals = turn.header.totals;
            loss_rate = totals.lost_bits as f64 / totals.sampled_bits as f64;
        }
        let capacity = f64::from(scenario.sensors.capacity_bits);
        let sensors = list.sensors().iter().zip(mission.queues_bits()).map(|(sensor, &queue)| MapSensor {
            position_m: sensor.position.coords.into(),
            share: f64::from(queue) / capacity,
        });
        maps.push(TrajectoryMap {
            title: format!("{}: η = {loss_rate:.3}", strategy.name()),
            width_m: scenario.area.width_m,
            height_m: scenario.area.height_m,
            sensors: sensors.collect(),
            start_m: scenario.uav.start.coords.into(),
            path_m,
        });
    }
    let side_m = maps[0].width_m;
    Ok(MapSheet {
        title: format!("Trajectories over 500 slots · {side_m} m × {side_m} m"),
        maps,
        share_label: "queue fill at the end".to_owned(),
        footer: format!("seed 1, the letter's mission · {}", campaign.command()),
    })
}
