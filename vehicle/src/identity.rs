//! Which of the vehicles on a connection is flown: the one that the address names, or the only one there. An autopilot
//! that nobody has named gets no order while there is another.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use mavlink::dialects::common::{HEARTBEAT_DATA, MavAutopilot, MavType};

use crate::telemetry::Fix;

/// How long a connection is listened to before the only vehicle on it is chosen [s].
const LISTEN_S: f64 = 4.0;

/// How long a vehicle keeps its address against a second sender of its system [s].
const KEEPS_ADDRESS_S: f64 = 2.0;

/// How late messages of an address that is not used any more may come [s].
const REORDERED_S: f64 = 0.5;

/// How long a restarted bridge waits for a vehicle where it was [s].
const EXPECTED_S: f64 = 10.0;

/// How far the clock of a vehicle may be from where it should be [s], and more for each second of silence.
const CLOCK_S: f64 = 1.0;
const CLOCK_DRIFT: f64 = 0.02;

/// How far a vehicle may be from its last position [m], and more for each second of silence [m/s].
const NEAR_M: f64 = 20.0;
const FAST_MPS: f64 = 30.0;

/// Length of a degree of latitude [m].
const DEGREE_M: f64 = 111_200.0;

/// Types of vehicles that hover, and whose modes are those of copters.
const HOVERING: [MavType; 9] = [
    MavType::MAV_TYPE_QUADROTOR,
    MavType::MAV_TYPE_COAXIAL,
    MavType::MAV_TYPE_HELICOPTER,
    MavType::MAV_TYPE_HEXAROTOR,
    MavType::MAV_TYPE_OCTOROTOR,
    MavType::MAV_TYPE_TRICOPTER,
    MavType::MAV_TYPE_DODECAROTOR,
    MavType::MAV_TYPE_DECAROTOR,
    MavType::MAV_TYPE_GENERIC_MULTIROTOR,
];

/// The vehicles on a connection, by their systems.
#[derive(Debug, Clone, Default)]
pub struct Vehicles {
    heard: BTreeMap<u8, Heard>,
    /// When the first was heard [s].
    first_s: Option<f64>,
    /// Where the bridge before has heard systems.
    expected: BTreeMap<u8, SocketAddr>,
}

/// A vehicle on a connection.
#[derive(Debug, Clone)]
struct Heard {
    /// Its first heartbeat.
    first: HEARTBEAT_DATA,
    kind: MavType,
    autopilot: MavAutopilot,
    address: Option<SocketAddr>,
    /// When it was heard from that address [s].
    heard_s: f64,
    /// Another address that has sent for its system, when it did so first [s], and whether the first has sent since.
    second: Option<SocketAddr>,
    second_s: f64,
    is_beside: bool,
    /// Its last position, and when that was heard [s].
    fix: Option<(Fix, f64)>,
    /// Whether its type is believed for good: ArduCopter tells its own only after a while.
    is_fixed: bool,
}

/// Whether a message is believed to come from the vehicle of its system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sender {
    /// From where it was before.
    Known,
    /// From a new address, as the old one is silent.
    Moved,
    /// From a second address of a system that is heard from another.
    Second,
    /// From a new address, as the old one is silent; nothing shows yet that it is the same vehicle.
    Unproven,
    /// Of a system without an autopilot, so far.
    Unknown,
}

impl Vehicles {
    /// Waits for `system` at `address` first, where the bridge before has heard it.
    pub fn expect(&mut self, system: u8, address: SocketAddr) {
        self.expected.insert(system, address);
    }

    /// Takes in a heartbeat of an autopilot. Returns whether its system is new.
    pub fn hear_heartbeat(
        &mut self,
        system: u8,
        heartbeat: &HEARTBEAT_DATA,
        address: Option<SocketAddr>,
        now_s: f64,
    ) -> bool {
        let is_elsewhere = self.expected.get(&system).is_some_and(|expected| address != Some(*expected));
        if is_elsewhere && now_s < EXPECTED_S && !self.heard.contains_key(&system) {
            return false;
        }
        self.first_s.get_or_insert(now_s);
        let is_new = !self.heard.contains_key(&system);
        let HEARTBEAT_DATA { mavtype: kind, autopilot, .. } = *heartbeat;
        let first = heartbeat.clone();
        let new = Heard {
            first,
            kind,
            autopilot,
            address,
            heard_s: now_s,
            second: None,
            second_s: 0.0,
            is_beside: false,
            fix: None,
            is_fixed: false,
        };
        let heard = self.heard.entry(system).or_insert(new);
        if !heard.is_fixed && heard.address == address {
            (heard.kind, heard.autopilot) = (kind, autopilot);
        }
        is_new
    }

