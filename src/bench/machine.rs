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
    /// Memory [MiB].
    pub memory_mib: u64,
    /// Release of the kernel.
    pub kernel: String,
    /// The compiler.
    pub rustc: &'static str,
    /// How it was built: `release` or `debug`.
    pub build: &'static str,
    /// Load average over the last minute, before the first measurement: what else runs here.
    pub load_average: f64,
}

impl Machine {
    /// This one; what the system does not say is empty or 0.
    pub fn this() -> Self {
        let read = |path| fs::read_to_string(path).unwrap_or_default();
        let value = |text: &str, key: &str| {
            let line = text.lines().find(|line| line.starts_with(key));
            line.and_then(|line| line.split_once(':')).map_or_else(String::new, |(_, value)| value.trim().to_owned())
        };
        let memory = value(&read("/proc/meminfo"), "MemTotal");
        let first_word = |text: &str| text.split_ascii_whitespace().next().unwrap_or_default().to_owned();
        Self {
            cpu: value(&read("/proc/cpuinfo"), "model name"),
            cores: cores(),
            memory_mib: first_word(&memory).parse::<u64>().unwrap_or(0) / 1024,
            kernel: read("/proc/sys/kernel/osrelease").trim().to_owned(),
            rustc: env!("SKYSINK_RUSTC"),
            build: if cfg!(debug_assertions) { "debug" } else { "release" },
            load_average: first_word(&read("/proc/loadavg")).parse().unwrap_or(0.0),
        }
    }
}

/// Cores that this process may use.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
