//! The links to the vehicles of a fleet: which vehicle is at which address. The messages themselves
//! are left to [`crate::codec`].

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::net::SocketAddr;

use mavlink::MavHeader;
use mavlink::dialects::common::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType};

use crate::codec::{AUTOPILOT, answers_to, decode, encode};
use crate::control::Heartbeats;
use crate::identity::{ChosenVehicle, Sender, Vehicles};
use crate::telemetry::{Fix, Order, Telemetry};
use crate::wire::{Received, Wire, WireAddress};

/// Messages that are taken in a poll at most, so that a flood of them does not stop the bridge.
const MOST_IN_A_POLL: usize = 4096;

/// Lines that are said of a connection at most, and those of them on strangers.
const MOST_NOTICES: usize = 64;
const MOST_STRANGERS: usize = 8;

/// The links to a fleet.
pub struct Link {
    connections: Vec<LinkedWire>,
    routes: Vec<Route>,
    /// Messages that may still be taken in this poll.
    budget: usize,
    said: Vec<String>,
}

/// A connection with what was heard on it.
struct LinkedWire {
    address: WireAddress,
    wire: Wire,
    vehicles: Vehicles,
    noticed: BTreeSet<String>,
}

/// The vehicle of a UAV.
struct Route {
    connection: usize,
    /// Its system, if it is named.
    named: Option<u8>,
    /// Its system, once it is chosen.
    system: Option<u8>,
    /// What the bridge before has chosen, and the system that it must be.
    before: Option<ChosenVehicle>,
    expected: Option<u8>,
}

impl Link {
    /// Opens the links to `uavs` vehicles: all at one address, as the systems 1 to `uavs` if it names none, or each at
    /// its own; the same address may name several systems.
    ///
    /// # Errors
    /// If an address cannot be opened; the error has the address.
    pub fn open(addresses: &[WireAddress], uavs: usize) -> Result<Self, (WireAddress, io::Error)> {
        let mut link = Self { connections: Vec::new(), routes: Vec::new(), budget: 0, said: Vec::new() };
        let is_shared = addresses.len() < uavs;
        for uav in 0..uavs {
            let address = &addresses[if is_shared { 0 } else { uav }];
            let is_same = |connection: &LinkedWire| connection.address.shares_wire(address);
            let connection = match link.connections.iter().position(is_same) {
                Some(connection) => connection,
                None => {
                    let wire = Wire::open(address).map_err(|error| (address.clone(), error))?;
                    let address = address.clone();
                    let vehicles = Vehicles::default();
                    link.connections.push(LinkedWire { address, wire, vehicles, noticed: BTreeSet::new() });
                    link.connections.len() - 1
                }
            };
            let named = if is_shared { u8::try_from(uav + 1).ok() } else { address.system };
            link.routes.push(Route { connection, named, system: None, before: None, expected: None });
        }
        Ok(link)
    }

    /// Begins a poll: chooses the vehicles, and checks that those which are not `is_committed`, by the number of their
    /// UAV, are still the only ones that can be meant. `away` says how far from the start of a UAV a vehicle is [m].
    ///
    /// # Errors
    /// If a vehicle must not be flown: the number of its UAV, from 0, and why.
    pub fn choose(
        &mut self,
        now_s: f64,
        is_committed: impl Fn(usize) -> bool,
        away: impl Fn(usize, &Fix) -> Option<f64>,
    ) -> Result<(), (usize, String)> {
        let mut chosen = Ok(());
        for (uav, route) in self.routes.iter_mut().enumerate() {
            let vehicles = &mut self.connections[route.connection].vehicles;
            let away = |fix: &Fix| away(uav, fix);
            let is_committed = is_committed(uav);
            let checked = match route.system {
                None => route.choose(vehicles, now_s, away),
                Some(system) if !is_committed => {
                    let alone = if route.named.is_none() { vehicles.check_alone(away) } else { Ok(()) };
                    alone.and_then(|()| vehicles.check(system, route.named.is_some()))
                }
                Some(system) => {
                    vehicles.fix(system);
                    Ok(())
                }
            };
            // One that has ended its mission before is only listened to; the others are chosen all the same.
            if !is_committed {
                chosen = chosen.and(checked.map_err(|why| (uav, why)));
            }
        }
        chosen
    }

