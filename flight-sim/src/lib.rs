//! The UAV and its radio channel: flies plans within the limits of the UAV, and reports the capacities of the links.
//!
//! Every plan is checked. The queues are left to field-sim.

mod contacts;
pub mod fleet;
pub mod flight;
#[cfg(feature = "node")]
pub mod journal;
#[cfg(feature = "node")]
pub mod node;
pub mod orders;
pub mod outside;
pub mod vehicle;

pub use fleet::Fleet;
pub use flight::Flight;
pub use orders::{Orders, ReportedFlight};
