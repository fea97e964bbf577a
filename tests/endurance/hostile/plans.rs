//! Infeasible plans.

use skysink_common::geometry::Position;
use skysink_common::message::{MAX_SERVED, Mode, NOBODY, Plan};

use super::audit::{audit, said};
use super::rogue::{LONG_S, Rogue, Turn, start_with_rogue};
use crate::support::Place;

/// A corruption of plans: its name, the function that corrupts the valid plan, and its expected effect.
type Nonsense = (&'static str, fn(&Rogue, &Turn) -> Plan, Wrong);

#[derive(Clone, Copy)]
enum Wrong {
    Waypoint,
    /// So many requests, and of the good ones only the first are served.
    Sensors(fn(&Plan) -> (u64, usize)),
    /// Nothing that matters.
    Nothing,
}

fn at(turn: &Turn, x_m: f64, y_m: f64, z_m: f64) -> Plan {
    Plan { x_m, y_m, z_m, ..turn.good }
}

/// A waypoint in the area, `by_m` [m] beyond the reach.
fn beyond_reach(rogue: &Rogue, turn: &Turn, by_m: f64) -> Plan {
    let from = turn.flight.position().xy();
    let far_m = rogue.scenario.reach_m() + by_m;
    let toward = if from.x < rogue.scenario.area.width_m() / 2.0 { far_m } else { -far_m };
    at(turn, from.x + toward, from.y, 20.0)
}

/// A sensor node out of range of the good waypoint.
fn far_away(rogue: &Rogue, turn: &Turn) -> u32 {
    let distance = |id: &usize| {
        let node = &rogue.sensors[*id];
        let waypoint = Position::new(turn.good.x_m, turn.good.y_m);
        (waypoint - Position::new(node.x_m, node.y_m)).norm()
    };
    let far = (0..rogue.sensors.len()).max_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
    u32::try_from(far).unwrap()
}

fn with_ids(turn: &Turn, ids: &[u32]) -> Plan {
    let mut plan = turn.good;
    plan.schedule(ids);
    plan
}

/// The good ids and those of `more`.
fn and(turn: &Turn, more: &[u32]) -> Plan {
    with_ids(turn, &[turn.good.scheduled(), more].concat())
}

const NONSENSE: [Nonsense; 21] = [
    ("a millimetre beyond reach", |rogue, turn| beyond_reach(rogue, turn, 1e-3), Wrong::Waypoint),
    ("beyond reach", |rogue, turn| beyond_reach(rogue, turn, 5.0), Wrong::Waypoint),
    ("west of the area", |_, turn| at(turn, -1e-3, turn.flight.y_m, 20.0), Wrong::Waypoint),
    (
        "north of the area",
        |rogue, turn| at(turn, turn.flight.x_m, rogue.scenario.area.height_m() + 1e-3, 20.0),
        Wrong::Waypoint,
    ),
    ("x is NaN", |_, turn| at(turn, f64::NAN, turn.good.y_m, 20.0), Wrong::Waypoint),
    ("y is NaN", |_, turn| at(turn, turn.good.x_m, f64::NAN, 20.0), Wrong::Waypoint),
    ("z is NaN", |_, turn| at(turn, turn.good.x_m, turn.good.y_m, f64::NAN), Wrong::Waypoint),
    ("x is infinite", |_, turn| at(turn, f64::INFINITY, turn.good.y_m, 20.0), Wrong::Waypoint),
    ("y is minus infinite", |_, turn| at(turn, turn.good.x_m, f64::NEG_INFINITY, 20.0), Wrong::Waypoint),
    ("z is infinite", |_, turn| at(turn, turn.good.x_m, turn.good.y_m, f64::INFINITY), Wrong::Waypoint),
    ("the largest number", |_, turn| at(turn, f64::MAX, f64::MIN, 20.0), Wrong::Waypoint),
    ("one SN out of range", |rogue, turn| with_ids(turn, &[far_away(rogue, turn)]), Wrong::Sensors(|_| (1, 0))),
    ("nobody", |_, turn| with_ids(turn, &[NOBODY]), Wrong::Sensors(|_| (1, 0))),
    ("SNs that do not exist", |_, turn| with_ids(turn, &[40, 41, u32::MAX - 1]), Wrong::Sensors(|_| (3, 0))),
    ("all twice", |_, turn| and(turn, turn.good.scheduled()), Wrong::Sensors(|good| (u64::from(good.served), 3))),
    ("the first twice", |_, turn| with_ids(turn, &[turn.good.ids[0]; 2]), Wrong::Sensors(|_| (1, 1))),
    ("64 times the first", |_, turn| with_ids(turn, &[turn.good.ids[0]; MAX_SERVED]), Wrong::Sensors(|_| (63, 1))),
    (
        "a place too many",
        |_, turn| with_ids(turn, &[NOBODY, NOBODY, NOBODY, turn.good.ids[0]]),
        Wrong::Sensors(|_| (4, 0)),
    ),
    (
        "the largest count",
        |_, turn| Plan { served: u32::MAX, ..turn.good },
        Wrong::Sensors(|good| (u64::from(u32::MAX - good.served), 3)),
    ),
    (
        "one more than the message holds",
        |_, turn| Plan { served: 65, ..turn.good },
        Wrong::Sensors(|good| (u64::from(65 - good.served), 3)),
    ),
    (
        "numbers that mean nothing",
        |_, turn| Plan {
            expected_bits: u64::MAX,
            plan_ns: u64::MAX,
            circles_m: [[f64::INFINITY, f64::NAN]; 5],
            anchor: 1_000_000,
            partner: 7_000_000,
            chosen: u32::MAX - 1,
            mode: 77,
            solver: 99,
            ..turn.good
        },
        Wrong::Nothing,
    ),
];

#[test]
fn the_feasible_part_of_any_plan_is_flown_and_the_rest_is_counted() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke"), LONG_S);
    let mut sent = Vec::new();
    while let Some(turn) = rogue.next() {
        // Every other plan is good, so that the UAV is where there is something to serve.
        let nonsense = NONSENSE.get((turn.slot / 2) as usize).filter(|_| turn.slot % 2 == 1 && turn.good.served > 0);
        rogue.send(rogue.header(turn.slot), nonsense.map_or(turn.good, |(_, spoil, _)| spoil(&rogue, &turn)));
        sent.push((turn, nonsense));
    }
    let ended = run.wait_for_success();
    let lines = audit(&place);
    assert_eq!((lines.len(), sent.len()), (60, 60));
    let mut kinds = 0;
    let mut refused = 0;
    for (line, (turn, nonsense)) in lines.iter().zip(sent) {
        let good = turn.good.scheduled();
        let wrong = nonsense.map_or(Wrong::Nothing, |(_, _, wrong)| *wrong);
        kinds += usize::from(nonsense.is_some());
        let what = nonsense.map(|(name, ..)| name);
        let (count, served) = match wrong {
            Wrong::Waypoint => (1, 0),
            Wrong::Sensors(expected) => (expected(&turn.good).0, expected(&turn.good).1.min(good.len())),
            Wrong::Nothing => (0, good.len()),
        };
        let mode = match wrong {
            Wrong::Waypoint => "hold",
            _ if turn.good.mode == Mode::Transit as u32 => "transit",
            _ if served == 0 => "fly",
            _ => "serve",
        };
        assert_eq!((line.mode.as_str(), line.refused), (mode, count), "{what:?}: {line:?}");
        assert_eq!(line.scheduled, good[..served], "{what:?}: {line:?}");
        refused += count;
    }
    assert_eq!(kinds, NONSENSE.len());
    let summary = place.summary("run");
    assert_eq!(summary["refused"], refused);
    assert_eq!((&summary["refused_messages"], &summary["complete"]), (&0.into(), &true.into()));
    for waypoints in ["waypoint with NaN or infinity", "waypoint out of reach, or outside the area"] {
        assert!(!said(&ended.stderr, waypoints).is_empty(), "{waypoints}: {ended:?}");
    }
    assert!(!said(&ended.stderr, "SN out of range").is_empty(), "{ended:?}");
    place.assert_clean();
}
