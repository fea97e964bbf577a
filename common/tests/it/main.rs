//! Scenarios and sensor lists.

mod geodetic;
mod keys;
mod scenario;
