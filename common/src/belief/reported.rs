//! The reports of served sensor nodes on their queues.

use serde::{Deserialize, Serialize};

use crate::checkpoint::CheckpointError;
use crate::message::MAX_SERVED;
use crate::scenario::MAX_UAVS;
use crate::told::Told;

/// The queues of some sensor nodes (SNs) at the beginning of a slot, which they report if they are served in it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReportedQueues {
    slot: u64,
    /// Id, and queue [bit].
    queues: Vec<(u32, u32)>,
}

impl ReportedQueues {
    /// The queues of the SNs `ids` at the beginning of `slot`, as they are `told` before it. SNs that are then silent
    /// or dead report none.
    ///
    /// # Panics
    /// If an SN is unknown.
    #[must_use]
    pub fn at<'t>(slot: u64, ids: impl IntoIterator<Item = u32>, told: impl Into<Told<'t>>) -> Self {
        let told = told.into();
        let sending = ids.into_iter().filter(|&id| told.answer(id).sends());
        Self { slot, queues: sending.map(|id| (id, told.queues_bits[id as usize])).collect() }
    }

    /// Whether SN `id`, one of those that were to report at the beginning of `slot`, was silent or dead.
    pub fn was_out(&self, slot: u64, id: u32) -> bool {
        self.slot == slot && self.queue_bits(slot, id).is_none()
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
    use crate::nodes::Answer;

    #[test]
    fn a_report_must_match_its_slot_and_sensor_node() {
        let reported = ReportedQueues::at(7, [2, 0], &[10, 20, 30]);
        assert_eq!([0, 1, 2].map(|id| reported.queue_bits(7, id)), [Some(10), None, Some(30)]);
        assert_eq!(reported.queue_bits(8, 2), None);
    }

    #[test]
    fn a_sensor_node_that_does_not_send_reports_nothing() {
        let answers = [Answer::Queue, Answer::Silent, Answer::Dead];
        let reported = ReportedQueues::at(7, [0, 1, 2], Told::new(&[10, 20, 0], &answers));
        assert_eq!([0, 1, 2].map(|id| reported.queue_bits(7, id)), [Some(10), None, None]);
        assert_eq!([0, 1, 2].map(|id| reported.was_out(7, id)), [false, true, true]);
        assert!(!reported.was_out(8, 1), "nothing is known of another slot");
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
