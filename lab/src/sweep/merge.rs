//! `skysink merge`: merges the shards of a sweep. The result equals that of the whole sweep.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use skysink_common::error::InputError;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use xxhash_rust::xxh3::Xxh3;

use super::definition::Definition;
use super::folder::{JOURNAL, SweepRecord};
use super::journal::{CheckSeeds, JournalLines, MissionRow, SweepJournal};
use super::manifest::{Manifest, SCENARIO, add_builds};
use super::plan::Sweep;
use super::saved::external;
use super::settings::SweepChanges;
use super::shard::Shard;
use crate::error::LabError;
use crate::metrics::Metric;

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
    let files = match shards.iter().find(|shard| shard.join(SCENARIO).exists()) {
        Some(shard) => {
            let models = found.definition.models.clone();
            let changes = SweepChanges { models, ..SweepChanges::default() };
            Sweep::read(shard, external(shard, &found.definition)?, changes)?.files()?
        }
        None => Vec::new(), // all were killed before they wrote it
    };
    let Shards { definition, builds, .. } = &found;
    let manifest = Manifest { shard: Shard::WHOLE, builds: builds.clone(), definition: definition.clone() };
    let mut record = SweepRecord::of(manifest, &files, out)?;
    for journal in &found.journals {
        for row in JournalLines::open(journal, definition, &found.seeds)? {
            stop.check()?;
            record.add(&row?)?;
        }
    }
    Ok(Merged { journal: record.write(stop)?, missing, builds: found.builds })
}

/// The missions in the shards of a sweep.
struct Shards {
    definition: Definition,
    seeds: CheckSeeds,
    /// The builds of all shards, in order.
    builds: Vec<String>,
    /// The largest number of shards in the manifests.
    n: usize,
    journals: Vec<PathBuf>,
    /// The hash of each mission's metrics, in the order of the results; 0 if it was not flown.
    hashes: Vec<u64>,
}

impl Shards {
    fn of(definition: Definition) -> Self {
        let hashes = vec![0; definition.mission_count()];
        Self { seeds: CheckSeeds::of(&definition), builds: Vec::new(), definition, n: 1, journals: Vec::new(), hashes }
    }

    /// Adds the missions in the journal of a folder, if it has one.
    fn add(&mut self, folder: &Path, stop: &Stop) -> Result<(), LabError> {
        let journal = folder.join(JOURNAL);
        if !journal.is_file() {
            return Ok(());
        }
        for row in JournalLines::open(&journal, &self.definition, &self.seeds)? {
            stop.check()?;
            let row = row?;
            let index = self.definition.index(row.key).expect("lines of other missions are refused");
            let hash = hash(&row);
            if self.hashes[index] != 0 && self.hashes[index] != hash {
                let message = "its results differ from those of another shard for the same missions: \
                               expected shards from the same executable";
                return Err(InputError::new("shard", folder, message).into());
            }
            self.hashes[index] = hash;
        }
        self.journals.push(journal);
        Ok(())
    }

    /// The number of missions, and the shards with missing ones; `None` if all are present.
    fn missing(&self) -> Option<String> {
        let expected = self.hashes.len();
        let is_missing = |&index: &usize| self.hashes[index] == 0;
        let missing = (0..expected).filter(is_missing).count();
        if missing == 0 {
            return None;
        }
        let n = self.n;
        let shards = (0..expected).filter(is_missing).map(|index| self.definition.shard_of(index, n));
        let shards = ranges(&shards.collect());
        let count = expected - missing;
        let remedy = format!("for example by --array={shards} and --shard $SLURM_ARRAY_TASK_ID/{n}");
        Some(format!("{count} of {expected} missions are present: run shards {shards} of {n}, {remedy}"))
    }
}

/// Hash of the metrics that do not depend on the clock; never 0.
fn hash(row: &MissionRow) -> u64 {
    let mut hash = Xxh3::new();
    for metric in Metric::all().filter(|metric| !metric.is_timing()) {
        hash.update(&row[metric].to_bits().to_le_bytes());
    }
    hash.digest().max(1)
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
