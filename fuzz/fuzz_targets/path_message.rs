#![no_main]
//! `cargo fuzz run` for the target of this name.

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| skysink_fuzz::targets::path_message(bytes));
