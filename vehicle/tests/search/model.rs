//! A vehicle, its pilot, a link and a bridge that may crash around the table: every order of events is searched.
//!
//! The table is [`step`] itself, not a copy. What it believes is modelled: a report that equals the one before it.

use std::sync::Arc;

use skysink_vehicle::autopilot::ModeMeaning;
use skysink_vehicle::table::{Checks, Command, Failsafe, Height, Input, Orders, Report, SpokenLine, State, step};
use stateright::{Checker, Model, Property};

/// What the table is replaced by in mutants.
pub type Table = Arc<dyn Fn(State, &Input) -> (State, Orders, Option<SpokenLine>) + Send + Sync>;

/// What is searched.
#[derive(Clone)]
pub struct TableSearch {
    /// Acts of the pilot, and crashes of the bridge, at most.
    pub acts: u8,
    pub crashes: u8,
    /// Reports that are on their way at most, and how many newer ones one may come after.
    pub bag: usize,
    pub delay: u8,
    /// Whether a take-off changes the mode, as of PX4.
    pub takes_off_in_any_mode: bool,
    /// The table.
    pub table: Table,
}

impl TableSearch {
    pub fn of(acts: u8, crashes: u8, bag: usize, delay: u8, takes_off_in_any_mode: bool) -> Self {
        Self { acts, crashes, bag, delay, takes_off_in_any_mode, table: Arc::new(step) }
    }
}

/// The mode of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Flies {
    Found,
    Follows,
    Returns,
    Pilot,
}

impl Flies {
    fn meaning(self) -> ModeMeaning {
        match self {
            Self::Follows => ModeMeaning::Follows,
            Self::Returns => ModeMeaning::Returns,
            Self::Found | Self::Pilot => ModeMeaning::Other,
        }
    }
}

/// A report on its way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Sent {
    report: Report,
    /// Acts of the pilot before it.
    acts: u8,
    age: u8,
}

/// The vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ModelVehicle {
    mode: Flies,
    is_armed: bool,
    height: Height,
    climbs: bool,
}

/// Everything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ModelWorld {
    vehicle: ModelVehicle,
    /// Reports, orders, and the last refusal of an order to arm.
    reports: [Option<Sent>; 2],
    order: Option<Command>,
    is_refused: bool,
    state: State,
    /// The last report, and whether it is believed.
    last: Option<Report>,
    is_believed: bool,
    is_over: bool,
    acts: u8,
    crashes: u8,
    /// Reports in a row that show the last act, after which no older one can come.
    shown: u8,
    /// Orders to arm that were sent.
    arms: u8,
    /// Whether somebody else than the bridge has control, or the vehicle was off after it was armed, as the bridge has
    /// heard.
    is_lost: bool,
    fault: Option<&'static str>,
}

/// What may happen next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ModelEvent {
    Report,
    Hear { index: usize, is_copied: bool, may_repeat: bool, crashes: bool },
    Lose { index: usize },
    Obey { is_copied: bool, is_refused: bool },
    LoseOrder,
    Late,
    End,
    Move,
    Disarms,
    Failsafe,
    Choose(Flies),
    Arm,
    Disarm,
    Crash,
}

impl ModelWorld {
    fn report(&self) -> Report {
        Report { mode: self.vehicle.mode.meaning(), is_armed: self.vehicle.is_armed }
    }

    fn input(&self, is_new: bool, may_repeat: bool, is_late: bool) -> Input {
        Input {
            believed: self.last.filter(|_| self.is_believed),
            is_new,
            says_armed: self.last.is_some_and(|report| report.is_armed),
            height: self.vehicle.height,
            is_placed: true,
            checks: Checks::Hold,
            are_all_checked: true,
            is_refused: self.is_refused,
            may_repeat,
            is_late,
            failsafe: Failsafe::Off,
            has_waypoint: true,
            is_at_start: false,
            is_over: self.is_over,
        }
    }