    /// Whether a heartbeat of `system` is that of a vehicle of the same type, with the same autopilot, as before.
    pub fn is_of_type(&self, system: u8, heartbeat: &HEARTBEAT_DATA) -> bool {
        let is_same = |heard: &Heard| heard.kind == heartbeat.mavtype && heard.autopilot == heartbeat.autopilot;
        self.heard.get(&system).is_some_and(is_same)
    }

    /// Takes in that `system` has sent a valid message from `from`; `fix` is the position that it reports, if it does.
    /// After a silence a vehicle in flight is believed elsewhere only if it goes on from where it was, by its clock.
    pub fn hear(&mut self, system: u8, from: Option<SocketAddr>, fix: Option<&Fix>, now_s: f64) -> Sender {
        let Some(heard) = self.heard.get_mut(&system) else { return Sender::Unknown };
        if heard.address == from {
            heard.heard_s = now_s;
            heard.is_beside |= heard.second.is_some() && now_s - heard.second_s >= REORDERED_S;
            return Sender::Known;
        }
        // One that has spoken beside the vehicle is not the vehicle, now or later.
        let is_beside = heard.is_beside && from.is_some() && heard.second == from;
        if now_s - heard.heard_s < KEEPS_ADDRESS_S || is_beside {
            if heard.second.is_none() {
                (heard.second, heard.second_s) = (from, now_s);
            }
            return Sender::Second;
        }
        if let Some((last, last_s)) = &heard.fix
            && heard.is_fixed
            && !fix.is_some_and(|fix| goes_on(last, fix, now_s - last_s))
        {
            return Sender::Unproven;
        }
        heard.address = from;
        heard.heard_s = now_s;
        heard.second = heard.second.filter(|second| Some(*second) != from);
        heard.is_beside &= heard.second.is_some();
        Sender::Moved
    }

    /// The first heartbeat of `system`.
    pub fn first_heartbeat(&self, system: u8) -> Option<&HEARTBEAT_DATA> {
        Some(&self.heard.get(&system)?.first)
    }

    /// Believes the type of `system` for good.
    pub fn fix_type(&mut self, system: u8) {
        if let Some(heard) = self.heard.get_mut(&system) {
            heard.is_fixed = true;
        }
    }

    /// Takes in where `system` is.
    pub fn locate(&mut self, system: u8, fix: &Fix, now_s: f64) {
        if let Some(heard) = self.heard.get_mut(&system) {
            heard.fix = Some((*fix, now_s));
        }
    }

    /// The address of `system`; `None` if it was not heard, or not over UDP.
    pub fn address(&self, system: u8) -> Option<SocketAddr> {
        self.heard.get(&system)?.address
    }

    /// Whether somebody at this address is one of the vehicles.
    pub fn is_at(&self, address: SocketAddr) -> bool {
        self.heard.values().any(|heard| heard.address == Some(address))
    }

    /// Which system is flown where the address names `named`, or none; `None` if that is not known yet. `away` says how
    /// far from its start a vehicle is [m].
    ///
    /// # Errors
    /// If none may be flown, in words.
    pub fn choose(
        &self,
        named: Option<u8>,
        now_s: f64,
        away: impl Fn(&Fix) -> Option<f64>,
    ) -> Result<Option<u8>, String> {
        let system = match named {
            Some(named) if self.heard.contains_key(&named) => named,
            Some(_) => return Ok(None),
            None => {
                let has_listened = self.first_s.is_some_and(|first_s| now_s - first_s >= LISTEN_S);
                let Some((&system, _)) = self.heard.first_key_value().filter(|_| has_listened) else { return Ok(None) };
                self.check_alone(away)?;
                system
            }
        };
        self.check(system, named.is_some())?;
        Ok(Some(system))
    }

    /// Checks that there is one vehicle.
    ///
    /// # Errors
    /// If there are several, in words.
    pub fn check_alone(&self, away: impl Fn(&Fix) -> Option<f64>) -> Result<(), String> {
        if self.heard.len() < 2 {
            return Ok(());
        }
        let row = |(system, heard): (&u8, &Heard)| {
            let place = heard.fix.as_ref().and_then(|(fix, _)| away(fix));
            let place =
                place.map_or("at an unknown place".to_owned(), |away_m| format!("{away_m:.0} m from the start"));
            format!("system {system} ({}, {place})", name(heard.kind))
        };
        let rows: Vec<String> = self.heard.iter().map(row).collect();
        Err(format!(
            "{} vehicles at its address: {}: expected one, or ?system=N behind the address",
            rows.len(),
            rows.join(", ")
        ))
    }

