//! Plans and whole missions, by every strategy.

/// Random cases of a property, as a multiple of those that `cargo test` runs.
const CASES_FACTOR: u32 = 1;

mod agreement;
mod baselines;
mod collect;
mod estimate;
mod fixtures;
mod index;
mod invariants;
mod oracle;
mod settings;
mod spatial;
#[path = "../support/mod.rs"]
mod support;
