//! The bridge's side of one vehicle: what it says becomes an input of the table, and what the table orders a message.
//!
//! Messages in, orders out. The clock is passed in, in seconds of the vehicle. What is ordered, and when, is decided in
//! [`crate::table`] alone.

mod lines;

use nalgebra::Point3;
use skysink_common::geometry::above;
use skysink_flight_sim::outside::REACHED_M;

use crate::autopilot::{AutopilotKind, ModeMeaning};
use crate::identity::ChosenVehicle;
use crate::jumps::{Jumps, Plausibility};
use crate::outbox::Outbox;
use crate::preflight::{Assignment, Preflight, PreflightRefusal};
use crate::said::Said;
use crate::saved::SavedVehicle;
use crate::state::{LinkArrivals, VehicleState};
use crate::table::{Checks, Command, Height, Input, State, step};
use crate::telemetry::{ACCEPTED, Fix, GlobalTarget, Order, TEMPORARILY_REJECTED, Telemetry, UNSUPPORTED};

/// Time after which positions far from the first one are believed before take-off: that one was wrong [s].
const MOVED_S: f64 = 3.0;

/// Time after which a waypoint that was rejected for now is sent again [s].
const RETRY_S: f64 = 1.0;

/// Altitude below that of the start at which a climb is over [m].
const CLIMBED_M: f64 = 1.0;

/// Greatest speed of a vehicle that hovers [m/s].
const HOVER_MPS: f64 = 0.5;

/// Time without a mode that is believed after which a vehicle gets no heartbeats until there is one [s].
const UNHEARD_S: f64 = 10.0;

/// How far the altitude of home may be from what the vehicle reports of it [m]: an autopilot corrects it by some
/// metres.
const HOME_SLACK_M: f64 = 30.0;

/// Time between two calls of a vehicle that was never heard, longer than any GCS failsafe waits (PX4: up to 300 s), and
/// how long one takes [s].
const CALL_EVERY_S: f64 = 310.0;
const CALL_S: f64 = 0.3;

/// Whether a vehicle gets heartbeats of the bridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heartbeats {
    /// It does, whoever else is at its address.
    Due,
    /// It does not, so that its GCS failsafe acts.
    Withheld,
    /// It does, unless those of another on its connection are withheld.
    Idle,
}

/// Where a vehicle is sent.
#[derive(Debug, Clone, Copy)]
struct Waypoint {
    at: Point3<f64>,
    /// Whether it was handed to the outbox: before that, the altitude of home is not known.
    is_queued: bool,
    is_refused: bool,
}

impl Waypoint {
    fn at(at: Point3<f64>) -> Self {
        Self { at, is_queued: false, is_refused: false }
    }
}

/// Which altitude of its home counts, above sea [m].
#[derive(Debug, Clone, Copy)]
enum HomeAltitude {
    /// The one that it reports.
    Reported,
    /// The one that the bridge before has saved, if what it reports is near: until then none is known.
    Saved(f64),
    /// The one of the arming: autopilots correct theirs in flight.
    Frozen(f64),
}

/// What is believed of what comes in.
#[derive(Debug, Clone)]
struct Hearing {
    arrivals: LinkArrivals,
    jumps: Jumps,
}

/// The bridge's side of one vehicle.
#[derive(Debug, Clone)]
pub struct VehicleControl {
    /// What is known of the vehicle.
    pub vehicle: VehicleState,
    assignment: Assignment,
    hearing: Hearing,
    preflight: Preflight,
    state: State,
    /// Since when it is in that state [s].
    since_s: f64,
    outbox: Outbox,
    waypoint: Option<Waypoint>,
    home: HomeAltitude,
    /// Why its mission is to end, or has ended, in a sentence about "it"; empty before.
    end: String,
    said: Said,
}

impl VehicleControl {
    /// A vehicle in this state, of which nothing was heard yet; `before` is what the bridge before has saved of it.
    #[must_use]
    pub fn new(assignment: Assignment, state: State, before: Option<&SavedVehicle>) -> Self {
        let hearing = Hearing { arrivals: LinkArrivals::default(), jumps: Jumps::at_most(assignment.speed_mps) };
        let start = assignment.start;
        let was_down = state.is_flown() || before.is_some_and(|before| before.was_down);
        let saved_home_m = before.filter(|_| state.may_fly()).and_then(|before| before.home_m); // else it is armed anew
        let mut outbox = Outbox::default();
        if let State::Fly { .. } = state {
            outbox.send(Order::Speed(assignment.speed_mps), 0.0); // the bridge before may not have had its answer
        }
        Self {
            vehicle: VehicleState::default(),
            assignment,
            hearing,
            preflight: Preflight::of(was_down),
            state,
            since_s: 0.0,
            outbox,
            waypoint: (state == State::Fly { has_begun: false }).then(|| Waypoint::at(start)),
            home: saved_home_m.map_or(HomeAltitude::Reported, HomeAltitude::Saved),
            end: String::new(),
            said: Said::default(),
        }
    }

