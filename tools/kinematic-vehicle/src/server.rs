//! The vehicles on a MAVLink connection: takes orders, and sends telemetry.

use std::io;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, CURRENT_MODE_DATA, EXTENDED_SYS_STATE_DATA, GLOBAL_POSITION_INT_DATA,
    HEARTBEAT_DATA, MavAutopilot, MavCmd, MavFrame, MavLandedState, MavMessage, MavModeFlag, MavParamType, MavResult,
    MavSeverity, MavState, MavSysStatusSensor, MavType, PARAM_VALUE_DATA, STATUSTEXT_DATA, SYS_STATUS_DATA,
};
use mavlink::{MavHeader, MessageData as _};
use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geometry::Position;
use skysink_common::stop::Stop;
use skysink_vehicle::wire::{ReceivedMessage, Wire};

use crate::autopilot::{Copter, Given};
use crate::options::KinematicOptions;

/// Step of the vehicles [s].
const STEP_S: f64 = 0.01;

/// Altitude of home above sea [m].
const HOME_M: f64 = 488.0;

/// Distance between the homes of two vehicles [m].
const APART_M: f64 = 5.0;

/// MAV_GCS_SYSID: the system of the ground station whose heartbeats it counts.
const GROUND_STATION: u8 = 255;

/// Period of the other telemetry, and of heartbeats that nobody has asked for [s].
const SLOW_S: f64 = 1.0;

/// Period of positions that nobody has asked for [s].
const DEFAULT_S: f64 = 0.25;

/// Period of PX4's reports of the mode [s], which it sends at changes, too.
const MODE_S: f64 = 0.5;

/// Longest text of a message [byte].
const TEXT: usize = 50;

/// The connection of the vehicles, on which messages get lost, with its random numbers.
struct LossyLink<'a> {
    wire: Wire,
    /// Who was heard over UDP: everybody hears the vehicles.
    peers: Vec<SocketAddr>,
    random: ChaCha8Rng,
    options: &'a KinematicOptions,
}

impl<'a> LossyLink<'a> {
    fn new(wire: Wire, options: &'a KinematicOptions) -> Self {
        Self { wire, peers: Vec::new(), random: ChaCha8Rng::seed_from_u64(options.seed), options }
    }

    /// The next message. The heartbeat of one ground station is passed on to the others, as autopilots do.
    fn receive(&mut self) -> Option<ReceivedMessage> {
        let received = self.wire.receive()?;
        if let Some(from) = received.from {
            if !self.peers.contains(&from) {
                self.peers.push(from);
            }
            if matches!(received.message, MavMessage::HEARTBEAT(_)) {
                let others = self.peers.iter().filter(|peer| **peer != from);
                others.for_each(|peer| self.wire.send(&received.header, &received.message, Some(*peer)));
            }
        }
        Some(received)
    }

    fn send(&self, header: &MavHeader, message: &MavMessage) {
        if self.peers.is_empty() {
            self.wire.send(header, message, None);
        }
        self.peers.iter().for_each(|peer| self.wire.send(header, message, Some(*peer)));
    }

    fn loses(&mut self) -> bool {
        self.random.random::<f64>() < self.options.loss
    }
}

/// A vehicle on the connection.
struct LinkedCopter {
    copter: Copter,
    system: u8,
    projection: Projection,
    position_every_s: f64,
    position_due_s: f64,
    heartbeat_every_s: f64,
    heartbeat_due_s: f64,
    slow_due_s: f64,
    mode_due_s: f64,
    said_mode: u32,
    texts: u16,
}

