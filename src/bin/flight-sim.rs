//! The flight-sim process of the ring: simulates the UAV and its radio channel.

fn main() -> std::process::ExitCode {
    skysink::programs::flight_sim(std::env::args_os().collect()).into()
}
