//! The options of `skysink bench`, and of the processes that it starts.

use std::path::PathBuf;
use std::time::Duration;

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use skysink_common::stop::Stop;
use skysink_ring::wait::Waiting;

use crate::bench::hop::{Medium, Place, Rounds};
use crate::bench::{Effort, Part, measure};
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
    only: Vec<PartName>,
}

impl BenchOptions {
    /// Measures, and prints what was measured.
    ///
    /// # Errors
    /// If an executable is missing or fails, or on a stop.
    pub fn bench(&self, stop: &Stop) -> Result<(), Error> {
        let effort = if self.quick { Effort::Quick } else { Effort::Full };
        let parts: Vec<Part> = self.only.iter().map(|name| name.0).collect();
        let report = measure(if parts.is_empty() { &Part::ALL } else { &parts }, effort, stop)?;
        if self.json {
            println!("{}", report.to_json());
        } else {
            print!("{report}");
        }
        Ok(())
    }
}

/// A part by its name.
#[derive(Debug, Clone, Copy)]
struct PartName(Part);

impl ValueEnum for PartName {
    fn value_variants<'a>() -> &'a [Self] {
        const { &[Self(Part::Planner), Self(Part::Field), Self(Part::Mission), Self(Part::Ring), Self(Part::Transport)] }
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(match self.0 {
            Part::Planner => PossibleValue::new("planner").help("a slot's plan, by strategy and number of SNs"),
            Part::Field => PossibleValue::new("field").help("a slot of the field, beside a copy"),
            Part::Mission => PossibleValue::new("mission").help("missions in one process, on one core and on all"),
            Part::Ring => PossibleValue::new("ring").help("the ring of processes, beside bare hops"),
            Part::Transport => PossibleValue::new("transport").help("bare hops by shared memory and by UNIX sockets"),
        })
    }
}

/// What `skysink bench` tells the processes that it starts.
#[derive(Debug, Args)]
pub struct HopOptions {
    folder: PathBuf,
    place: usize,
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
        let (medium, wait, sensors, rounds) = (self.medium, self.wait, self.sensors, self.rounds);
        let rounds = Rounds { medium, wait, sensors, rounds, period: Duration::from_micros(self.period_us) };
        Place { folder: self.folder, place: self.place }.hop(rounds, stop)
    }
}

fn medium(text: &str) -> Result<Medium, String> {
    let all = [Medium::SharedMemory, Medium::Socket];
    all.into_iter().find(|medium| medium.name() == text).ok_or_else(|| "expected a medium".to_owned())
}
