//! How autopilots differ: the numbers and names of their modes, their altitudes, and the parameter of their GCS
//! failsafe.

use serde::{Deserialize, Serialize};

/// The autopilot of a vehicle, by its heartbeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AutopilotKind {
    /// ArduPilot, of a copter.
    ArduPilot,
    /// PX4.
    Px4,
    /// Another, whose modes the address has to name.
    Other,
}

/// An altitude, by what it is measured from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Altitude {
    /// Above the home position of the vehicle [m].
    AboveHome(f64),
    /// Above mean sea level [m].
    AboveSea(f64),
}

/// What the mode of a vehicle means for its bridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum ModeMeaning {
    /// It follows commands. That it is in this mode is the consent of its operator.
    Follows,
    /// It flies home, or lands.
    Returns,
    /// A pilot or a mission flies it.
    Other,
}

/// The meanings of modes that an address names, by their numbers; of an autopilot that is known, none have to be.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NamedModes(pub Vec<(ModeMeaning, u32)>);

impl NamedModes {
    /// What mode number `mode` of `autopilot` means.
    pub fn meaning(&self, autopilot: AutopilotKind, mode: u32) -> ModeMeaning {
        let named = self.0.iter().find(|(_, number)| *number == mode).map(|(meaning, _)| *meaning);
        named.unwrap_or_else(|| autopilot.meaning(mode))
    }

    /// Whether a mode of this meaning is named.
    pub fn names(&self, meaning: ModeMeaning) -> bool {
        self.0.iter().any(|(named, _)| *named == meaning)
    }
}

/// Modes of ArduCopter.
mod arducopter {
    /// The names of all modes, by their numbers.
    pub const NAMES: [(u32, &str); 27] = [
        (0, "STABILIZE"),
        (1, "ACRO"),
        (2, "ALT_HOLD"),
        (3, "AUTO"),
        (4, "GUIDED"),
        (5, "LOITER"),
        (6, "RTL"),
        (7, "CIRCLE"),
        (9, "LAND"),
        (11, "DRIFT"),
        (13, "SPORT"),
        (14, "FLIP"),
        (15, "AUTOTUNE"),
        (16, "POSHOLD"),
        (17, "BRAKE"),
        (18, "THROW"),
        (19, "AVOID_ADSB"),
        (20, "GUIDED_NOGPS"),
        (21, "SMART_RTL"),
        (22, "FLOWHOLD"),
        (23, "FOLLOW"),
        (24, "ZIGZAG"),
        (25, "SYSTEMID"),
        (26, "AUTOROTATE"),
        (27, "AUTO_RTL"),
        (28, "TURTLE"),
        (29, "RATE_ACRO"),
    ];
    pub const GUIDED: u32 = 4;
    pub const RTL: u32 = 6;
    pub const LAND: u32 = 9;
    pub const SMART_RTL: u32 = 21;
    pub const AUTO_RTL: u32 = 27;
}

/// Modes of PX4: the main mode in bits 16 to 23, its sub-mode in bits 24 to 31.
mod px4 {
    /// The names of the main modes.
    pub const NAMES: [(u32, &str); 10] = [
        (1, "MANUAL"),
        (2, "ALTCTL"),
        (3, "POSCTL"),
        (AUTO, "AUTO"),
        (5, "ACRO"),
        (6, "OFFBOARD"),
        (7, "STABILIZED"),
        (8, "RATTITUDE"),
        (9, "SIMPLE"),
        (10, "TERMINATION"),
    ];
    /// The names of the sub-modes of AUTO, as ground stations show them.
    pub const AUTO_NAMES: [(u32, &str); 8] = [
        (1, "READY"),
        (TAKE_OFF, "TAKEOFF"),
        (LOITER, "HOLD"),
        (4, "MISSION"),
        (RTL, "RETURN"),
        (LAND, "LAND"),
        (8, "FOLLOW_TARGET"),
        (PRECISION_LAND, "PRECLAND"),
    ];
    pub const AUTO: u32 = 4;
    pub const TAKE_OFF: u32 = 2;
    pub const LOITER: u32 = 3;
    pub const RTL: u32 = 5;
    pub const LAND: u32 = 6;
    pub const PRECISION_LAND: u32 = 9;
    /// The bit of `COM_DLL_EXCEPT` for Hold, and with it for take-off.
    pub const EXCEPT_HOLD: i32 = 1 << 1;
}

