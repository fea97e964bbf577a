//! The links to the vehicles of a fleet: which vehicle is at which address, and messages and orders as MAVLink.

use std::collections::BTreeSet;
use std::io;
use std::net::SocketAddr;

use mavlink::dialects::common::{
    BATTERY_STATUS_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, CURRENT_MODE_DATA, ESTIMATOR_STATUS_DATA,
    EXTENDED_SYS_STATE_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavFrame, MavLandedState,
    MavMessage, MavModeFlag, MavParamType, MavState, MavType, PARAM_REQUEST_READ_DATA, SYS_STATUS_DATA,
};
use mavlink::{MavHeader, MessageData as _};

use crate::autopilot::{Altitude, AutopilotKind};
use crate::identity::{Sender, Vehicles};
use crate::telemetry::{Fix, GlobalTarget, Order, Stream, Telemetry};
use crate::wire::{Received, Wire, WireAddress};

/// Component of an autopilot.
const AUTOPILOT: u8 = 1;

/// Bit of the base mode of an armed vehicle.
const ARMED: MavModeFlag = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;

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
    /// The first heartbeats of vehicles that were chosen since, twice: whoever changes their modes while the link listens
    /// is noticed.
    first: Vec<(usize, Telemetry)>,
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
}

impl Link {
    /// Opens the links to `uavs` vehicles: all at one address, as the systems 1 to `uavs` if it names none, or each at
    /// its own; the same address may name several systems.
    ///
    /// # Errors
    /// If an address cannot be opened; the error has the address.
    pub fn open(addresses: &[WireAddress], uavs: usize) -> Result<Self, (WireAddress, io::Error)> {
        let mut link =
            Self { connections: Vec::new(), routes: Vec::new(), budget: 0, first: Vec::new(), said: Vec::new() };
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
            link.routes.push(Route { connection, named, system: None });
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
        for (uav, route) in self.routes.iter_mut().enumerate() {
            let vehicles = &mut self.connections[route.connection].vehicles;
            let away = |fix: &Fix| away(uav, fix);
            match route.system {
                // It has ended its mission before: it is only listened to.
                None if is_committed(uav) => route.system = vehicles.choose(route.named, now_s, away).unwrap_or(None),
                None => {
                    route.system = vehicles.choose(route.named, now_s, away).map_err(|why| (uav, why))?;
                    let first = route.system.and_then(|system| vehicles.first_heartbeat(system));
                    let first = first.and_then(|heartbeat| decode(&MavMessage::HEARTBEAT(heartbeat.clone())));
                    self.first.extend(first.iter().flat_map(|first| [(uav, first.clone()), (uav, first.clone())]));
                }
                Some(system) if !is_committed(uav) => {
                    let alone = if route.named.is_none() { vehicles.check_alone(away) } else { Ok(()) };
                    alone.and_then(|()| vehicles.check(system, route.named.is_some())).map_err(|why| (uav, why))?;
                }
                Some(system) => vehicles.fix_type(system),
            }
        }
        Ok(())
    }

    /// Begins to take messages, a limited number until the next call.
    pub fn begin_poll(&mut self) {
        self.budget = MOST_IN_A_POLL;
    }

    /// The systems of the vehicles that are chosen, by the numbers of their UAVs.
    #[must_use]
    pub fn systems(&self) -> Vec<Option<u8>> {
        self.routes.iter().map(|route| route.system).collect()
    }

    /// Names the vehicles that the bridge before has chosen.
    pub fn name(&mut self, systems: &[Option<u8>]) {
        for (route, system) in self.routes.iter_mut().zip(systems) {
            route.named = route.named.or(*system);
        }
    }

    /// Takes the lines for people that have come up.
    pub fn take_said(&mut self) -> Vec<String> {
        std::mem::take(&mut self.said)
    }

