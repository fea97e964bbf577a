//! The bridge in closed loops with kinematic vehicles, without sockets and processes.

mod doubts;
mod faults;
mod fleets;
mod flight;
mod missions;
mod page;
mod pilots;
mod restarts;
mod storm;