    /// Checks that `system` hovers, and is one vehicle, or that of the bridge before. A generic one, of which nothing is known, hovers if it is named.
    ///
    /// # Errors
    /// If not, in words.
    pub fn check(&self, system: u8, is_named: bool) -> Result<(), String> {
        let Some(heard) = self.heard.get(&system) else { return Ok(()) };
        let is_generic = heard.kind == MavType::MAV_TYPE_GENERIC;
        if !(HOVERING.contains(&heard.kind) || is_generic && is_named) {
            let number = heard.kind as u32;
            let or_named = if is_generic { ", or ?system=N behind the address" } else { "" };
            let kind = name(heard.kind);
            return Err(format!("system {system} is a {kind} (MAV_TYPE {number}): expected a copter{or_named}"));
        }
        let is_known = self.expected.get(&system).is_some_and(|expected| heard.address == Some(*expected));
        if let (Some(first), Some(second), false) = (heard.address, heard.second, is_known) {
            return Err(format!("system {system} is heard from {first} and from {second}: expected one vehicle"));
        }
        Ok(())
    }

    /// What `system` is, for people.
    pub fn describe(&self, system: u8) -> String {
        let kind = self.heard.get(&system).map(|heard| format!(" ({})", name(heard.kind)));
        format!("system {system}{}", kind.unwrap_or_default())
    }
}

/// Whether `fix` may be a later one of the vehicle of `last`, after `seconds` [s]: its clock goes on, and it is no farther
/// than a vehicle flies in that time.
fn goes_on(last: &Fix, fix: &Fix, seconds: f64) -> bool {
    let north_m = (fix.lat_deg - last.lat_deg) * DEGREE_M;
    let east_m = (fix.lon_deg - last.lon_deg) * DEGREE_M * last.lat_deg.to_radians().cos();
    let is_in_time = (fix.boot_s - last.boot_s - seconds).abs() <= CLOCK_S + CLOCK_DRIFT * seconds;
    is_in_time && north_m.hypot(east_m) <= NEAR_M + FAST_MPS * seconds
}

