//! The field-sim process of the ring: simulates the sensor nodes and owns the slot clock.

fn main() -> std::process::ExitCode {
    skysink::programs::field_sim(std::env::args_os().collect()).into()
}
