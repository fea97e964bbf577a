//! The transport of the ring: what its processes share beside the model. The only crate beside the nodes that knows iceoryx2.
//!
//! Roles and their claims, topics with their writers and readers, waiting, journals, the folder in which the processes of a
//! run meet, and the clearing up after processes that were killed. What the messages mean is left to `skysink-common`.

pub mod claim;
pub mod dead;
pub mod health;
pub mod janitor;
pub mod journal;
pub mod node;
pub mod reader;
pub mod refusals;
pub mod ring;
pub mod ring_folder;
pub mod topic;
pub mod waiting;
pub mod writer;
