//! Tests that take a minute: bounds and look-ahead over many missions.

mod bound;
mod horizon;
#[path = "../support/mod.rs"]
mod support;
