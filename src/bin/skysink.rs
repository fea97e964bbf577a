//! The launcher and command line.

fn main() -> std::process::ExitCode {
    skysink::cli::execute(std::env::args_os().collect()).into()
}
