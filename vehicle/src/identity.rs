//! Which of the vehicles on a connection is flown: the one that the address names, or the only one there. An autopilot
//! that nobody has named gets no order while there is another.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use mavlink::dialects::common::{HEARTBEAT_DATA, MavAutopilot, MavType};
use serde::{Deserialize, Serialize};

use crate::telemetry::Fix;

/// A vehicle that is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChosenVehicle {
    /// Its system.
    pub system: u8,
    /// Its address, over UDP.
    pub address: Option<SocketAddr>,
}

/// How long a connection is listened to before the only vehicle on it is chosen [s].
const LISTEN_S: f64 = 4.0;

/// How long a vehicle keeps its address against a second sender of its system [s].
const KEEPS_ADDRESS_S: f64 = 2.0;

/// How long a restarted bridge waits for a vehicle where it was [s].
const EXPECTED_S: f64 = 10.0;

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
    kind: MavType,
    autopilot: MavAutopilot,
    address: Option<SocketAddr>,
    /// When it was heard from that address [s].
    heard_s: f64,
    /// Another address that has sent for its system.
    second: Option<SocketAddr>,
    /// Its last position.
    fix: Option<Fix>,
    /// Whether its type and its address are believed for good, as it is flown: ArduCopter tells its own type only after
    /// a while.
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
        let new = Heard { kind, autopilot, address, heard_s: now_s, second: None, fix: None, is_fixed: false };
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

    /// Takes in that `system` has sent a valid message from `from`. Once it is flown, another sender is silence.
    pub fn hear(&mut self, system: u8, from: Option<SocketAddr>, now_s: f64) -> Sender {
        let Some(heard) = self.heard.get_mut(&system) else { return Sender::Unknown };
        if heard.address == from {
            heard.heard_s = now_s;
            return Sender::Known;
        }
        if heard.is_fixed || now_s - heard.heard_s < KEEPS_ADDRESS_S {
            heard.second = heard.second.or(from);
            return Sender::Second;
        }
        (heard.address, heard.heard_s) = (from, now_s);
        heard.second = heard.second.filter(|second| Some(*second) != from);
        Sender::Moved
    }

    /// Believes the type and the address of `system` for good.
    pub fn fix(&mut self, system: u8) {
        if let Some(heard) = self.heard.get_mut(&system) {
            heard.is_fixed = true;
        }
    }

    /// Takes in where `system` is.
    pub fn locate(&mut self, system: u8, fix: &Fix) {
        if let Some(heard) = self.heard.get_mut(&system) {
            heard.fix = Some(*fix);
        }
    }

    /// Whether any vehicle was heard.
    pub fn is_empty(&self) -> bool {
        self.heard.is_empty()
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
            let place = heard.fix.as_ref().and_then(&away);
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

    /// Checks that `system` hovers, and is one vehicle, or that of the bridge before. A generic one hovers if it
    /// is named.
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
        two.locate(3, &fix);
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
        assert_eq!(one.hear(2, address(1), 0.5), Sender::Unknown);
        assert_eq!(one.hear(1, address(1), 1.0), Sender::Known);
        assert_eq!(one.hear(1, address(9), 2.9), Sender::Second);
        assert_eq!(one.address(1), address(1));
        let two = "system 1 is heard from 127.0.0.1:1 and from 127.0.0.1:9: expected one vehicle";
        assert_eq!(one.choose(Some(1), 3.0, |_| None), Err(two.to_owned()));
        let mut moved = one.clone();
        assert_eq!(moved.hear(1, address(9), 3.0), Sender::Moved, "it was silent from then on");
        assert_eq!(moved.choose(Some(1), 9.0, |_| None), Ok(Some(1)), "it is heard from there alone");
        assert_eq!((moved.address(1), moved.is_at(address(1).unwrap())), (address(9), false));
    }

    #[test]
    fn a_vehicle_is_waited_for_where_it_was_before() {
        let mut one = Vehicles::default();
        one.expect(1, address(5).unwrap());
        let heartbeat = HEARTBEAT_DATA { mavtype: MAV_TYPE_QUADROTOR, ..HEARTBEAT_DATA::default() };
        assert!(!one.hear_heartbeat(1, &heartbeat, address(9), 1.0));
        assert_eq!(one.hear(1, address(9), 1.0), Sender::Unknown);
        assert!(one.clone().hear_heartbeat(1, &heartbeat, address(5), 2.0));
        assert!(one.hear_heartbeat(1, &heartbeat, address(9), EXPECTED_S), "it is not there any more");
    }

    #[test]
    fn another_sender_of_a_vehicle_in_flight_is_silence() {
        let mut one = heard(&[(1, MAV_TYPE_QUADROTOR)]);
        assert_eq!(one.clone().hear(1, address(9), 60.0), Sender::Moved, "before it is flown");
        one.fix(1);
        assert_eq!([11.0, 3600.0].map(|now_s| one.hear(1, address(9), now_s)), [Sender::Second; 2]);
        assert_eq!((one.address(1), one.hear(1, address(1), 3601.0)), (address(1), Sender::Known));
    }
}
