//! The page *The MAVLink bridge* has the table of the code: this test makes it from [`step`] and looks for it there.

use skysink_vehicle::autopilot::ModeMeaning;
use skysink_vehicle::table::{Checks, Command, Failsafe, Height, Input, Report, State, step};

const PAGE: &str = include_str!("../../../docs/src/mavlink-bridge.md");

/// The rows: a state, and how high a vehicle in it is.
const ROWS: [(&str, State, Height); 13] = [
    ("CHECK", State::Check { may_fly_on: false }, Height::Ground),
    ("CHECK, resumed from a flight", State::Check { may_fly_on: true }, Height::Up),
    ("ARM, not reported as armed yet", State::Arm { was_armed: false }, Height::Ground),
    ("ARM, reported as armed", State::Arm { was_armed: true }, Height::Ground),
    ("CLIMB, on the ground", State::Climb, Height::Ground),
    ("CLIMB, below the start", State::Climb, Height::Low),
    ("CLIMB, at the start's altitude", State::Climb, Height::Up),
    ("FLY", State::Fly { has_begun: true }, Height::Up),
    ("HOME, no return reported", State::Home { was_seen: false }, Height::Up),
    ("HOME, a return reported", State::Home { was_seen: true }, Height::Low),
    ("HANDS-OFF", State::HandsOff, Height::Up),
    ("SILENT", State::Silent, Height::Up),
    ("DONE", State::Done, Height::Ground),
];

fn name(state: State) -> &'static str {
    match state {
        State::Check { .. } => "CHECK",
        State::Arm { .. } => "ARM",
        State::Climb => "CLIMB",
        State::Fly { .. } => "FLY",
        State::Home { .. } => "HOME",
        State::HandsOff => "HANDS-OFF",
        State::Silent => "SILENT",
        State::Done => "DONE",
    }
}

fn command(command: Command) -> &'static str {
    match command {
        Command::Arm => "arm",
        Command::TakeOff => "take off",
        Command::Waypoint => "waypoint",
        Command::Return => "return",
    }
}

/// An input in which everything that may be sent is due.
fn input(report: Option<Report>, height: Height) -> Input {
    Input {
        believed: report,
        is_new: report.is_some(),
        says_armed: report.is_some_and(|report| report.is_armed),
        height,
        is_placed: true,
        checks: Checks::Hold,
        are_all_checked: true,
        is_refused: false,
        may_repeat: true,
        is_late: false,
        failsafe: Failsafe::Off,
        has_waypoint: true,
        is_at_start: false,
        is_over: false,
    }
}

fn cell(state: State, input: &Input) -> String {
    let (next, orders, _) = step(state, input);
    let orders = orders.iter().map(|order| command(*order).to_owned());
    let is_other = std::mem::discriminant(&next) != std::mem::discriminant(&state);
    let parts: Vec<String> = orders.chain(is_other.then(|| format!("→ {}", name(next)))).collect();
    if parts.is_empty() { "–".to_owned() } else { parts.join(" ") }
}

fn table() -> String {
    let mut lines = vec![
        "| state | follows | returns | another mode | disarmed, on the ground | time limit | the mission is over |"
            .to_owned(),
        "|---|---|---|---|---|---|---|".to_owned(),
    ];
    for (what, state, height) in ROWS {
        let is_armed = state != State::Check { may_fly_on: false };
        let of = |mode| Some(Report { mode, is_armed });
        let off = Some(Report { mode: ModeMeaning::Follows, is_armed: false });
        let follows = of(ModeMeaning::Follows);
        let cells = [
            input(follows, height),
            input(of(ModeMeaning::Returns), height),
            input(of(ModeMeaning::Other), height),
            Input { checks: Checks::Wait, ..input(off, Height::Ground) },
            Input { is_late: state.limit_s().is_some(), ..input(None, height) },
            Input { is_over: true, ..input(follows, height) },
        ];
        // A time limit in the air ends in a command, which follows a report.
        let late = Input { is_late: state.limit_s().is_some(), ..input(follows, height) };
        let mut cells = cells.map(|input| cell(state, &input));
        if state == State::Climb && height != Height::Up {
            cells[4] = cell(state, &late);
        }
        lines.push(format!("| {what} | {} |", cells.join(" | ")));
    }
    lines.join("\n")
}

#[test]
fn the_page_has_the_table_of_the_code() {
    let table = table();
    assert!(PAGE.contains(&table), "expected in docs/src/mavlink-bridge.md:\n{table}");
}

#[test]
fn the_page_has_the_numbers_of_the_search() {
    for number in ["35,404", "41,275"] {
        assert!(PAGE.contains(number), "{number}");
    }
}
