//! Plane geometry, independent of the other modules.

pub mod circle;
pub mod detour;
pub mod disks;
pub mod round;
pub mod turns;
