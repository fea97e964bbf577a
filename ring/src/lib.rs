//! The transport of the ring: what its processes share beside the model. With the nodes, the
//! launcher and the benchmarks all that knows iceoryx2.
//!
//! What the messages mean is left to `skysink-common`. Each file imports only files above it:
//!
//! | file | holds |
//! |---|---|
//! | [`error`] | why a ring cannot be used, why a process ends early |
//! | [`role`] | who takes part; the seat of a role |
//! | [`wait`] | how a process waits, and what ends a wait |
//! | [`terms`] | what the processes of a run agree on |
//! | [`folder`] | where they meet |
//! | [`health`], [`refusals`] | what becomes of processes; what they do not accept |
//! | [`cleanup`] | what killed processes leave behind |
//! | [`journal`] | what a process saves across its own death |
//! | [`sample`], [`topic`] | what a sample is; a topic |
//! | [`admission`], [`reader`], [`writer`] | the two ends of a topic |
//! | [`survey`] | what a look at a topic from outside shows |
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