    /// The next message of a chosen vehicle, with the number of its UAV, from 0; messages that mean nothing here are
    /// left out.
    pub fn receive(&mut self, now_s: f64) -> Option<(usize, Telemetry)> {
        if let Some(first) = self.first.pop() {
            return Some(first);
        }
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
                self.notice(index, format!(
                    "another ground station of system {system} is there: its heartbeats keep the vehicle from returning \
                         when the bridge is silent; ?own_system=N behind the address gives the bridge another"
                ));
            }
            return None;
        }
        if header.component_id != AUTOPILOT {
            self.notice_stranger(index, from.as_ref(), header);
            return None;
        }
        let telemetry = decode(message);
        if let (MavMessage::HEARTBEAT(heartbeat), Some(_)) = (message, &telemetry) {
            let is_flown = self.routes.iter().any(|route| route.connection == index && route.system.is_some());
            if vehicles.hear_heartbeat(system, heartbeat, *from, now_s) && is_flown {
                let other = vehicles.describe(system);
                self.notice(index, format!("another vehicle is there, {other}: it gets no orders"));
            }
        }
        let vehicles = &mut self.connections[index].vehicles;
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
        if let Some(Telemetry::Position(fix)) = &telemetry {
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
        if let Some(from) = from.filter(|from| !self.connections[index].vehicles.is_at(**from)) {
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

    /// Says to all chosen vehicles that the bridge is there, and where nobody was heard yet, to the address of the
    /// connection.
    pub fn send_heartbeats(&self) {
        let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: MavType::MAV_TYPE_GCS,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        });
        let mut told = BTreeSet::new();
        for Route { connection, system, .. } in &self.routes {
            let linked = &self.connections[*connection];
            let to = system.and_then(|system| linked.vehicles.address(system));
            if told.insert((*connection, to)) {
                linked.wire.send(&linked.header(), &heartbeat, to);
            }
        }
    }
}

impl LinkedWire {
    fn header(&self) -> MavHeader {
        let WireAddress { own_system, own_component, .. } = self.address;
        MavHeader { system_id: own_system.into(), component_id: own_component, sequence: 0 } // the connection counts
    }
}

/// What a message of an autopilot means; `None` for one that means nothing here.
fn decode(message: &MavMessage) -> Option<Telemetry> {
    Some(match message {
        MavMessage::HEARTBEAT(heartbeat) => Telemetry::Heartbeat {
            autopilot: match heartbeat.autopilot {
                MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => AutopilotKind::ArduPilot,
                MavAutopilot::MAV_AUTOPILOT_PX4 => AutopilotKind::Px4,
                MavAutopilot::MAV_AUTOPILOT_INVALID => return None, // no autopilot
                _ => AutopilotKind::Other,
            },
            mode: heartbeat.custom_mode,
            is_armed: heartbeat.base_mode.contains(ARMED),
            is_booting: matches!(
                heartbeat.system_status,
                MavState::MAV_STATE_UNINIT | MavState::MAV_STATE_BOOT | MavState::MAV_STATE_CALIBRATING
            ),
        },
        MavMessage::CURRENT_MODE(current) => Telemetry::Mode(current.custom_mode),
        MavMessage::GLOBAL_POSITION_INT(position) if position.lat != 0 || position.lon != 0 => {
            let cm = |value: i16| f64::from(value) / 100.0;
            let heading_deg = f64::from(position.hdg) / 100.0;
            Telemetry::Position(Fix {
                lat_deg: f64::from(position.lat) / 1e7,
                lon_deg: f64::from(position.lon) / 1e7,
                above_home_m: f64::from(position.relative_alt) / 1e3,
                above_sea_m: f64::from(position.alt) / 1e3,
                velocity_mps: [cm(position.vy), cm(position.vx), -cm(position.vz)], // from north, east, down
                heading_deg: if position.hdg == u16::MAX { f64::INFINITY } else { heading_deg },
                boot_s: f64::from(position.time_boot_ms) / 1e3,
            })
        }
        MavMessage::ESTIMATOR_STATUS(status) => {
            let accuracy_m = [status.pos_horiz_accuracy, status.pos_vert_accuracy].map(f64::from);
            let is_known = accuracy_m.iter().all(|sigma_m| sigma_m.is_finite() && *sigma_m >= 0.0);
            is_known.then_some(Telemetry::Accuracy(accuracy_m))?
        }
        MavMessage::BATTERY_STATUS(status) if status.id == 0 => battery(status.battery_remaining),
        MavMessage::SYS_STATUS(status) => battery(status.battery_remaining),
        MavMessage::EXTENDED_SYS_STATE(state) => match state.landed_state {
            MavLandedState::MAV_LANDED_STATE_UNDEFINED => return None,
            landed => Telemetry::InAir(landed != MavLandedState::MAV_LANDED_STATE_ON_GROUND),
        },
        MavMessage::COMMAND_ACK(ack) => Telemetry::Answer {
            command: u16::try_from(ack.command as u32).ok()?,
            result: u8::try_from(ack.result as u32).ok()?,
        },
        MavMessage::STATUSTEXT(status) => Telemetry::Text(status.text.to_str().ok()?.to_owned()),
        MavMessage::PARAM_VALUE(parameter) => Telemetry::Parameter {
            name: parameter.param_id.to_str().ok()?.to_owned(),
            value: parameter.param_value,
            is_integer: parameter.param_type != MavParamType::MAV_PARAM_TYPE_REAL32,
        },
        _ => return None,
    })
}