    /// Begins to take messages, a limited number until the next call.
    pub fn begin_poll(&mut self) {
        self.budget = MOST_IN_A_POLL;
    }

    /// The vehicles that are chosen, or were by the bridge before, by UAV.
    pub fn chosen(&self) -> impl Iterator<Item = Option<ChosenVehicle>> {
        self.routes.iter().map(|route| {
            let address = |system| self.connections[route.connection].vehicles.address(system);
            let new = |system| ChosenVehicle { system, address: address(system) };
            route.system.map(new).or(route.before)
        })
    }

    /// Where the vehicle of a UAV, by its number from 0, was waited for, if none is chosen.
    pub fn awaited_at(&self, uav: usize) -> Option<&WireAddress> {
        let route = &self.routes[uav];
        route.system.is_none().then(|| &self.connections[route.connection].address)
    }

    /// Names the vehicles that the bridge before has chosen, each with whether it was armed: those that were are no
    /// others. They get heartbeats where that bridge has heard them, before they are heard again.
    pub fn name(&mut self, chosen: impl Iterator<Item = (Option<ChosenVehicle>, bool)>) {
        for (route, (vehicle, was_armed)) in self.routes.iter_mut().zip(chosen) {
            route.named = route.named.or(vehicle.filter(|_| was_armed).map(|vehicle| vehicle.system));
            route.before = vehicle;
            // Who has named another since means that one, unless the one before may be in the air.
            route.expected = vehicle.filter(|_| was_armed || route.named.is_none()).map(|vehicle| vehicle.system);
            if let Some(ChosenVehicle { system, address: Some(address), .. }) = vehicle {
                self.connections[route.connection].vehicles.expect(system, address);
            }
        }
    }

    /// Takes the lines for people that have come up.
    pub fn take_said(&mut self) -> Vec<String> {
        std::mem::take(&mut self.said)
    }

    /// The next message of a chosen vehicle, with the number of its UAV, from 0; messages that mean nothing here are
    /// left out.
    pub fn receive(&mut self, now_s: f64) -> Option<(usize, Telemetry)> {
        for index in 0..self.connections.len() {
            while self.budget > 0
                && let Some(received) = self.connections[index].wire.receive()
            {
                self.budget -= 1;
                if let Some(heard) = self.hear(index, &received, now_s) {
                    return Some(heard);
                }
            }
        }
        None
    }

