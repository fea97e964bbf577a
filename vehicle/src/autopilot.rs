//! How autopilots differ: the numbers of their modes, their altitudes, and the parameter of their dead-man switch.

/// The autopilot of a vehicle, by its heartbeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AutopilotKind {
    /// ArduPilot, of a copter.
    ArduPilot,
    /// PX4.
    Px4,
    /// Another, of whose modes nothing is known.
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModeMeaning {
    /// It follows orders.
    FollowsOrders,
    /// It flies home, or lands.
    Returns,
    /// A pilot, a mission or a failsafe flies it.
    IsFlownByOthers,
    /// Unknown.
    Unknown,
}

/// Modes of ArduCopter.
mod arducopter {
    pub const GUIDED: u32 = 4;
    pub const RTL: u32 = 6;
    pub const LAND: u32 = 9;
    pub const SMART_RTL: u32 = 21;
}

/// Modes of PX4: the main mode in bits 16 to 23, its sub-mode in bits 24 to 31.
mod px4 {
    pub const AUTO: u32 = 4;
    pub const TAKE_OFF: u32 = 2;
    pub const LOITER: u32 = 3;
    pub const RTL: u32 = 5;
    pub const LAND: u32 = 6;
}

impl AutopilotKind {
    /// The mode to change to before arming; `None` if take-off and reposition change the mode themselves.
    #[must_use]
    pub fn guided_mode(self) -> Option<u32> {
        (self == Self::ArduPilot).then_some(arducopter::GUIDED)
    }

    /// What its mode number `mode` means.
    #[must_use]
    pub fn meaning(self, mode: u32) -> ModeMeaning {
        match self {
            Self::ArduPilot => match mode {
                arducopter::GUIDED => ModeMeaning::FollowsOrders,
                arducopter::RTL | arducopter::LAND | arducopter::SMART_RTL => ModeMeaning::Returns,
                _ => ModeMeaning::IsFlownByOthers,
            },
            Self::Px4 => match [mode >> 16 & 0xFF, mode >> 24] {
                [px4::AUTO, px4::TAKE_OFF | px4::LOITER] => ModeMeaning::FollowsOrders,
                [px4::AUTO, px4::RTL | px4::LAND] => ModeMeaning::Returns,
                _ => ModeMeaning::IsFlownByOthers,
            },
            Self::Other => ModeMeaning::Unknown,
        }
    }

    /// Whether a reposition has to be allowed to change the mode. PX4 refuses it otherwise; ArduPilot would be taken
    /// out of the hands of a pilot whose change of mode has not arrived here yet.
    #[must_use]
    pub fn needs_mode_change(self) -> bool {
        self != Self::ArduPilot
    }

    /// The altitude `z_m` above home [m] as the autopilot expects it. PX4 reads it above sea, whatever frame is named.
    #[must_use]
    pub fn altitude(self, z_m: f64, home_above_sea_m: f64) -> Altitude {
        match self {
            Self::Px4 => Altitude::AboveSea(home_above_sea_m + z_m),
            Self::ArduPilot | Self::Other => Altitude::AboveHome(z_m),
        }
    }

    /// The parameter that makes it return when the bridge is silent, unless it is 0.
    #[must_use]
    pub fn dead_man_switch(self) -> Option<&'static str> {
        match self {
            Self::ArduPilot => Some("FS_GCS_ENABLE"),
            Self::Px4 => Some("NAV_DLL_ACT"),
            Self::Other => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mode_numbers_are_decoded_per_autopilot() {
        let arducopter = [0, 4, 6, 9, 5].map(|mode| AutopilotKind::ArduPilot.meaning(mode));
        use ModeMeaning::{FollowsOrders, IsFlownByOthers, Returns, Unknown};
        assert_eq!(arducopter, [IsFlownByOthers, FollowsOrders, Returns, Returns, IsFlownByOthers]);
        let px4 = [0x0302_0000, 0x0304_0000, 0x0204_0000, 0x0504_0000, 0x0404_0000, 0x0001_0000];
        let px4 = px4.map(|mode| AutopilotKind::Px4.meaning(mode));
        assert_eq!(px4, [IsFlownByOthers, FollowsOrders, FollowsOrders, Returns, IsFlownByOthers, IsFlownByOthers]);
        assert_eq!(AutopilotKind::Other.meaning(4), Unknown);
    }
}