impl AutopilotKind {
    /// The name of the mode that follows commands, into which the operator puts it.
    #[must_use]
    pub fn follow_name(self) -> &'static str {
        match self {
            Self::ArduPilot => "GUIDED",
            Self::Px4 => "HOLD",
            Self::Other => "the mode that follows commands",
        }
    }

    /// What its mode number `mode` means. Modes that an autopilot takes itself belong to those of the command before:
    /// Takeoff and then Hold of PX4 in a climb, Land at the end of a return.
    #[must_use]
    pub fn meaning(self, mode: u32) -> ModeMeaning {
        match self {
            Self::ArduPilot => match mode {
                arducopter::GUIDED => ModeMeaning::Follows,
                arducopter::RTL | arducopter::LAND | arducopter::SMART_RTL | arducopter::AUTO_RTL => {
                    ModeMeaning::Returns
                }
                _ => ModeMeaning::Other,
            },
            Self::Px4 => match px4_modes(mode) {
                [px4::AUTO, px4::TAKE_OFF | px4::LOITER] => ModeMeaning::Follows,
                [px4::AUTO, px4::RTL | px4::LAND | px4::PRECISION_LAND] => ModeMeaning::Returns,
                _ => ModeMeaning::Other,
            },
            Self::Other => ModeMeaning::Other,
        }
    }

    /// Whether `mode` is one for the take-off alone, which ends by itself in the mode that follows commands.
    #[must_use]
    pub fn takes_off_in(self, mode: u32) -> bool {
        self == Self::Px4 && px4_modes(mode) == [px4::AUTO, px4::TAKE_OFF]
    }

    /// The name of its mode number `mode`, such as `LOITER`; the number, as in `mode 31`, of one that is not known.
    #[must_use]
    pub fn mode_name(self, mode: u32) -> String {
        let name_in = |names: &[(u32, &'static str)], number: u32| {
            names.iter().find(|(known, _)| *known == number).map(|(_, name)| *name)
        };
        let name = match self {
            Self::ArduPilot => name_in(&arducopter::NAMES, mode),
            Self::Px4 => match px4_modes(mode) {
                [px4::AUTO, sub] if sub > 0 => name_in(&px4::AUTO_NAMES, sub),
                [main, _] => name_in(&px4::NAMES, main),
            },
            Self::Other => None,
        };
        name.map_or_else(|| format!("mode {mode}"), str::to_owned)
    }

    /// Whether the speed is part of each reposition. PX4 forgets another one when it enters Hold.
    #[must_use]
    pub fn takes_speed_with_waypoint(self) -> bool {
        self == Self::Px4
    }

    /// Whether it reads altitudes above sea, whatever frame is named.
    #[must_use]
    pub fn reads_above_sea(self) -> bool {
        self == Self::Px4
    }

    /// The altitude `z_m` above home [m] as the autopilot expects it.
    #[must_use]
    pub fn altitude(self, z_m: f64, home_above_sea_m: f64) -> Altitude {
        if self.reads_above_sea() { Altitude::AboveSea(home_above_sea_m + z_m) } else { Altitude::AboveHome(z_m) }
    }

    /// What makes it come down when the bridge is silent.
    #[must_use]
    pub fn gcs_failsafe(self) -> Option<&'static GcsFailsafe> {
        match self {
            Self::ArduPilot => Some(&GcsFailsafe {
                parameter: "FS_GCS_ENABLE",
                values: &[
                    (1, "returns"),
                    (3, "returns along its path, or else directly"),
                    (4, "returns along its path, or else lands"),
                ],
            }),
            Self::Px4 => Some(&GcsFailsafe { parameter: "NAV_DLL_ACT", values: &[(2, "returns"), (3, "lands")] }),
            Self::Other => None,
        }
    }

    /// What its GCS failsafe depends on, too, in some versions.
    #[must_use]
    pub fn condition(self) -> Option<&'static Condition> {
        match self {
            Self::ArduPilot => Some(&Condition {
                parameters: &["SYSID_MYGCS", "MAV_GCS_SYSID"],
                meaning: "to say which ground station it listens to",
                refusal: |value, own_system| {
                    (value != f64::from(own_system)).then(|| {
                        format!(
                            "expected {own_system}, the system of the bridge, or ?own_system={value} behind the \
                            address"
                        )
                    })
                },
            }),
            Self::Px4 => Some(&Condition {
                parameters: &["COM_DLL_EXCEPT"],
                meaning: "to say in which modes it may stay when the bridge is silent",
                refusal: |value, _| {
                    (value as i32 & px4::EXCEPT_HOLD != 0).then(|| {
                        "it stays in the air in Hold, in which it is flown: expected a value without bit 1".to_owned()
                    })
                },
            }),
            Self::Other => None,
        }
    }

    /// The value of a parameter that was sent as `value`. PX4 sends the bits of an integer.
    #[must_use]
    pub fn parameter(self, value: f32, is_integer: bool) -> f64 {
        if self == Self::Px4 && is_integer { f64::from(value.to_bits().cast_signed()) } else { f64::from(value) }
    }
}

