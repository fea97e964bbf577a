//! The transport of the ring. Only this crate, the nodes, the launcher and the benchmarks depend on iceoryx2.
//!
//! The messages themselves are left to `skysink-common`. Each file imports only files above it:
//!
//! | file | contents |
//! |---|---|
//! | [`error`] | errors of a ring and of its processes |
//! | [`role`] | the roles of the processes, and their locks |
//! | [`wait`] | waiting for samples, stops and timeouts |
//! | [`terms`] | the parameters of a run, common to its processes |
//! | [`home`] | the folder of a user's rings, and the removal of abandoned ones |
//! | [`folder`] | the folder of a ring |
//! | [`health`], [`refusals`] | events of processes; refused samples |
//! | [`cleanup`] | removal of the resources of killed processes |
//! | [`records`], [`journal`] | records that survive a kill; what a restarted process resumes from |
//! | [`sample`], [`topic`] | samples; a topic |
//! | [`admission`], [`reader`], [`writer`] | the two ends of a topic |
//! | [`survey`] | the state of the topics, as observed from outside |
//! | [`topics`] | the table of topics, and the ring made from it |
//! | [`join`] | joining a ring |

pub mod admission;
pub mod cleanup;
pub mod error;
pub mod folder;
pub mod health;
pub mod home;
pub mod join;
pub mod journal;
pub mod reader;
pub mod records;
pub mod refusals;
pub mod role;
pub mod sample;
pub mod survey;
pub mod terms;
pub mod topic;
pub mod topics;
pub mod wait;
pub mod writer;
