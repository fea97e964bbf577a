//! `max-weight`: the max-weight (backpressure) policy, one slot at a time.
//!
//! In every slot it chooses a waypoint in reach and a set of at most n sensor nodes (SNs) in range of it with a large
//! `Σ Q_i b_i`, the sum of queue times service, with `Q_i = B_i(t−1)` [bit]. By default `b_i` is what is uploaded,
//! `min(Q_i, floor(r_i τ_c))` [bit]; with `planner.max-weight.service = "capacity"` it is what the link carries,
//! `floor(r_i τ_c)`, as in the source. Where links empty the queues, the first weighs an SN by `Q_i²`, and the second
//! nearly by `Q_i`.
//!
//! Source: L. Tassiulas, A. Ephremides, "Stability Properties of Constrained Queueing Systems and Scheduling Policies
//! for Maximum Throughput in Multihop Radio Networks", IEEE Transactions on Automatic Control 37(12), 1992. Of the sets
//! of links that may be active together, the policy activates the one with the largest sum of queue times rate. It
//! stabilises all queues whenever some policy can. (Known from how it is commonly summarised; the paper was not read
//! for this.)
//!
//! Adapted to a UAV: the feasible sets depend on the waypoint, and by default an SN's service is at most what it holds.
//! The stability theorem does not carry over, because the feasible sets depend on earlier slots and buffers are finite.
//! Like every one-slot policy it does not leave the SNs in reach for fuller ones farther away.

use serde::{Deserialize, Serialize};
use skysink_common::keys::Accepts;
use strum::VariantNames;

use super::queue_weight::{QueueWeight, Service};
use crate::strategy::Registered;

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("max-weight", "max-weight: a large sum of queue times service in the slot", |setup| {
        let keys: MaxWeightKeys = setup.scenario.planner_keys("planner.max-weight").expect("they were checked");
        Box::new(QueueWeight::new(setup, 0.0, keys.service))
    })
    .with_keys::<MaxWeightKeys>();

skysink_common::keys! {
    /// `[planner.max-weight]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct MaxWeightKeys {
        /// Service by which a queue is multiplied: what is uploaded, or what the link can carry.
        service: Service = "upload", Accepts::OneOf(Service::VARIANTS);
    }
}