/// The energy that is left [%]; negative if it is not known.
fn battery(remaining: i8) -> Telemetry {
    Telemetry::Battery((remaining >= 0).then(|| f64::from(remaining) / 100.0))
}

/// An order to the system `target_system`.
fn encode(order: &Order, target_system: u8) -> MavMessage {
    let long = |command: MavCmd, params: [f32; 7]| {
        let [param1, param2, param3, param4, param5, param6, param7] = params;
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
            command,
            target_system,
            target_component: AUTOPILOT,
            confirmation: 0,
        })
    };
    match *order {
        Order::Mode(mode) => {
            let is_custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
            long(MavCmd::MAV_CMD_DO_SET_MODE, [f32::from(is_custom), mode as f32, 0.0, 0.0, 0.0, 0.0, 0.0])
        }
        Order::Arm => long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        Order::TakeOff(altitude) => {
            let (frame, z_m) = frame_of(altitude);
            // PX4 takes 0 for a place; ArduPilot makes an integer of it.
            let here = if frame == MavFrame::MAV_FRAME_GLOBAL { f32::NAN } else { 0.0 };
            long(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 0.0, here, here, here, z_m])
        }
        Order::Speed(mps) => long(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [1.0, mps as f32, -1.0, 0.0, 0.0, 0.0, 0.0]),
        Order::Reposition { to, may_change_mode } => reposition(&to, may_change_mode, target_system),
        Order::Return => long(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, [0.0; 7]),
        Order::Interval { stream, period_s } => {
            let [id, period_us] = [message_id(stream) as f32, (period_s * 1e6) as f32];
            long(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [id, period_us, 0.0, 0.0, 0.0, 0.0, 0.0])
        }
        Order::Parameter(name) => MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: -1,
            target_system,
            target_component: AUTOPILOT,
            param_id: name.into(),
        }),
    }
}

fn reposition(to: &GlobalTarget, may_change_mode: bool, target_system: u8) -> MavMessage {
    let (frame, z) = frame_of(to.altitude);
    let e7 = |degrees: f64| (degrees * 1e7).round() as i32;
    MavMessage::COMMAND_INT(COMMAND_INT_DATA {
        param1: -1.0, // the speed stays
        param2: f32::from(u8::from(may_change_mode)),
        param3: 0.0,
        param4: f32::NAN, // so does the yaw
        x: e7(to.lat_deg),
        y: e7(to.lon_deg),
        z,
        command: MavCmd::MAV_CMD_DO_REPOSITION,
        target_system,
        target_component: AUTOPILOT,
        frame,
        current: 0,
        autocontinue: 0,
    })
}

/// An altitude as a frame and a number [m].
fn frame_of(altitude: Altitude) -> (MavFrame, f32) {
    match altitude {
        Altitude::AboveHome(z_m) => (MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT, z_m as f32),
        Altitude::AboveSea(z_m) => (MavFrame::MAV_FRAME_GLOBAL, z_m as f32),
    }
}