    /// Believes nothing that was heard before: the bridge was stopped meanwhile.
    pub fn doubt(&mut self, now_s: f64) {
        self.hearing.arrivals.note_deafness(now_s);
        self.vehicle.belief.doubt(Some(now_s));
    }

    /// Notes that the command to arm was not sent, because of `why`: its start is over.
    pub fn forget_arming(&mut self, why: &str) {
        self.state = State::Done;
        self.end_with(why, "is not armed");
    }

    /// Takes the lines for people that have come up.
    pub fn take_said(&mut self) -> Vec<String> {
        self.said.take()
    }

    /// Takes in a message of the vehicle.
    pub fn hear(&mut self, telemetry: &Telemetry, now_s: f64) {
        if self.hearing.arrivals.hear(now_s) {
            self.vehicle.belief.doubt(None);
        }
        if self.hearing.arrivals.is_stale(now_s) {
            return; // it has waited in the link
        }
        if let Telemetry::Position(fix) = telemetry
            && !self.admit_fix(fix, now_s)
        {
            return;
        }
        self.vehicle.hear(telemetry, &self.assignment.modes, self.assignment.low_battery, now_s);
        match telemetry {
            Telemetry::Answer { command, result } => self.hear_answer(*command, *result, now_s),
            Telemetry::Text { text, line } => self.said.quote_part(text, *line, now_s),
            Telemetry::Parameter { name, value, is_integer } => {
                if let Some(autopilot) = self.vehicle.autopilot {
                    self.preflight.hear_parameter(autopilot, name, autopilot.parameter(*value, *is_integer));
                }
            }
            _ => {}
        }
    }

    /// Notes, and says, whether the vehicle can be at `fix`.
    fn admit_fix(&mut self, fix: &Fix, now_s: f64) -> bool {
        let jumps = &mut self.hearing.jumps;
        if matches!(self.state, State::Check { .. }) && jumps.away_for_s(now_s) >= MOVED_S {
            *jumps = Jumps::at_most(self.assignment.speed_mps);
        }
        let plausibility = jumps.admit(self.assignment.frame.position(fix), now_s);
        let Fix { lat_deg, lon_deg, .. } = fix;
        match plausibility {
            Plausibility::Plausible | Plausibility::StillAway => {}
            Plausibility::Again => self.said.say(format!("is believed again to be at {lat_deg}, {lon_deg}")),
            Plausibility::Jump { away_m } => {
                let km = away_m.map_or("far".to_owned(), |away_m| format!("{:.1} km", away_m / 1e3));
                self.said.say(format!(
                    "is not believed to be at {lat_deg}, {lon_deg}, {km} from where it was: it gets no waypoints \
                     meanwhile"
                ));
            }
        }
        matches!(plausibility, Plausibility::Plausible | Plausibility::Again)
    }

    fn hear_answer(&mut self, command: u16, result: u8, now_s: f64) {
        if self.outbox.hear_answer(command, result, now_s) && result != ACCEPTED {
            let what = match self.state {
                State::Climb => Some(("take-off", "refuses to take off", "for two minutes")),
                State::Home { .. } => Some(("return", "refuses to return", "for half a minute")),
                _ => None, // arming: said with the transition
            };
            if let Some((matter, what, how_long)) = what {
                let line = format!("{what}: MAVLink result {result}; it is asked again {how_long}");
                self.said.say_while(matter, Some(line), 0.0, now_s);
            }
        }
        let Some(order) = self.outbox.answer(command, result, now_s) else { return };
        let is_flown = self.vehicle.autopilot == Some(AutopilotKind::Px4) && result == UNSUPPORTED;
        match order {
            _ if result == ACCEPTED => {}
            Order::Reposition { .. } if is_flown => {}
            Order::Reposition { .. } if result == TEMPORARILY_REJECTED => self.outbox.send(order, now_s + RETRY_S),
            Order::Speed(speed_mps) => self.said.say(format!("keeps its own speed, not {speed_mps} m/s")),
            _ => {
                self.waypoint.iter_mut().for_each(|waypoint| waypoint.is_refused = true);
                self.said.say(format!("refuses its waypoint: MAVLink result {result}"));
            }
        }
    }

