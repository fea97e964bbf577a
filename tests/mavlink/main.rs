//! Flights over MAVLink. They mostly wait for a vehicle that flies in real time, so several of them run at once on the
//! smallest machine, too.

mod flights;
#[path = "../support/mod.rs"]
mod support;

use std::num::NonZero;
use std::process::ExitCode;
use std::thread::available_parallelism;

use libtest_mimic::{Arguments, Trial};

/// Least number of tests at once, unless `--test-threads` says another number.
const THREADS: usize = 4;

/// The trials of these functions.
macro_rules! trials {
    ($($module:ident::$name:ident,)*) => {
        vec![$(trial(concat!(stringify!($module), "::", stringify!($name)), $module::$name)),*]
    };
}

fn main() -> ExitCode {
    let trials = trials![
        flights::a_vehicle_flies_a_run_that_every_command_reads,
        flights::lost_messages_gusts_and_delayed_arming_do_not_end_a_mission,
        flights::a_failsafe_ends_the_orders_and_the_mission_is_recorded_to_its_end,
        flights::a_pilot_who_takes_over_ends_the_orders_and_the_run_says_how_to_end_it,
        flights::a_run_whose_vehicle_was_overridden_is_not_offered_to_be_resumed,
        flights::what_a_pilot_took_over_or_landed_in_the_last_slot_is_left_alone_by_a_resumed_run,
        flights::a_run_in_which_nothing_is_flown_fails_and_says_why,
        flights::a_run_that_is_stopped_in_the_climb_does_not_say_that_nothing_was_flown,
        flights::a_vehicle_that_is_not_there_is_named_by_its_address,
        flights::a_stopped_launcher_is_noticed_by_clock_and_the_vehicle_returns,
        flights::orders_reach_the_vehicle_whoever_else_speaks_to_the_port,
        flights::a_restarted_bridge_takes_over_the_vehicle_in_the_air,
        flights::a_restarted_bridge_keeps_a_vehicle_with_a_failsafe_of_five_seconds,
        flights::heartbeats_stop_for_a_vehicle_that_is_not_heard,
        flights::a_vehicle_that_the_bridge_before_has_armed_is_not_armed_again,
        flights::a_pilot_override_outlives_the_bridge,
        flights::a_bridge_that_is_killed_while_the_vehicle_returns_is_named,
        flights::a_killed_planner_is_restarted_and_a_silent_one_makes_the_vehicle_return,
        flights::the_vehicle_returns_when_the_launcher_is_killed_and_when_the_run_is_stopped,
        flights::a_stopped_run_is_resumed_where_the_vehicle_was,
        flights::one_bridge_flies_a_fleet,
        flights::the_vehicles_of_a_fleet_may_have_separate_addresses,
        flights::a_vehicle_that_must_not_take_off_is_refused_in_one_line,
        flights::invalid_addresses_are_refused_in_one_line,
    ];
    let mut arguments = Arguments::from_args();
    let cores = available_parallelism().map_or(1, NonZero::get);
    arguments.test_threads.get_or_insert(cores.max(THREADS));
    libtest_mimic::run(&arguments, trials).exit_code()
}

fn trial(name: &str, run: fn()) -> Trial {
    Trial::test(name, move || {
        run();
        Ok(())
    })
}
