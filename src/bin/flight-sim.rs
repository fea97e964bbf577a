//! The UAV and its radio channel, as a process of the ring.

use skysink::replay::process;
use skysink::worker;
use skysink_ring::role::Role;

fn main() -> std::process::ExitCode {
    worker::main(Role::FlightSim, process::flight_sim)
}
