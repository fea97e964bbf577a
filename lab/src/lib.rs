//! Evaluation: sweeps, metrics, plots, comparisons, the search for the best known flight, import of positions and
//! export of runs. The only crate that depends on resvg, krilla and map formats.

pub mod compare;
mod drawing;
mod error;
pub mod export;
pub mod import;
pub mod least_fleet;
pub mod optimize;
pub mod plot;
pub mod progress;
pub mod statistics;
pub mod sweep;
pub mod unflown;

pub use error::LabError;
