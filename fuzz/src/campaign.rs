//! Many inputs for one target, made of its corpus by counting: input i of a seed is the same everywhere.

use std::io;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::process::exit;
use std::sync::Mutex;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::corpus;
use crate::mutation::mutate;
use crate::targets::Target;

/// Longest that a target may take for an input.
const LONGEST: Duration = Duration::from_secs(20);

/// Inputs that are made and checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Campaign {
    /// Seed of the changes.
    pub seed: u64,
    /// Numbers of the inputs.
    pub inputs: Range<u64>,
}

/// Why a campaign ends early.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// The corpus is not there, or a case cannot be kept.
    #[error("fuzz/: {0}")]
    Io(#[from] io::Error),
    /// The target has found something wrong.
    #[error("{target}: {message}\nreplay it: cargo run -p skysink-fuzz --example campaign -- {target} --replay {}", file.display())]
    Wrong {
        /// The target's name.
        target: &'static str,
        /// The words of its panic.
        message: String,
        /// The input.
        file: PathBuf,
    },
}

/// Gives a target every input that is kept for it, and returns how many there are.
///
/// # Errors
/// If the corpus cannot be read, or something is wrong.
pub fn replay(target: Target) -> Result<usize, CampaignError> {
    let inputs = corpus::read(target.name)?;
    for (file, bytes) in &inputs {
        check(target, bytes, || Ok(file.clone()))?;
    }
    Ok(inputs.len())
}

/// Gives a target the inputs of a campaign. An input that takes too long is kept, and ends the process.
///
/// # Errors
/// If the corpus cannot be read, or something is wrong.
pub fn run(target: Target, campaign: Campaign) -> Result<(), CampaignError> {
    let seeds: Vec<Vec<u8>> = corpus::read(target.name)?.into_iter().map(|(_, bytes)| bytes).collect();
    let under_way = Mutex::new((Instant::now(), Vec::new()));
    let (done, ended) = channel::<()>();
    thread::scope(|scope| {
        let watched = &under_way;
        scope.spawn(move || {
            while ended.recv_timeout(Duration::from_secs(1)) == Err(RecvTimeoutError::Timeout) {
                give_up_on(target, watched);
            }
        });
        let _done = done; // ends the watch, also when the target panics
        for number in campaign.inputs {
            let bytes = mutate(&seeds, target.input, &mut random(campaign.seed, number));
            *under_way.lock().expect("no thread panics with the lock") = (Instant::now(), bytes.clone());
            check(target, &bytes, || corpus::keep(target.name, &bytes))?;
        }
        Ok(())
    })
}

/// Gives a target one input.
///
/// # Errors
/// If something is wrong; `keep` says where the input is.
pub fn check(target: Target, bytes: &[u8], keep: impl FnOnce() -> io::Result<PathBuf>) -> Result<(), CampaignError> {
    let Err(panic) = catch_unwind(AssertUnwindSafe(|| (target.check)(bytes))) else { return Ok(()) };
    let words = panic.downcast_ref::<String>().cloned();
    let words = words.or_else(|| panic.downcast_ref::<&str>().map(|&words| words.to_owned()));
    let message = words.unwrap_or_else(|| "a panic without words".to_owned());
    Err(CampaignError::Wrong { target: target.name, message, file: keep()? })
}

/// Ends the process if an input takes too long.
fn give_up_on(target: Target, under_way: &Mutex<(Instant, Vec<u8>)>) {
    let (begin, bytes) = under_way.lock().expect("no thread panics with the lock").clone();
    if begin.elapsed() > LONGEST {
        let message = format!("takes longer than {LONGEST:?}");
        let error = match corpus::keep(target.name, &bytes) {
            Ok(file) => CampaignError::Wrong { target: target.name, message, file },
            Err(error) => error.into(),
        };
        eprintln!("{error}");
        exit(1);
    }
}

/// The changes of one input.
fn random(seed: u64, number: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..16].copy_from_slice(&number.to_le_bytes());
    ChaCha8Rng::from_seed(key)
}