/// Flies until `stop`. Shows the vehicles, in the order of their systems, to `seen` about every millisecond, which may
/// be their pilot.
///
/// # Errors
/// If the connection cannot be opened.
pub fn serve(options: &KinematicOptions, stop: &Stop, mut seen: impl FnMut(usize, &mut Copter)) -> io::Result<()> {
    let mut link = LossyLink::new(Wire::open(&options.connect)?, options);
    let first = Projection::at(options.home);
    let mut vehicles: Vec<LinkedCopter> =
        (1..=options.count).map(|system| LinkedCopter::new(options, system, &first)).collect();
    let begin = Instant::now();
    let mut steps: u64 = 0;
    while stop.requested().is_none() {
        while let Some(ReceivedMessage { header, message, .. }) = link.receive() {
            if !link.loses() {
                vehicles.iter_mut().for_each(|vehicle| vehicle.hear(&header, &message, &mut link));
            }
        }
        let now = (begin.elapsed().as_secs_f64() * options.speed_factor / STEP_S) as u64;
        while steps < now {
            steps += 1;
            for vehicle in &mut vehicles {
                vehicle.copter.step(STEP_S, &mut link.random);
                vehicle.speak(&mut link);
            }
        }
        vehicles.iter_mut().enumerate().for_each(|(index, vehicle)| seen(index, &mut vehicle.copter));
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

impl LinkedCopter {
    fn new(options: &KinematicOptions, system: u8, first: &Projection) -> Self {
        let east_m = APART_M * f64::from(system - 1);
        let home = first.unproject(&Position::new(east_m, 0.0)).expect("beside the first home");
        Self {
            copter: Copter::new(options),
            system,
            projection: Projection::at(Origin { lat_deg: home.lat_deg, lon_deg: home.lon_deg }),
            position_every_s: DEFAULT_S,
            position_due_s: 0.0,
            heartbeat_every_s: SLOW_S,
            heartbeat_due_s: 0.0,
            slow_due_s: 0.0,
            mode_due_s: 0.0,
            said_mode: 0,
            texts: 0,
        }
    }

    fn send(&self, message: &MavMessage, link: &mut LossyLink) {
        if !link.loses() {
            link.send(&MavHeader { system_id: self.system.into(), component_id: 1, sequence: 0 }, message);
        }
    }

    /// Takes in a message, if it is for this vehicle.
    fn hear(&mut self, header: &MavHeader, message: &MavMessage, link: &mut LossyLink) {
        let is_mine = |target: u8| target == 0 || target == self.system;
        match message {
            MavMessage::HEARTBEAT(_) if header.system_id == u32::from(GROUND_STATION) => self.copter.hear_bridge(),
            MavMessage::COMMAND_LONG(command) if is_mine(command.target_system) => {
                let parameters = [command.param1, command.param2, command.param3, command.param7].map(f64::from);
                let result = self.obey_long(command.command, parameters, link.options.is_px4());
                self.answer(command.command, result, header.system_id as u8, link);
            }
            MavMessage::COMMAND_INT(command) if is_mine(command.target_system) => {
                let result = match command.command {
                    MavCmd::MAV_CMD_DO_REPOSITION => self.reposition(command),
                    _ => MavResult::MAV_RESULT_UNSUPPORTED,
                };
                self.answer(command.command, result, header.system_id as u8, link);
            }
            MavMessage::PARAM_REQUEST_READ(request) if is_mine(request.target_system) => {
                let is_px4 = link.options.is_px4();
                let value = match (request.param_id.to_str(), is_px4) {
                    (Ok("FS_GCS_ENABLE"), false) | (Ok("NAV_DLL_ACT"), true) => link.options.gcs_failsafe(),
                    (Ok("MAV_GCS_SYSID"), false) => GROUND_STATION,
                    (Ok("COM_DLL_EXCEPT"), true) => 0,
                    _ => return,
                };
                let param_value = if is_px4 { f32::from_bits(value.into()) } else { f32::from(value) };
                let value = MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
                    param_value,
                    param_count: 1,
                    param_index: 0,
                    param_id: request.param_id,
                    param_type: if is_px4 {
                        MavParamType::MAV_PARAM_TYPE_INT32
                    } else {
                        MavParamType::MAV_PARAM_TYPE_INT8
                    },
                });
                self.send(&value, link);
            }
            _ => {}
        }
    }

    fn obey_long(&mut self, command: MavCmd, [p1, p2, p3, p7]: [f64; 4], is_px4: bool) -> MavResult {
        let given = match command {
            MavCmd::MAV_CMD_DO_SET_MODE if is_px4 => Given::Mode((p2 as u32) << 16 | (p3 as u32) << 24),
            MavCmd::MAV_CMD_DO_SET_MODE => Given::Mode(p2 as u32),
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM if p1 == 1.0 => Given::Arm,
            MavCmd::MAV_CMD_NAV_TAKEOFF => Given::TakeOff(if is_px4 { p7 - HOME_M } else { p7 }),
            MavCmd::MAV_CMD_DO_CHANGE_SPEED => Given::Speed(p2),
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Given::Return,
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let asked_s = (p2 > 0.0).then_some(p2 / 1e6);
                if p1 == f64::from(GLOBAL_POSITION_INT_DATA::ID) {
                    self.position_every_s = asked_s.unwrap_or(DEFAULT_S);
                } else if p1 == f64::from(HEARTBEAT_DATA::ID) && is_px4 {
                    return MavResult::MAV_RESULT_FAILED;
                } else if p1 == f64::from(HEARTBEAT_DATA::ID) {
                    self.heartbeat_every_s = asked_s.unwrap_or(SLOW_S);
                }
                return MavResult::MAV_RESULT_ACCEPTED;
            }
            _ => return MavResult::MAV_RESULT_UNSUPPORTED, // also a reposition
        };
        self.copter.obey(given)
    }

    fn reposition(&mut self, command: &COMMAND_INT_DATA) -> MavResult {
        let COMMAND_INT_DATA { x, y, z, frame, param1: speed_mps, .. } = *command;
        let z_m = match frame {
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT => f64::from(z),
            MavFrame::MAV_FRAME_GLOBAL => f64::from(z) - HOME_M,
            _ => return MavResult::MAV_RESULT_DENIED,
        };
        let [lat_deg, lon_deg] = [x, y].map(|e7| f64::from(e7) / 1e7);
        match self.projection.project(lat_deg, lon_deg) {
            Some(place) if (x, y) != (0, 0) => {
                let speed_mps = (speed_mps > 0.0).then_some(f64::from(speed_mps));
                self.copter.obey(Given::Reposition(Vector3::new(place.x, place.y, z_m), speed_mps))
            }
            _ => MavResult::MAV_RESULT_DENIED,
        }
    }

    fn answer(&self, command: MavCmd, result: MavResult, to: u8, link: &mut LossyLink) {
        let ack = COMMAND_ACK_DATA { command, result, target_system: to, ..COMMAND_ACK_DATA::default() };
        self.send(&MavMessage::COMMAND_ACK(ack), link);
    }

    /// Sends what is due.
    fn speak(&mut self, link: &mut LossyLink) {
        let now_s = self.copter.boot_s;
        for line in self.copter.take_said() {
            let severity = MavSeverity::MAV_SEVERITY_CRITICAL;
            self.texts += 1;
            let id = if line.len() > TEXT { self.texts } else { 0 };
            for (part, chunk_seq) in line.as_bytes().chunks(TEXT).zip(0..) {
                let text = std::str::from_utf8(part).expect("ASCII").into();
                self.send(&MavMessage::STATUSTEXT(STATUSTEXT_DATA { severity, text, id, chunk_seq }), link);
            }
        }
        if now_s >= self.position_due_s {
            self.position_due_s = now_s + self.position_every_s;
            let position = self.position(link);
            self.send(&position, link);
        }
        let mode = self.copter.mode_number();
        if link.options.is_px4() && (now_s >= self.mode_due_s || mode != self.said_mode) {
            (self.mode_due_s, self.said_mode) = (now_s + MODE_S, mode);
            let current = CURRENT_MODE_DATA { custom_mode: mode, ..CURRENT_MODE_DATA::default() };
            self.send(&MavMessage::CURRENT_MODE(current), link);
        }
        if now_s >= self.heartbeat_due_s {
            self.heartbeat_due_s = now_s + self.heartbeat_every_s;
            self.send(&self.heartbeat(link.options.is_px4()), link);
        }
        if now_s >= self.slow_due_s {
            self.slow_due_s = now_s + SLOW_S;
            for message in [self.battery(), self.landed_state()] {
                self.send(&message, link);
            }
        }
    }

    fn position(&self, link: &mut LossyLink) -> MavMessage {
        let body = &self.copter.body;
        let noise_m = [0; 3].map(|_| link.options.noise * link.random.sample::<f64, _>(StandardNormal));
        let at_m = body.position_m + Vector3::from(noise_m);
        let place = self.projection.unproject(&at_m.xy().into()).expect("near its home");
        let cm = |mps: f64| (mps * 100.0).round() as i16;
        let velocity_mps = body.measured_mps();
        MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms: (self.copter.boot_s * 1e3) as u32,
            lat: (place.lat_deg * 1e7).round() as i32,
            lon: (place.lon_deg * 1e7).round() as i32,
            alt: ((HOME_M + at_m.z) * 1e3).round() as i32,
            relative_alt: (at_m.z * 1e3).round() as i32,
            vx: cm(velocity_mps.y),
            vy: cm(velocity_mps.x),
            vz: -cm(velocity_mps.z),
            hdg: 0,
        })
    }

    fn heartbeat(&self, is_px4: bool) -> MavMessage {
        let armed = if self.copter.is_armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: self.copter.mode_number(),
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: if is_px4 { MavAutopilot::MAV_AUTOPILOT_PX4 } else { MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA },
            base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed,
            system_status: match self.copter.is_critical() {
                true => MavState::MAV_STATE_CRITICAL,
                false => MavState::MAV_STATE_ACTIVE,
            },
            mavlink_version: 3,
        })
    }

    fn battery(&self) -> MavMessage {
        let prearm = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
        MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            onboard_control_sensors_enabled: prearm,
            onboard_control_sensors_health: if self.copter.is_ready() { prearm } else { MavSysStatusSensor::empty() },
            battery_remaining: (self.copter.battery * 100.0).round() as i8,
            ..SYS_STATUS_DATA::default()
        })
    }

    fn landed_state(&self) -> MavMessage {
        let landed_state = if self.copter.is_in_air() {
            MavLandedState::MAV_LANDED_STATE_IN_AIR
        } else {
            MavLandedState::MAV_LANDED_STATE_ON_GROUND
        };
        MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA { landed_state, ..EXTENDED_SYS_STATE_DATA::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::CopterMode;
    use crate::modes::Imitated;
    use mavlink::dialects::common::{COMMAND_LONG_DATA, PARAM_REQUEST_READ_DATA};

    /// A vehicle with these options, and its link to a wire that hears it.
    fn linked(options: &KinematicOptions) -> (LinkedCopter, LossyLink<'_>, Wire) {
        let port = std::net::UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr()).unwrap().port();
        let wire = |scheme: &str| Wire::open(&format!("{scheme}:127.0.0.1:{port}").parse().unwrap()).unwrap();
        let peer = wire("udpin");
        let link = LossyLink::new(wire("udpout"), options);
        (LinkedCopter::new(options, 1, &Projection::at(options.home)), link, peer)
    }

    /// The next `count` messages that the peer receives, within 10 s.
    fn heard(peer: &Wire, count: usize) -> Vec<MavMessage> {
        let begin = Instant::now();
        let mut messages = Vec::new();
        while messages.len() < count {
            assert!(begin.elapsed() < Duration::from_secs(10), "only {messages:?}");
            messages.extend(peer.receive().map(|received| received.message));
        }
        messages
    }

    #[test]
    fn a_position_is_in_units_of_the_message_from_north_east_down() {
        let options = KinematicOptions::default();
        let (mut vehicle, mut link, _) = linked(&options);
        vehicle.copter.body.position_m = Vector3::new(10.0, -20.0, 30.5);
        vehicle.copter.body.velocity_mps = Vector3::new(1.25, -2.5, 0.75);
        vehicle.copter.boot_s = 4.5;
        let MavMessage::GLOBAL_POSITION_INT(sent) = vehicle.position(&mut link) else { panic!("another message") };
        assert_eq!([sent.vx, sent.vy, sent.vz], [-250, 125, -75]);
        assert_eq!((sent.relative_alt, sent.alt, sent.time_boot_ms), (30_500, 518_500, 4_500));
        let at_m = vehicle.projection.project(f64::from(sent.lat) / 1e7, f64::from(sent.lon) / 1e7).unwrap();
        assert!((at_m - Position::new(10.0, -20.0)).norm() < 0.02, "{at_m:?}");
    }

    #[test]
    fn it_speaks_of_its_state_every_second_and_of_its_position_as_often_as_asked() {
        let options = KinematicOptions { battery: 60, ..KinematicOptions::default() };
        let (mut vehicle, mut link, peer) = linked(&options);
        vehicle.copter.is_armed = true;
        vehicle.copter.mode = CopterMode::Return;
        vehicle.speak(&mut link);
        use MavMessage::{EXTENDED_SYS_STATE, GLOBAL_POSITION_INT, HEARTBEAT, SYS_STATUS};
        let heard_first = heard(&peer, 4);
        let [GLOBAL_POSITION_INT(_), HEARTBEAT(heartbeat), SYS_STATUS(status), EXTENDED_SYS_STATE(state)] =
            &heard_first[..]
        else {
            panic!("others: {heard_first:?}")
        };
        let bits = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        assert_eq!((heartbeat.custom_mode, heartbeat.base_mode, status.battery_remaining), (6, bits, 60));
        assert_eq!(state.landed_state, MavLandedState::MAV_LANDED_STATE_ON_GROUND);
        let mut positions = |asked_us: f64| {
            let command = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
            vehicle.obey_long(command, [f64::from(GLOBAL_POSITION_INT_DATA::ID), asked_us, 0.0, 0.0], false);
            let begin_s = vehicle.copter.boot_s;
            (1..=400).for_each(|step| {
                vehicle.copter.boot_s = begin_s + f64::from(step) * 0.01;
                vehicle.speak(&mut link);
            });
            vehicle.answer(command, MavResult::MAV_RESULT_ACCEPTED, 255, &mut link); // the last message
            let mut said = Vec::new();
            while !matches!(said.last(), Some(MavMessage::COMMAND_ACK(_))) {
                said.extend(heard(&peer, 1));
            }
            said.into_iter().filter(|message| matches!(message, GLOBAL_POSITION_INT(_))).count()
        };
        // In four seconds; the first may be due, and a period is rounded up to steps.
        for (asked_us, expected) in [(500_000.0, 7..=9), (50_000.0, 65..=81), (0.0, 14..=17)] {
            let positions = positions(asked_us);
            assert!(expected.contains(&positions), "{positions} with a period of {asked_us} µs");
        }
    }

    #[test]
    fn it_tells_its_own_gcs_failsafe_and_no_other_parameter() {
        let options = KinematicOptions { gcs_failsafe: Some(0), ..KinematicOptions::default() };
        let (mut vehicle, mut link, peer) = linked(&options);
        let header = MavHeader { system_id: GROUND_STATION.into(), component_id: 190, sequence: 0 };
        for (target_system, name) in [(1, "FS_GCS_TIMEOUT"), (2, "FS_GCS_ENABLE"), (1, "FS_GCS_ENABLE")] {
            let asked = PARAM_REQUEST_READ_DATA { target_system, param_id: name.into(), ..Default::default() };
            vehicle.hear(&header, &MavMessage::PARAM_REQUEST_READ(asked), &mut link);
        }
        vehicle.send(&vehicle.heartbeat(false), &mut link);
        let [MavMessage::PARAM_VALUE(told), MavMessage::HEARTBEAT(_)] = &heard(&peer, 2)[..] else { panic!("others") };
        assert_eq!((told.param_id.to_str(), told.param_value), (Ok("FS_GCS_ENABLE"), 0.0));
    }

    #[test]
    fn a_mode_is_set_by_the_numbers_of_the_imitated_autopilot() {
        for (imitated, [p2, p3], number) in
            [(Imitated::Arducopter, [5.0, 0.0], 5), (Imitated::Px4, [4.0, 3.0], 4 << 16 | 3 << 24)]
        {
            let options = KinematicOptions { autopilot: imitated, ..KinematicOptions::default() };
            let (mut vehicle, _, _) = linked(&options);
            let mut set = |p2| vehicle.obey_long(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, p2, p3, 0.0], options.is_px4());
            assert_eq!(set(77.0), MavResult::MAV_RESULT_FAILED, "it has no such mode");
            assert_eq!(set(p2), MavResult::MAV_RESULT_ACCEPTED);
            assert_eq!(vehicle.copter.mode_number(), number);
        }
    }

    #[test]
    fn a_reposition_in_an_unknown_frame_or_without_a_place_is_denied() {
        let options = KinematicOptions::default();
        let (mut vehicle, mut link, peer) = linked(&options);
        (0..300).for_each(|_| vehicle.copter.step(STEP_S, &mut link.random));
        let begun = [Given::Mode(4), Given::Arm, Given::TakeOff(10.0)].map(|given| vehicle.copter.obey(given));
        assert_eq!(begun, [MavResult::MAV_RESULT_ACCEPTED; 3]);
        let home = options.home;
        let [lat, lon] = [home.lat_deg, home.lon_deg].map(|degrees| (degrees * 1e7) as i32);
        let [above_home, above_sea] = [MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT, MavFrame::MAV_FRAME_GLOBAL];
        for ((x, y), z, frame) in [
            ((lat, lon), 20.0, above_home),
            ((lat, lon), 508.0, above_sea),
            ((0, 0), 20.0, above_home),
            ((lat, lon), 20.0, MavFrame::MAV_FRAME_LOCAL_NED),
        ] {
            let command = MavCmd::MAV_CMD_DO_REPOSITION;
            let sent = COMMAND_INT_DATA { target_system: 1, command, x, y, z, frame, ..Default::default() };
            vehicle.hear(&MavHeader::default(), &MavMessage::COMMAND_INT(sent), &mut link);
            (0..2_000).for_each(|_| vehicle.copter.step(STEP_S, &mut link.random));
            let z_m = vehicle.copter.body.position_m.z;
            assert!((z_m - 20.0).abs() < 0.1, "{z} m in {frame:?} is 20 m above home, not {z_m} m");
        }
        let results: Vec<MavResult> = heard(&peer, 4)
            .iter()
            .map(|message| match message {
                MavMessage::COMMAND_ACK(answer) => answer.result,
                other => panic!("{other:?}"),
            })
            .collect();
        let [accepted, denied] = [MavResult::MAV_RESULT_ACCEPTED, MavResult::MAV_RESULT_DENIED];
        assert_eq!(results, [accepted, accepted, denied, denied]);
    }

    #[test]
    fn it_obeys_orders_for_its_system_and_for_all() {
        let options = KinematicOptions::default();
        for (target_system, obeys) in [(1, true), (0, true), (2, false)] {
            let (mut vehicle, mut link, _) = linked(&options);
            vehicle.copter.is_armed = true;
            vehicle.copter.body.position_m.z = 20.0;
            let command = MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH;
            let order = COMMAND_LONG_DATA { target_system, command, ..Default::default() };
            vehicle.hear(&MavHeader::default(), &MavMessage::COMMAND_LONG(order), &mut link);
            assert_eq!(vehicle.copter.mode == CopterMode::Return, obeys, "system {target_system}");
        }
    }

    #[test]
    fn messages_are_lost_with_their_probability() {
        let options = KinematicOptions { loss: 0.3, ..KinematicOptions::default() };
        let (_, mut link, _) = linked(&options);
        let lost = (0..10_000).filter(|_| link.loses()).count();
        assert!((2_800..3_200).contains(&lost), "{lost} of 10 000"); // 4 standard deviations are 183
    }
}
