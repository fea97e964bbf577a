//! Skysink's joined-up parts: the ring as plain calls ([`mission`]) and as processes ([`launch`]), what a run leaves
//! behind ([`record`]), and the command line.
//!
//! What is computed lives in the crates of the workspace; here it is only put together.

pub mod bench;
pub mod cli;
pub mod error;
pub mod figures;
pub mod latency;
pub mod launch;
pub mod metrics;
pub mod mission;
pub mod optimize;
pub mod propulsion;
pub mod record;
pub mod recorder;
pub mod report;
pub mod restart;
pub mod resume;
pub mod run;
pub mod simulate;
pub mod soak;
pub mod summary;
pub mod sweep;
pub mod watch;
pub mod worker;

pub use error::Error;
