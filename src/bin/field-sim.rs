//! field-sim
fn main() {}
