//! The figures of `skysink figures` and their settings.

use std::path::PathBuf;

use clap::ValueEnum;
use serde::Deserialize;

/// Default number of search steps of `horizon` per slot. Sparse fields use four times as many.
pub const HORIZON_ITERATIONS: u32 = 2_000;

/// A group of figures with their own sweeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum FigurePart {
    /// Loss against the side of the area, the paper's Fig. 2 (a).
    Area,
    /// Loss against the side of the area, up to 1 000 m.
    Sparse,
    /// Loss against the sampling rate, the paper's Fig. 2 (b).
    Rate,
    /// Planning time per slot.
    Time,
    /// Loss against the duration of the mission, the paper's Fig. 2 (c).
    MissionTime,
    /// Loss with estimated queues and rates.
    Knowledge,
    /// Loss with fixed and free altitude.
    Altitude,
    /// Maps of the trajectories.
    Maps,
}

/// The figures to draw and their settings.
#[derive(Debug, Clone)]
pub struct Choice {
    /// The figures; all if empty.
    pub only: Vec<FigurePart>,
    /// Missions per point.
    pub runs: u64,
    /// Search steps of `horizon` per slot.
    pub horizon_iterations: u32,
    /// Number of threads; 0 for one per core.
    pub threads: usize,
    /// Output folder.
    pub out: PathBuf,
}

impl Choice {
    /// Whether to draw the figures of this part.
    pub(super) fn includes(&self, part: FigurePart) -> bool {
        self.only.is_empty() || self.only.contains(&part)
    }

    /// The version and the command line, for descriptions and tables.
    pub(super) fn command(&self) -> String {
        let steps = match self.horizon_iterations {
            HORIZON_ITERATIONS => String::new(),
            steps => format!(" --horizon-iterations {steps}"),
        };
        format!("skysink {} · skysink figures --runs {}{steps}", env!("CARGO_PKG_VERSION"), self.runs)
    }
}
