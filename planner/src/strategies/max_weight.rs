//! `max-weight`: the waypoint and schedule of the largest queue-weighted service, one slot at a time.
//!
//! Source: L. Tassiulas, A. Ephremides, "Stability Properties of Constrained Queueing Systems and Scheduling Policies
//! for Maximum Throughput in Multihop Radio Networks", IEEE Transactions on Automatic Control 37(12), 1992: of the sets
//! of links that may be active together, the one of largest sum of queue times rate, which keeps every queue stable
//! that any policy can keep stable. (Known from how it is commonly summarised; the paper was not read for this.)
//!
//! Adapted to a UAV: what may be active together depends on where it flies, so that a choice is a waypoint in reach and
//! at most n sensor nodes (SNs) in range of it; and an SN sends no more than it holds, `Σ Q_i min(Q_i, r_i τ_c)`. Which
//! waypoints are compared says the file `queue_weight.rs`. The theorem does not carry over: the sets to choose from
//! depend on the slots before, and buffers are finite. Like every rule of one slot it does not leave the SNs in its
//! reach for fuller ones beyond.

use super::Registered;
use super::queue_weight::QueueWeight;

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered {
    name: "max-weight",
    about: "the waypoint and schedule of the largest queue-weighted service in the slot",
    is_stateless: true,
    has_path: false,
    keys: None,
    make: |setup| Box::new(QueueWeight::new(setup, 0.0)),
};
