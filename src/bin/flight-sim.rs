//! The UAV and its radio channel, as a process of the ring.

use iceoryx2::prelude::ipc;
use skysink::replay::process;
use skysink_flight_sim::node::run;
use skysink_ring::role::Role;

fn main() -> std::process::ExitCode {
    process::main(Role::FlightSim, run::<ipc::Service>, process::repeat_flight)
}
