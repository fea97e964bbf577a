//! Missions in one process, and their records.
//!
//! | module | contents |
//! |---|---|
//! | [`mission`] | a mission as plain calls of field-sim, flight-sim and planner |
//! | [`record`], [`origin`] | the run folder; its `run.toml` |
//! | [`slot_log`], [`trace`] | writing `slots.csv`; its lines |
//! | [`replay`], [`recorded`] | a recorded mission flown again; all of its slots |
//! | [`summary`], [`sensor_results`] | the results of a run; those of each sensor node |
//! | [`ages`], [`latency`] | ages of information; latencies of the ring |
//!
//! The ring of processes is left to the root crate.

pub mod ages;
pub mod error;
pub mod latency;
pub mod mission;
pub mod origin;
pub mod record;
pub mod recorded;
pub mod replay;
pub mod sensor_results;
pub mod slot_log;
pub mod summary;
pub mod trace;

pub use error::MissionError;
pub use mission::Mission;
pub use replay::Replay;
