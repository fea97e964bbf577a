//! The letter's figures: curves with confidence bands ([`chart`]) and trajectory maps ([`map`]), each drawn once and
//! written as SVG and PNG.
//!
//! The same input gives the same bytes: no system font, no clock, no random number takes part. Where the numbers come
//! from is left to the sweeps.

mod altitude;
mod axis;
pub mod campaign;
mod canvas;
pub mod chart;
pub mod error;
mod flights;
mod knowledge;
pub mod map;
mod panel;
mod study;
mod style;
#[cfg(test)]
mod tests;

pub use chart::{Chart, Point, Scale, Series};
pub use error::FigureError;
pub use map::{MapSensor, MapSheet, TrajectoryMap};
