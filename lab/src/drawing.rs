//! Charts with confidence bands ([`chart`]) and maps of trajectories, written as SVG and, with the feature `pictures`,
//! PDF and PNG.
//!
//! The same data give the same bytes: the output depends on no system font, clock or random number.

mod axis;
pub mod chart;
pub(crate) mod curves;
pub(crate) mod levels;
pub(crate) mod map;
pub(crate) mod page;
#[cfg(feature = "pictures")]
mod pictures;
pub(crate) mod style;
pub(crate) mod table;
#[cfg(test)]
mod tests;