    /// What a message means, and for which UAV.
    fn hear(&mut self, index: usize, received: &Received, now_s: f64) -> Option<(usize, Telemetry)> {
        let Received { from, header, message } = received;
        let LinkedWire { address, vehicles, .. } = &mut self.connections[index];
        let system = u8::try_from(header.system_id).ok()?;
        if system == address.own_system {
            if matches!(message, MavMessage::HEARTBEAT(_)) {
                self.notice(
                    index,
                    format!(
                        "another ground station of system {system} is there: its heartbeats keep the vehicle from \
                         returning when the bridge is silent; ?own_system=N behind the address gives the bridge another"
                    ),
                );
            }
            return None;
        }
        if header.component_id != AUTOPILOT {
            if vehicles.address(system).is_some() {
                return None; // a camera, a gimbal, a companion of a vehicle
            }
            self.notice_stranger(index, from.as_ref(), header);
            return None;
        }
        if answers_to(message).is_some_and(|answered| answered != address.own_system) {
            return None; // an answer to another ground station
        }
        let telemetry = decode(message);
        if let (MavMessage::HEARTBEAT(heartbeat), Some(_)) = (message, &telemetry) {
            let mut routes = self.routes.iter().filter(|route| route.connection == index);
            let is_meant = routes.clone().any(|route| [route.named, route.system].contains(&Some(system)));
            let is_flown = !is_meant && routes.any(|route| route.system.is_some());
            if vehicles.hear_heartbeat(system, heartbeat, *from, now_s) && is_flown {
                let other = vehicles.describe(system);
                self.notice(index, format!("another vehicle is there, {other}: it gets no orders"));
            }
        }
        let vehicles = &mut self.connections[index].vehicles;
        let fix = if let Some(Telemetry::Position(fix)) = &telemetry { Some(fix) } else { None };
        match vehicles.hear(system, *from, now_s) {
            Sender::Known => {}
            Sender::Moved => {
                let from = from.map_or_else(String::new, |from| format!(" at {from}"));
                self.notice(index, format!("system {system} is heard{from} now: it is spoken to there"));
            }
            Sender::Second => {
                let from = from.map_or_else(String::new, |from| format!(", {from}"));
                self.notice(index, format!("a second address{from}, sends as system {system}: it is not believed"));
                return None;
            }
            Sender::Unknown => {
                if self.routes.iter().any(|route| route.connection == index && route.system.is_some()) {
                    self.notice_stranger(index, from.as_ref(), header);
                }
                return None;
            }
        }
        let vehicles = &mut self.connections[index].vehicles;
        if let Some(fix) = fix {
            vehicles.locate(system, fix);
        }
        if let MavMessage::HEARTBEAT(heartbeat) = message
            && !vehicles.is_of_type(system, heartbeat)
        {
            self.notice(index, format!("a vehicle of another type sends as system {system}, too: it is not believed"));
            return None;
        }
        let is_route = |route: &Route| route.connection == index && route.system == Some(system);
        Some((self.routes.iter().position(is_route)?, telemetry?))
    }

    /// Says once for each address that somebody who is no vehicle of this run speaks on a connection.
    fn notice_stranger(&mut self, index: usize, from: Option<&SocketAddr>, header: &MavHeader) {
        let vehicles = &self.connections[index].vehicles;
        // Before the first autopilot is heard, who speaks may be a component of its vehicle, such as a camera.
        if let Some(from) = from.filter(|from| !vehicles.is_empty() && !vehicles.is_at(**from)) {
            let MavHeader { system_id, component_id, .. } = header;
            let line = format!(
                "{from} speaks as system {system_id}, component {component_id}, which is no vehicle of this run: it is \
                 neither answered nor believed"
            );
            let strangers = self.connections[index].noticed.iter().filter(|what| what.parse::<SocketAddr>().is_ok());
            if strangers.count() < MOST_STRANGERS {
                self.notice_of(index, from.to_string(), &line);
            }
        }
    }

    /// Says a line once, and few of them.
    fn notice(&mut self, index: usize, line: String) {
        self.notice_of(index, line.clone(), &line);
    }

    /// Says a line on `what` once, and few of them.
    fn notice_of(&mut self, index: usize, what: String, line: &str) {
        let LinkedWire { address, noticed, .. } = &mut self.connections[index];
        if noticed.len() < MOST_NOTICES && noticed.insert(what) {
            self.said.push(format!("{address}: {line}"));
        }
    }

    /// Sends an order to the vehicle of a UAV, unless none is chosen.
    pub fn send(&self, uav: usize, order: &Order) {
        let route = &self.routes[uav];
        if let Some(system) = route.system {
            let connection = &self.connections[route.connection];
            connection.wire.send(&connection.header(), &encode(order, system), connection.vehicles.address(system));
        }
    }

    /// Says to all chosen vehicles that the bridge is there; to those that were not heard yet, where the bridge before
    /// has heard them, or at the address of the connection. Where none is due, none is sent while one is withheld on
    /// the connection, `of` the numbers of UAVs from 0: they may be one address.
    pub fn send_heartbeats(&self, of: impl Fn(usize) -> Heartbeats) {
        let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: MavType::MAV_TYPE_GCS,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        });
        let mut at_addresses = BTreeMap::<_, bool>::new();
        let mut withheld = BTreeSet::new();
        for (uav, Route { connection, system, before, .. }) in self.routes.iter().enumerate() {
            let to = match system {
                Some(system) => self.connections[*connection].vehicles.address(*system),
                None => before.and_then(|before| before.address),
            };
            let heartbeats = of(uav);
            *at_addresses.entry((*connection, to)).or_default() |= heartbeats == Heartbeats::Due;
            withheld.extend((heartbeats == Heartbeats::Withheld).then_some(*connection));
        }
        for ((connection, to), is_due) in at_addresses {
            if is_due || !withheld.contains(&connection) {
                let linked = &self.connections[connection];
                linked.wire.send(&linked.header(), &heartbeat, to);
            }
        }
    }
}

