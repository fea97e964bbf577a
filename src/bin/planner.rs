//! The planner, schedule and waypoint of each slot, as a process of the ring.

use iceoryx2::prelude::ipc;
use skysink::replay::process;
use skysink_planner::node::run;
use skysink_ring::role::Role;

fn main() -> std::process::ExitCode {
    process::main(Role::Planner, run::<ipc::Service>, process::repeat_plans)
}
