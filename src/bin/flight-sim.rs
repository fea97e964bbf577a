//! The UAV and its radio channel, as a process of the ring.

use iceoryx2::prelude::ipc;
use skysink::worker;
use skysink_ring::role::Role;

fn main() -> std::process::ExitCode {
    worker::main(Role::FlightSim, skysink_flight_sim::node::run::<ipc::Service>)
}
