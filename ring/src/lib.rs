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
//! | [`folder`] | the folder of a ring |
//! | [`health`], [`refusals`] | events of processes; refused samples |
//! | [`cleanup`] | removal of the resources of killed processes |
//! | [`journal`] | records from which a restarted process resumes |
//! | [`sample`], [`topic`] | samples; a topic |
//! | [`admission`], [`reader`], [`writer`] | the two ends of a topic |
//! | [`survey`] | the state of the topics, as observed from outside |
//! | [`topics`] | the table of topics |

pub mod admission;
pub mod cleanup;
pub mod error;
pub mod folder;
pub mod health;
pub mod journal;
pub mod reader;
pub mod refusals;
pub mod role;
pub mod sample;
pub mod survey;
pub mod terms;
pub mod topic;
pub mod topics;
pub mod wait;
pub mod writer;
