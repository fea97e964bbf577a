//! Tests of missions in one process.

mod assumed_link;
mod battery;
mod chance;
mod each;
mod expiry;
mod figures;
mod finite;
mod fleet;
mod grid;
mod heard;
mod node_energy;
mod objectives;
mod optima;
mod random_fleets;
mod record;
mod sites;
mod support;
mod traces;
mod track;
mod zones;
