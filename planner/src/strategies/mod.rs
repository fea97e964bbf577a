//! The strategies: whom to serve, and where to fly by rule.

pub mod algorithm_1;
pub mod baselines;
pub mod exact;
pub(crate) mod nearby;
pub mod rounds;
