//! The command line, and the launcher of the ring's processes ([`run`]).
//!
//! The model, the planner and the evaluation are in the other crates of the workspace.

pub mod check;
pub mod cli;
#[cfg(feature = "lab")]
pub mod compare;
pub mod error;
pub mod join;
pub mod new;
pub mod options;
pub mod programs;
pub mod replay;
pub mod report;
pub mod run;
pub mod simulate;
#[cfg(feature = "viewer")]
mod slot_views;
pub mod topics;
pub mod usage;
pub mod view;
pub mod worker;

pub use error::Error;
