//! `skysink merge`: merges the shards of a sweep. The result equals that of the whole sweep.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use skysink_common::error::InputError;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;

use super::definition::Definition;
use super::folder::{JOURNAL, SweepRecord};
use super::journal::{MissionRow, MissionRows, SweepJournal, read};
use super::manifest::{Manifest, SCENARIO, add_builds};
use super::plan::Sweep;
use super::saved::external;
use super::settings::SweepChanges;
use super::shard::Shard;
use crate::error::LabError;
use crate::unflown::UnflownFlights;
use skysink_mission::metrics::Metric;

/// The parameters of a merge.
#[derive(Debug, Args)]
pub struct Merge {
    /// Output folders of the shards.
    #[arg(required = true)]
    pub shards: Vec<PathBuf>,
    /// Output folder.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Accept missing missions.
    #[arg(long)]
    pub partial: bool,
}

/// A merged sweep.
#[derive(Debug)]
pub struct Merged {
    /// Its missions.
    pub journal: SweepJournal,
    /// For a partial merge: the number of missions, and the shards to run.
    pub missing: Option<String>,
    /// Commit, compiler and target of each program that flew a shard.
    pub builds: Vec<String>,
    /// The flights whose plans were not flown as they were decided.
    pub unflown: Vec<UnflownFlights>,
}

/// Merges the shards of a sweep.
///
/// # Errors
/// If the shards belong to different sweeps or contradict each other, if missions are missing and it is not partial, or
/// on a stop.
///
/// # Panics
/// If there are no shards.
pub fn merge(Merge { shards, out, partial }: &Merge, stop: &Stop) -> Result<Merged, LabError> {
    let mut folders = BTreeSet::new();
    let mut first: Option<Shards> = None;
    for path in shards {
        let refuse = |message: &str| InputError::new("shard", path, message);
        let manifest = Manifest::read("shard", path)?;
        if !folders.insert(fs::canonicalize(path).at(path)?) {
            return Err(refuse("it is given twice: expected each shard once").into());
        }
        let Some(Manifest { definition, shard, builds }) = manifest else { continue };
        let found = first.get_or_insert_with(|| Shards::of(definition.clone()));
        if found.definition != definition {
            return Err(refuse("it belongs to another sweep than the first").into());
        }
        let (_, n) = shard.into();
        found.n = found.n.max(n);
        found.add(path, stop)?;
        add_builds(&mut found.builds, builds);
    }
    let Some(found) = first else {
        return Err(InputError::new("shard", &shards[0], "no shard contains a mission: run them first").into());
    };
    let missing = found.missing();
    if let (false, Some(missing)) = (partial, &missing) {
        return Err(InputError::new("sweep folder", out, format_args!("{missing}, or pass --partial")).into());
    }
    let (files, unflown) = match shards.iter().find(|shard| shard.join(SCENARIO).exists()) {
        Some(shard) => {
            let models = found.definition.models.clone();
            let changes = SweepChanges { models, ..SweepChanges::default() };
            let sweep = Sweep::read(shard, external(shard, &found.definition)?, changes)?;
            (sweep.files()?, UnflownFlights::of_sweep(&sweep, &found.rows)?)
        }
        None => (Vec::new(), Vec::new()), // all were killed before they wrote it
    };
    let Shards { definition, builds, rows, .. } = found;
    let mut record =
        SweepRecord::of(Manifest { shard: Shard::WHOLE, builds: builds.clone(), definition }, &files, out)?;
    for row in rows.values() {
        stop.check()?;
        record.add(row)?;
    }
    Ok(Merged { journal: record.write(stop)?, missing, builds, unflown })
}

/// The missions in the shards of a sweep.
struct Shards {
    definition: Definition,
    /// The builds of all shards, in order.
    builds: Vec<String>,
    /// The largest number of shards in the manifests.
    n: usize,
    rows: MissionRows,
}

impl Shards {
    fn of(definition: Definition) -> Self {
        Self { builds: Vec::new(), definition, n: 1, rows: MissionRows::new() }
    }

    /// Adds the missions in the journal of a folder, if it has one.
    fn add(&mut self, folder: &Path, stop: &Stop) -> Result<(), LabError> {
        let journal = folder.join(JOURNAL);
        if !journal.is_file() {
            return Ok(());
        }
        for (key, row) in read(&journal, &self.definition)? {
            stop.check()?;
            if self.rows.insert(key, row).is_some_and(|other| !is_same(&row, &other)) {
                let message = "its results differ from those of another shard for the same missions: \
                               expected shards from the same executable";
                return Err(InputError::new("shard", folder, message).into());
            }
        }
        Ok(())
    }

    /// The number of missions, and the shards with missing ones; `None` if all are present.
    fn missing(&self) -> Option<String> {
        let expected = self.definition.mission_count();
        let count = self.rows.len();
        if count == expected {
            return None;
        }
        let n = self.n;
        let all = self.definition.missions(Shard::WHOLE).enumerate();
        let missing = all.filter(|(_, mission)| !self.rows.contains_key(mission));
        let shards = ranges(&missing.map(|(index, _)| self.definition.shard_of(index, n)).collect());
        let remedy = format!("for example by --array={shards} and --shard $SLURM_ARRAY_TASK_ID/{n}");
        Some(format!("{count} of {expected} missions are present: run shards {shards} of {n}, {remedy}"))
    }
}

/// Whether two missions have the same metrics, but for those that depend on the clock.
fn is_same(row: &MissionRow, other: &MissionRow) -> bool {
    Metric::all().filter(|metric| !metric.is_timing()).all(|metric| row[metric].to_bits() == other[metric].to_bits())
}

/// Formats numbers as a list of ranges, such as `1,3-5`.
fn ranges(numbers: &BTreeSet<usize>) -> String {
    let mut ranges: Vec<[usize; 2]> = Vec::new();
    for &number in numbers {
        match ranges.last_mut() {
            Some([_, last]) if *last + 1 == number => *last = number,
            _ => ranges.push([number; 2]),
        }
    }
    let text = |&[first, last]: &[usize; 2]| if first == last { first.to_string() } else { format!("{first}-{last}") };
    ranges.iter().map(text).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn consecutive_numbers_are_printed_as_ranges() {
        for (numbers, text) in [(&[][..], ""), (&[4], "4"), (&[1, 3, 4, 5, 9, 10], "1,3-5,9-10")] {
            assert_eq!(ranges(&numbers.iter().copied().collect()), text);
        }
    }
}
