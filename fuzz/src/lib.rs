//! Fuzz tests of all code that reads external input.
//!
//! A target is a function of an input that panics when a promise is broken, not only when the code under it crashes.
//! libFuzzer makes the inputs, by `main.rs`, and `tests/inputs.rs` runs it for each target.

mod import;
mod journals;
mod messages;
mod planner;
mod text;
mod web;
mod world;

use arbitrary::{Result, Unstructured};

/// Checks one input; panics if a promise is broken.
pub type Check = fn(&[u8]);

/// The fuzz targets, with the names of their corpora.
pub const TARGETS: [(&str, Check); 16] = [
    ("scenario", text::scenario),
    ("sensors", text::sensors),
    ("import", import::files),
    ("mission", text::mission),
    ("trace", text::trace),
    ("sweep_journal", text::sweep_journal),
    ("http_request", web::request),
    ("journal", |input| numbers(input, journals::records)),
    ("field_journal", |input| numbers(input, journals::field_journal)),
    ("flight_journal", |input| numbers(input, journals::flight_journal)),
    ("planner_memory", |input| numbers(input, planner::checkpoint)),
    ("plan_message", |input| numbers(input, messages::plan)),
    ("flight_message", |input| numbers(input, messages::flight)),
    ("planner_message", |input| numbers(input, planner::message)),
    ("health_message", |input| numbers(input, messages::health)),
    ("path_message", |input| numbers(input, messages::path)),
];

/// Number of targets that read text; they come first.
pub const TEXTS: usize = 7;

/// Runs a check that reads numbers from the input.
fn numbers(input: &[u8], check: fn(&mut Unstructured) -> Result<()>) {
    check(&mut Unstructured::new(input)).expect("zeros follow the end of the input");
}
