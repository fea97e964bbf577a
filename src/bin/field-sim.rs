//! The sensor nodes and the slot clock, as a process of the ring.

use iceoryx2::prelude::ipc;
use skysink::worker::{self, NoArguments};
use skysink_field_sim::node::run;
use skysink_ring::role::Role;

fn main() -> std::process::ExitCode {
    worker::main(Role::FieldSim, |scenario, folder, stop, NoArguments {}| run::<ipc::Service>(scenario, folder, stop))
}
