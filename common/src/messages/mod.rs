//! What is told: the messages of the ring, the rows of a slot, and the figures of a mission.

pub mod figure;
pub mod message;
pub mod possible;
pub mod slot_record;
pub mod told;