    /// Flies to `target` [m] and holds there, as soon as it may; without effect before the flight and after it.
    pub fn fly_to(&mut self, target: Point3<f64>, now_s: f64) {
        let State::Fly { .. } = self.state else { return };
        self.waypoint = Some(Waypoint::at(target));
        self.queue_waypoint(now_s);
    }

    /// Sends the waypoint as soon as it may be sent.
    fn queue_waypoint(&mut self, now_s: f64) {
        let home_m = self.home_m();
        let (Some(waypoint), Some(autopilot), Some(home_m)) = (&mut self.waypoint, self.vehicle.autopilot, home_m)
        else {
            return;
        };
        waypoint.is_queued = true;
        let Some(place) = self.assignment.frame.geodetic(&waypoint.at) else { return };
        let altitude = autopilot.altitude(waypoint.at.z, home_m);
        let to = GlobalTarget { lat_deg: place.lat_deg, lon_deg: place.lon_deg, altitude };
        let speed_mps = autopilot.takes_speed_with_waypoint().then_some(self.assignment.speed_mps);
        self.outbox.send(Order::Reposition { to, speed_mps }, now_s);
    }

    /// Ends its mission, because of `why`: it flies home, or does not take off.
    pub fn return_home(&mut self, why: &str) {
        if self.end.is_empty() && self.state.is_ours() {
            why.clone_into(&mut self.end);
        }
    }

    /// Ends its mission before it flies, because of `why`. One that the run before may have left in the air gets no
    /// commands and no heartbeats.
    pub fn refuse(&mut self, why: &str) {
        if let State::Check { may_fly_on } = self.state {
            self.state = if may_fly_on { State::Silent } else { State::Done };
            self.end_with(why, if may_fly_on { "is left to its GCS failsafe" } else { "is not armed" });
        }
    }

    /// Advances to `now_s` [s], by one step of the table; adds the orders that are due to `orders`. Whether
    /// `are_all_checked` is the same for all vehicles. Returns why it has ended before it was armed, if that is new.
    pub fn poll(&mut self, now_s: f64, are_all_checked: bool, orders: &mut Vec<Order>) -> Option<PreflightRefusal> {
        if self.state.is_ours() {
            orders.extend(self.vehicle.requests(now_s));
        }
        if matches!(self.state, State::Climb | State::Fly { .. }) && self.vehicle.power.is_low() {
            let has = 100.0 * self.vehicle.power.left.unwrap_or_default();
            let limit = 100.0 * self.assignment.low_battery;
            self.return_home(&format!("its battery is at {has:.0} %, below {limit:.0} %"));
        }
        self.restore_home();
        if self.waypoint.is_some_and(|waypoint| !waypoint.is_queued) {
            self.queue_waypoint(now_s);
        }
        let checks = self.check(now_s, orders);
        let input = self.input(checks, are_all_checked, now_s);
        let before = self.state;
        let (state, commands, line) = step(before, &input);
        if std::mem::discriminant(&state) != std::mem::discriminant(&before) {
            self.since_s = now_s;
            self.begin(state, now_s);
        }
        self.state = state;
        line.into_iter().for_each(|line| self.say_line(line));
        commands.iter().for_each(|command| self.command(*command, now_s, orders));
        self.say_what_lasts(&input, now_s);
        let is_down = input.believed.is_some_and(|report| !report.is_armed);
        let was_down = matches!(before, State::Check { .. }) && is_down || before == State::Silent;
        self.preflight.was_down |= was_down || state.is_flown();
        // Somebody who arms it while the bridge waits flies it, with heartbeats; one that is found armed is no vehicle
        // to fly.
        let is_kept = state == State::HandsOff && self.preflight.was_down;
        let was_refused = matches!(before, State::Check { .. }) && !state.is_ours() && !input.is_over && !is_kept;
        was_refused.then(|| PreflightRefusal(self.end.clone()))
    }

    /// Whether the checks before take-off hold now. Of a vehicle that may be in the air nothing is checked.
    fn check(&mut self, now_s: f64, orders: &mut Vec<Order>) -> Checks {
        let State::Check { may_fly_on: false } = self.state else { return Checks::Hold };
        let position = self.position().filter(|_| self.has_current_position(now_s));
        self.preflight.check(&self.vehicle, position, &self.assignment, now_s, orders)
    }