    /// One step of the table, with the properties that hold of each.
    fn step(&mut self, search: &TableSearch, input: &Input, crashes: bool) {
        let before = self.state;
        let (after, orders, line) = (search.table)(before, input);
        let is_end = |state| matches!(state, State::HandsOff | State::Silent | State::Done);
        if is_end(after) && after != before && line.is_none() {
            self.fault = Some("P6: an end without a line");
        }
        self.state = after;
        for order in orders {
            match order {
                Command::Waypoint => {
                    let flies = Some(Report { mode: ModeMeaning::Follows, is_armed: true });
                    if !matches!(before, State::Fly { .. }) || input.believed != flies {
                        self.fault = Some("P4: a waypoint outside of a flight, or in doubt");
                    }
                }
                _ if is_end(before) => self.fault = Some("P3: an order after the end"),
                _ if self.shown >= 1 => self.fault = Some("P1: an order after the pilot's act was heard"),
                _ if self.is_lost => self.fault = Some("P2: an order after it was off"),
                _ => {}
            }
            if self.shown >= 2 {
                self.fault = Some("P1: an order after the pilot's act was heard twice");
            }
            if *order == Command::Arm {
                self.arms += 1;
            }
            if self.arms > 1 {
                self.fault = Some("P2: armed twice");
            }
            if *order != Command::Waypoint && !crashes {
                self.order = Some(*order);
                self.is_refused = false;
            }
        }
        if crashes {
            self.crash();
        }
    }

    fn crash(&mut self) {
        self.crashes += 1;
        self.state = self.state.restarted();
        (self.last, self.is_believed, self.is_refused) = (None, false, false);
    }

    fn hear(&mut self, search: &TableSearch, index: usize, is_copied: bool, may_repeat: bool, crashes: bool) {
        let Some(sent) = self.reports[index] else { return };
        if !is_copied {
            self.reports[index] = None;
        }
        let was_armed = self.last.is_some_and(|report| report.is_armed);
        self.is_believed = self.last == Some(sent.report);
        self.last = Some(sent.report);
        let are_older = self.reports.iter().flatten().any(|other| other.acts < self.acts);
        let is_override = sent.report.mode == ModeMeaning::Other;
        let is_latest = sent.acts == self.acts && self.acts > 0 && !are_older;
        self.shown = if is_latest && is_override { (self.shown + 1).min(2) } else { 0 };
        let is_off = self.is_believed && !sent.report.is_armed && self.vehicle.height == Height::Ground;
        self.is_lost |=
            is_off && (was_armed || matches!(self.state, State::Climb | State::Fly { .. } | State::Home { .. }));
        let input = self.input(true, may_repeat, false);
        self.step(search, &input, crashes);
    }

    fn obey(&mut self, search: &TableSearch, order: Command, is_refused: bool) {
        let ModelVehicle { mode, is_armed, height, climbs } = &mut self.vehicle;
        match order {
            Command::Arm if is_refused => self.is_refused = true,
            Command::Arm if *height == Height::Ground => *is_armed = true,
            Command::TakeOff if *is_armed && (search.takes_off_in_any_mode || *mode == Flies::Follows) => {
                (*mode, *climbs) = (Flies::Follows, true);
            }
            Command::Return if *is_armed => *mode = Flies::Returns,
            _ => {}
        }
    }

    /// Climbs, comes down, or lands and disarms.
    fn fly(&mut self) {
        let vehicle = &mut self.vehicle;
        match (vehicle.mode, vehicle.height) {
            (Flies::Follows, Height::Ground) if vehicle.climbs => vehicle.height = Height::Low,
            (Flies::Follows, Height::Low) if vehicle.climbs => vehicle.height = Height::Up,
            (Flies::Returns, Height::Up) => vehicle.height = Height::Low,
            (Flies::Returns, Height::Low) => (vehicle.height, vehicle.climbs) = (Height::Ground, false),
            (Flies::Returns, Height::Ground) => (vehicle.is_armed, vehicle.climbs) = (false, false),
            _ => {}
        }
    }

    /// Whether its GCS failsafe may act: the bridge is silent on purpose.
    fn is_unheard(&self) -> bool {
        let flies = self.vehicle.is_armed && self.vehicle.height != Height::Ground;
        flies && (self.state == State::Silent || self.state == State::Done)
    }

