//! What at least two of Skysink's crates speak: the scenario, the queue ledger, the link, counted random streams, the
//! messages and topics of the ring, and the wait loop of a node.
//!
//! It decides nothing: scheduling, flight and bookkeeping live in the crates that depend on this one.

pub mod arrivals;
pub mod checkpoint;
pub mod claim;
pub mod dead;
pub mod geometry;
pub mod health;
pub mod janitor;
pub mod journal;
pub mod ledger;
pub mod link;
pub mod los;
pub mod message;
pub mod node;
pub mod pace;
pub mod path;
pub mod random;
pub mod reader;
pub mod refusals;
pub mod ring;
pub mod ring_folder;
pub mod scenario;
pub mod sensors;
pub mod topic;
pub mod units;
pub mod waiting;
pub mod wide;
pub mod writer;
