//! The visits of other UAVs, as plans reckon with them.

use super::sensor::SensorModel;
use crate::neighbours::PlannedVisit;

/// Least part of a full buffer that a visit of another UAV takes, to count as one that empties its sensor.
const MOST_OF_BUFFER: f64 = 0.5;

/// The visits of other UAVs in a planning window, each of which is expected to empty its sensor; those that take little
/// are left out.
#[derive(Debug, Clone, Default)]
pub struct OtherVisits {
    /// By sensor: their slots, ascending; 1 is the first of the window. Empty without visits.
    pub(super) slots: Vec<Vec<f64>>,
}

impl OtherVisits {
    /// Of a window that begins with the slot `first`, for `sensors` with these `ids`, ascending.
    #[must_use]
    pub fn of(visits: &[PlannedVisit], ids: &[u32], sensors: &[SensorModel], first: u64) -> Self {
        let mut slots = vec![Vec::new(); if visits.is_empty() { 0 } else { ids.len() }];
        for visit in visits.iter().filter(|visit| visit.slot >= first) {
            let Ok(sensor) = ids.binary_search(&visit.sensor) else { continue };
            let SensorModel { fill_slots, mean_bits, costs, .. } = sensors[sensor];
            // Where ages count, whatever it takes.
            if !costs.is_by_bits() || visit.bits >= MOST_OF_BUFFER * fill_slots * mean_bits {
                slots[sensor].push((visit.slot - first + 1) as f64);
            }
        }
        slots.iter_mut().for_each(|slots: &mut Vec<f64>| slots.sort_unstable_by(f64::total_cmp));
        Self { slots }
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }
}
