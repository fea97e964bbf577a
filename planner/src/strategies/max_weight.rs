//! `max-weight`: the max-weight (backpressure) policy, one slot at a time.
//!
//! In every slot it chooses the waypoint in reach and the set of at most n sensor nodes (SNs) in range of it that
//! maximise `Σ Q_i min(Q_i, floor(r_i τ_c))`, the sum of queue times service, with `Q_i = B_i(t−1)` [bit]. The search
//! over waypoints is in `queue_weight.rs`.
//!
//! Source: L. Tassiulas, A. Ephremides, "Stability Properties of Constrained Queueing Systems and Scheduling Policies
//! for Maximum Throughput in Multihop Radio Networks", IEEE Transactions on Automatic Control 37(12), 1992. Of the sets
//! of links that may be active together, the policy activates the one with the largest sum of queue times rate. It
//! stabilises all queues whenever some policy can. (Known from how it is commonly summarised; the paper was not read
//! for this.)
//!
//! Adapted to a UAV: the feasible sets depend on the waypoint, and an SN sends no more than it holds. The stability
//! theorem does not carry over, because the feasible sets depend on earlier slots and buffers are finite. Like every
//! one-slot policy it does not leave the SNs in reach for fuller ones farther away.

use super::queue_weight::QueueWeight;
use crate::strategy::Registered;

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("max-weight", "max-weight: maximises the sum of queue times service in the slot", |setup| {
        Box::new(QueueWeight::new(setup, 0.0))
    });