    /// Whether nothing more is to come of it: it is on the ground, off, or somebody flies it.
    fn is_settled(&self) -> bool {
        let is_down = self.vehicle.height == Height::Ground && !self.vehicle.climbs && self.order.is_none();
        let is_pilot_s = self.state == State::HandsOff && self.acts > 0; // who has chosen the mode that follows, too
        let is_flown = self.vehicle.mode.meaning() == ModeMeaning::Other || is_pilot_s;
        is_down || is_flown || self.vehicle.mode == Flies::Returns
    }

    /// P5: without further acts the ground, a return, or a mode of a pilot is reached, also if no order arrives.
    fn settles(mut self, search: &TableSearch, is_deaf: bool) -> bool {
        for _ in 0..60 {
            if let Some(order) = self.order.take().filter(|_| !is_deaf) {
                self.obey(search, order, false);
            }
            if self.is_settled() && !matches!(self.state, State::Check { .. } | State::Arm { .. } | State::Climb) {
                return true;
            }
            self.is_over = true;
            self.reports = [None; 2];
            for _ in 0..2 {
                self.reports[0] = Some(Sent { report: self.report(), acts: self.acts, age: 0 });
                self.hear(search, 0, false, true, false);
            }
            self.order = self.order.filter(|_| !is_deaf);
            if self.is_unheard() {
                self.vehicle.mode = Flies::Returns;
            }
            if self.state.limit_s().is_some() && self.order.is_none() {
                let input = self.input(false, false, true);
                self.step(search, &input, false);
            }
            self.fly();
            if !self.vehicle.climbs && self.vehicle.height == Height::Ground && self.state == State::Done {
                self.vehicle.is_armed = false; // by itself
            }
        }
        false
    }
}

impl Model for TableSearch {
    type State = ModelWorld;
    type Action = ModelEvent;

    fn init_states(&self) -> Vec<ModelWorld> {
        let world = |mode, state| ModelWorld {
            vehicle: ModelVehicle { mode, is_armed: false, height: Height::Ground, climbs: false },
            reports: [None; 2],
            order: None,
            is_refused: false,
            state,
            last: None,
            is_believed: false,
            is_over: false,
            acts: 0,
            crashes: 0,
            shown: 0,
            arms: 0,
            is_lost: false,
            fault: None,
        };
        let check = State::Check { may_fly_on: false };
        let mut resumed = world(Flies::Follows, State::Check { may_fly_on: true });
        resumed.vehicle = ModelVehicle { is_armed: true, height: Height::Up, climbs: true, ..resumed.vehicle };
        let mut returning = world(Flies::Returns, check);
        returning.vehicle = ModelVehicle { is_armed: true, height: Height::Low, ..returning.vehicle };
        vec![world(Flies::Found, check), world(Flies::Follows, check), resumed, returning]
    }

    fn actions(&self, world: &ModelWorld, actions: &mut Vec<ModelEvent>) {
        actions.push(ModelEvent::Report);
        for (index, _) in world.reports.iter().enumerate().filter(|(_, report)| report.is_some()) {
            actions.push(ModelEvent::Lose { index });
            for (is_copied, may_repeat) in [(false, false), (false, true), (true, false), (true, true)] {
                actions.push(ModelEvent::Hear { index, is_copied, may_repeat, crashes: false });
                if world.crashes < self.crashes {
                    actions.push(ModelEvent::Hear { index, is_copied, may_repeat, crashes: true });
                }
            }
        }
        if let Some(order) = world.order {
            actions.push(ModelEvent::LoseOrder);
            for is_copied in [false, true] {
                actions.push(ModelEvent::Obey { is_copied, is_refused: false });
                if order == Command::Arm {
                    actions.push(ModelEvent::Obey { is_copied, is_refused: true });
                }
            }
        }
        // An order to arm is not on its way any more when it is given up.
        if world.state.limit_s().is_some() && world.order != Some(Command::Arm) {
            actions.push(ModelEvent::Late);
        }
        if !world.is_over {
            actions.push(ModelEvent::End);
        }
        actions.push(ModelEvent::Move);
        if world.vehicle.is_armed && world.vehicle.height == Height::Ground {
            actions.push(ModelEvent::Disarms);
        }
        if world.is_unheard() {
            actions.push(ModelEvent::Failsafe);
        }
        if world.acts < self.acts {
            let modes = [Flies::Found, Flies::Follows, Flies::Returns, Flies::Pilot];
            actions.extend(modes.into_iter().filter(|mode| *mode != world.vehicle.mode).map(ModelEvent::Choose));
            if world.vehicle.height == Height::Ground {
                actions.push(if world.vehicle.is_armed { ModelEvent::Disarm } else { ModelEvent::Arm });
            }
        }
        if world.crashes < self.crashes {
            actions.push(ModelEvent::Crash);
        }
    }

