//! The launcher and command line.

fn main() -> std::process::ExitCode {
    skysink::cli::main()
}
