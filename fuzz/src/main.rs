//! libFuzzer, for the target that the path of a corpus or of an input names: `fuzz/corpus/scenario`.
#![no_main]

use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use skysink_fuzz::{Check, TARGETS};

/// The check of the target whose corpus or input is named first.
static CHECK: LazyLock<Check> = LazyLock::new(|| {
    let paths = std::env::args().skip(1).filter(|argument| !argument.starts_with('-'));
    let named = |folder: &str| TARGETS.into_iter().find(|(name, _)| *name == folder);
    let target = paths.filter_map(|path| path.rsplit('/').find_map(named)).next();
    target.expect("the folder of a corpus, such as fuzz/corpus/scenario").1
});

/// Additional coverage counters. libFuzzer keeps inputs that increase its coverage.
#[unsafe(link_section = "__libfuzzer_extra_counters")]
static COVERED: [AtomicU64; 64] = [const { AtomicU64::new(0) }; 64];

fuzz_target!(|input: &[u8]| {
    static RUNS: AtomicUsize = AtomicUsize::new(0);
    // The first runs are the corpus: each of them counts as new coverage, even without instrumentation by the compiler.
    if let Some(counter) = COVERED.get(RUNS.fetch_add(1, Ordering::Relaxed)) {
        counter.store(1, Ordering::Relaxed);
    }
    CHECK(input)
});

/// Boundary values of numbers.
const VALUES: [&str; 10] = ["0", "-0", "-1", "0.5", "1e-320", "1e308", "inf", "nan", "4294967296", "[nan, nan]"];

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let text = std::str::from_utf8(&data[..size]).ok().filter(|text| seed.is_multiple_of(2) && !text.is_empty());
    match text.map(|text| with_value(text, seed as usize / 2)) {
        Some(text) if text.len() <= max_size => {
            data[..text.len()].copy_from_slice(text.as_bytes());
            text.len()
        }
        _ => fuzzer_mutate(data, size, max_size),
    }
});

/// Replaces a key, a value or a field of the text by a boundary value. A dictionary alone does so too rarely.
fn with_value(text: &str, seed: usize) -> String {
    let mut pieces: Vec<&str> = text.split_inclusive([',', '=', '\n']).collect();
    let at = seed / VALUES.len() % pieces.len();
    let separator = pieces[at].trim_start_matches(|letter| !",=\n".contains(letter));
    let piece = [VALUES[seed % VALUES.len()], separator].concat();
    pieces[at] = &piece;
    pieces.concat()
}
