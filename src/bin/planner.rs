//! The planner, schedule and waypoint of each slot, as a process of the ring.

fn main() -> std::process::ExitCode {
    skysink::programs::planner(std::env::args_os().collect()).into()
}
