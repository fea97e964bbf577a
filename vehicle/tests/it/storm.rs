//! Random pilots who act once or twice, at random instants or on an event, on vehicles of both kinds at 1, 4 and 10
//! heartbeats a second, over links that lose, delay and copy messages, under bridges that are killed and runs that are
//! resumed: nobody is overruled, nothing is armed twice, and nothing flies without a line.

use rand::seq::IndexedRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::CopterMode;
use skysink_vehicle::autopilot::AutopilotKind;
use skysink_vehicle::bridge::Beginning;
use skysink_vehicle::table::State;
use skysink_vehicle::telemetry::Order;

use crate::flight::{
    BEFORE_SLOT, ClosedLoop, KINDS, RESTARTED, arms, count, may_overrule, options_of, plan, take_offs,
};

/// What a pilot does.
#[derive(Debug, Clone, Copy)]
enum Act {
    Change(CopterMode),
    Disarm,
    Arm,
}

/// When.
#[derive(Debug, Clone, Copy)]
enum When {
    At(f64),
    /// So long after an order to arm, or a take-off, is given.
    AfterArming(f64),
    AfterTakeOff(f64),
    /// At this altitude of the climb.
    AtAltitude(f64),
    /// So long after a waypoint is given, or the return.
    AfterWaypoint(f64),
    AfterReturn(f64),
}

impl When {
    fn of(random: &mut ChaCha8Rng) -> Self {
        let soon_s = random.random_range(0.0..2.0);
        match random.random_range(0..8) {
            0 => Self::AfterArming(soon_s),
            1 => Self::AfterTakeOff(soon_s),
            2 => Self::AtAltitude(random.random_range(0.1..19.5)),
            3 => Self::AfterWaypoint(soon_s / 2.0),
            4 => Self::AfterReturn(soon_s),
            _ => Self::At(random.random_range(1.0..80.0)),
        }
    }

    fn is_now(self, flight: &ClosedLoop) -> bool {
        let after = |s: f64, is: fn(&Order) -> bool| {
            flight.orders.iter().rev().find(|(_, order)| is(order)).is_some_and(|(at_s, _)| flight.now_s >= at_s + s)
        };
        match self {
            Self::At(at_s) => flight.now_s >= at_s,
            Self::AfterArming(s) => after(s, |order| *order == Order::Arm),
            Self::AfterTakeOff(s) => after(s, |order| matches!(order, Order::TakeOff(_))),
            Self::AtAltitude(z_m) => flight.copter.body.position_m.z >= z_m,
            Self::AfterWaypoint(s) => after(s, |order| matches!(order, Order::Reposition { .. })),
            Self::AfterReturn(s) => after(s, |order| *order == Order::Return),
        }
    }
}

fn do_it(flight: &mut ClosedLoop, act: Act) {
    match act {
        Act::Change(mode) => {
            let _ = flight.copter.change_to(mode);
        }
        Act::Disarm if !flight.copter.is_in_air() => flight.copter.disarm(),
        Act::Arm if !flight.copter.is_in_air() => flight.copter.is_armed = true,
        Act::Disarm | Act::Arm => {}
    }
}

#[derive(Debug, Default)]
struct Tally {
    overruled: Vec<String>,
    armed_twice: Vec<String>,
    silent: Vec<String>,
    for_ever: Vec<String>,
    seen: u32,
    flown: u32,
    killed: u32,
    /// Acts within a round trip of the link of an order that undoes them: nobody can help that, as the page says.
    crossed: u32,
}

