//! What a scene shows: everything of one slot, and whether the wall clock is measured.

use skysink_common::message::{FlightReport, PathPoint, Plan, QueuesHeader};

/// Whether the wall clock is measured, so that its curves are laid out on the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WallClock {
    /// Slots come with their plan latency and pace.
    Measured,
    /// They do not, and equal missions make equal recordings.
    Unmeasured,
}

/// Everything that is known of one slot; slot 0 is the state before the first and has no plan.
#[derive(Debug, Clone, Copy)]
pub struct SlotView<'a> {
    /// The slot.
    pub slot: u64,
    /// Queue [bit] of every sensor node after it.
    pub queues_bits: &'a [u32],
    /// Bits of the slot and since the start.
    pub header: &'a QueuesHeader,
    /// The plan, if one was there in time.
    pub plan: Option<&'a Plan>,
    /// Where it leads, its own waypoint first; empty if that is not known.
    pub path: &'a [PathPoint],
    /// What was flown and served.
    pub flight: &'a FlightReport,
    /// Slots per second of wall time, if measured.
    pub slots_per_s: Option<f64>,
    /// Wall time of planning the slot [ms], if measured.
    pub plan_ms: Option<f64>,
}
