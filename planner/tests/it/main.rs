//! Plans and whole missions, by every strategy.

mod agreement;
mod baselines;
mod estimate;
mod fixtures;
mod index;
mod invariants;
mod oracle;
mod settings;
mod spatial;
#[path = "../support/mod.rs"]
mod support;
