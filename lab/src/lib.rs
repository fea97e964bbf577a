//! Evaluation: sweeps, metrics, plots, comparisons, the search for the best known flight, import of positions and
//! export of runs. The only crate that depends on arrow, resvg, krilla and map formats.

pub mod compare;
mod drawing;
mod error;
pub mod export;
pub mod import;
pub mod least_fleet;
pub mod optimize;
mod parquet_file;
pub mod plot;
pub mod progress;
pub mod statistics;
pub mod sweep;
pub mod tables;

pub use error::LabError;
