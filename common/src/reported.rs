//! The reports of served sensor nodes on their queues.

use serde::{Deserialize, Serialize};

use crate::checkpoint::CheckpointError;
use crate::message::MAX_SERVED;
use crate::scenario::MAX_UAVS;

/// The queues of some sensor nodes (SNs) at the beginning of a slot, which they report if they are served in it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReportedQueues {
    slot: u64,
    /// Id, and queue [bit].
    queues: Vec<(u32, u32)>,
}

impl ReportedQueues {
    /// The queues of the SNs `ids` at the beginning of `slot`, of the queues `queues_bits` [bit], by id.
    ///
    /// # Panics
    /// If an SN is unknown.
    #[must_use]
    pub fn at(slot: u64, ids: impl IntoIterator<Item = u32>, queues_bits: &[u32]) -> Self {
        Self { slot, queues: ids.into_iter().map(|id| (id, queues_bits[id as usize])).collect() }
    }

    /// The queue of SN `id` at the beginning of `slot` [bit], if it was reported.
    pub fn queue_bits(&self, slot: u64, id: u32) -> Option<u32> {
        let &(_, queue_bits) = self.queues.iter().find(|(reporting, _)| *reporting == id)?;
        (self.slot == slot).then_some(queue_bits)
    }

    /// Refuses reports of other SNs than the first `count`, of more than can be served, or of slots after `slot`.
    ///
    /// # Errors
    /// If they are impossible.
    pub fn check(&self, slot: u64, count: usize) -> Result<(), CheckpointError> {
        let are_known = self.queues.iter().all(|(id, _)| (*id as usize) < count);
        let is_possible = are_known && self.queues.len() <= MAX_SERVED * MAX_UAVS as usize && self.slot <= slot;
        CheckpointError::ensure(is_possible, "reports of scheduled sensor nodes of this field")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_must_match_its_slot_and_sensor_node() {
        let reported = ReportedQueues::at(7, [2, 0], &[10, 20, 30]);
        assert_eq!([0, 1, 2].map(|id| reported.queue_bits(7, id)), [Some(10), None, Some(30)]);
        assert_eq!(reported.queue_bits(8, 2), None);
    }

    #[test]
    fn impossible_reports_are_refused() {
        assert!(ReportedQueues::at(7, [2, 0], &[10, 20, 30]).check(7, 3).is_ok());
        assert!(ReportedQueues::default().check(0, 0).is_ok());
        assert!(ReportedQueues::at(8, [2], &[10, 20, 30]).check(7, 3).is_err(), "of a slot to come");
        assert!(ReportedQueues::at(7, [2], &[10, 20, 30]).check(7, 2).is_err(), "SN 2 of two");
        assert!(ReportedQueues::at(7, [0; 4097], &[10]).check(7, 3).is_err(), "more than can be served");
    }
}
