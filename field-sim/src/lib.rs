//! The sensor field: sampling, queues, losses and uploads of the sensor nodes, and the slot clock of the ring.
//!
//! The UAV and its links are left to flight-sim.

pub mod field;
#[cfg(feature = "node")]
pub mod journal;
#[cfg(feature = "node")]
pub mod node;

pub use field::{Field, FieldError, SlotBits};
