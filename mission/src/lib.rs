//! A mission in one process and on record.
//!
//! [`mission`] is the round trip as plain calls, [`record`] the run folder, [`recorded`] a run that is read from it,
//! [`origin`] how a run was begun, [`slot_log`] the trace under way, [`trace`] its lines, [`summary`] what a run comes to,
//! [`latency`] how its times are kept. The ring as processes is left to the product.

pub mod error;
pub mod latency;
pub mod mission;
pub mod origin;
pub mod record;
pub mod recorded;
pub mod slot_log;
pub mod summary;
pub mod trace;

pub use error::MissionError;
pub use mission::Mission;