impl Route {
    /// Chooses the vehicle of the UAV, if that is known now.
    fn choose(&mut self, vehicles: &Vehicles, now_s: f64, away: impl Fn(&Fix) -> Option<f64>) -> Result<(), String> {
        let Some(system) = vehicles.choose(self.named, now_s, away)? else { return Ok(()) };
        if let Some(expected) = self.expected.filter(|expected| *expected != system) {
            let [other, expected] = [system, expected].map(|system| vehicles.describe(system));
            return Err(format!(
                "{other} is there: expected {expected}, as before the restart of the bridge, or ?system=N behind the \
                 address"
            ));
        }
        self.system = Some(system);
        Ok(())
    }
}

impl LinkedWire {
    fn header(&self) -> MavHeader {
        let WireAddress { own_system, own_component, .. } = self.address;
        MavHeader { system_id: own_system.into(), component_id: own_component, sequence: 0 } // the connection counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::SYS_STATUS_DATA;

    /// A link with these options behind its address, which listens where nobody speaks.
    fn link(options: &[&str], uavs: usize) -> Link {
        let port = std::net::UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr()).unwrap().port();
        let addresses: Vec<WireAddress> =
            options.iter().map(|options| format!("udpin:127.0.0.1:{port}{options}").parse().unwrap()).collect();
        Link::open(&addresses, uavs).unwrap_or_else(|(address, error)| panic!("{address}: {error}"))
    }

    /// A message of an autopilot of this system from this port.
    fn sent(port: u16, system_id: u32, component_id: u8, message: MavMessage) -> Received {
        let header = MavHeader { system_id, component_id, sequence: 0 };
        Received { from: Some(SocketAddr::from(([127, 0, 0, 1], port))), header, message }
    }

