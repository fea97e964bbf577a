//! A mission in one process and on record.
//!
//! [`mission`] is the round trip as plain calls, [`record`] the run folder, [`origin`] how a run was begun, [`slot_log`]
//! the trace under way, [`trace`] its lines, [`replay`] a mission on record flown again, [`recorded`] all of its slots,
//! [`summary`] what a run comes to, [`sensor_results`] what it comes to for each sensor node, [`ages`] how ages are
//! counted, [`latency`] how its times are kept. The ring as processes is left to the product.

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
