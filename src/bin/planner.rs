//! The planner, schedule and waypoint of each slot, as a process of the ring.

use skysink::replay::process;
use skysink::worker;
use skysink_ring::role::Role;

fn main() -> std::process::ExitCode {
    worker::main(Role::Planner, process::planner)
}
