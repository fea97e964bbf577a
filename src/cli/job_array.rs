//! Which part of a sweep a job of a job array flies, as its scheduler says.

use skysink_lab::sweep::plan::Shard;

/// The variables of a scheduler's job array.
struct Scheduler {
    /// The job's number.
    task: &'static str,
    /// Jobs of the array.
    count: Option<&'static str>,
    /// The highest number of the array.
    last: Option<&'static str>,
}

/// Slurm, PBS and Grid Engine. PBS does not say how many jobs an array has.
const SCHEDULERS: [Scheduler; 3] = [
    Scheduler {
        task: "SLURM_ARRAY_TASK_ID",
        count: Some("SLURM_ARRAY_TASK_COUNT"),
        last: Some("SLURM_ARRAY_TASK_MAX"),
    },
    Scheduler { task: "PBS_ARRAY_INDEX", count: None, last: None },
    Scheduler { task: "SGE_TASK_ID", count: None, last: Some("SGE_TASK_LAST") },
];

/// The shard of the job that has these variables: k is its number, n is `shards` or the number of jobs of the array,
/// which then has to be a whole one that counts from 1.
///
/// # Errors
/// If it is no job of an array, a variable is missing, or the array is none of all shards.
pub fn shard(variable: impl Fn(&str) -> Option<String>, shards: Option<usize>) -> Result<Shard, String> {
    let number = |name: &str| -> Result<usize, String> {
        let text =
            variable(name).ok_or_else(|| format!("{name} is not set: expected auto/N with the number of shards"))?;
        text.parse().map_err(|_| format!("{name}={text}: expected a whole number"))
    };
    let is_there = |scheduler: &&Scheduler| variable(scheduler.task).is_some_and(|task| task != "undefined");
    let names = SCHEDULERS.map(|scheduler| scheduler.task).join(", ");
    let scheduler = SCHEDULERS.iter().find(is_there);
    let Scheduler { task, count, last } =
        scheduler.ok_or_else(|| format!("expected a job array, which sets one of {names}"))?;
    let k = number(task)?;
    let n = match (shards, last) {
        (Some(shards), _) => shards,
        (None, Some(last)) => number(last)?,
        (None, None) => return Err(format!("{task} comes without the number of jobs: expected auto/N")),
    };
    if let (None, Some(count)) = (shards, count) {
        let count = number(count)?;
        let message =
            || format!("{task}={k}: expected an array from 1 to {count}, or auto/N with the number of shards");
        (count == n).then_some(()).ok_or_else(message)?;
    }
    let is_one = (1..=n).contains(&k);
    is_one.then_some(Shard(k, n)).ok_or_else(|| format!("{task}={k}: expected a job of an array such as 1-{n}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shard_of(variables: &[(&str, &str)], shards: Option<usize>) -> Result<Shard, String> {
        let value = |name: &str| variables.iter().find(|(other, _)| *other == name).map(|(_, value)| (*value).into());
        shard(value, shards)
    }

    fn slurm<'a>(task: &'a str, count: &'a str, last: &'a str) -> [(&'a str, &'a str); 3] {
        [("SLURM_ARRAY_TASK_ID", task), ("SLURM_ARRAY_TASK_COUNT", count), ("SLURM_ARRAY_TASK_MAX", last)]
    }

    #[test]
    fn a_job_flies_the_shard_of_its_number() {
        assert_eq!(shard_of(&slurm("8", "8", "8"), None), Ok(Shard(8, 8)));
        assert_eq!(shard_of(&[("PBS_ARRAY_INDEX", "3")], Some(4)), Ok(Shard(3, 4)));
        assert_eq!(shard_of(&[("SGE_TASK_ID", "5"), ("SGE_TASK_LAST", "9")], None), Ok(Shard(5, 9)));
    }

    #[test]
    fn a_part_of_an_array_that_is_submitted_again_says_how_many_shards_there_are() {
        assert_eq!(shard_of(&slurm("3", "2", "4"), Some(8)), Ok(Shard(3, 8)));
        let refusal = shard_of(&slurm("3", "2", "4"), None).unwrap_err();
        assert_eq!(
            refusal,
            "SLURM_ARRAY_TASK_ID=3: expected an array from 1 to 2, or auto/N with the number of shards"
        );
    }

    #[test]
    fn what_is_no_job_of_an_array_is_refused() {
        for (variables, shards, says) in [
            (&[][..], None, "SLURM_ARRAY_TASK_ID, PBS_ARRAY_INDEX, SGE_TASK_ID"),
            (&[("SGE_TASK_ID", "undefined")], None, "expected a job array"),
            (&[("PBS_ARRAY_INDEX", "3")], None, "expected auto/N"),
            (&[("SLURM_ARRAY_TASK_ID", "3")], None, "SLURM_ARRAY_TASK_MAX is not set"),
            (&[("PBS_ARRAY_INDEX", "x")], Some(4), "PBS_ARRAY_INDEX=x: expected a whole number"),
            (&[("PBS_ARRAY_INDEX", "5")], Some(4), "PBS_ARRAY_INDEX=5: expected a job of an array such as 1-4"),
            (&slurm("0", "5", "4"), None, "SLURM_ARRAY_TASK_ID=0: expected an array from 1 to 5,"),
            (&[("SGE_TASK_ID", "0"), ("SGE_TASK_LAST", "4")], None, "SGE_TASK_ID=0"),
        ] {
            let refusal = shard_of(variables, shards).unwrap_err();
            assert!(refusal.contains(says), "{refusal}");
        }
    }
}
