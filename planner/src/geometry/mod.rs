//! Plane geometry that the other folders share; it knows none of them.

pub mod circle;
pub mod disks;
pub mod grid;
pub mod tour;
