//! Which figures `skysink figures` makes, and of what.

use std::path::PathBuf;

use clap::ValueEnum;
use serde::Deserialize;

/// Search steps of `horizon` in a slot, if nothing else is wanted: the sparse fields take four times as many.
pub const HORIZON_ITERATIONS: u32 = 2_000;

/// A group of figures with sweeps of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum FigurePart {
    /// Against the area, the letter's Fig. 2 (a).
    Area,
    /// Against the area, up to 1 000 m.
    Sparse,
    /// Against the sampling rate, Fig. 2 (b).
    Rate,
    /// Planning time of a slot.
    Time,
    /// Against the mission's time, Fig. 2 (c).
    MissionTime,
    /// What it costs not to know the queues.
    Knowledge,
    /// What the third dimension is worth.
    Altitude,
    /// Trajectories.
    Maps,
}

/// What the figures are made of.
#[derive(Debug, Clone)]
pub struct Choice {
    /// Which of them; all if none is named.
    pub only: Vec<FigurePart>,
    /// Missions per point.
    pub runs: u64,
    /// Search steps of `horizon` in a slot.
    pub horizon_iterations: u32,
    /// Missions at the same time, 0 for one per core.
    pub threads: usize,
    /// Folder of the figures.
    pub out: PathBuf,
}

impl Choice {
    /// Whether figures of this part are to be drawn.
    pub(super) fn wants(&self, part: FigurePart) -> bool {
        self.only.is_empty() || self.only.contains(&part)
    }

    /// Version and command, for descriptions and tables.
    pub(super) fn command(&self) -> String {
        let steps = match self.horizon_iterations {
            HORIZON_ITERATIONS => String::new(),
            steps => format!(" --horizon-iterations {steps}"),
        };
        format!("skysink {} · skysink figures --runs {}{steps}", env!("CARGO_PKG_VERSION"), self.runs)
    }
}