    fn next_state(&self, world: &ModelWorld, event: ModelEvent) -> Option<ModelWorld> {
        let mut next = *world;
        match event {
            ModelEvent::Report => {
                for report in &mut next.reports {
                    *report =
                        report.map(|sent| Sent { age: sent.age + 1, ..sent }).filter(|sent| sent.age <= self.delay);
                }
                let free = next.reports[..self.bag].iter_mut().find(|report| report.is_none())?;
                *free = Some(Sent { report: world.report(), acts: world.acts, age: 0 });
            }
            ModelEvent::Hear { index, is_copied, may_repeat, crashes } => {
                next.hear(self, index, is_copied, may_repeat, crashes);
            }
            ModelEvent::Lose { index } => next.reports[index] = None,
            ModelEvent::Obey { is_copied, is_refused } => {
                let order = if is_copied { next.order } else { next.order.take() };
                next.obey(self, order?, is_refused);
            }
            ModelEvent::LoseOrder => next.order = None,
            ModelEvent::Late => {
                let input = next.input(false, false, true);
                next.step(self, &input, false);
            }
            ModelEvent::End => next.is_over = true,
            ModelEvent::Move => next.fly(),
            ModelEvent::Disarms => (next.vehicle.is_armed, next.vehicle.climbs) = (false, false),
            ModelEvent::Failsafe => next.vehicle.mode = Flies::Returns,
            ModelEvent::Choose(mode) => {
                next.acts += 1;
                next.shown = 0;
                next.vehicle.mode = mode;
            }
            ModelEvent::Arm => (next.acts, next.vehicle.is_armed) = (next.acts + 1, true),
            ModelEvent::Disarm => {
                (next.acts, next.vehicle.is_armed, next.vehicle.climbs) = (next.acts + 1, false, false);
            }
            ModelEvent::Crash => next.crash(),
        }
        (next != *world).then_some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("P1 to P4, P6", |_, world: &ModelWorld| world.fault.is_none()),
            Property::always("P5", |search: &TableSearch, world: &ModelWorld| {
                world.settles(search, false) && world.settles(search, true)
            }),
            Property::sometimes("it flies", |_, world: &ModelWorld| matches!(world.state, State::Fly { .. })),
            Property::sometimes("it comes home", |_, world: &ModelWorld| {
                world.state == State::Done && world.arms > 0 && !world.vehicle.is_armed
            }),
        ]
    }
}

/// What a search has found.
#[derive(Debug)]
pub struct SearchResult {
    pub states: usize,
    pub transitions: usize,
    /// Properties that do not hold, with a path to where they do not.
    pub violations: Vec<String>,
}

/// Searches everything.
pub fn search(search: TableSearch) -> SearchResult {
    let checker = search.checker().threads(2).spawn_bfs().join();
    let violations = checker
        .discoveries()
        .into_iter()
        .filter(|(name, _)| name.starts_with('P'))
        .map(|(name, path)| format!("{name}: {path}"))
        .collect();
    let missed = ["it flies", "it comes home"].into_iter().filter(|name| checker.discovery(name).is_none());
    assert_eq!(missed.collect::<Vec<_>>(), [""; 0], "the model is too small");
    SearchResult { states: checker.unique_state_count(), transitions: checker.state_count(), violations }
}

/// The first property that is violated, with the number of states that were searched until then.
pub fn first_violation(search: TableSearch) -> Option<(usize, &'static str)> {
    let checker = search.checker().finish_when(stateright::HasDiscoveries::AnyFailures).spawn_bfs().join();
    let name = checker.discoveries().into_keys().find(|name| name.starts_with('P'))?;
    Some((checker.unique_state_count(), name))
}
