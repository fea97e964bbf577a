//! Inputs that libFuzzer makes of the corpora, the same ones each time.

use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::thread::{available_parallelism, scope};

use skysink_fuzz::{TARGETS, TEXTS};

#[test]
fn every_target_survives_5000_libfuzzer_inputs() {
    let targets = Mutex::new(TARGETS.into_iter().enumerate());
    let next = || targets.lock().unwrap().next();
    let fuzz_targets = || {
        while let Some((i, (target, _))) = next() {
            fuzz(target, if i < TEXTS { "text.dict" } else { "numbers.dict" });
        }
    };
    let cores = available_parallelism().map_or(1, usize::from);
    scope(|threads| (0..cores).for_each(|_| drop(threads.spawn(fuzz_targets))));
}

/// Fails with the words of libFuzzer and the command that repeats what it stopped at.
fn fuzz(target: &str, dictionary: &str) {
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let artifacts = home.join("artifacts").join(target);
    std::fs::create_dir_all(&artifacts).expect("a folder can be made");
    let scratch = tempfile::tempdir().expect("a temporary folder can be made"); // of which a crash leaves nothing
    let output = Command::new(env!("CARGO_BIN_EXE_fuzz"))
        .env("TMPDIR", scratch.path())
        .args(["-keep_seed=1", "-timeout=20", "-max_len=4096", "-runs=5000", "-seed=1"])
        .arg(format!("-dict={}", home.join(dictionary).display()))
        .arg(format!("-artifact_prefix={}/", artifacts.display()))
        .args([scratch.path(), &home.join("corpus").join(target)]) // the first takes what covers something new
        .output()
        .expect("libFuzzer starts");
    let words = String::from_utf8_lossy(&output.stderr);
    let input = words.lines().find_map(|line| line.split_once("written to ")).map_or("INPUT", |(_, path)| path);
    let command = format!("cargo run -p skysink-fuzz --features libfuzzer {input}");
    assert!(output.status.success(), "{words}\nreplay it: {command}");
}
