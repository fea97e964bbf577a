//! Evaluation: sweeps, metrics, figures, comparisons, the search for the best known flight, import of positions and
//! export of runs. The only crate that depends on arrow, resvg, krilla and map formats.

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
