//! The model: the scenario, the sensor list, the queue ledger, the channel, counted random streams, the messages of the
//! ring, and written files that are compared with what is there.
//!
//! Scheduling, flight and bookkeeping are left to the crates that depend on this one. Each folder uses those before it
//! in this list, and none after it:
//!
//! | folder | contents |
//! |---|---|
//! | `numbers` | units, random streams, slacks against rounding, shared values |
//! | `text` | errors, tables, checkpoints, files that are written |
//! | `space` | positions, where UAVs may fly, and where they land |
//! | [`geodata`] | maps and reference systems |
//! | [`keys`] | the keys of a scenario file, and presets |
//! | [`channel`] | links: laws, draws and rates |
//! | [`nodes`] | what sensor nodes sample, store and lose, and their features |
//! | [`scenario`] | the mission as its file says it |
//! | `messages` | the messages of the ring, the rows of a slot, figures |
//! | [`sensors`] | the sensor nodes of a mission |
//! | [`belief`] | what a UAV believes of them |

pub mod belief;
pub mod channel;
pub mod geodata;
pub mod keys;
mod messages;
pub mod nodes;
mod numbers;
pub mod scenario;
pub mod sensors;
mod space;
mod text;

pub use belief::{estimate, reported};
pub use geodata::option_value;
pub use keys::presets;
pub use messages::{figure, message, possible, slot_record, told};
pub use nodes::{arrivals, ledger, queues, sampling, weights};
pub(crate) use numbers::shared;
pub use numbers::{interpolation, per_sensor, random, simd, slack, units};
pub use scenario::{battery, limits, loss_rate, propulsion};
pub use sensors::link_places;
pub use space::{airspace, base, geometry};
pub(crate) use text::csv_rows;
pub use text::{build, checkpoint, csv_cell, error, file_locks, markup, pace, stop, terminal, written_file};
