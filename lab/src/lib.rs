//! Research: sweeps, metrics, figures, the search for the best known flight, and the export of runs. The only crate that
//! knows arrow, resvg and the formats of maps and vehicles.

mod ages;
pub mod compare;
mod error;
pub mod export;
pub mod figures;
pub mod metrics;
pub mod optimize;
pub mod progress;
pub mod sweep;

pub use error::LabError;
