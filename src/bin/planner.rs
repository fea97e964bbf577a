//! The planner, schedule and waypoint of each slot, as a process of the ring.

use iceoryx2::prelude::ipc;
use skysink::worker;
use skysink_ring::role::Role;

fn main() -> std::process::ExitCode {
    worker::main(Role::Planner, skysink_planner::node::run::<ipc::Service>)
}
