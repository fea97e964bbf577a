//! The command line program `skysink`, also the launcher of the ring.

fn main() -> std::process::ExitCode {
    skysink::cli::execute(std::env::args_os().collect()).into()
}
