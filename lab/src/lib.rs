//! Research: sweeps, metrics, figures, and the search for the best known flight. The only crate that knows arrow and
//! resvg.

mod ages;
pub mod compare;
mod error;
pub mod figures;
pub mod metrics;
pub mod optimize;
pub mod progress;
pub mod sweep;

pub use error::LabError;