/// The main mode and the sub-mode of a mode number of PX4.
fn px4_modes(mode: u32) -> [u32; 2] {
    [mode >> 16 & 0xFF, mode >> 24]
}

/// The parameter of what a vehicle does when its ground station is silent.
#[derive(Debug)]
pub struct GcsFailsafe {
    /// Its name.
    pub parameter: &'static str,
    /// The values with which it comes down safely, and what it does.
    values: &'static [(i32, &'static str)],
}

/// What a GCS failsafe depends on.
#[derive(Debug)]
pub struct Condition {
    /// The names of its parameter, by version; some versions have none.
    pub parameters: &'static [&'static str],
    /// What a vehicle says by it, in words after "waiting for it".
    pub meaning: &'static str,
    /// Why the switch does not act with a value, for a bridge of this system, in words after the value.
    pub refusal: fn(f64, u8) -> Option<String>,
}

impl GcsFailsafe {
    /// What the vehicle does with this value; `None` if it does not come down safely.
    pub fn effect(&self, value: f64) -> Option<&'static str> {
        self.values.iter().find(|(accepted, _)| f64::from(*accepted) == value).map(|(_, effect)| *effect)
    }

    /// The accepted values, for people.
    pub fn expected(&self) -> String {
        let rows: Vec<String> = self.values.iter().map(|(value, effect)| format!("{value} ({effect})")).collect();
        rows.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mode_numbers_are_decoded_per_autopilot() {
        let arducopter = [0, 4, 6, 9, 5].map(|mode| AutopilotKind::ArduPilot.meaning(mode));
        use ModeMeaning::{Follows, Other, Returns};
        assert_eq!(arducopter, [Other, Follows, Returns, Returns, Other]);
        let px4 = [0x0302_0000, 0x0304_0000, 0x0204_0000, 0x0504_0000, 0x0404_0000, 0x0001_0000];
        let px4 = px4.map(|mode| AutopilotKind::Px4.meaning(mode));
        assert_eq!(px4, [Other, Follows, Follows, Returns, Other, Other]);
        let named = NamedModes(vec![(Follows, 31), (Returns, 34)]);
        let other = [31, 34, 4].map(|mode| named.meaning(AutopilotKind::Other, mode));
        assert_eq!(other, [Follows, Returns, Other]);
        assert!(named.names(Returns) && !NamedModes::default().names(Returns));
    }

    #[test]
    fn modes_have_the_names_of_their_autopilots_and_unknown_ones_their_numbers() {
        let arducopter = [0, 4, 5, 6, 21, 8, 99].map(|mode| AutopilotKind::ArduPilot.mode_name(mode));
        assert_eq!(arducopter, ["STABILIZE", "GUIDED", "LOITER", "RTL", "SMART_RTL", "mode 8", "mode 99"]);
        // PX4's custom mode: main mode << 16, sub-mode << 24.
        let px4 = [0x0003_0000, 0x0006_0000, 0x0304_0000, 0x0404_0000, 0x0504_0000, 0x0204_0000, 0x6304_0000, 0];
        let names = ["POSCTL", "OFFBOARD", "HOLD", "MISSION", "RETURN", "TAKEOFF", "mode 1661206528", "mode 0"];
        assert_eq!(px4.map(|mode| AutopilotKind::Px4.mode_name(mode)), names);
        assert_eq!(AutopilotKind::Other.mode_name(4), "mode 4");
    }

    #[test]
    fn only_values_that_bring_a_vehicle_down_safely_are_accepted() {
        let accepted = |autopilot: AutopilotKind| {
            let switch = autopilot.gcs_failsafe().unwrap();
            (-1..=8).filter(|value| switch.effect(f64::from(*value)).is_some()).collect::<Vec<i32>>()
        };
        assert_eq!(accepted(AutopilotKind::ArduPilot), [1, 3, 4]);
        assert_eq!(accepted(AutopilotKind::Px4), [2, 3], "neither hold (1) nor terminate (5) nor lockdown (6)");
        let expected = AutopilotKind::Px4.gcs_failsafe().unwrap().expected();
        assert_eq!(expected, "2 (returns), 3 (lands)");
    }

    #[test]
    fn px4_sends_the_bits_of_an_integer_and_ardupilot_its_value() {
        assert_eq!(AutopilotKind::Px4.parameter(f32::from_bits(2), true), 2.0);
        assert_eq!(AutopilotKind::Px4.parameter(f32::from_bits(u32::MAX), true), -1.0);
        assert_eq!(AutopilotKind::Px4.parameter(2.0, false), 2.0);
        assert_eq!(AutopilotKind::ArduPilot.parameter(3.0, true), 3.0);
    }
}
