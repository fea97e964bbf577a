//! Fuzz tests of all code that reads external input.
//!
//! A target is a function of an input that panics when a promise is broken, not only when the code under it crashes.
//! libFuzzer makes the inputs, by `main.rs`, and `tests/inputs.rs` runs it for each target.

mod journals;
mod messages;
mod planner;
mod text;
mod world;

use arbitrary::{Result, Unstructured};

/// Panics if the input makes something go wrong.
pub type Check = fn(&[u8]);

/// What is fuzzed, with the names of the corpora.
pub const TARGETS: [(&str, Check); 14] = [
    ("scenario", text::scenario),
    ("sensors", text::sensors),
    ("mission", text::mission),
    ("trace", text::trace),
    ("sweep_journal", text::sweep_journal),
    ("journal", |input| numbers(input, journals::journal)),
    ("field_journal", |input| numbers(input, journals::field_journal)),
    ("flight_journal", |input| numbers(input, journals::flight_journal)),
    ("planner_memory", |input| numbers(input, planner::checkpoint)),
    ("plan_message", |input| numbers(input, messages::plan)),
    ("flight_message", |input| numbers(input, messages::flight)),
    ("planner_message", |input| numbers(input, planner::message)),
    ("health_message", |input| numbers(input, messages::health)),
    ("path_message", |input| numbers(input, messages::path)),
];

/// So many of them, the first, read text.
pub const TEXTS: usize = 5;

/// Checks an input whose numbers are read from its front.
fn numbers(input: &[u8], check: fn(&mut Unstructured) -> Result<()>) {
    check(&mut Unstructured::new(input)).expect("behind the end of the input are zeros");
}

/// Fails unless the words are one line, as messages to people are.
fn assert_one_line(words: &impl std::fmt::Display) {
    let words = words.to_string();
    assert!(!words.is_empty() && !words.contains('\n'), "not one line: {words:?}");
}
