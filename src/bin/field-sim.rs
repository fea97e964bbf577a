//! The sensor nodes and the slot clock, as a process of the ring.

use iceoryx2::prelude::ipc;
use skysink::worker;
use skysink_ring::role::Role;

fn main() -> std::process::ExitCode {
    worker::main(Role::FieldSim, skysink_field_sim::node::run::<ipc::Service>)
}
