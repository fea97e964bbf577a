//! The bridge as a process of the ring: takes the plans, and publishes where the vehicles are at the end of each slot.

use std::path::Path;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, Plan, SlotHeader, Tick};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use skysink_flight_sim::journal::{journal, restore};
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::reader::Reader;
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release, monotonic_ns};
use skysink_ring::wait::WaitContext;

use crate::apart;
use crate::bridge::{Beginning, Bridge, OwnSide, VehicleRefusal, start};
use crate::clock::{Attention, VehicleClock};
use crate::frame::AreaFrame;
use crate::latency::OrderLatencies;
use crate::link::Link;
use crate::saved::SavedVehicles;
use crate::telemetry::Order;
use crate::wire::{WireAddress, check_addresses};

/// Longest time between two polls of the links.
const POLL_EVERY: Duration = Duration::from_millis(2);

/// How long before its end a slot is reported, as a fraction of it, and at most: the planner plans in this time.
const AHEAD: f64 = 0.02;
const FARTHEST_AHEAD: Duration = Duration::from_millis(50);

/// The part of a slot after which a plan comes too late.
const LATE: f64 = 0.5;

/// How long the bridge that is stopped waits until the vehicles say that they return. The launcher kills it after 3 s.
const STOP_TIMEOUT: Duration = Duration::from_millis(2_500);

/// How long a bridge whose launcher has died waits for it.
const ORPHAN_TIMEOUT: Duration = Duration::from_secs(10);

/// How long the bridge waits for the landing of vehicles that are not heard.
const UNHEARD: Duration = Duration::from_mins(10);

/// Time that the vehicles wait at least for the first plan, of the clock of this machine: its processes need time to
/// start.
const FIRST_PATIENCE: Duration = Duration::from_secs(10);

/// Time between two heartbeats of the bridge [s], in seconds of the vehicles.
const HEARTBEAT_S: f64 = 0.25;

/// Flies vehicles at `addresses` until the mission ends: waits until they hover at their starts, and sends them home at
/// the end, and after an error. A restarted process continues with the vehicles in the air.
///
/// # Errors
/// If an address cannot be opened, a vehicle must not take off, or none begins its mission, a peer is missing, the ring
/// fails, or `stop` is requested.
pub fn run<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    addresses: &[WireAddress],
) -> Result<(), NodeError> {
    let (ring, wait) = Ring::<S>::join(folder, scenario, Role::FlightSim, stop)?;
    let mut flown = restore(&journal(folder, scenario.uav.uavs())?, scenario.uav.uavs())?;
    let is_new = flown.is_empty();
    if is_new {
        flown.push((0, start(scenario)));
    }
    let mut process = BridgeProcess::new(&ring, scenario, folder, wait, addresses, &flown)?;
    let result = process.fly(scenario, folder, &ring, &flown, is_new);
    let (why, timeout) = match &result {
        Ok(()) => return process.land(),
        Err(NodeError::Orphaned) => ("skysink run has ended", ORPHAN_TIMEOUT),
        Err(NodeError::Stopped(_)) => ("the run is stopped", STOP_TIMEOUT),
        Err(_) => ("the bridge ends, with the error that follows", STOP_TIMEOUT),
    };
    if let Err(NodeError::Stopped(_)) = &result {
        process.say_awaited();
    }
    process.return_home(why, timeout);
    result
}

/// The last slots flown, with their flights.
type Flown = [(u64, ByUav<FlightReport>)];

/// How slots go by.
#[derive(Debug)]
struct SlotFlow {
    /// Wall time of a slot.
    period: Duration,
    /// Whether one was flown.
    has_flown: bool,
    /// Whether the other processes have the same clock.
    is_local: bool,
    latencies: OrderLatencies,
    /// Most elements of `links`.
    most_links: usize,
}

/// The bridge with its links and its clock.
struct BridgeProcess<S: Service + 'static> {
    bridge: Bridge,
    link: Link,
    wait: WaitContext,
    /// Notified with `plan`.
    listener: Listener<S>,
    clock: VehicleClock,
    attention: Attention,
    /// When the next heartbeat is due, in seconds of the vehicles [s].
    heartbeat_s: f64,
    slots: SlotFlow,
    /// What is known of the vehicles, for the bridge after this one.
    saved: SavedVehicles,
    /// Of the vehicles, for people.
    addresses: String,
}

/// What the bridge is to the vehicle at `address`.
fn own_side(address: &WireAddress) -> OwnSide {
    OwnSide { system: address.own_system, modes: address.modes.clone() }
}