fn fly(seed: u64, tally: &mut Tally) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let found = *[CopterMode::Guided, CopterMode::Guided, CopterMode::Stabilize, CopterMode::Loiter, CopterMode::Land]
        .choose(&mut random)
        .unwrap();
    let options = KinematicOptions { seed, mode: found, ..options_of(KINDS[(seed % 2) as usize]) };
    let mut flight = ClosedLoop::new(&options, *[0.0, 0.0, 0.1].choose(&mut random).unwrap());
    flight.is_deaf = true;
    flight.heartbeat_s =
        if flight.autopilot == AutopilotKind::Px4 { 1.0 } else { [1.0, 0.24, 0.1][(seed / 2 % 3) as usize] };
    flight.delay_s = *[0.0, 0.1, 0.4].choose(&mut random).unwrap();
    flight.copies = *[0.0, 0.0, 0.2].choose(&mut random).unwrap();
    let operator_s = if found == CopterMode::Guided { f64::INFINITY } else { random.random_range(0.0..8.0) };
    let act = *[
        Act::Change(CopterMode::Loiter),
        Act::Change(CopterMode::Stabilize),
        Act::Change(found),
        Act::Change(CopterMode::Return),
        Act::Change(CopterMode::Land),
        Act::Disarm,
        Act::Arm,
    ]
    .choose(&mut random)
    .unwrap();
    let when = When::of(&mut random);
    let killed_s = if random.random_range(0..3) == 0 { random.random_range(2.0..70.0) } else { f64::INFINITY };
    let is_resumed = random.random::<bool>();
    let mut acted_s = None;
    let mut is_seen_by_nobody = false;
    let mut was_done = false; // on the ground, which has been said
    let mut has_operator = false;
    let mut slot = 0;
    let mut slot_s = 0.0;
    let mut is_killed = false;
    let mut orders_at_act = 0;
    let mut arrived_at_act = 0;
    let mut said_at_act = 0;
    while flight.now_s < 260.0 && !(flight.bridge.has_landed() && acted_s.is_some_and(|s: f64| flight.now_s > s + 20.0))
    {
        if !has_operator && flight.now_s >= operator_s && acted_s.is_none() && !flight.copter.is_armed {
            has_operator = true;
            let _ = flight.copter.change_to(CopterMode::Guided);
        }
        if acted_s.is_none() && when.is_now(&flight) {
            let before = (flight.copter.mode, flight.copter.is_armed);
            was_done = flight.state() == State::Done;
            do_it(&mut flight, act);
            let after = (flight.copter.mode, flight.copter.is_armed);
            acted_s = Some(flight.now_s);
            is_seen_by_nobody =
                before == after || matches!(after, (CopterMode::Guided, is_armed) if is_armed == before.1);
            (orders_at_act, arrived_at_act) = (flight.orders.len(), flight.arrived.len());
            said_at_act = flight.said.len();
        }
        if !is_killed && flight.now_s >= killed_s {
            is_killed = true;
            tally.killed += 1;
            let beginning = match (flight.bridge.has_begun(), is_resumed) {
                (_, true) if !flight.copter.is_armed => RESTARTED,
                (true, _) => RESTARTED,
                (false, _) => BEFORE_SLOT,
            };
            flight.restart(if is_resumed && flight.bridge.has_begun() { Beginning::First } else { beginning });
        }
        if flight.bridge.has_begun() && flight.now_s >= slot_s && slot < 8 {
            slot += 1;
            slot_s = flight.now_s + 6.0;
            flight.bridge.await_plan();
            flight.bridge.begin(slot, 0.0);
            let now_s = flight.now_s;
            flight.bridge.fly(&[plan(50.0, 56.0 + (slot % 5) as f64 * 2.0)], now_s);
        } else if slot == 8 && flight.now_s >= slot_s {
            slot += 1;
            flight.bridge.return_home("the mission is over");
        }
        flight.step();
    }
    let who = format!(
        "pilot {seed}: {act:?}, {when:?} = {acted_s:?} s, found in {found:?} over {:?}, killed {killed_s:.1} s {is_resumed}",
        flight.autopilot
    );
    tally.flown += u32::from(take_offs(&flight) > 0);
    if arms(&flight) > 1 && !is_killed || arms(&flight) > 2 {
        tally.armed_twice.push(format!("{who}: {:?}", flight.orders));
    }
    // It is up there, nobody has chosen that, and nobody is told.
    let said = ["is on its way to its start", "does not follow", "nobody is known to fly it"];
    let is_said = said.iter().any(|words| count(&flight, words) > 0);
    let is_hanging = flight.copter.is_in_air() && flight.copter.mode == CopterMode::Guided && !is_said;
    if is_hanging && flight.state() != State::HandsOff {
        tally.for_ever.push(format!("{who}: {:?} {:?}", flight.state(), flight.said));
    }
    let Some(acted_s) = acted_s.filter(|_| !is_seen_by_nobody) else { return };
    tally.seen += 1;
    let on_its_way =
        flight.arrived[arrived_at_act..].iter().filter(|(at_s, _)| *at_s <= acted_s + 2.0 * flight.delay_s + 0.35);
    if on_its_way.filter(|(_, order)| may_overrule(order)).count() > 0 {
        tally.crossed += 1;
        return;
    }
    // Two reports, the longest interval between which is that of a lossy link, and the delays of the link.
    let window_s = 2.0 * flight.heartbeat_s.max(0.2) + 2.0 * flight.delay_s + if flight.loss > 0.0 { 8.0 } else { 0.3 };
    let late =
        flight.orders[orders_at_act..].iter().filter(|(at_s, order)| may_overrule(order) && *at_s > acted_s + window_s);
    let is_returned =
        |order: &Order| *order == Order::Return && matches!(act, Act::Change(CopterMode::Land | CopterMode::Return));
    let late: Vec<_> = late.filter(|(_, order)| !is_returned(order) || flight.state() == State::HandsOff).collect();
    let is_waiting = matches!(act, Act::Change(_)) && arms(&flight) > 0 && flight.orders[..orders_at_act].is_empty();
    if !late.is_empty() && !is_waiting {
        tally.overruled.push(format!("{who}: {late:?} {:?}", flight.said));
    }
    let words = [
        "is overridden",
        "its mission is over",
        "has landed",
        "is not flown",
        "is left",
        "stays on the ground",
        "is on the ground",
        "waiting for it",
    ];
    let said = &flight.said[said_at_act..];
    if !said.iter().any(|line| words.iter().any(|words| line.contains(words))) && flight.refusal.is_none() && !was_done
    {
        tally.silent.push(format!("{who}: {:?}", flight.said));
    }
}

/// Checks so many pilots.
pub fn check(pilots: u64) {
    let mut tally = Tally::default();
    (0..pilots).for_each(|seed| fly(seed, &mut tally));
    let Tally { overruled, armed_twice, silent, for_ever, seen, flown, killed, crossed } = tally;
    println!("{pilots} pilots: {seen} acts that can be seen, {crossed} crossed, {flown} flights, {killed} kills");
    for (what, found) in
        [("overruled", overruled), ("armed twice", armed_twice), ("silent", silent), ("for ever", for_ever)]
    {
        assert!(found.is_empty(), "{} {what}: {:#?}", found.len(), &found[..found.len().min(5)]);
    }
    let least = pilots as u32 / 2;
    assert!(
        seen > least && flown > least && killed > least / 3 && crossed < seen / 10,
        "{seen} {flown} {killed} {crossed}"
    );
}

#[test]
fn random_pilots_are_never_overruled() {
    check(150);
}
