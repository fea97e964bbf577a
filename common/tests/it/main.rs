//! Scenarios and sensor lists.

mod geodetic;
mod scenario;
