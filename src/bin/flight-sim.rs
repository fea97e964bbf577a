//! flight-sim
fn main() {}
