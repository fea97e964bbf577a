//! The options of `skysink optimize`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use skysink_common::node::Stop;
use skysink_common::scenario::{Overrides, Scenario, Strategy};

use super::Flown;
use crate::error::Error;
use crate::optimize::{Budget, MAX_STEPS, Optimization, optimize};
use crate::record::RunFolder;
use crate::report;
use crate::summary::Summary;

/// Options of `skysink optimize`.
#[derive(Debug, Args)]
pub struct OptimizeOptions {
    /// Scenario file.
    scenario: PathBuf,
    /// How long to search: a time such as 60s, or a number of search steps.
    #[arg(long, value_name = "BUDGET", default_value = "10s", value_parser = budget)]
    budget: Budget,
    #[command(flatten)]
    flight: Flown,
    /// Leave a recording for rerun, mission.rrd.
    #[arg(long)]
    record: bool,
}

impl OptimizeOptions {
    /// Searches, flies the best, and prints how every strategy compares.
    ///
    /// # Errors
    /// If the scenario is refused, something cannot be written, or on a stop.
    pub fn optimize(self, stop: &Stop) -> Result<(RunFolder, Summary), Error> {
        let by = |strategy| {
            let overrides = Overrides { seed: self.flight.seed, strategy: Some(strategy), ..Overrides::default() };
            Scenario::read(&self.scenario, overrides)
        };
        let scenarios = Strategy::ALL.map(by).into_iter().collect::<Result<_, _>>()?;
        let Self { budget, flight: Flown { out, force, .. }, record, .. } = self;
        let (folder, summary, optimum) = optimize(&Optimization { scenarios, budget, out, force, record }, stop)?;
        report::print_optimum(&optimum);
        Ok((folder, summary))
    }
}

fn budget(text: &str) -> Result<Budget, String> {
    let time = text.strip_suffix('s').and_then(|seconds| seconds.parse::<f64>().ok());
    let time = time.filter(|seconds| *seconds > 0.0 && *seconds <= 1e6);
    let steps = || text.parse().ok().filter(|steps| *steps <= MAX_STEPS);
    match (time, steps()) {
        (Some(seconds), _) => Ok(Budget::Time(Duration::from_secs_f64(seconds))),
        (None, Some(steps)) => Ok(Budget::Steps(steps)),
        (None, None) => Err("expected seconds, such as 60s, or search steps, at most 1000000000000".to_owned()),
    }
}
