//! The sensor field: what the sensor nodes sample, store, lose and upload, and the slot clock of the ring.
//!
//! It owns the queues. Where the UAV is and what its links carry is flight-sim's.

pub mod arrivals;
pub mod field;
#[cfg(feature = "node")]
pub mod journal;
#[cfg(feature = "node")]
pub mod node;

pub use field::{Field, FieldError, SlotBits};
