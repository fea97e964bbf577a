//! The command line, and the launcher of the ring's processes ([`run`]).
//!
//! The model, the planner and the evaluation are in the other crates of the workspace.

mod check;
pub mod cli;
#[cfg(feature = "lab")]
mod compare;
mod error;
mod join;
mod new;
mod options;
pub mod programs;
mod replay;
pub mod report;
pub mod run;
mod simulate;
#[cfg(feature = "viewer")]
mod slot_views;
mod topics;
mod unflown;
pub mod usage;
mod view;
pub mod worker;

pub use error::Error;
