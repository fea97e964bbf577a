//! Every input that is kept, and many that libFuzzer makes of them. They are the same for a seed.

use std::path::Path;
use std::process::Command;

use clap::Parser;
use libtest_mimic::{Arguments, Failed, Trial};
use skysink_fuzz::{TARGETS, TEXTS};

/// Most inputs that are kept for a target, and the longest [byte].
const MOST_KEPT: usize = 40;
const LONGEST: u64 = 4096;

#[derive(Debug, Parser)]
struct Options {
    /// Inputs for each target.
    #[arg(long, default_value_t = 5_000)]
    runs: u64,
    /// Seed of the inputs, from 1.
    #[arg(long, default_value_t = 1)]
    seed: u32,
    #[command(flatten)]
    harness: Arguments,
}

fn main() {
    let Options { runs, seed, harness } = Options::parse();
    let trials = TARGETS.iter().enumerate().map(|(i, (target, _))| {
        let dictionary = if i < TEXTS { "text.dict" } else { "numbers.dict" };
        Trial::test(*target, move || fuzz(target, dictionary, runs, seed))
    });
    libtest_mimic::run(&harness, trials.collect()).exit();
}

fn fuzz(target: &str, dictionary: &str, runs: u64, seed: u32) -> Result<(), Failed> {
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let corpus = home.join("corpus").join(target);
    let kept = std::fs::read_dir(&corpus)?.map(|file| file?.metadata()).collect::<Result<Vec<_>, _>>()?;
    assert!((1..=MOST_KEPT).contains(&kept.len()), "{}: {} inputs", corpus.display(), kept.len());
    assert!(kept.iter().all(|file| file.len() <= LONGEST), "{}: above {LONGEST} bytes", corpus.display());
    let artifacts = home.join("artifacts").join(target);
    std::fs::create_dir_all(&artifacts)?;
    let scratch = tempfile::tempdir()?; // of which a crash leaves nothing
    let output = Command::new(env!("CARGO_BIN_EXE_fuzz"))
        .env("TMPDIR", scratch.path())
        .args(["-keep_seed=1".to_owned(), "-timeout=20".to_owned(), format!("-max_len={LONGEST}")])
        .args([format!("-runs={runs}"), format!("-seed={seed}"), format!("-dict={}", home.join(dictionary).display())])
        .arg(format!("-artifact_prefix={}/", artifacts.display()))
        .args([scratch.path(), &corpus]) // the first takes what covers something new
        .output()?;
    let words = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        let input = words.lines().find_map(|line| line.split_once("written to ")).map_or("INPUT", |(_, path)| path);
        return Err(format!("{words}\nreplay it: cargo run -p skysink-fuzz {input}").into());
    }
    Ok(())
}