    /// What the table has to know.
    fn input(&mut self, checks: Checks, are_all_checked: bool, now_s: f64) -> Input {
        let (is_new, missed, says_armed) = self.vehicle.belief.take_new();
        let above_home_m = self.position().map(|position| position.z);
        let believed = self.vehicle.believed(now_s);
        let missed = missed.filter(|_| !self.vehicle.is_lost(now_s));
        let height = match above_home_m {
            _ if self.vehicle.is_on_ground(now_s) => Height::Ground,
            Some(z_m) if z_m > self.assignment.start.z - CLIMBED_M && !self.vehicle.takes_off() => Height::Up,
            _ => Height::Low,
        };
        Input {
            believed: missed.or(believed),
            // Nothing is ordered on what was contradicted since.
            is_new: is_new && (missed.is_none() || missed == believed),
            says_armed,
            height,
            is_placed: self.has_current_position(now_s),
            checks,
            are_all_checked,
            is_refused: self.outbox.is_refused(),
            may_repeat: self.outbox.may_repeat(now_s),
            is_late: self.state.limit_s().is_some_and(|limit_s| now_s - self.since_s > limit_s),
            failsafe: self.vehicle.failsafe(now_s),
            has_waypoint: self.outbox.is_due(now_s),
            is_at_start: self.hovers_at_start(now_s),
            is_over: !self.end.is_empty(),
        }
    }

    /// What begins with a state.
    fn begin(&mut self, state: State, now_s: f64) {
        self.outbox.clear();
        if let State::Fly { has_begun: false } = state {
            self.waypoint = Some(Waypoint::at(self.assignment.start));
            self.outbox.send(Order::Speed(self.assignment.speed_mps), now_s);
            self.queue_waypoint(now_s);
        }
    }

    fn command(&mut self, command: Command, now_s: f64, orders: &mut Vec<Order>) {
        let order = match command {
            Command::Waypoint => return orders.extend(self.outbox.due(now_s)),
            Command::Arm => {
                self.home = self.vehicle.home_m().map_or(HomeAltitude::Reported, HomeAltitude::Frozen);
                Order::Arm
            }
            Command::TakeOff => {
                let (Some(autopilot), Some(home_m)) = (self.vehicle.autopilot, self.home_m()) else { return };
                Order::TakeOff(autopilot.altitude(self.assignment.start.z, home_m))
            }
            Command::Return => Order::Return,
        };
        self.outbox.note_sent(order, now_s);
        orders.push(order);
    }

    fn hovers_at_start(&self, now_s: f64) -> bool {
        let is_near = self.position().is_some_and(|at| (at - self.assignment.start).norm() <= REACHED_M);
        let is_slow = self.vehicle.speed_mps().is_some_and(|speed_mps| speed_mps <= HOVER_MPS);
        is_near && is_slow && self.has_current_position(now_s)
    }

    /// Whether it gets heartbeats. A vehicle that may be in the air gets none if its GCS failsafe has to bring it home:
    /// the bridge does not fly it, and nobody else is known to, or it was not heard for long.
    pub fn heartbeats(&self, now_s: f64) -> Heartbeats {
        let is_called = self.vehicle.autopilot.is_none() && now_s % CALL_EVERY_S < CALL_S;
        let is_withheld = match self.state {
            State::Done if !self.vehicle.says_armed() => return Heartbeats::Idle,
            // Else somebody flies it again.
            State::Done => self.vehicle.meaning() == Some(ModeMeaning::Follows) || !self.preflight.was_down,
            State::Silent => true,
            State::Check { .. } if self.vehicle.autopilot.is_some() && !self.preflight.was_down => true,
            // However long it is silent: a GCS failsafe would act over its pilot.
            State::HandsOff => !self.preflight.was_down,
            _ => self.state.may_fly() && self.vehicle.belief.doubt_s(now_s) >= UNHEARD_S && !is_called,
        };
        if is_withheld { Heartbeats::Withheld } else { Heartbeats::Due }
    }

    /// The state of its mission.
    pub fn state(&self) -> State {
        self.state
    }

    /// Whether it was heard, and not too long ago.
    pub fn is_heard(&self, now_s: f64) -> bool {
        self.vehicle.autopilot.is_some() && !self.vehicle.is_lost(now_s)
    }

    /// What it is waited for before take-off, in words after "waited for it"; `None` if nothing is.
    pub fn missing(&self) -> Option<&str> {
        let is_waited_for = matches!(self.state, State::Check { .. }) && !self.preflight.missing.is_empty();
        is_waited_for.then_some(&*self.preflight.missing)
    }

    /// Why its mission is to end, or has ended; empty while it goes on.
    pub fn end(&self) -> &str {
        &self.end
    }

