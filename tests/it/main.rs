//! The executables, as a user runs them. Most tests wait for processes or for real time, so several of them run at once
//! on the smallest machine, too. What needs rights or programs that not every machine has is ignored there, and says
//! which command brings them.

#[macro_use]
extern crate skysink_trial;

mod agreement;
mod arrivals;
mod changes;
mod channel_map;
mod channel_table;
mod check;
mod cli;
#[cfg(feature = "lab")]
mod compare;
#[cfg(all(feature = "lab", feature = "viewer"))]
mod docs;
mod examples;
mod export;
mod external;
mod farm;
mod fixtures;
mod fleet;
mod folders;
#[cfg(feature = "lab")]
mod foreign_lists;
#[cfg(feature = "lab")]
mod foreign_zones;
mod help;
mod hosts;
mod imports;
mod invariants;
mod keys;
#[cfg(feature = "lab")]
mod least_fleet;
#[cfg(feature = "lab")]
mod library;
#[cfg(feature = "mavlink")]
mod mavlink;
mod medium;
mod motion;
mod names;
mod new;
mod nodes;
mod objectives;
mod optimize;
mod other_hosts;
#[cfg(feature = "lab")]
mod outcomes;
#[cfg(feature = "lab")]
mod plans;
mod plot;
mod presets;
mod printed_commands;
#[cfg(feature = "viewer")]
mod recording;
mod refusals;
mod release;
mod replay;
mod report;
mod reproduce;
mod resume;
mod ring;
mod ring_planners;
mod settings;
#[cfg(feature = "lab")]
mod style;
#[path = "../support/mod.rs"]
mod support;
mod surveys;
#[cfg(feature = "lab")]
mod sweep;
#[cfg(feature = "lab")]
mod tables;
mod topics;
mod track;
#[cfg(feature = "lab")]
mod unflown;
mod vehicle;
#[cfg(feature = "viewer")]
mod view;

use std::num::NonZero;
use std::process::ExitCode;
use std::thread::available_parallelism;

use libtest_mimic::{Arguments, Completion, Failed};

/// Least number of tests at once, unless `--test-threads` says another number.
const THREADS: usize = 4;

/// All tests of this program.
#[linkme::distributed_slice]
pub static TRIALS: [Trial];

/// A test.
pub struct Trial {
    /// The path of its module.
    pub module: &'static str,
    /// Its name there.
    pub name: &'static str,
    /// Whether it runs only with `--ignored`.
    pub is_ignored: bool,
    /// Runs it.
    pub run: fn() -> TrialEnd,
}

/// How a test has ended that has not panicked.
pub struct TrialEnd(Completion);

impl From<()> for TrialEnd {
    fn from((): ()) -> Self {
        Self(Completion::Completed)
    }
}

/// What a test lacks on this machine, with the command that brings it.
pub struct Missing(String);

impl From<Result<(), Missing>> for TrialEnd {
    fn from(result: Result<(), Missing>) -> Self {
        Self(result.map_or_else(|Missing(what)| Completion::ignored_with(what), |()| Completion::Completed))
    }
}

/// The module whose vehicles fly by the clock: what else takes the processors would be late orders to them.
const BY_THE_CLOCK: &str = "mavlink::";

fn main() -> ExitCode {
    if let Some(example) = ring_planners::example() {
        return example();
    }
    let mut arguments = Arguments::from_args();
    let cores = available_parallelism().map_or(1, NonZero::get);
    arguments.test_threads.get_or_insert(cores.max(THREADS));
    let trials = TRIALS.iter().map(|Trial { module, name, is_ignored, run }| {
        let module = module.split_once("::").map_or("", |(_, module)| module);
        let run = || Ok::<_, Failed>(run().0);
        libtest_mimic::Trial::ignorable_test(format!("{module}::{name}"), run).with_ignored_flag(*is_ignored)
    });
    let (by_the_clock, others): (Vec<_>, Vec<_>) = trials.partition(|trial| trial.name().starts_with(BY_THE_CLOCK));
    let ended = [by_the_clock, others].map(|trials| libtest_mimic::run(&arguments, trials));
    let failed: u64 = ended.iter().map(|suite| suite.num_failed).sum();
    if failed > 0 {
        eprintln!("{failed} tests of both suites have failed");
        return ExitCode::from(101);
    }
    ExitCode::SUCCESS
}
