//! The autopilots that are imitated, and their modes.

use clap::ValueEnum;

/// The autopilot that is imitated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum Imitated {
    /// ArduCopter.
    #[default]
    Arducopter,
    /// PX4.
    Px4,
}

/// Flight modes, by ArduCopter's numbers but [`TakeOff`](Self::TakeOff).
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[repr(u32)]
pub enum CopterMode {
    /// Flown by a pilot.
    Stabilize = 0,
    /// Follows orders: GUIDED, or Hold of PX4.
    Guided = 4,
    /// Flown by a pilot who lets it hover: LOITER, or Position of PX4.
    Loiter = 5,
    /// Returns and lands.
    Return = 6,
    /// Lands where it is.
    Land = 9,
    /// Takes off, and then follows orders: PX4 alone.
    TakeOff = 100,
}

impl CopterMode {
    /// Its number, as `autopilot` says it.
    pub fn number(self, autopilot: Imitated) -> u32 {
        match (autopilot, self) {
            (Imitated::Arducopter, mode) => mode as u32,
            (Imitated::Px4, Self::Stabilize) => 7 << 16,
            (Imitated::Px4, Self::Loiter) => 3 << 16,
            (Imitated::Px4, Self::TakeOff) => 4 << 16 | 2 << 24,
            (Imitated::Px4, Self::Guided) => 4 << 16 | 3 << 24,
            (Imitated::Px4, Self::Return) => 4 << 16 | 5 << 24,
            (Imitated::Px4, Self::Land) => 4 << 16 | 6 << 24,
        }
    }

    /// The mode of this number of `autopilot`; `None` if there is none that is imitated.
    pub fn of(autopilot: Imitated, number: u32) -> Option<Self> {
        let mut modes = Self::value_variants().iter().copied().filter(|mode| mode.is_of(autopilot));
        modes.find(|mode| mode.number(autopilot) == number)
    }

    /// Whether `autopilot` has it.
    pub fn is_of(self, autopilot: Imitated) -> bool {
        autopilot == Imitated::Px4 || self != Self::TakeOff
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_is_known_by_its_number() {
        for autopilot in [Imitated::Arducopter, Imitated::Px4] {
            for &mode in CopterMode::value_variants() {
                let expected = mode.is_of(autopilot).then_some(mode);
                assert_eq!(CopterMode::of(autopilot, mode.number(autopilot)), expected, "{autopilot:?}");
            }
        }
        assert_eq!(CopterMode::of(Imitated::Px4, 4), None);
    }
}
