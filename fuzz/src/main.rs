//! libFuzzer, for the target that the path of a corpus or of an input names: `fuzz/corpus/scenario`.
#![no_main]

use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use libfuzzer_sys::fuzz_target;
use skysink_fuzz::{Check, TARGETS};

/// The check of the target whose corpus or input is named first.
static CHECK: LazyLock<Check> = LazyLock::new(|| {
    let paths = std::env::args().skip(1).filter(|argument| !argument.starts_with('-'));
    let named = |folder: &str| TARGETS.into_iter().find(|(name, _)| *name == folder);
    let target = paths.filter_map(|path| path.rsplit('/').find_map(named)).next();
    target.expect("the folder of a corpus, such as fuzz/corpus/scenario").1
});

/// Coverage that libFuzzer reads besides the compiler's. It chooses among inputs that cover something new.
#[unsafe(link_section = "__libfuzzer_extra_counters")]
static COVERED: [AtomicU64; 64] = [const { AtomicU64::new(0) }; 64];

/// Inputs so far.
static RUNS: AtomicUsize = AtomicUsize::new(0);

fuzz_target!(|input: &[u8]| {
    // The first ones are the corpus: each counts as new even if the compiler counts nothing.
    if let Some(counter) = COVERED.get(RUNS.fetch_add(1, Ordering::Relaxed)) {
        counter.store(1, Ordering::Relaxed);
    }
    CHECK(input)
});
