//! What a process does not accept from its peers: counted, and said in one line, but not a thousand times.

use std::cell::RefCell;
use std::rc::Rc;

use strum::{Display, EnumCount};

use crate::role::Role;

/// Why a sample is not accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumCount)]
pub enum Refusal {
    /// It belongs to another run.
    #[strum(to_string = "it belongs to another run")]
    Mission,
    /// Its writer is not the one that is heard, and that one is still there.
    #[strum(to_string = "another process is writing this topic already")]
    SecondWriter,
    /// Its writer has sent a slot that is not after the last one.
    #[strum(to_string = "its writer has sent that slot, or a later one, before")]
    OldSlot,
    /// Its slot is further ahead than the ring can be.
    #[strum(to_string = "the ring cannot be that far")]
    FarSlot,
    /// It has another length than the field has sensor nodes.
    #[strum(to_string = "expected a queue for each SN")]
    Length,
    /// The waypoint of a plan is no number, out of reach, or outside the area.
    #[strum(to_string = "waypoint not finite, out of reach, or outside the area: the UAV holds")]
    Waypoint,
    /// A plan names a sensor node that is out of range, unknown, named before, or beyond the resource blocks.
    #[strum(to_string = "SN out of range, unknown, named twice, or beyond the resource blocks")]
    Sensor,
    /// A path has no point, more than there is room for, or one that is no number or outside the area.
    #[strum(to_string = "expected 1 to 64 points, finite and in the area")]
    Path,
}

/// The refusals of a process, shared by its readers.
#[derive(Debug, Clone)]
pub struct Refusals(Rc<RefCell<State>>);

#[derive(Debug)]
struct State {
    counts: [u64; Refusal::COUNT],
    speaker: Option<Role>,
}

impl Refusals {
    /// Refusals that `speaker`, if there is one, says on standard error: the first of its kind, the 10th, the 100th...
    #[must_use]
    pub fn new(speaker: Option<Role>) -> Self {
        Self(Rc::new(RefCell::new(State { counts: [0; Refusal::COUNT], speaker })))
    }

    /// Counts the refusal of the sample of `slot` on `topic`, which is `count` of its kind.
    pub fn add(&self, topic: &str, slot: u64, refusal: Refusal, count: u64) {
        let mut state = self.0.borrow_mut();
        let total = &mut state.counts[refusal as usize];
        let before = *total;
        *total += count;
        if let Some(line) = line(topic, slot, refusal, before, *total)
            && let Some(speaker) = state.speaker
        {
            speaker.say(line);
        }
    }

    /// How many were refused, of all kinds.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.0.borrow().counts.iter().sum()
    }
}

/// What is said when the count goes from `before` to `now`: something whenever it reaches a further power of ten.
fn line(topic: &str, slot: u64, refusal: Refusal, before: u64, now: u64) -> Option<String> {
    let magnitude = |count: u64| count.checked_ilog10().map_or(0, |log| log + 1);
    if magnitude(now) == magnitude(before) {
        return None;
    }
    let so_far = if now > 1 { format!(" ({now} so far)") } else { String::new() };
    Some(format!("{topic}({slot}) refused: {refusal}{so_far}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_power_of_ten_is_said() {
        let said = |before, now| line("plan", 7, Refusal::Mission, before, now);
        assert_eq!(said(0, 1).unwrap(), "plan(7) refused: it belongs to another run");
        assert_eq!(said(1, 2), None);
        assert_eq!(said(9, 10).unwrap(), "plan(7) refused: it belongs to another run (10 so far)");
        assert_eq!(said(10, 99), None);
        assert_eq!(said(99, 1001).unwrap(), "plan(7) refused: it belongs to another run (1001 so far)");
    }

    #[test]
    fn readers_count_together() {
        let refusals = Refusals::new(None);
        refusals.clone().add("plan", 1, Refusal::FarSlot, 1);
        refusals.add("queues", 2, Refusal::Mission, 3);
        assert_eq!(refusals.total(), 4);
    }
}
