//! Peers that send nonsense, take places that are not theirs, or do not listen: what they cannot do to a run.

#[path = "hostile/audit.rs"]
mod audit;
#[path = "hostile/intruder.rs"]
mod intruder;
#[path = "hostile/messages.rs"]
mod messages;
#[path = "hostile/modes.rs"]
mod modes;
#[cfg(feature = "viewer")]
#[path = "hostile/paths.rs"]
mod paths;
#[path = "hostile/places.rs"]
mod places;
#[path = "hostile/plans.rs"]
mod plans;
#[path = "hostile/readers.rs"]
mod readers;
#[path = "hostile/rogue.rs"]
mod rogue;
mod support;
#[path = "hostile/told.rs"]
mod told;
#[path = "hostile/writers.rs"]
mod writers;
