//! Tests that take minutes: bounds and look-ahead over many missions, and the modules of `it` with properties,
//! which take more cases here.

/// Random cases of a property, as a multiple of those that `cargo test` runs.
const CASES_FACTOR: u32 = 10;

#[path = "../it/agreement.rs"]
mod agreement;
mod bound;
#[path = "../it/estimate.rs"]
mod estimate;
mod horizon;
#[path = "../it/index.rs"]
mod index;
#[path = "../it/invariants.rs"]
mod invariants;
#[path = "../it/oracle.rs"]
mod oracle;
#[path = "../it/spatial.rs"]
mod spatial;
#[path = "../support/mod.rs"]
mod support;
