//! Searches and storms that take minutes.

#[path = "../it/flight.rs"]
#[allow(dead_code, reason = "shared with shorter tests")]
mod flight;
#[path = "../search/model.rs"]
#[allow(dead_code, reason = "shared with the search of one act")]
mod model;
#[path = "../it/storm.rs"]
mod storm;

use model::{TableSearch, search};

#[test]
fn no_order_of_events_with_two_acts_and_a_crash_violates_a_property() {
    for takes_off_in_any_mode in [false, true] {
        let found = search(TableSearch::of(2, 1, 1, 1, takes_off_in_any_mode));
        println!(
            "two acts and a crash, take-off in any mode {takes_off_in_any_mode}: {} states, {} edges",
            found.states, found.transitions
        );
        assert!(found.violations.is_empty(), "{:?}", found.violations);
    }
}

/// Two reports on their way, of which each may come after two newer ones.
#[test]
fn no_order_of_events_in_late_links_violates_a_property() {
    for takes_off_in_any_mode in [false, true] {
        let found = search(TableSearch::of(1, 1, 2, 2, takes_off_in_any_mode));
        println!(
            "one act and a crash over late links, take-off in any mode {takes_off_in_any_mode}: {} states, {} edges",
            found.states, found.transitions
        );
        assert!(found.violations.is_empty(), "{:?}", found.violations);
    }
}

#[test]
fn a_thousand_random_pilots_are_never_overruled() {
    storm::check(1_000);
}
