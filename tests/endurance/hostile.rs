//! Peers that send nonsense, take places that are not theirs, or do not listen: what they cannot do to a run.

mod audit;
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
