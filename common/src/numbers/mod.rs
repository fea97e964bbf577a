//! Numbers: units, random streams, slacks against rounding, and values that are shared or equal.

pub mod interpolation;
pub mod per_sensor;
pub mod random;
pub(crate) mod shared;
pub mod simd;
pub mod slack;
pub mod units;