impl<S: Service + 'static> BridgeProcess<S> {
    fn new(
        ring: &Ring<S>,
        scenario: &Scenario,
        folder: &RingFolder,
        mut wait: WaitContext,
        addresses: &[WireAddress],
        flown: &Flown,
    ) -> Result<Self, NodeError> {
        let refuse = |message: &str| InputError::of_argument("vehicle", &list(addresses), message);
        let uavs = scenario.uav.uavs();
        let saved = SavedVehicles::of(folder.path(), uavs, ring.restarts > 0);
        let (Pace::Factor(factor), Some(period)) = (ring.terms.pace, ring.terms.pace.period(scenario.slot_s)) else {
            return Err(refuse("expected a paced run, by --pace realtime or a factor").into());
        };
        let origin = scenario.area.origin();
        let origin = origin.ok_or_else(|| refuse("expected a scenario with area.origin_lat_deg and origin_lon_deg"))?;
        check_addresses(addresses, uavs).map_err(|message| refuse(&message))?;
        let (last, reports) = flown.last().expect("at least slot 0");
        match (ring.restarts, *last) {
            (0, 0) => apart::check_starts(scenario)?,
            (0, slot) => apart::check_resumed(scenario, slot, reports)?,
            _ => {}
        }
        let cannot_open = |(address, error): (WireAddress, std::io::Error)| {
            InputError::of_argument("vehicle", &address.to_string(), format_args!("cannot be opened: {error}"))
        };
        let mut link = Link::open(addresses, uavs).map_err(cannot_open)?;
        link.name(saved.vehicles().iter().map(|vehicle| (vehicle.chosen, vehicle.state.may_fly())));
        let mut sensors = ring.sensors.reader()?;
        let nodes = sensors.wait_for_next(&mut wait, 0)?;
        let beginning = match ring.restarts {
            0 if !saved.is_lost() => Beginning::First,
            // The journal of a resumed run begins with one slot.
            _ => Beginning::Restarted { in_mission: flown.len() > 1 },
        };
        let address_of = |uav: usize| &addresses[uav.min(addresses.len() - 1)];
        let own: Vec<OwnSide> = (0..uavs).map(|uav| own_side(address_of(uav))).collect();
        let frame = AreaFrame::at(origin);
        let vehicles = saved.vehicles();
        let mut bridge = Bridge::new(scenario, nodes.payload(), frame, reports, beginning, vehicles, &own);
        bridge.wait_at_first(FIRST_PATIENCE.as_secs_f64() * factor);
        Ok(Self {
            bridge,
            link,
            wait,
            listener: ring.plan.listener()?,
            clock: VehicleClock::new(factor),
            attention: Attention::default(),
            heartbeat_s: 0.0,
            slots: SlotFlow {
                period,
                has_flown: false,
                is_local: ring.terms.link.is_none(),
                latencies: OrderLatencies::default(),
                most_links: uavs * nodes.payload().len(),
            },
            saved,
            addresses: list(addresses),
        })
    }

    /// Flies all slots after those `flown`.
    fn fly(
        &mut self,
        scenario: &Scenario,
        folder: &RingFolder,
        ring: &Ring<S>,
        flown: &Flown,
        is_new: bool,
    ) -> Result<(), NodeError> {
        let flights = ring.flight.list_writer(scenario.uav.uavs())?;
        let links = ring.links.as_ref().map(|links| links.list_writer(self.slots.most_links)).transpose()?;
        let publish = |bridge: &Bridge, slot: u64, reports: &[FlightReport]| {
            if let Some(links) = &links {
                // Before the flights, as flight-sim.
                links.send_list(ring.header(slot, 0), &bridge.heard_links(slot, reports))?;
            }
            flights.send_list(ring.header(slot, 0), reports)
        };
        let mut plans = ring.plan.reader()?;
        let mut ticks = ring.tick.reader()?;
        let mut journal = journal(folder, scenario.uav.uavs())?;
        let mut heard = Instant::now();
        while !self.bridge.has_begun() {
            self.poll()?;
            self.bridge.check_flyable().map_err(|refused| refusal(&refused))?;
            let may_be_in_air = (0..self.bridge.uavs()).any(|uav| self.bridge.control(uav).is_committed());
            if !may_be_in_air || self.bridge.is_heard(self.clock.now_s()) {
                heard = Instant::now();
            } else if heard.elapsed() > UNHEARD {
                let message =
                    "none was heard for ten minutes since the bridge was restarted: expected those of the run";
                return Err(InputError::of_argument("vehicle", &self.addresses, message).into());
            }
            self.pause()?;
        }
        let (last, mut reports) = flown.last().expect("at least slot 0").clone();
        if is_new {
            journal.save(last, &[], &reports)?;
        }
        for (slot, reports) in flown {
            publish(&self.bridge, *slot, reports)?;
        }
        for slot in last + 1..=scenario.slots {
            self.fly_slot(slot, &mut ticks, &mut plans)?;
            let now_s = self.clock.now_s();
            self.bridge.end(slot, &mut reports, now_s);
            journal.save(slot, &[], &reports)?; // before they are published
            publish(&self.bridge, slot, &reports)?;
        }
        self.bridge.return_home("the mission is over");
        self.bridge
            .ends
            .said()
            .into_iter()
            .chain(self.slots.latencies.said())
            .for_each(|line| Role::FlightSim.log(line));
        self.wait_for_release(ring)
    }

    /// Flies `slot`: waits for it to begin, and follows its plan as soon as that is there, until it ends.
    fn fly_slot(
        &mut self,
        slot: u64,
        ticks: &mut Reader<S, Tick, SlotHeader>,
        plans: &mut Reader<S, [Plan], SlotHeader>,
    ) -> Result<(), NodeError> {
        self.bridge.await_plan();
        let ahead = self.slots.period.mul_f64(AHEAD).min(FARTHEST_AHEAD);
        let mut begin_ns = None;
        let mut is_planned = false;
        loop {
            if begin_ns.is_none() {
                begin_ns = self.poll_begin(slot, ticks)?;
            }
            let elapsed = begin_ns.map(|begin_ns| Duration::from_nanos(monotonic_ns().saturating_sub(begin_ns)));
            let may_fly = match elapsed {
                Some(elapsed) => elapsed < self.slots.period.mul_f64(LATE),
                None => self.slots.has_flown, // the plan that follows the last slot is for now
            };
            if !is_planned
                && may_fly
                && let Some(plan) = plans.poll_slot(slot)?.available()
            {
                is_planned = true;
                let now_s = self.clock.now_s();
                self.bridge.fly(&plan, now_s);
                self.poll()?;
                // The first plan has waited for its slot to begin, or for this process to be restarted.
                if self.slots.has_flown && self.slots.is_local {
                    self.slots.latencies.add(plan.user_header().sent_ns, monotonic_ns());
                }
            }
            if elapsed.is_some_and(|elapsed| elapsed + ahead >= self.slots.period) {
                self.slots.has_flown = true;
                return Ok(());
            }
            self.poll()?;
            self.pause()?;
        }
    }

    /// When `slot` has begun, on the monotonic clock [ns]; `None` if it has not.
    fn poll_begin(&mut self, slot: u64, ticks: &mut Reader<S, Tick, SlotHeader>) -> Result<Option<u64>, NodeError> {
        let Some(tick) = ticks.poll_slot(slot)?.available() else { return Ok(None) };
        let now_ns = monotonic_ns();
        let begin_ns = if self.slots.is_local { tick.user_header().sent_ns.min(now_ns) } else { now_ns };
        self.bridge.begin(slot, self.clock.of_vehicles_s((now_ns - begin_ns) as f64 / 1e9));
        Ok(Some(begin_ns))
    }

    /// Chooses the vehicles, takes in what they say, and sends what is due.
    fn poll(&mut self) -> Result<(), NodeError> {
        if let Err((uav, why)) = self.choose() {
            self.bridge.refuse(uav, why).map_err(|refused| refusal(&refused))?;
        }
        self.exchange()
    }

    /// Chooses the vehicles, or says which must not be flown, and why.
    fn choose(&mut self) -> Result<(), (usize, String)> {
        let now_s = self.clock.now_s();
        let bridge = &self.bridge;
        let is_committed = |uav| bridge.control(uav).is_committed();
        self.link.choose(now_s, is_committed, |uav, fix| bridge.control(uav).away_m(fix))
    }

    /// Takes in what the chosen vehicles say, and sends what is due once the states are saved.
    fn exchange(&mut self) -> Result<(), NodeError> {
        let now_s = self.clock.now_s();
        self.link.begin_poll();
        if let Some(suspended) = self.attention.poll() {
            let suspended_s = suspended.as_secs_f64();
            Role::FlightSim.log(format_args!("the bridge was suspended for {suspended_s:.1} s"));
            self.bridge.note_suspension(self.clock.of_vehicles_s(suspended_s));
        }
        let is_stale = self.attention.is_stale();
        while let Some((uav, telemetry)) = self.link.receive(now_s) {
            if !is_stale {
                self.bridge.hear(uav, &telemetry, now_s);
            }
        }
        if is_stale {
            self.bridge.doubt(now_s); // what has waited is not how it is now
        }
        for line in self.link.take_said() {
            Role::FlightSim.log(format_args!("{line}"));
        }
        if now_s >= self.heartbeat_s {
            self.heartbeat_s = now_s + HEARTBEAT_S;
            self.link.send_heartbeats(|uav| self.bridge.control(uav).heartbeats(now_s));
        }
        let mut orders = Vec::new();
        let say = |uav: usize, line: String| Role::FlightSim.log(format_args!("vehicle {}: {line}", uav + 1));
        let polled = self.bridge.poll(now_s, |uav, order| orders.push((uav, *order)), say);
        let is_saved = self.save();
        let mut was_forgotten = false;
        for (uav, order) in orders {
            if order != Order::Arm || is_saved && polled.is_ok() {
                self.link.send(uav, &order);
            } else {
                let why = if is_saved { "another vehicle must not fly" } else { "its state cannot be saved" };
                self.bridge.forget_arming(uav, why).into_iter().for_each(|line| say(uav, line));
                was_forgotten = true;
            }
        }
        if was_forgotten {
            self.save();
        }
        polled.map_err(|refused| refusal(&refused))
    }

    /// Saves what the bridge after this one has to know. Returns whether it is saved.
    fn save(&mut self) -> bool {
        let saved = |(uav, chosen)| self.bridge.control(uav).saved(chosen);
        self.saved.save(self.link.chosen().enumerate().map(saved).collect())
    }

    /// Sleeps until there is a plan, for at most [`POLL_EVERY`].
    fn pause(&mut self) -> Result<(), NodeError> {
        let _ = self.listener.timed_wait(|_| {}, POLL_EVERY); // an interrupted wait is a short one
        self.wait.sleep_until(Instant::now()) // ends on a stop or with the launcher
    }

    /// Waits for the final commit, while the vehicles return.
    fn wait_for_release(&mut self, ring: &Ring<S>) -> Result<(), NodeError> {
        let mut commits = ring.commit.reader()?;
        loop {
            while let Some(commit) = commits.next_sample()? {
                if is_release(commit.user_header()) {
                    return Ok(());
                }
            }
            self.poll()?;
            self.pause()?;
        }
    }

    /// Waits until the vehicles have landed, or the launcher ends.
    fn land(&mut self) -> Result<(), NodeError> {
        for number in self.bridge.overridden() {
            Role::FlightSim.log(format_args!("vehicle {number}: the run waits for its landing; Ctrl-C ends the run"));
        }
        let mut heard = Instant::now();
        while !self.bridge.has_landed() {
            self.poll()?;
            if self.bridge.is_heard(self.clock.now_s()) {
                heard = Instant::now();
            } else if heard.elapsed() > UNHEARD {
                Role::FlightSim.log("no vehicle that may be in the air is heard any more: the run ends");
                return Ok(());
            }
            match self.pause() {
                Err(NodeError::Orphaned) => {
                    self.return_home("skysink run has ended", ORPHAN_TIMEOUT);
                    return Ok(());
                }
                Err(error) => {
                    self.return_home("the run is stopped", STOP_TIMEOUT);
                    return Err(error);
                }
                Ok(()) => {}
            }
        }
        Ok(())
    }

    /// Sends the vehicles home because of `why`, and waits until they say so, for at most `timeout`.
    fn return_home(&mut self, why: &str, timeout: Duration) {
        self.bridge.return_home(why);
        let begin = Instant::now();
        while !self.bridge.is_homebound() && begin.elapsed() < timeout {
            // One that must not fly keeps none of the others from returning.
            let _ = self.choose();
            let _ = self.exchange();
            std::thread::sleep(POLL_EVERY);
        }
        for uav in (0..self.bridge.uavs()).filter(|uav| !self.bridge.control(*uav).is_homebound()) {
            if self.bridge.control(uav).state().may_fly() {
                Role::FlightSim.log(format_args!(
                    "vehicle {}: has not said that it returns: its GCS failsafe has to bring it home",
                    uav + 1
                ));
            }
        }
    }

    /// Says which vehicles were waited for until now, where, and for what.
    fn say_awaited(&self) {
        let seconds = self.clock.elapsed_s();
        for uav in 0..self.bridge.uavs() {
            let number = uav + 1;
            if let Some(address) = self.link.awaited_at(uav) {
                Role::FlightSim
                    .log(format_args!("vehicle {number}: no vehicle was heard at {address} for {seconds:.0} s"));
            } else if let Some(missing) = self.bridge.control(uav).missing() {
                Role::FlightSim.log(format_args!("vehicle {number}: waited {seconds:.0} s for it {missing}"));
            }
        }
    }
}

fn refusal(refused: &VehicleRefusal) -> NodeError {
    InputError::new("vehicle", Path::new(&refused.number.to_string()), &refused.why).into()
}

fn list(addresses: &[WireAddress]) -> String {
    addresses.iter().map(ToString::to_string).collect::<Vec<_>>().join(",")
}
