//! MAVLink messages of a vehicle as [`Telemetry`], and orders to it as MAVLink messages.

use mavlink::MessageData as _;
use mavlink::dialects::common::{
    BATTERY_STATUS_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, CURRENT_MODE_DATA, ESTIMATOR_STATUS_DATA,
    EXTENDED_SYS_STATE_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavFrame, MavLandedState,
    MavMessage, MavModeFlag, MavParamType, MavState, MavSysStatusSensor, PARAM_REQUEST_READ_DATA, SYS_STATUS_DATA,
};

use crate::autopilot::{Altitude, AutopilotKind};
use crate::telemetry::{Fix, GlobalTarget, Order, Stream, Telemetry};

/// Component of an autopilot.
pub const AUTOPILOT: u8 = 1;

/// Bit of the base mode of an armed vehicle.
const ARMED: MavModeFlag = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;

/// Bit of the checks that a vehicle makes before arming.
const PREARM: MavSysStatusSensor = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;

/// Standard deviation of a position [m] beyond which it is no estimate.
const MOST_SIGMA_M: f64 = 1e6;

/// What a message of an autopilot means; `None` for one that means nothing here.
#[must_use]
pub fn decode(message: &MavMessage) -> Option<Telemetry> {
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
            is_critical: matches!(
                heartbeat.system_status,
                MavState::MAV_STATE_CRITICAL | MavState::MAV_STATE_EMERGENCY
            ),
        },
        MavMessage::CURRENT_MODE(current) => Telemetry::Mode(current.custom_mode),
        MavMessage::GLOBAL_POSITION_INT(position) if position.lat != 0 || position.lon != 0 => {
            Telemetry::Position(fix(position))
        }
        MavMessage::ESTIMATOR_STATUS(status) => {
            let accuracy_m = [status.pos_horiz_accuracy, status.pos_vert_accuracy].map(f64::from);
            let is_known = accuracy_m.iter().all(|sigma_m| (0.0..=MOST_SIGMA_M).contains(sigma_m));
            is_known.then_some(Telemetry::Accuracy(accuracy_m))?
        }
        MavMessage::BATTERY_STATUS(status) if status.id == 0 => Telemetry::Battery(charge(status.battery_remaining)),
        MavMessage::SYS_STATUS(status) => Telemetry::Status {
            left: charge(status.battery_remaining),
            is_ready: status
                .onboard_control_sensors_enabled
                .contains(PREARM)
                .then(|| status.onboard_control_sensors_health.contains(PREARM)),
        },
        MavMessage::EXTENDED_SYS_STATE(state) => match state.landed_state {
            MavLandedState::MAV_LANDED_STATE_UNDEFINED => return None,
            landed => Telemetry::InAir(landed != MavLandedState::MAV_LANDED_STATE_ON_GROUND),
        },
        MavMessage::COMMAND_ACK(ack) => Telemetry::Answer {
            command: u16::try_from(ack.command as u32).ok()?,
            result: u8::try_from(ack.result as u32).ok()?,
        },
        MavMessage::STATUSTEXT(status) => {
            Telemetry::Text { text: status.text.to_str().ok()?.to_owned(), line: status.id }
        }
        MavMessage::PARAM_VALUE(parameter) => Telemetry::Parameter {
            name: parameter.param_id.to_str().ok()?.to_owned(),
            value: parameter.param_value,
            is_integer: parameter.param_type != MavParamType::MAV_PARAM_TYPE_REAL32,
        },
        _ => return None,
    })
}

/// The position of a message.
fn fix(position: &GLOBAL_POSITION_INT_DATA) -> Fix {
    let cm = |value: i16| f64::from(value) / 100.0;
    let heading_deg = f64::from(position.hdg) / 100.0;
    Fix {
        lat_deg: f64::from(position.lat) / 1e7,
        lon_deg: f64::from(position.lon) / 1e7,
        above_home_m: f64::from(position.relative_alt) / 1e3,
        above_sea_m: f64::from(position.alt) / 1e3,
        velocity_mps: [cm(position.vy), cm(position.vx), -cm(position.vz)], // from north, east, down
        heading_deg: if position.hdg == u16::MAX { f64::INFINITY } else { heading_deg },
        boot_s: f64::from(position.time_boot_ms) / 1e3,
    }
}

/// The energy that is left, as a fraction, of a number [%] that is negative if it is not known.
fn charge(remaining: i8) -> Option<f64> {
    (remaining >= 0).then(|| f64::from(remaining) / 100.0)
}

/// The system to which a message of a vehicle is an answer; `None` if it is no answer, or does not say whose.
pub fn answers_to(message: &MavMessage) -> Option<u8> {
    match message {
        MavMessage::COMMAND_ACK(ack) => Some(ack.target_system).filter(|system| *system > 0),
        _ => None,
    }
}

/// An order to the system `target_system`.
#[must_use]
pub fn encode(order: &Order, target_system: u8) -> MavMessage {
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
        Order::Arm => long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        Order::TakeOff(altitude) => {
            let (frame, z_m) = frame_of(altitude);
            // PX4 takes 0 for a place; ArduPilot makes an integer of it.
            let here = if frame == MavFrame::MAV_FRAME_GLOBAL { f32::NAN } else { 0.0 };
            long(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 0.0, here, here, here, z_m])
        }
        Order::Speed(mps) => long(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [1.0, mps as f32, -1.0, 0.0, 0.0, 0.0, 0.0]),
        Order::Reposition { to, speed_mps } => reposition(&to, speed_mps, target_system),
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

