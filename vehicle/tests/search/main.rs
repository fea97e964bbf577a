//! Every order of events around the table, with one act of the pilot and one crash of the bridge; two acts are in the
//! long tests.

mod model;

use std::sync::Arc;

use model::{TableSearch, search};
use skysink_vehicle::autopilot::ModeMeaning;
use skysink_vehicle::table::{Command, Ending, Height, Input, Report, SpokenLine, State, step};

#[test]
fn no_order_of_events_with_one_act_and_one_crash_violates_a_property() {
    for (takes_off_in_any_mode, states) in [(false, 35_404), (true, 41_275)] {
        let found = search(TableSearch::of(1, 1, 1, 1, takes_off_in_any_mode));
        println!(
            "one act and a crash, take-off in any mode {takes_off_in_any_mode}: {} states, {} edges",
            found.states, found.transitions
        );
        assert!(found.violations.is_empty(), "{:?}", found.violations);
        assert_eq!(found.states, states, "a row has changed: so does this number, and that of the page");
    }
}

type Step = (State, &'static [Command], Option<SpokenLine>);
type Mutant = fn(State, &Input, Step) -> Step;

/// Rows of the table that are changed, one in each.
const MUTANTS: [(&str, Mutant); 12] = [
    ("a report of another mode is ignored in a climb", |state, input, right| match (state, input.believed) {
        (State::Climb, Some(Report { mode: ModeMeaning::Other, is_armed: true })) => (state, &[], None),
        _ => right,
    }),
    ("a found mode is waited over in a flight, and the vehicle is sent home", |state, input, right| {
        match (state, input.believed) {
            (State::Fly { .. }, Some(Report { mode: ModeMeaning::Other, is_armed: true })) if input.is_over => {
                (State::Home { was_seen: false }, &[Command::Return], Some(SpokenLine::Returns(Ending::Over)))
            }
            _ => right,
        }
    }),
    ("it is armed on the first report", |state, input, right| match state {
        State::Check { may_fly_on: false } if !input.says_armed && !input.is_over && input.is_new => {
            (State::Arm { was_armed: false }, &[Command::Arm], Some(SpokenLine::Arming))
        }
        _ => right,
    }),
    ("an order to arm is repeated", |state, input, right| match state {
        State::Arm { was_armed: false }
            if input.is_new && input.may_repeat && right.1.is_empty() && right.2.is_none() =>
        {
            (right.0, &[Command::Arm], None)
        }
        _ => right,
    }),
    ("one that was off is waited for to be armed again", |state, input, right| match (state, input.believed) {
        (State::Arm { .. }, Some(Report { is_armed: false, .. })) if right.0 == State::Done => (state, &[], None),
        _ => right,
    }),
    ("a take-off is ordered whatever is reported", |state, input, right| match state {
        State::Climb if input.is_new && input.may_repeat && input.height == Height::Ground && right.0 == state => {
            (state, &[Command::TakeOff], None)
        }
        _ => right,
    }),
    ("a waypoint is sent in doubt", |state, _, right| match state {
        State::Fly { .. } if right.0 == state => (state, &[Command::Waypoint], None),
        _ => right,
    }),
    ("a return that was stopped is ordered again", |state, input, right| match (state, input.believed) {
        (State::Home { .. }, Some(Report { is_armed: true, mode })) if mode != ModeMeaning::Returns => {
            (state, &[Command::Return], None)
        }
        _ => right,
    }),
    ("a return without an effect is waited for, with heartbeats", |state, _, right| match right.0 {
        State::Silent if state != State::Silent => (state, &[], None),
        _ => right,
    }),
    ("an end has no line", |_, _, right| match right.0 {
        State::HandsOff => (right.0, right.1, None),
        _ => right,
    }),
    ("the climb is not ended by the end of the run", |state, input, right| match (state, right.0) {
        (State::Climb, State::Home { .. }) if input.is_over => (state, &[], None),
        _ => right,
    }),
    ("hands are not kept off", |state, input, right| match (state, input.believed) {
        (State::HandsOff, Some(Report { mode: ModeMeaning::Other, is_armed: true })) if input.is_over => {
            (state, &[Command::Return], None)
        }
        _ => right,
    }),
];

#[test]
fn a_table_with_a_changed_row_is_found() {
    for (what, mutant) in MUTANTS {
        let found = [false, true].into_iter().find_map(|takes_off_in_any_mode| {
            let table = Arc::new(move |state, input: &Input| mutant(state, input, step(state, input)));
            model::first_violation(TableSearch { table, ..TableSearch::of(1, 1, 1, 1, takes_off_in_any_mode) })
        });
        let (states, name) = found.unwrap_or_else(|| panic!("not found: {what}"));
        println!("{what}: {name} after {states} states");
    }
}
