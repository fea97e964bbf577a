//! The model: the scenario, the sensor list, the queue ledger, the channel, counted random streams, the messages of the
//! ring, and written files that are compared with what is there.
//!
//! Scheduling, flight and bookkeeping are left to the crates that depend on this one.

pub mod airspace;
pub mod arrivals;
pub mod base;
pub mod battery;
pub mod belief;
pub mod build;
pub mod channel;
pub mod checkpoint;
pub mod csv_cell;
mod csv_rows;
pub mod error;
pub mod estimate;
pub mod figure;
pub mod file_locks;
pub mod geodata;
pub mod geometry;
pub mod interpolation;
pub mod keys;
pub mod ledger;
pub mod limits;
pub mod link_places;
pub mod loss_rate;
pub mod markup;
pub mod message;
pub mod nodes;
pub mod option_value;
pub mod pace;
pub mod per_sensor;
pub mod possible;
pub mod presets;
pub mod propulsion;
pub mod queues;
pub mod random;
pub mod reported;
pub mod sampling;
pub mod scenario;
pub mod sensors;
mod shared;
pub mod simd;
pub mod slack;
pub mod slot_record;
pub mod stop;
pub mod terminal;
pub mod units;
pub mod weights;
pub mod written_file;
