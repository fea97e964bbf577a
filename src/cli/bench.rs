//! The options of `skysink bench`, and of the processes that it starts.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use skysink_common::stop::Stop;
use skysink_ring::wait::Waiting;

use crate::bench::hop::{HopProcess, HopRounds};
use crate::bench::medium::Medium;
use crate::bench::{BenchPart, Effort, measure};
use crate::error::Error;

/// Options of `skysink bench`.
#[derive(Debug, Args)]
pub struct BenchOptions {
    /// Only whether it works, and about how fast: seconds instead of minutes.
    #[arg(long)]
    quick: bool,
    /// Print the measurements for machines.
    #[arg(long)]
    json: bool,
    /// Measure this only (repeatable).
    #[arg(long, value_name = "PART")]
    only: Vec<BenchPart>,
}

impl BenchOptions {
    /// Measures, and prints what was measured.
    ///
    /// # Errors
    /// If an executable is missing or fails, or on a stop.
    pub fn bench(&self, stop: &Stop) -> Result<(), Error> {
        let effort = if self.quick { Effort::Quick } else { Effort::Full };
        let report = measure(&self.only, effort, stop)?;
        if self.json {
            println!("{}", report.to_json());
        } else {
            print!("{report}");
        }
        Ok(())
    }
}

/// What `skysink bench` tells the processes that it starts.
#[derive(Debug, Args)]
pub struct HopOptions {
    folder: PathBuf,
    index: usize,
    #[arg(value_parser = medium)]
    medium: Medium,
    wait: Waiting,
    sensors: u32,
    rounds: u64,
    period_us: u64,
}

impl HopOptions {
    /// Takes its part.
    ///
    /// # Errors
    /// If another process is missing.
    pub fn hop(self, stop: &Stop) -> Result<(), Error> {
        let Self { medium, wait, sensors, rounds, .. } = self;
        let rounds = HopRounds { medium, wait, sensors, rounds, period: Duration::from_micros(self.period_us) };
        HopProcess { folder: self.folder, index: self.index }.run(rounds, stop)
    }
}

fn medium(text: &str) -> Result<Medium, String> {
    Medium::ALL.into_iter().find(|medium| medium.name() == text).ok_or_else(|| "expected a medium".to_owned())
}
