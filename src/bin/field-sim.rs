//! The sensor nodes and the slot clock, as a process of the ring.

fn main() -> std::process::ExitCode {
    skysink::programs::field_sim(std::env::args_os().collect()).into()
}
