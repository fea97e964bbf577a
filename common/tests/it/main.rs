//! Scenarios and sensor lists.

mod airspace;
mod each;
mod geodetic;
mod keys;
mod scenario;
mod sight;
mod zone_files;