/// The number of the message of a stream.
fn message_id(stream: Stream) -> u32 {
    match stream {
        Stream::Position => GLOBAL_POSITION_INT_DATA::ID,
        Stream::Accuracy => ESTIMATOR_STATUS_DATA::ID,
        Stream::Heartbeat => HEARTBEAT_DATA::ID,
        Stream::Mode => CURRENT_MODE_DATA::ID,
        Stream::Battery => BATTERY_STATUS_DATA::ID,
        Stream::Status => SYS_STATUS_DATA::ID,
        Stream::InAir => EXTENDED_SYS_STATE_DATA::ID,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::{COMMAND_ACK_DATA, MavResult, PARAM_VALUE_DATA, STATUSTEXT_DATA, SYS_STATUS_DATA};

    #[test]
    fn a_reposition_is_a_command_int_above_home_in_ten_millionths_of_a_degree() {
        let to = GlobalTarget { lat_deg: 47.397_742, lon_deg: -8.545_594, altitude: Altitude::AboveHome(20.0) };
        let MavMessage::COMMAND_INT(sent) = encode(&Order::Reposition { to, may_change_mode: false }, 3) else {
            panic!("another message");
        };
        assert_eq!((sent.x, sent.y, sent.z), (473_977_420, -85_455_940, 20.0));
        assert_eq!((sent.frame, sent.param2, sent.target_system), (MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT, 0.0, 3));
    }

    #[test]
    fn a_heartbeat_tells_the_autopilot_its_mode_and_whether_it_is_armed() {
        let decoded = |autopilot, base_mode| {
            let heartbeat = HEARTBEAT_DATA { autopilot, base_mode, custom_mode: 4, ..HEARTBEAT_DATA::default() };
            decode(&MavMessage::HEARTBEAT(heartbeat))
        };
        for (sent, autopilot) in [
            (MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, AutopilotKind::ArduPilot),
            (MavAutopilot::MAV_AUTOPILOT_PX4, AutopilotKind::Px4),
            (MavAutopilot::MAV_AUTOPILOT_GENERIC, AutopilotKind::Other),
        ] {
            for (base_mode, is_armed) in [(ARMED, true), (MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, false)] {
                assert_eq!(
                    decoded(sent, base_mode),
                    Some(Telemetry::Heartbeat { autopilot, mode: 4, is_armed, is_booting: true })
                );
            }
        }
        assert_eq!(decoded(MavAutopilot::MAV_AUTOPILOT_INVALID, ARMED), None, "a ground station");
    }

    #[test]
    fn other_messages_are_decoded_in_si_units() {
        let text = STATUSTEXT_DATA { text: "EKF variance".into(), ..Default::default() };
        assert_eq!(decode(&MavMessage::STATUSTEXT(text)), Some(Telemetry::Text("EKF variance".to_owned())));
        let told = PARAM_VALUE_DATA { param_id: "FS_GCS_ENABLE".into(), param_value: 1.0, ..Default::default() };
        let name = "FS_GCS_ENABLE".to_owned();
        let parameter = Telemetry::Parameter { name, value: 1.0, is_integer: true };
        assert_eq!(decode(&MavMessage::PARAM_VALUE(told)), Some(parameter));
        let answer = COMMAND_ACK_DATA { command: MavCmd::MAV_CMD_NAV_TAKEOFF, result: MavResult::MAV_RESULT_DENIED };
        assert_eq!(decode(&MavMessage::COMMAND_ACK(answer)), Some(Telemetry::Answer { command: 22, result: 2 }));
        for (landed_state, telemetry) in [
            (MavLandedState::MAV_LANDED_STATE_UNDEFINED, None),
            (MavLandedState::MAV_LANDED_STATE_ON_GROUND, Some(Telemetry::InAir(false))),
            (MavLandedState::MAV_LANDED_STATE_IN_AIR, Some(Telemetry::InAir(true))),
            (MavLandedState::MAV_LANDED_STATE_TAKEOFF, Some(Telemetry::InAir(true))),
        ] {
            let state = EXTENDED_SYS_STATE_DATA { landed_state, ..Default::default() };
            assert_eq!(decode(&MavMessage::EXTENDED_SYS_STATE(state)), telemetry, "{landed_state:?}");
        }
        let status = |id| BATTERY_STATUS_DATA { id, battery_remaining: 40, ..Default::default() };
        let [main, second] = [0, 1].map(|id| decode(&MavMessage::BATTERY_STATUS(status(id))));
        assert_eq!((main, second), (Some(Telemetry::Battery(Some(0.4))), None));
    }

    #[test]
    fn orders_have_the_parameters_of_their_commands() {
        let params = |order: Order| match encode(&order, 7) {
            MavMessage::COMMAND_LONG(sent) => {
                assert_eq!((sent.target_system, sent.target_component), (7, 1));
                [sent.param1, sent.param2, sent.param3, sent.param4, sent.param7]
            }
            other => panic!("{other:?}"),
        };
        assert_eq!(params(Order::Mode(4)), [1.0, 4.0, 0.0, 0.0, 0.0]);
        assert_eq!(params(Order::Arm), [1.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(params(Order::Speed(7.0)), [1.0, 7.0, -1.0, 0.0, 0.0], "over ground, without throttle");
        assert_eq!(params(Order::TakeOff(Altitude::AboveHome(20.0))), [0.0, 0.0, 0.0, 0.0, 20.0]);
        let [.., yaw, z_m] = params(Order::TakeOff(Altitude::AboveSea(508.0)));
        assert!(yaw.is_nan() && z_m == 508.0);
        let to = GlobalTarget { lat_deg: 1.0, lon_deg: 2.0, altitude: Altitude::AboveSea(3.0) };
        let MavMessage::COMMAND_INT(sent) = encode(&Order::Reposition { to, may_change_mode: true }, 7) else {
            panic!("another message");
        };
        assert!(sent.param1 == -1.0 && sent.param2 == 1.0 && sent.param4.is_nan(), "its speed and yaw: {sent:?}");
        let MavMessage::PARAM_REQUEST_READ(sent) = encode(&Order::Parameter("NAV_DLL_ACT"), 7) else {
            panic!("another message");
        };
        assert_eq!((sent.param_index, sent.target_system, sent.param_id.to_str()), (-1, 7, Ok("NAV_DLL_ACT")));
    }

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
            let battery = Telemetry::Battery(Some(0.2));
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
            "it speaks from elsewhere after silence"
        );
        assert_eq!(address_of(&link, 0), Some(10));
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

    #[test]
    fn a_stream_is_asked_for_by_the_number_of_its_message_with_its_period_in_microseconds() {
        // Numbers of the MAVLink common message set.
        let asked = [
            (Stream::Position, 33.0),
            (Stream::Accuracy, 230.0),
            (Stream::Battery, 147.0),
            (Stream::InAir, 245.0),
            (Stream::Heartbeat, 0.0),
            (Stream::Mode, 436.0),
            (Stream::Status, 1.0),
        ];
        for (stream, number) in asked {
            let MavMessage::COMMAND_LONG(sent) = encode(&Order::Interval { stream, period_s: 0.25 }, 1) else {
                panic!("another message");
            };
            assert_eq!((sent.param1, sent.param2), (number, 250_000.0), "{stream:?}");
        }
    }

    #[test]
    fn a_position_is_east_north_up_and_absent_without_a_fix() {
        let sent = GLOBAL_POSITION_INT_DATA {
            time_boot_ms: 1_500,
            lat: 473_977_420,
            lon: -85_455_940,
            alt: 508_000,
            relative_alt: 20_000,
            vx: 100,
            vy: 200,
            vz: -50,
            hdg: u16::MAX,
        };
        let expected = Fix {
            lat_deg: 47.397_742,
            lon_deg: -8.545_594,
            above_home_m: 20.0,
            above_sea_m: 508.0,
            velocity_mps: [2.0, 1.0, 0.5],
            heading_deg: f64::INFINITY,
            boot_s: 1.5,
        };
        let decoded = |sent: &GLOBAL_POSITION_INT_DATA| decode(&MavMessage::GLOBAL_POSITION_INT(sent.clone()));
        assert_eq!(decoded(&sent), Some(Telemetry::Position(expected)));
        let east = Telemetry::Position(Fix { heading_deg: 90.0, ..expected });
        assert_eq!(decoded(&GLOBAL_POSITION_INT_DATA { hdg: 9_000, ..sent.clone() }), Some(east));
        assert_eq!(decoded(&GLOBAL_POSITION_INT_DATA { lat: 0, lon: 0, ..sent }), None);
    }

    #[test]
    fn unknown_values_are_decoded_to_none() {
        assert_eq!((battery(-1), battery(40)), (Telemetry::Battery(None), Telemetry::Battery(Some(0.4))));
        let accuracy = |pos_horiz_accuracy: f32| {
            decode(&MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA { pos_horiz_accuracy, ..Default::default() }))
        };
        assert_eq!((accuracy(f32::NAN), accuracy(-0.5)), (None, None));
        assert_eq!(accuracy(0.5), Some(Telemetry::Accuracy([0.5, 0.0])));
    }

    #[test]
    fn an_order_has_the_command_of_its_message() {
        let to = GlobalTarget { lat_deg: 1.0, lon_deg: 2.0, altitude: Altitude::AboveSea(3.0) };
        for order in [
            Order::Mode(4),
            Order::Arm,
            Order::TakeOff(Altitude::AboveHome(20.0)),
            Order::Speed(7.0),
            Order::Reposition { to, may_change_mode: true },
            Order::Return,
        ] {
            let command = match encode(&order, 1) {
                MavMessage::COMMAND_LONG(sent) => sent.command,
                MavMessage::COMMAND_INT(sent) => sent.command,
                other => panic!("{other:?}"),
            };
            assert_eq!(order.command().map(u32::from), Some(command as u32), "{order:?}");
        }
    }
}
