//! Research: sweeps, metrics, figures, the search for the best known flight, imports. The only crate that knows arrow
//! and resvg.

mod ages;
mod error;
pub mod figures;
pub mod import;
mod metrics;
pub mod optimize;
pub mod progress;
pub mod sweep;

pub use error::LabError;
