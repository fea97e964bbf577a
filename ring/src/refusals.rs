//! Samples that a process refuses: counted, and logged with increasing intervals.

use std::cell::RefCell;
use std::rc::Rc;

use strum::{Display, EnumCount};

use crate::role::Role;

/// Why a sample is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, EnumCount)]
pub enum Refusal {
    /// The sample belongs to another run.
    #[strum(to_string = "it belongs to another run")]
    Mission,
    /// Its writer is not the admitted one, which is still attached.
    #[strum(to_string = "another process is writing this topic already")]
    SecondWriter,
    /// Its slot is not after the last one of its writer.
    #[strum(to_string = "its writer has already sent that slot or a later one")]
    OldSlot,
    /// Its slot is further ahead than the ring can be.
    #[strum(to_string = "its slot is too far ahead")]
    FarSlot,
    /// Its length is not the number of sensor nodes.
    #[strum(to_string = "expected a queue for each SN")]
    Length,
    /// It has not one element for each UAV.
    #[strum(to_string = "expected an element for each UAV")]
    Uavs,
    /// It has an impossible number.
    #[strum(to_string = "expected finite numbers, and links by ascending SN, none in a hold")]
    Numbers,
    /// It names a UAV or a sensor node that does not exist.
    #[strum(to_string = "expected links of the UAVs and SNs of the mission")]
    Links,
    /// The waypoint of a plan has NaN or infinity.
    #[strum(to_string = "waypoint with NaN or infinity: the UAV holds")]
    NotFinite,
    /// The waypoint of a plan is out of reach, or outside the area.
    #[strum(to_string = "waypoint out of reach, or outside the area: the UAV holds")]
    Waypoint,
    /// A plan charges outside the base.
    #[strum(to_string = "the UAV is not in the base: it holds instead of charging")]
    Base,
    /// The way to the waypoint of a plan leads through a zone.
    #[strum(to_string = "a no-fly zone or a building is in the way: the UAV holds")]
    Zone,
    /// A waypoint is too near to where a UAV of lower number ends the slot.
    #[strum(to_string = "too near to another UAV: the UAV holds")]
    Separation,
    /// A plan charges in a site of the base whose pads are all taken.
    #[strum(to_string = "all pads of the site are taken: the UAV waits instead of charging")]
    Pad,
    /// A plan schedules a sensor node that is out of range, unknown, named twice, beyond the resource blocks, or served
    /// by a UAV of lower number.
    #[strum(to_string = "SN out of range, unknown, named twice, beyond the resource blocks, or served by another UAV")]
    Sensor,
    /// A path has no point, too many, or one that is not finite or outside the area.
    #[strum(to_string = "expected 1 to 64 points, finite and in the area")]
    Path,
}

/// The refusals of a process, shared by its readers.
#[derive(Debug, Clone)]
pub struct Refusals(Rc<RefCell<State>>);

#[derive(Debug)]
struct State {
    counts: [u64; Refusal::COUNT],
    /// The process in whose name refusals are logged; `None` to log nothing.
    logger: Option<Role>,
}

impl Refusals {
    /// Counters whose 1st, 10th, 100th... refusal of each kind is logged to standard error in the name of `logger`.
    #[must_use]
    pub fn new(logger: Option<Role>) -> Self {
        Self(Rc::new(RefCell::new(State { counts: [0; Refusal::COUNT], logger })))
    }

    /// Counts `count` refusals of one kind in the sample of `slot` on `topic`.
    pub fn add(&self, topic: &str, slot: u64, refusal: Refusal, count: u64) {
        let mut state = self.0.borrow_mut();
        let total = &mut state.counts[refusal as usize];
        let before = *total;
        *total += count;
        if let Some(line) = line(topic, slot, refusal, before, *total)
            && let Some(logger) = state.logger
        {
            logger.log(line);
        }
    }

    /// The number of refusals of all kinds.
    pub fn total(&self) -> u64 {
        self.0.borrow().counts.iter().sum()
    }
}

/// The line to log when a count rises from `before` to `now`, if it has reached another power of ten.
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
    fn refusals_are_logged_at_powers_of_ten() {
        let said = |before, now| line("plan", 7, Refusal::Mission, before, now);
        assert_eq!(said(0, 1).unwrap(), "plan(7) refused: it belongs to another run");
        assert_eq!(said(1, 2), None);
        assert_eq!(said(9, 10).unwrap(), "plan(7) refused: it belongs to another run (10 so far)");
        assert_eq!(said(10, 99), None);
        assert_eq!(said(99, 1001).unwrap(), "plan(7) refused: it belongs to another run (1001 so far)");
    }

    #[test]
    fn clones_share_their_counts() {
        let refusals = Refusals::new(None);
        refusals.clone().add("plan", 1, Refusal::FarSlot, 1);
        refusals.add("queues", 2, Refusal::Mission, 3);
        assert_eq!(refusals.total(), 4);
    }
}
