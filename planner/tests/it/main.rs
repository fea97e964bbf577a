//! Plans and whole missions, by every strategy.

mod agreement;
mod baselines;
mod bound;
mod estimate;
mod fixtures;
mod horizon;
mod index;
mod invariants;
mod oracle;
mod settings;
mod spatial;
mod support;
