//! The bridge to vehicles over MAVLink, in the place of flight-sim.

fn main() -> std::process::ExitCode {
    skysink::programs::mavlink(std::env::args_os().collect()).into()
}
