//! The command line program `skysink`, also the launcher of the ring.

fn main() -> std::process::ExitCode {
    skysink::programs::skysink(std::env::args_os().collect()).into()
}
