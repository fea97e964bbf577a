//! A plan to start from where blocks are scarce: every slot serves the best set of that slot, as `exact` does.
//!
//! Its stops belong to no partition of the sensors: who shares a slot differs from visit to visit.

use skysink_common::geometry::distance_squared;

use super::flight::{Visit, serve};
use super::forecast::PlanningWindow;
use super::model::PlanningModel;
use super::service_disk::ServiceDisk;
use crate::sensor_table::SensorTable;
use crate::strategies::exact::ExactSearch;

/// The stops of the slots of `window` if every slot serves the fullest set of SNs of `table` in reach; `None` where a
/// slot has no SN in reach.
#[must_use]
pub fn roll_out(model: &PlanningModel, window: &PlanningWindow, table: &SensorTable) -> Option<Vec<ServiceDisk>> {
    let mut search = ExactSearch::new(table);
    let mut queues_bits = vec![0; table.positions.len()];
    let mut empty = window.empty.clone();
    let mut at = window.start;
    let mut ids = Vec::new();
    let mut stops = Vec::new();
    for slot in 1..=window.slots {
        for ((sensor, id), empty) in model.sensors.iter().zip(&model.ids).zip(&empty) {
            let stored_slots = (f64::from(slot - 1) - empty).min(sensor.fill_slots);
            queues_bits[*id as usize] = (stored_slots * sensor.mean_bits) as u32;
        }
        at = search.best_set(table, &at, &queues_bits, &mut ids)?;
        let members = ids.iter().filter_map(|id| model.ids.binary_search(id).ok());
        let members: Vec<u32> = members.map(|sensor| sensor as u32).collect();
        for &sensor in &members {
            let away_m2 = distance_squared(model.table.position(sensor), &at);
            let capacity_slots = model.capacity_slots(sensor, away_m2);
            serve(model, &mut empty, &Visit { sensor, slot, capacity_slots });
        }
        stops.extend(ServiceDisk::at(&model.table, at, members));
    }
    Some(stops)
}