    fn beat(mavtype: MavType) -> MavMessage {
        let autopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
        MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype, autopilot, ..HEARTBEAT_DATA::default() })
    }

    fn charge(percent: i8) -> MavMessage {
        MavMessage::SYS_STATUS(SYS_STATUS_DATA { battery_remaining: percent, ..SYS_STATUS_DATA::default() })
    }

    const QUADROTOR: MavType = MavType::MAV_TYPE_QUADROTOR;

    /// A link to the vehicle of system 1 at port 1, which is chosen.
    fn chosen(options: &str) -> Link {
        let mut link = link(&[options], 1);
        assert_eq!(link.hear(0, &sent(1, 1, AUTOPILOT, beat(QUADROTOR)), 0.0), None, "not chosen yet");
        link.choose(5.0, |_| false, |_, _| None).unwrap();
        link
    }

    fn address_of(link: &Link, uav: usize) -> Option<u16> {
        let Route { connection, system, .. } = link.routes[uav];
        link.connections[connection].vehicles.address(system?).map(|address| address.port())
    }

    #[test]
    fn vehicles_on_one_link_are_told_apart_by_their_systems_and_only_autopilots_are_heard() {
        for options in [&[""][..], &["?system=1", "?system=2"]] {
            let mut link = link(options, 2);
            for system in [2, 3, 1] {
                assert_eq!(link.hear(0, &sent(system as u16, system, AUTOPILOT, beat(QUADROTOR)), 0.0), None);
            }
            link.choose(0.0, |_| false, |_, _| None).unwrap();
            let mut heard =
                |system: u32, component: u8| link.hear(0, &sent(system as u16, system, component, charge(20)), 1.0);
            let battery = Telemetry::Status { left: Some(0.2), is_ready: None };
            assert_eq!(heard(2, AUTOPILOT), Some((1, battery.clone())));
            assert_eq!((heard(2, 100), heard(3, AUTOPILOT)), (None, None), "a camera, and a vehicle that is not named");
            assert_eq!(heard(1, AUTOPILOT), Some((0, battery)));
            assert_eq!([0, 1].map(|uav| address_of(&link, uav)), [Some(1), Some(2)]);
        }
    }

    #[test]
    fn orders_go_to_the_vehicle_and_not_to_whoever_spoke_last() {
        let mut link = chosen("");
        let station = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_GCS,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            ..HEARTBEAT_DATA::default()
        });
        for second in 0..20 {
            let now_s = 5.0 + f64::from(second);
            assert!(link.hear(0, &sent(1, 1, AUTOPILOT, beat(QUADROTOR)), now_s).is_some());
            assert_eq!(link.hear(0, &sent(7, 254, 190, station.clone()), now_s), None);
            assert_eq!(link.hear(0, &sent(8, 9, AUTOPILOT, charge(1)), now_s), None);
            assert_eq!(link.hear(0, &sent(9, 1, AUTOPILOT, charge(1)), now_s), None, "as system 1, from elsewhere");
            assert_eq!(address_of(&link, 0), Some(1));
        }
        let said = link.take_said();
        assert_eq!(said.len(), 3, "each once: {said:?}");
        assert!(said[0].contains("127.0.0.1:7 speaks as system 254, component 190, which is no vehicle of this run"));
        assert!(said[2].contains("a second address, 127.0.0.1:9, sends as system 1: it is not believed"));
        assert!(
            link.hear(0, &sent(10, 1, AUTOPILOT, charge(40)), 60.0).is_some(),
            "before its flight it may speak elsewhere"
        );
        assert_eq!(address_of(&link, 0), Some(10));
    }

    #[test]
    fn a_vehicle_that_is_left_to_its_gcs_failsafe_gets_no_heartbeats() {
        let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(std::time::Duration::from_millis(100))).unwrap();
        let port = socket.local_addr().unwrap().port();
        use Heartbeats::{Due, Idle, Withheld};
        // Two behind a router: one that is due gets them, and with it the other.
        for ([first, second], is_sent) in [
            ([Due, Due], true),
            ([Withheld, Withheld], false),
            ([Idle, Withheld], false),
            ([Withheld, Due], true),
            ([Idle, Idle], true),
        ] {
            let mut link = link(&["?system=1", "?system=2"], 2);
            for system in [1, 2] {
                let _ = link.hear(0, &sent(port, system, AUTOPILOT, beat(QUADROTOR)), 0.0);
            }
            link.choose(0.0, |_| false, |_, _| None).unwrap();
            link.send_heartbeats(|uav| [first, second][uav]);
            assert_eq!(socket.recv(&mut [0; 300]).is_ok(), is_sent, "{first:?} {second:?}");
        }
    }

    #[test]
    fn a_vehicle_that_was_never_heard_feeds_none_that_is_left_to_its_gcs_failsafe() {
        let router = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        router.set_read_timeout(Some(std::time::Duration::from_millis(100))).unwrap();
        let at = router.local_addr().unwrap();
        let addresses = [1, 2].map(|system| format!("udpout:{at}?system={system}").parse().unwrap());
        let mut link = Link::open(&addresses, 2).unwrap_or_else(|(address, error)| panic!("{address}: {error}"));
        let beat = Received { from: Some(at), ..sent(0, 1, AUTOPILOT, beat(QUADROTOR)) };
        let _ = link.hear(0, &beat, 0.0);
        link.choose(0.0, |_| false, |_, _| None).unwrap();
        use Heartbeats::{Due, Idle, Withheld};
        for ([heard, unheard], is_sent) in [
            ([Withheld, Idle], false),
            ([Idle, Withheld], false),
            ([Withheld, Due], true),
            ([Due, Withheld], true),
            ([Idle, Idle], true),
        ] {
            link.send_heartbeats(|uav| [heard, unheard][uav]);
            assert_eq!(router.recv(&mut [0; 300]).is_ok(), is_sent, "{heard:?} {unheard:?}");
            while is_sent && router.recv(&mut [0; 300]).is_ok() {}
        }
    }

    #[test]
    fn a_vehicle_of_the_bridge_before_is_known_beside_a_second_sender() {
        let mut link = link(&[""], 2);
        let at = |port: u16| Some(SocketAddr::from(([127, 0, 0, 1], port)));
        let before = |system, port| (Some(ChosenVehicle { system, address: at(port) }), true);
        link.name([before(1, 1), before(2, 2)].into_iter());
        // The second one is heard first, and waited out.
        for (port, message) in [(9, beat(QUADROTOR)), (2, beat(QUADROTOR)), (9, charge(20))] {
            assert_eq!(link.hear(0, &sent(port, 2, AUTOPILOT, message), 0.1), None);
        }
        link.choose(0.3, |_| false, |_, _| None).unwrap();
        link.choose(0.4, |_| false, |_, _| None).unwrap();
        assert_eq!(address_of(&link, 1), Some(2));
    }

    #[test]
    fn a_vehicle_that_the_bridge_before_has_not_armed_is_not_named_by_that() {
        let chosen_beside_another = |was_armed| {
            let mut link = link(&[""], 1);
            link.name(std::iter::once((Some(ChosenVehicle { system: 7, address: None }), was_armed)));
            for system in [7, 8] {
                let _ = link.hear(0, &sent(system as u16, system, AUTOPILOT, beat(QUADROTOR)), 0.0);
            }
            link.choose(20.0, |_| false, |_, _| None)
        };
        assert!(chosen_beside_another(true).is_ok() && chosen_beside_another(false).is_err());
    }

    #[test]
    fn a_vehicle_that_must_not_fly_keeps_no_other_from_being_chosen() {
        for rover in [1, 2] {
            let mut link = link(&["?system=1", "?system=2"], 2);
            for system in [1, 2] {
                let kind = if system == rover { MavType::MAV_TYPE_GROUND_ROVER } else { QUADROTOR };
                let _ = link.hear(0, &sent(system as u16, system, AUTOPILOT, beat(kind)), 0.0);
            }
            let refused = link.choose(0.0, |_| false, |_, _| None).unwrap_err();
            assert_eq!(refused.0 as u32, rover - 1, "{refused:?}");
            assert_eq!([0, 1].map(|uav| address_of(&link, uav).is_some()), [rover == 2, rover == 1]);
        }
    }

    #[test]
    fn an_answer_to_another_ground_station_is_not_ours() {
        let ack = |target_system| {
            MavMessage::COMMAND_ACK(mavlink::dialects::common::COMMAND_ACK_DATA { target_system, ..Default::default() })
        };
        for (options, own) in [("", 255), ("?own_system=250", 250)] {
            let mut link = chosen(options);
            let heard = [0, own, 254].map(|system| link.hear(0, &sent(1, 1, AUTOPILOT, ack(system)), 6.0).is_some());
            assert_eq!(heard, [true, true, false], "{options}: one that names nobody is ours");
        }
    }

    #[test]
    fn components_of_a_vehicle_that_are_heard_first_are_waited_over() {
        let mut link = link(&[""], 1);
        for component in [100, 154, 191] {
            assert_eq!(link.hear(0, &sent(3, 1, component, beat(MavType::MAV_TYPE_CAMERA)), 0.0), None);
        }
        let _ = link.hear(0, &sent(1, 1, AUTOPILOT, beat(QUADROTOR)), 1.0);
        link.choose(6.0, |_| false, |_, _| None).unwrap();
        assert_eq!(link.hear(0, &sent(3, 1, 191, beat(MavType::MAV_TYPE_CAMERA)), 7.0), None);
        assert_eq!((address_of(&link, 0), link.take_said()), (Some(1), vec![]));
    }

    #[test]
    fn another_vehicle_than_that_of_the_bridge_before_is_not_chosen() {
        let there = |options: &str, was_armed: bool, senders: &[(u16, u32)], is_committed: bool| {
            let mut link = link(&[options], 1);
            let address = Some(SocketAddr::from(([127, 0, 0, 1], 7)));
            link.name(std::iter::once((Some(ChosenVehicle { system: 7, address }), was_armed)));
            for &(port, system) in senders {
                let _ = link.hear(0, &sent(port, system, AUTOPILOT, beat(QUADROTOR)), 0.0);
            }
            link.choose(5.0, |_| is_committed, |_, _| None).map(|()| link.routes[0].system)
        };
        assert_eq!(there("", false, &[(7, 7)], false), Ok(Some(7)));
        let why = "system 8 (quadrotor) is there: expected system 7, as before the restart of the bridge, or ?system=N \
                   behind the address";
        // That of before is there, too, but not where it was: it is not believed yet.
        assert_eq!(there("", false, &[(70, 7), (8, 8)], false), Err((0, why.to_owned())));
        assert_eq!(there("", false, &[(8, 8)], true), Ok(None), "nor is it listened to once the mission has ended");
        // Who names it since means it, unless the one before may be in the air.
        assert_eq!(there("?system=8", false, &[(8, 8)], false), Ok(Some(8)));
        assert_eq!(there("?system=8", true, &[(8, 8)], false), Err((0, why.to_owned())));
    }

    #[test]
    fn a_flood_of_strangers_is_a_few_lines() {
        let mut link = chosen("");
        (1_000..3_000).for_each(|port| drop(link.hear(0, &sent(port, 254, 190, charge(1)), 5.0)));
        assert_eq!(link.take_said().len(), MOST_STRANGERS);
    }

    #[test]
    fn a_second_ground_station_of_the_own_system_is_said_once() {
        for (options, system, is_own) in [("", 255, true), ("", 250, false), ("?own_system=250", 250, true)] {
            let mut link = chosen(options);
            (0..3).for_each(|_| drop(link.hear(0, &sent(1, system, 190, beat(MavType::MAV_TYPE_GCS)), 5.0)));
            let said = link.take_said();
            let told = said.iter().filter(|line| line.contains(&format!("another ground station of system {system}")));
            assert_eq!(told.count(), usize::from(is_own), "{said:?}");
        }
    }

    #[test]
    fn another_vehicle_is_refused_before_arming_and_said_in_flight() {
        let other = |link: &mut Link| link.hear(0, &sent(2, 2, AUTOPILOT, beat(QUADROTOR)), 6.0);
        let mut link = chosen("");
        assert_eq!(other(&mut link), None);
        let refused = link.choose(6.0, |_| false, |_, _| None).unwrap_err();
        assert!(
            refused.0 == 0 && refused.1.starts_with("2 vehicles at its address: system 1 (quadrotor"),
            "{refused:?}"
        );
        link.choose(6.0, |_| true, |_, _| None).unwrap();
        let expected = "another vehicle is there, system 2 (quadrotor): it gets no orders";
        assert!(link.take_said().iter().any(|line| line.ends_with(expected)));
        let mut named = chosen("?system=1");
        assert_eq!(other(&mut named), None);
        named.choose(6.0, |_| false, |_, _| None).unwrap();
    }

    #[test]
    fn a_heartbeat_of_another_type_is_not_that_of_the_vehicle() {
        let mut link = chosen("");
        link.choose(5.0, |_| true, |_, _| None).unwrap(); // it is flown
        let px4 = HEARTBEAT_DATA {
            mavtype: QUADROTOR,
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            ..HEARTBEAT_DATA::default()
        };
        for odd in [beat(MavType::MAV_TYPE_GROUND_ROVER), MavMessage::HEARTBEAT(px4)] {
            assert_eq!(link.hear(0, &sent(1, 1, AUTOPILOT, odd), 5.0), None);
        }
        assert!(link.take_said()[0].contains("a vehicle of another type sends as system 1, too"));
    }
}
