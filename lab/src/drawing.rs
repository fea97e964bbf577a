//! Charts with confidence bands ([`chart`]) and maps of trajectories, written as SVG and, with the feature `pictures`,
//! PDF and PNG.
//!
//! The same data give the same bytes: the output depends on no system font, clock or random number.

mod axis;
pub mod chart;
pub mod curves;
pub mod levels;
pub mod map;
pub mod page;
#[cfg(feature = "pictures")]
mod pictures;
pub mod style;
pub mod table;
#[cfg(test)]
mod tests;