    /// Whether the checks before take-off hold, or are over.
    pub fn is_checked(&self) -> bool {
        self.preflight.holds || !matches!(self.state, State::Check { .. })
    }

    /// Whether the bridge has commanded it to arm, or the one before.
    pub fn is_committed(&self) -> bool {
        !matches!(self.state, State::Check { .. })
    }

    /// Whether the bridge flies it, or somebody else does.
    pub fn is_flown_by_anybody(&self) -> bool {
        self.state.is_flown() || self.state == State::HandsOff
    }

    /// Whether it flies to the waypoints of plans, as far as is known.
    pub fn follows_plans(&self, now_s: f64) -> bool {
        self.takes_waypoints() && self.has_current_position(now_s)
    }

    /// Whether it is in its mission, has not refused its waypoint, and has a home that is believed.
    pub fn takes_waypoints(&self) -> bool {
        matches!(self.state, State::Fly { .. }) && !self.has_refused() && self.home_m().is_some()
    }

    /// Whether it has refused its waypoint.
    pub fn has_refused(&self) -> bool {
        self.waypoint.is_some_and(|waypoint| waypoint.is_refused)
    }

    /// Where it was sent last [m], if it may be on its way there.
    pub fn target(&self) -> Option<Point3<f64>> {
        self.waypoint.map(|waypoint| waypoint.at).filter(|_| matches!(self.state, State::Fly { .. }))
    }

    /// The altitude of its home above sea [m]: as it was when it was armed, before that the median of some seconds.
    pub fn home_m(&self) -> Option<f64> {
        match self.home {
            HomeAltitude::Frozen(home_m) => Some(home_m),
            HomeAltitude::Saved(_) if self.reads_above_sea() => None,
            HomeAltitude::Reported | HomeAltitude::Saved(_) => self.vehicle.home_m(),
        }
    }

    fn reads_above_sea(&self) -> bool {
        self.vehicle.autopilot.is_some_and(AutopilotKind::reads_above_sea)
    }

    /// Takes what the bridge before has saved, if it is near what the vehicle reports.
    fn restore_home(&mut self) {
        if let (HomeAltitude::Saved(saved_m), Some(off_m)) = (self.home, self.home_is_off_m())
            && off_m < HOME_SLACK_M
        {
            self.home = HomeAltitude::Frozen(saved_m);
        }
    }

    /// How far the altitude of home that the vehicle reports is from the saved one [m], once it has reported it for
    /// some time; `None` if none is awaited.
    fn home_is_off_m(&self) -> Option<f64> {
        let HomeAltitude::Saved(saved_m) = self.home else { return None };
        self.vehicle.settled_home_m().map(|reported_m| (saved_m - reported_m).abs())
    }

    /// What the bridge after this one has to know: its state, its home once it was armed, and whether it was seen
    /// disarmed.
    pub fn saved(&self, chosen: Option<ChosenVehicle>) -> SavedVehicle {
        let home_m = match self.home {
            HomeAltitude::Frozen(home_m) | HomeAltitude::Saved(home_m) => Some(home_m),
            HomeAltitude::Reported => None,
        };
        SavedVehicle { chosen, state: self.state, home_m, was_down: self.preflight.was_down, was_flown: false }
    }

    /// Where it is [m]; `None` if that was never known. Its altitude is above its home as it was when it was armed, if
    /// its waypoints are.
    pub fn position(&self) -> Option<Point3<f64>> {
        let fix = self.vehicle.fix()?;
        let position = self.assignment.frame.position(fix)?;
        let is_frozen = matches!(self.home, HomeAltitude::Frozen(_)) && self.reads_above_sea();
        let home_m = self.home_m().filter(|_| is_frozen);
        Some(home_m.map_or(position, |home_m| above(&position.xy(), fix.above_sea_m - home_m)))
    }

    /// Whether its position is current, and believed.
    pub fn has_current_position(&self, now_s: f64) -> bool {
        self.vehicle.has_current_fix(now_s) && !self.hearing.jumps.is_doubtful(now_s)
    }

    /// How far from its start a vehicle is [m].
    pub fn away_m(&self, fix: &Fix) -> Option<f64> {
        Some((self.assignment.frame.position(fix)?.xy() - self.assignment.start.xy()).norm())
    }

    /// Whether it needs no further command: it says that it returns, is flown by others, or is on the ground.
    pub fn is_homebound(&self) -> bool {
        match self.state {
            State::Home { was_seen } => was_seen || self.outbox.result() == Some(ACCEPTED),
            State::HandsOff | State::Silent | State::Done => true,
            _ => false,
        }
    }
}
