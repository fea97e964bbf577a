//! Research: sweeps, metrics, figures, comparisons, the search for the best known flight, positions from and runs to the
//! formats of maps and vehicles. The only crate that knows arrow, resvg, krilla and those formats.

pub mod compare;
mod error;
pub mod export;
pub mod figures;
pub mod import;
pub mod metrics;
pub mod optimize;
mod parquet_file;
pub mod plot;
pub mod progress;
pub mod sweep;

pub use error::LabError;
