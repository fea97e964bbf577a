//! The bridge and kinematic vehicles, without sockets, clocks and processes.

mod doubts;
mod fleets;
mod flight;
mod missions;
mod pilot;
mod rearmed;
mod restarts;
mod stops;
