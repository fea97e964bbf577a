//! The machine on which something was measured.

use std::fs;

use serde::Serialize;

/// What a measurement depends on besides the program.
#[derive(Debug, Default, Serialize)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// The compiler.
    pub rustc: &'static str,
    /// How it was built: `release` or `debug`.
    pub build: &'static str,
    /// Load average over the last minute, before the first measurement: what else runs here.
    pub load_average: f64,
}

impl Machine {
    /// This machine; what the system does not tell is empty or 0.
    pub fn this() -> Self {
        let read = |path| fs::read_to_string(path).unwrap_or_default();
        let processor = read("/proc/cpuinfo");
        let model = processor.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or_default();
        let load = read("/proc/loadavg");
        Self {
            cpu: model.trim_start_matches([' ', '\t', ':']).to_owned(),
            cores: cores(),
            rustc: env!("SKYSINK_RUSTC"),
            build: if cfg!(debug_assertions) { "debug" } else { "release" },
            load_average: load.split(' ').next().and_then(|minute| minute.parse().ok()).unwrap_or(0.0),
        }
    }
}

/// Cores that this process may use.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
