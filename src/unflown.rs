//! Warns of flights whose plans were not flown as they were decided.

use skysink_common::scenario::Scenario;
#[cfg(feature = "lab")]
use skysink_lab::unflown::{UnflownFlights, text_of};
use skysink_mission::figures::Summary;
use skysink_mission::unflown::{REASONS, UnflownPlans};
use skysink_ring::role::Role;

/// Warns of a run that held or refused more than 1 % of its slots.
pub(crate) fn warn_of_run(summary: &Summary, scenario: &Scenario) {
    if let Some(plans) = UnflownPlans::of_summary(summary, scenario) {
        warn(&plans.to_string());
    }
}

/// Warns of plans of which more than 1 % would have been held or refused: slots held, and requests refused.
pub(crate) fn warn_of_counts(scenario: &Scenario, slots: u64, counts: [u64; 2]) {
    if let Some(plans) = UnflownPlans::of(scenario, slots, counts, None) {
        warn(&plans.to_string());
    }
}

/// Warns of these flights of several strategies.
#[cfg(feature = "lab")]
pub(crate) fn warn_of_flights(flights: &[UnflownFlights]) {
    if let Some(flights) = text_of(flights) {
        warn(&flights);
    }
}

fn warn(plans: &str) {
    Role::Launcher.log(format_args!("warning: {plans}: {REASONS}"));
}
