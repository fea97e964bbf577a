//! The shard of a sweep for a job of a job array, from the environment variables of the scheduler.

use skysink_lab::sweep::plan::Shard;

/// The environment variables of a job array.
struct Scheduler {
    /// The index of the job.
    task: &'static str,
    /// The highest index of the array, if the scheduler sets it.
    last: Option<&'static str>,
    /// The number of jobs, if the scheduler sets it. It must equal the highest index.
    count: Option<&'static str>,
    /// Variables that are 1 if the array has every index from 1 on.
    ones: &'static [&'static str],
}

/// Slurm, PBS and Grid Engine.
const SCHEDULERS: [Scheduler; 3] = [
    Scheduler {
        task: "SLURM_ARRAY_TASK_ID",
        last: Some("SLURM_ARRAY_TASK_MAX"),
        count: Some("SLURM_ARRAY_TASK_COUNT"),
        ones: &["SLURM_ARRAY_TASK_MIN"],
    },
    Scheduler { task: "PBS_ARRAY_INDEX", last: None, count: None, ones: &[] },
    Scheduler {
        task: "SGE_TASK_ID",
        last: Some("SGE_TASK_LAST"),
        count: None,
        ones: &["SGE_TASK_FIRST", "SGE_TASK_STEPSIZE"],
    },
];

/// The shard k/n of this job: k is its index, n is `shards` or else the number of jobs.
///
/// # Errors
/// If the process is not a job of an array, or a variable is missing. Without `shards`, also if the indices of the
/// array are not 1, 2, …, n.
pub fn shard(variable: impl Fn(&str) -> Option<String>, shards: Option<usize>) -> Result<Shard, String> {
    let number = |name: &str| -> Result<usize, String> {
        let text =
            variable(name).ok_or_else(|| format!("{name} is not set: expected auto/N with the number of shards"))?;
        text.parse().map_err(|_| format!("{name}={text}: expected a whole number"))
    };
    let is_active = |scheduler: &&Scheduler| variable(scheduler.task).is_some_and(|task| task != "undefined");
    let names = SCHEDULERS.map(|scheduler| scheduler.task).join(", ");
    let scheduler = SCHEDULERS.iter().find(is_active);
    let Scheduler { task, last, count, ones } =
        scheduler.ok_or_else(|| format!("expected a job array, which sets one of {names}"))?;
    let k = number(task)?;
    let n = match (shards, last) {
        (Some(shards), _) => shards,
        (None, None) => return Err(format!("{task} does not contain the number of jobs: expected auto/N")),
        (None, Some(last)) => {
            let n = number(last)?;
            let required = ones.iter().map(|&name| (name, 1)).chain(count.map(|name| (name, n)));
            for (name, required) in required {
                let found = number(name)?;
                if found != required {
                    let expected = "expected an array such as 1-8, or auto/N with the number of shards";
                    return Err(format!("{name}={found}: {expected}"));
                }
            }
            n
        }
    };
    Shard::new(k, n).ok_or_else(|| format!("{task}={k}: expected 1 to {n}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shard_of(variables: &[(&str, &str)], shards: Option<usize>) -> Result<Shard, String> {
        let value = |name: &str| variables.iter().find(|(other, _)| *other == name).map(|(_, value)| (*value).into());
        shard(value, shards)
    }

    fn slurm<'a>(task: &'a str, min: &'a str, max: &'a str, count: &'a str) -> [(&'a str, &'a str); 4] {
        [
            ("SLURM_ARRAY_TASK_ID", task),
            ("SLURM_ARRAY_TASK_MIN", min),
            ("SLURM_ARRAY_TASK_MAX", max),
            ("SLURM_ARRAY_TASK_COUNT", count),
        ]
    }

    fn grid_engine<'a>(task: &'a str, first: &'a str, step: &'a str) -> [(&'a str, &'a str); 4] {
        [("SGE_TASK_ID", task), ("SGE_TASK_FIRST", first), ("SGE_TASK_LAST", "9"), ("SGE_TASK_STEPSIZE", step)]
    }

    #[test]
    fn a_job_flies_the_shard_of_its_index() {
        assert_eq!(shard_of(&slurm("8", "1", "8", "8"), None), Ok(Shard::new(8, 8).unwrap()));
        assert_eq!(shard_of(&[("PBS_ARRAY_INDEX", "3")], Some(4)), Ok(Shard::new(3, 4).unwrap()));
        assert_eq!(shard_of(&grid_engine("5", "1", "1"), None), Ok(Shard::new(5, 9).unwrap()));
    }

    #[test]
    fn a_part_of_an_array_needs_the_number_of_shards() {
        for part in [
            slurm("3", "3", "4", "2"),
            slurm("1", "1", "4", "2"),
            slurm("2", "0", "2", "2"),
            grid_engine("3", "3", "1"),
            grid_engine("3", "1", "2"),
        ] {
            let refusal = shard_of(&part, None).unwrap_err();
            assert!(
                refusal.ends_with("expected an array such as 1-8, or auto/N with the number of shards"),
                "{refusal}"
            );
            assert_eq!(shard_of(&part, Some(8)).unwrap().n(), 8);
        }
        assert_eq!(shard_of(&slurm("3", "3", "4", "2"), Some(8)), Ok(Shard::new(3, 8).unwrap()));
    }

    #[test]
    fn a_process_outside_a_job_array_is_refused() {
        for (variables, shards, expected) in [
            (&[][..], None, "SLURM_ARRAY_TASK_ID, PBS_ARRAY_INDEX, SGE_TASK_ID"),
            (&[("SGE_TASK_ID", "undefined")], None, "expected a job array"),
            (&[("PBS_ARRAY_INDEX", "3")], None, "expected auto/N"),
            (&[("SLURM_ARRAY_TASK_ID", "3")], None, "SLURM_ARRAY_TASK_MAX is not set"),
            (&[("PBS_ARRAY_INDEX", "x")], Some(4), "PBS_ARRAY_INDEX=x: expected a whole number"),
            (&[("PBS_ARRAY_INDEX", "5")], Some(4), "PBS_ARRAY_INDEX=5: expected 1 to 4"),
            (&grid_engine("0", "1", "1"), None, "SGE_TASK_ID=0: expected 1 to 9"),
        ] {
            let refusal = shard_of(variables, shards).unwrap_err();
            assert!(refusal.contains(expected), "{refusal}");
        }
    }
}
