//! The viewer process of the ring: writes the rerun recording.

fn main() -> std::process::ExitCode {
    skysink::programs::viewer(std::env::args_os().collect()).into()
}
