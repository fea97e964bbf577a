//! The UAV and its radio channel: flies what it is told if it can, and reports what its links can carry.
//!
//! It never trusts the planner. The queues are field-sim's.

pub mod flight;
#[cfg(feature = "node")]
pub mod journal;
#[cfg(feature = "node")]
pub mod node;
pub mod vehicle;

pub use flight::Flight;