/// The name of a type, such as `ground rover`.
fn name(kind: MavType) -> String {
    format!("{kind:?}").trim_start_matches("MAV_TYPE_").to_lowercase().replace('_', " ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use MavType::{
        MAV_TYPE_FIXED_WING, MAV_TYPE_GCS, MAV_TYPE_GENERIC, MAV_TYPE_GROUND_ROVER, MAV_TYPE_HEXAROTOR,
        MAV_TYPE_QUADROTOR,
    };

    fn address(port: u16) -> Option<SocketAddr> {
        Some(SocketAddr::from(([127, 0, 0, 1], port)))
    }

    fn heard(vehicles: &[(u8, MavType)]) -> Vehicles {
        let mut all = Vehicles::default();
        for &(system, kind) in vehicles {
            let heartbeat = HEARTBEAT_DATA { mavtype: kind, ..HEARTBEAT_DATA::default() };
            let _ = all.hear_heartbeat(system, &heartbeat, address(system.into()), 0.0);
        }
        all
    }

    fn choose(vehicles: &[(u8, MavType)], named: Option<u8>, now_s: f64) -> Result<Option<u8>, String> {
        heard(vehicles).choose(named, now_s, |_| None)
    }

    #[test]
    fn the_only_vehicle_is_chosen_after_listening_for_others_and_a_named_one_at_once() {
        let one = [(7, MAV_TYPE_HEXAROTOR)];
        assert_eq!(choose(&[], None, 60.0), Ok(None));
        assert_eq!([0.0, 3.9, 4.0].map(|now_s| choose(&one, None, now_s)), [Ok(None), Ok(None), Ok(Some(7))]);
        assert_eq!((choose(&one, Some(7), 0.0), choose(&one, Some(1), 60.0)), (Ok(Some(7)), Ok(None)));
        let two = [(7, MAV_TYPE_HEXAROTOR), (1, MAV_TYPE_QUADROTOR)];
        assert_eq!(choose(&two, Some(1), 0.0), Ok(Some(1)));
    }

    #[test]
    fn of_two_vehicles_none_is_chosen_and_both_are_listed() {
        let mut two = heard(&[(3, MAV_TYPE_QUADROTOR), (1, MAV_TYPE_GROUND_ROVER)]);
        let fix = Fix {
            lat_deg: 0.0,
            lon_deg: 0.0,
            above_home_m: 0.0,
            above_sea_m: 0.0,
            velocity_mps: [0.0; 3],
            heading_deg: 0.0,
            boot_s: 0.0,
        };
        two.locate(3, &fix, 0.0);
        let expected = "2 vehicles at its address: system 1 (ground rover, at an unknown place), system 3 (quadrotor, 12 m \
                        from the start): expected one, or ?system=N behind the address";
        assert_eq!(two.choose(None, 9.0, |_| Some(12.3)), Err(expected.to_owned()));
    }

    #[test]
    fn only_what_hovers_is_chosen_even_if_it_is_named() {
        for (kind, words) in
            [(MAV_TYPE_GROUND_ROVER, "ground rover"), (MAV_TYPE_FIXED_WING, "fixed wing"), (MAV_TYPE_GCS, "gcs")]
        {
            for named in [None, Some(1)] {
                let number = kind as u32;
                let expected = format!("system 1 is a {words} (MAV_TYPE {number}): expected a copter");
                assert_eq!(choose(&[(1, kind)], named, 9.0), Err(expected));
            }
        }
        assert!(choose(&[(1, MAV_TYPE_GENERIC)], None, 9.0).is_err());
        assert_eq!(choose(&[(1, MAV_TYPE_GENERIC)], Some(1), 9.0), Ok(Some(1)), "somebody vouches for it");
    }

    #[test]
    fn a_vehicle_keeps_its_address_until_it_is_silent_there() {
        let mut one = heard(&[(1, MAV_TYPE_QUADROTOR)]);
        assert_eq!(one.hear(2, address(1), None, 0.5), Sender::Unknown);
        assert_eq!(one.hear(1, address(1), None, 1.0), Sender::Known);
        assert_eq!(one.hear(1, address(9), None, 2.9), Sender::Second);
        assert_eq!(one.address(1), address(1));
        let two = "system 1 is heard from 127.0.0.1:1 and from 127.0.0.1:9: expected one vehicle";
        assert_eq!(one.choose(Some(1), 3.0, |_| None), Err(two.to_owned()));
        let mut moved = one.clone();
        assert_eq!(moved.hear(1, address(9), None, 3.0), Sender::Moved, "it was silent from then on");
        assert_eq!(moved.choose(Some(1), 9.0, |_| None), Ok(Some(1)), "it is heard from there alone");
        assert_eq!(one.hear(1, address(1), None, 3.3), Sender::Known);
        assert_eq!(one.clone().hear(1, address(9), None, 5.3), Sender::Moved, "that one came late");
        assert_eq!(one.hear(1, address(1), None, 3.5), Sender::Known);
        assert_eq!(one.hear(1, address(9), None, 60.0), Sender::Second, "it was beside the vehicle");
        assert_eq!(one.hear(1, address(8), None, 61.0), Sender::Moved);
        assert_eq!((one.address(1), one.is_at(address(1).unwrap())), (address(8), false));
    }

    #[test]
    fn a_vehicle_is_waited_for_where_it_was_before() {
        let mut one = Vehicles::default();
        one.expect(1, address(5).unwrap());
        let heartbeat = HEARTBEAT_DATA { mavtype: MAV_TYPE_QUADROTOR, ..HEARTBEAT_DATA::default() };
        assert!(!one.hear_heartbeat(1, &heartbeat, address(9), 1.0));
        assert_eq!(one.hear(1, address(9), None, 1.0), Sender::Unknown);
        assert!(one.clone().hear_heartbeat(1, &heartbeat, address(5), 2.0));
        assert!(one.hear_heartbeat(1, &heartbeat, address(9), EXPECTED_S), "it is not there any more");
    }

    #[test]
    fn a_vehicle_in_flight_is_believed_elsewhere_only_if_it_goes_on_from_where_it_was() {
        let fix = |lat_deg: f64, boot_s: f64| Fix {
            lat_deg,
            lon_deg: 8.0,
            above_home_m: 20.0,
            above_sea_m: 500.0,
            velocity_mps: [0.0; 3],
            heading_deg: 0.0,
            boot_s,
        };
        let mut one = heard(&[(1, MAV_TYPE_QUADROTOR)]);
        one.locate(1, &fix(47.0, 100.0), 1.0);
        assert_eq!(one.clone().hear(1, address(9), None, 60.0), Sender::Moved, "before it is flown");
        one.fix_type(1);
        for (other, expected) in [
            (None, Sender::Unproven),
            (Some(fix(47.0, 60.0)), Sender::Unproven),  // of another clock
            (Some(fix(47.1, 110.0)), Sender::Unproven), // 11 km away
            (Some(fix(47.001, 110.0)), Sender::Moved),
            (Some(Fix { lon_deg: 8.004, ..fix(47.0, 110.0) }), Sender::Moved), // 303 m, of 320
            (Some(Fix { lon_deg: 8.0043, ..fix(47.0, 110.0) }), Sender::Unproven),
            (Some(fix(47.0, 111.15)), Sender::Moved), // 1 s, and 2 % of 10 s
            (Some(fix(47.0, 111.25)), Sender::Unproven),
        ] {
            assert_eq!(one.clone().hear(1, address(9), other.as_ref(), 11.0), expected, "{other:?}");
        }
        assert_eq!(one.address(1), address(1));
    }
}
