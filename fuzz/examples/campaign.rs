//! The kept inputs, and many more made of them, on any toolchain.

use std::path::PathBuf;
use std::process::ExitCode;
use std::thread;
use std::time::Instant;

use clap::Parser;
use skysink_fuzz::campaign::{Campaign, CampaignError, check, replay, run};
use skysink_fuzz::{TARGETS, Target};

/// Gives anything to whatever reads what Skysink has not written itself.
#[derive(Debug, Parser)]
#[command(name = "campaign")]
struct Options {
    /// What is fuzzed [default: everything].
    #[arg(value_name = "TARGET", value_parser = target)]
    targets: Vec<Target>,
    /// Inputs for each target.
    #[arg(long, default_value_t = 1_000_000)]
    inputs: u64,
    /// Seed of the inputs.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; the inputs are the same.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=256))]
    jobs: u64,
    /// Give the target this file, and nothing else.
    #[arg(long, value_name = "FILE", requires = "targets")]
    replay: Option<PathBuf>,
}

fn main() -> ExitCode {
    let options = Options::parse();
    let targets = if options.targets.is_empty() { TARGETS.to_vec() } else { options.targets.clone() };
    for target in targets {
        if let Err(error) = fuzz(target, &options) {
            eprintln!("error: {error}");
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

fn fuzz(target: Target, options: &Options) -> Result<(), CampaignError> {
    if let Some(file) = &options.replay {
        return check(target, &std::fs::read(file)?, || Ok(file.clone()));
    }
    let begin = Instant::now();
    let kept = replay(target)?;
    thread::scope(|scope| {
        let share = |job: u64| options.inputs * job / options.jobs;
        let campaign = |job| Campaign { seed: options.seed, inputs: share(job)..share(job + 1) };
        let jobs: Vec<_> =
            (0..options.jobs).map(campaign).map(|campaign| scope.spawn(move || run(target, campaign))).collect();
        jobs.into_iter().try_for_each(|job| job.join().expect("a campaign catches the panics of its target"))
    })?;
    let seconds = begin.elapsed().as_secs_f64();
    println!("{}: {kept} kept and {} new inputs in {seconds:.1} s, nothing wrong", target.name, options.inputs);
    Ok(())
}

fn target(name: &str) -> Result<Target, String> {
    let names = || TARGETS.map(|target| target.name).join(", ");
    Target::named(name).ok_or_else(|| format!("expected one of {}", names()))
}
