//! Space: positions, where UAVs may fly, and where they land.

pub mod airspace;
pub mod base;
pub mod geometry;
