//! The planner process of the ring: plans schedule and waypoint of each slot.

fn main() -> std::process::ExitCode {
    skysink::programs::planner(std::env::args_os().collect()).into()
}
