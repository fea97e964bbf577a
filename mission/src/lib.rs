//! Missions in one process, and their records.
//!
//! | module | contents |
//! |---|---|
//! | [`plant`] | field-sim and flight-sim as plain calls |
//! | [`drive`] | driving a mission: pilots plan its slots, observers take them in |
//! | [`mission`] | a plant with its planner |
//! | [`files`], [`folder`] | files that are whole or absent; a folder of results, locked and replaced |
//! | [`record`], [`origin`] | the run folder; its `run.toml` |
//! | [`slot_log`], [`trace`] | writing `slots.csv`; its lines |
//! | [`recorded`], [`replay`] | the pilot of a trace on record; a run flown again |
//! | [`figures`], [`metrics`] | the table of all figures of a mission; those that are columns of sweeps |
//! | [`sums`], [`tally`], [`meter`] | what figures are computed from; the figures of a run; those of a mission with its field |
//! | `trapped` | UAVs that stay in one part of the area |
//! | [`bounds`] | what no flight exceeds |
//! | [`summary`], `losses`, [`sensor_results`] | parts of the results of a run; those of each sensor node |
//! | [`numbers`] | how reports print numbers, and how evenly they are spread |
//! | [`unflown`] | plans that were not flown as they were decided |
//! | [`ages`], [`service_gaps`] | ages of information; the gaps between services |
//! | [`latency`] | latencies of the ring |
//!
//! The ring of processes is left to the root crate.

pub mod ages;
pub mod bounds;
pub mod drive;
pub mod error;
pub mod figures;
pub mod files;
pub mod folder;
pub mod latency;
mod losses;
pub mod meter;
pub mod metrics;
pub mod mission;
pub mod numbers;
pub mod origin;
pub mod plant;
pub mod record;
pub mod recorded;
pub mod replay;
pub mod sensor_results;
pub mod service_gaps;
pub mod slot_log;
pub mod summary;
pub mod sums;
pub mod tally;
pub mod trace;
mod trapped;
pub mod unflown;

pub use drive::drive;
pub use error::MissionError;
pub use mission::Mission;
pub use plant::Plant;
pub use replay::Replay;
pub use skysink_flight_sim::Orders;
