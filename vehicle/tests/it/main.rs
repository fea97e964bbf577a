//! The bridge and kinematic vehicles, without sockets, clocks and processes.

mod flight;
mod missions;
mod pilot;
mod restarts;
