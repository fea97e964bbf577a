//! The input of a scene: all data of one slot.

use skysink_common::message::{FlightReport, HeardLink, PathPoint, Plan, QueuesHeader};
use skysink_common::nodes::NodeFeatures;
use skysink_common::slot_record::{UAV, UavSlot};
use skysink_common::told::Told;

/// The timeline that counts slots.
pub const SLOT: &str = "slot";

/// The timeline of simulated seconds.
pub const SIM_TIME: &str = "sim_time";

/// Whether wall-clock times are measured, which determines whether their curves are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WallClock {
    /// Slots contain planning time and pace.
    Measured,
    /// Slots contain no wall-clock times, so that equal missions give equal recordings.
    Unmeasured,
}

/// All data of one slot. Slot 0 is the state before the first slot and has no plan.
#[derive(Debug, Clone, Copy)]
pub struct SlotView<'a> {
    /// The slot.
    pub slot: u64,
    /// Queue of every sensor node after the slot, and its answer in the next.
    pub told: Told<'a>,
    /// Bits of the slot and since the start.
    pub header: &'a QueuesHeader,
    /// The plan of each UAV, if it was in time.
    pub plans: &'a [Option<Plan>],
    /// The planned paths, UAV by UAV, each with the waypoint of the slot first; empty if there is none.
    pub paths: &'a [PathPoint],
    /// The flight of each UAV.
    pub flights: &'a [FlightReport],
    /// What the UAVs hear of links, with `link.beacon_radius_m`.
    pub heard: &'a [HeardLink],
    /// The features of the sensor nodes; `None` where they are unknown, as if slots have been missed.
    pub features: Option<&'a NodeFeatures>,
    /// Slots per second of wall time, if measured.
    pub slots_per_s: Option<f64>,
    /// Wall time of planning the slot [ms], if measured.
    pub plan_ms: Option<f64>,
}

impl SlotView<'_> {
    /// What the slot left of each UAV, in the order of their numbers.
    pub(crate) fn uavs(&self) -> impl ExactSizeIterator<Item = UavSlot<'_>> {
        self.flights.iter().enumerate().map(|(uav, flight)| {
            let first_of = |uav: usize| self.paths.partition_point(|point| (point.uav as usize) < uav);
            let plan = self.plans.get(uav).and_then(Option::as_ref);
            UavSlot { uav, plan, path: &self.paths[first_of(uav)..first_of(uav + 1)], flight }
        })
    }

    /// The flight of the first UAV.
    pub(crate) fn flight(&self) -> &FlightReport {
        &self.flights[UAV]
    }

    /// The plan of the first UAV.
    pub(crate) fn plan(&self) -> Option<&Plan> {
        self.plans.get(UAV)?.as_ref()
    }
}
