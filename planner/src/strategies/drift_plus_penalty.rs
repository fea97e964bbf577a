//! `drift-plus-penalty`: Lyapunov drift plus penalty, with the propulsion energy as the penalty.
//!
//! In every slot it chooses the waypoint in reach and the set of at most n sensor nodes (SNs) in range of it that
//! maximise `Σ Q_i b_i − V E`, with the queue `Q_i = B_i(t−1)` [bit], the service `b_i = min(Q_i, floor(r_i τ_c))`
//! [bit], the slot's propulsion energy E [J], and the price V [bit²/J], `planner.drift-plus-penalty.price_bits2_per_j`.
//! With V = 0 it is [`max-weight`](super::max_weight). The search over waypoints is in `queue_weight.rs`.
//!
//! Source: M. J. Neely, "Stochastic Network Optimization with Application to Communication and Queueing Systems",
//! Morgan & Claypool, 2010. In every slot the method minimises a bound on the drift of the Lyapunov function `½ Σ Q_i²`
//! plus V times a penalty. The average penalty is within O(1/V) of the least, and queues grow in proportion to V.
//! (Known from summaries of the method; the book was not read for this.)
//!
//! The bounds do not carry over to a UAV, for the reasons given in [`max-weight`](super::max_weight). A rotary wing
//! needs least power in slow flight, so a high price makes the UAV fly slowly instead of hovering.

use serde::{Deserialize, Serialize};

use super::queue_weight::QueueWeight;
use super::{Registered, checked};

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered {
    name: "drift-plus-penalty",
    about: "max-weight less a price for propulsion energy (Lyapunov optimisation)",
    is_stateless: true,
    has_path: false,
    keys: Some(checked::<DriftPlusPenaltyKeys>),
    make: |setup| {
        let keys: DriftPlusPenaltyKeys =
            setup.scenario.planner_keys("planner.drift-plus-penalty").expect("they were checked");
        Box::new(QueueWeight::new(setup, keys.price_bits2_per_j.into()))
    },
};

/// `[planner.drift-plus-penalty]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DriftPlusPenaltyKeys {
    /// Price of energy, V [bit²/J].
    pub price_bits2_per_j: Price,
}

impl Default for DriftPlusPenaltyKeys {
    fn default() -> Self {
        Self { price_bits2_per_j: Price(3e5) }
    }
}

/// A price [bit²/J], 0 to 10^18.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Price(f64);

impl TryFrom<f64> for Price {
    type Error = &'static str;

    fn try_from(price: f64) -> Result<Self, Self::Error> {
        if (0.0..=1e18).contains(&price) { Ok(Self(price)) } else { Err("expected bit²/J, 0 to 1e18") }
    }
}

impl From<Price> for f64 {
    fn from(price: Price) -> Self {
        price.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_price_that_is_none_is_refused() {
        assert!([-1.0, 1.1e18, f64::NAN, f64::INFINITY].iter().all(|&price| Price::try_from(price).is_err()));
        assert!([0.0, 1e18].iter().all(|&price| Price::try_from(price).is_ok()));
    }
}