/// A reposition without the flag that lets it change the mode: it overrules no pilot, and no failsafe.
fn reposition(to: &GlobalTarget, speed_mps: Option<f64>, target_system: u8) -> MavMessage {
    let (frame, z) = frame_of(to.altitude);
    let e7 = |degrees: f64| (degrees * 1e7).round() as i32;
    MavMessage::COMMAND_INT(COMMAND_INT_DATA {
        param1: speed_mps.map_or(-1.0, |speed_mps| speed_mps as f32), // below 0 it stays
        param2: 0.0,
        param3: 0.0,
        param4: f32::NAN, // the yaw stays
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
    use mavlink::dialects::common::{COMMAND_ACK_DATA, MavResult, PARAM_VALUE_DATA, STATUSTEXT_DATA};

    #[test]
    fn a_reposition_is_a_command_int_above_home_in_ten_millionths_of_a_degree() {
        let to = GlobalTarget { lat_deg: 47.397_742, lon_deg: -8.545_594, altitude: Altitude::AboveHome(20.0) };
        let MavMessage::COMMAND_INT(sent) = encode(&Order::Reposition { to, speed_mps: None }, 3) else {
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
                    Some(Telemetry::Heartbeat { autopilot, mode: 4, is_armed, is_critical: false })
                );
            }
        }
        assert_eq!(decoded(MavAutopilot::MAV_AUTOPILOT_INVALID, ARMED), None, "a ground station");
    }

    #[test]
    fn other_messages_are_decoded_in_si_units() {
        let text = STATUSTEXT_DATA { text: "EKF variance".into(), ..Default::default() };
        assert_eq!(
            decode(&MavMessage::STATUSTEXT(text)),
            Some(Telemetry::Text { text: "EKF variance".to_owned(), line: 0 })
        );
        let ours = |target_system| {
            answers_to(&MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { target_system, ..Default::default() }))
        };
        assert_eq!([0, 7].map(ours), [None, Some(7)]);
        let told = PARAM_VALUE_DATA { param_id: "FS_GCS_ENABLE".into(), param_value: 1.0, ..Default::default() };
        let name = "FS_GCS_ENABLE".to_owned();
        let parameter = Telemetry::Parameter { name, value: 1.0, is_integer: true };
        assert_eq!(decode(&MavMessage::PARAM_VALUE(told)), Some(parameter));
        let answer = COMMAND_ACK_DATA {
            command: MavCmd::MAV_CMD_NAV_TAKEOFF,
            result: MavResult::MAV_RESULT_DENIED,
            ..Default::default()
        };
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
        assert_eq!(params(Order::Arm), [1.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(params(Order::Speed(7.0)), [1.0, 7.0, -1.0, 0.0, 0.0], "over ground, without throttle");
        assert_eq!(params(Order::TakeOff(Altitude::AboveHome(20.0))), [0.0, 0.0, 0.0, 0.0, 20.0]);
        let [.., yaw, z_m] = params(Order::TakeOff(Altitude::AboveSea(508.0)));
        assert!(yaw.is_nan() && z_m == 508.0);
        let to = GlobalTarget { lat_deg: 1.0, lon_deg: 2.0, altitude: Altitude::AboveSea(3.0) };
        let MavMessage::COMMAND_INT(sent) = encode(&Order::Reposition { to, speed_mps: Some(7.0) }, 7) else {
            panic!("another message");
        };
        assert!(sent.param1 == 7.0 && sent.param2 == 0.0 && sent.param4.is_nan(), "no change of mode: {sent:?}");
        let MavMessage::PARAM_REQUEST_READ(sent) = encode(&Order::Parameter("NAV_DLL_ACT"), 7) else {
            panic!("another message");
        };
        assert_eq!((sent.param_index, sent.target_system, sent.param_id.to_str()), (-1, 7, Ok("NAV_DLL_ACT")));
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
        assert_eq!((charge(-1), charge(40)), (None, Some(0.4)));
        let status = |enabled: bool, health: bool| {
            let [onboard_control_sensors_enabled, onboard_control_sensors_health] =
                [enabled, health].map(|is_set| if is_set { PREARM } else { MavSysStatusSensor::empty() });
            let sent = SYS_STATUS_DATA {
                onboard_control_sensors_enabled,
                onboard_control_sensors_health,
                battery_remaining: -1,
                ..Default::default()
            };
            decode(&MavMessage::SYS_STATUS(sent))
        };
        let says = |is_ready| Some(Telemetry::Status { left: None, is_ready });
        assert_eq!(
            [status(false, false), status(true, false), status(true, true)],
            [says(None), says(Some(false)), says(Some(true))]
        );
        let accuracy = |pos_horiz_accuracy: f32| {
            decode(&MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA { pos_horiz_accuracy, ..Default::default() }))
        };
        assert_eq!([f32::NAN, -0.5, 1e20].map(accuracy), [None, None, None]);
        assert_eq!(accuracy(0.5), Some(Telemetry::Accuracy([0.5, 0.0])));
    }

    #[test]
    fn an_order_has_the_command_of_its_message() {
        let to = GlobalTarget { lat_deg: 1.0, lon_deg: 2.0, altitude: Altitude::AboveSea(3.0) };
        for order in [
            Order::Arm,
            Order::TakeOff(Altitude::AboveHome(20.0)),
            Order::Speed(7.0),
            Order::Reposition { to, speed_mps: Some(7.0) },
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
