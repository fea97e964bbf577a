//! The product: the command line, the ring as processes ([`run`]), endurance tests and benchmarks.
//!
//! What is computed lives in the crates of the workspace; here it is only put together.

#[cfg(feature = "lab")]
mod bench;
pub mod check;
pub mod cli;
#[cfg(feature = "lab")]
pub mod compare;
pub mod error;
pub mod join;
pub mod new;
pub mod programs;
pub mod replay;
pub mod report;
pub mod run;
pub mod simulate;
pub mod soak;
pub mod topics;
pub mod usage;
pub mod view;
pub mod worker;

pub use error::Error;
