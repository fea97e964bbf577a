//! Fuzzing: any bytes for everything that reads what it has not written itself.
//!
//! A target is a function of the bytes that panics when it finds something wrong: not only a crash, but a broken
//! promise. [`campaign`] makes inputs from the corpus on any toolchain; `fuzz_targets` gives the same functions to
//! libFuzzer.

pub mod campaign;
pub mod corpus;
pub mod cursor;
pub mod mutation;
pub mod targets;

pub use targets::{TARGETS, Target};
