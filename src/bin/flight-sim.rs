//! The UAV and its radio channel, as a process of the ring.

fn main() -> std::process::ExitCode {
    skysink::programs::flight_sim(std::env::args_os().collect()).into()
}
