//! What needs rights or programs that not every machine has: a test that lacks them is ignored, and says which command
//! brings them.

mod hosts;
mod medium;
#[path = "../support/mod.rs"]
mod support;

use std::process::ExitCode;

use libtest_mimic::{Arguments, Completion, Trial};

/// What a test lacks on this machine, with the command that brings it.
pub struct Missing(String);

/// The trials of these functions.
macro_rules! trials {
    ($($module:ident::$name:ident,)*) => {
        vec![$(trial(concat!(stringify!($module), "::", stringify!($name)), $module::$name)),*]
    };
}

fn main() -> ExitCode {
    let trials = trials![
        hosts::a_disconnected_host_is_reported_and_does_not_change_the_trace,
        hosts::a_paced_run_continues_without_the_planners_host_and_counts_missed_slots,
        medium::a_full_disk_ends_a_run_with_whole_lines,
        medium::a_full_disk_ends_a_run_with_a_viewer,
        medium::a_folder_that_cannot_be_written_is_named,
        medium::a_ring_folder_of_another_user_is_refused,
        medium::too_little_shared_memory_is_refused_before_anything_is_written,
        medium::a_file_at_its_size_limit_ends_a_run_with_one_line,
    ];
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}

fn trial(name: &str, run: fn() -> Result<(), Missing>) -> Trial {
    Trial::ignorable_test(name, move || {
        Ok(match run() {
            Ok(()) => Completion::Completed,
            Err(Missing(what)) => Completion::ignored_with(what),
        })
    })
}
