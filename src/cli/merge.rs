//! `skysink merge`: arguments and printed results.

use clap::Args;
use skysink_common::stop::Stop;
use skysink_common::terminal::shell_path;
use skysink_lab::sweep::merge::{Merge, merge};

use crate::error::{Error, ended_early};
use crate::report::print;
use crate::unflown::warn_of_flights;

/// Merge the shards of a sweep.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink merge area-1 area-2 --out area
  skysink merge area-shards/* --out area --partial    before all shards are done")]
pub struct MergeCommand {
    #[command(flatten)]
    request: Merge,
}

impl MergeCommand {
    /// Merges the shards.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let Merge { out, .. } = &self.request;
        let merged = merge(&self.request, stop);
        let merged = merged.map_err(|error| ended_early(error, "the shards are unchanged"))?;
        print(format_args!("{} missions: {}", merged.journal.count(), out.join("results.csv").display()))?;
        warn_of_flights(&merged.unflown);
        if let [_, _, ..] = &merged.builds[..] {
            let count = merged.builds.len();
            print(format_args!("The shards were flown by {count} builds: {}", merged.builds.join("; ")))?;
        }
        match merged.missing {
            Some(missing) => print(format_args!("Not all: {missing}")),
            None => print(format_args!("Draw them: skysink plot {} --x KEY", shell_path(out))),
        }
    }
}
