//! Peers that send invalid samples, write the topics of others, or do not read: none of them changes a run.

mod audit;
mod flights;
mod hung;
mod intruder;
mod messages;
mod modes;
#[cfg(feature = "viewer")]
mod paths;
mod places;
mod plans;
mod readers;
mod rogue;
mod told;
mod writers;
