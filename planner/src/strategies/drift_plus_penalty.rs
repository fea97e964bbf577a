//! `drift-plus-penalty`: Lyapunov drift plus penalty, with the propulsion energy as the penalty.
//!
//! In every slot it chooses the waypoint in reach and the set of at most n sensor nodes (SNs) in range of it that
//! maximise `Σ Q_i b_i − V E`, with the queue `Q_i = B_i(t−1)` [bit], the service `b_i = min(Q_i, floor(r_i τ_c))`
//! [bit], the slot's propulsion energy E [J], and the price V [bit²/J], `planner.drift-plus-penalty.price_bits2_per_j`.
//! With V = 0 it is [`max-weight`](super::max_weight).
//!
//! Source: M. J. Neely, "Stochastic Network Optimization with Application to Communication and Queueing Systems",
//! Morgan & Claypool, 2010. In every slot the method minimises a bound on the drift of the Lyapunov function `½ Σ Q_i²`
//! plus V times a penalty. The average penalty is within O(1/V) of the least, and queues grow in proportion to V.
//! (Known from summaries of the method; the book was not read for this.)
//!
//! The bounds do not carry over to a UAV, for the reasons given in [`max-weight`](super::max_weight). A rotary wing
//! needs least power in slow flight, so a high price makes the UAV fly slowly instead of hovering, toward the fullest
//! queue that it can serve in a slot where nothing else decides.

use serde::{Deserialize, Serialize};
use skysink_common::keys::Accepts;

use super::queue_weight::{QueueWeight, Service};
use crate::strategy::Registered;

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered::new(
    "drift-plus-penalty",
    "max-weight less a price for propulsion energy (Lyapunov optimisation)",
    |setup| {
        let keys: DriftPlusPenaltyKeys =
            setup.scenario.planner_keys("planner.drift-plus-penalty").expect("they were checked");
        Box::new(QueueWeight::new(setup, keys.price_bits2_per_j, Service::Upload))
    },
)
.with_keys::<DriftPlusPenaltyKeys>();

skysink_common::keys! {
    /// `[planner.drift-plus-penalty]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct DriftPlusPenaltyKeys {
        /// Price of energy, `V` [bit²/J].
        price_bits2_per_j: f64 = 3e5, Accepts::Number("bit²/J, 0 to 1e18", |price| (0.0..=1e18).contains(&price));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::keys::Keys;

    #[test]
    fn an_invalid_price_is_refused() {
        let is_refused = |price: f64| DriftPlusPenaltyKeys::KEYS[0].accepts.refusal(&price.into()).is_some();
        assert!([-1.0, 1.1e18, f64::NAN, f64::INFINITY].into_iter().all(is_refused));
        assert!(![0.0, 1e18].into_iter().any(is_refused));
    }
}
