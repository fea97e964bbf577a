//! What a planner carries from one slot to the next, as bytes, so that a restarted one goes on as if nothing had happened.
//!
//! Little-endian: version `u8`, strategy `u8`, what is believed of the queues `u8`, the slot planned last `u64`, then the
//! beliefs, if there are any, and what the strategy adds. Where the bytes are kept is left to whoever runs the planner.

use crate::estimate::Estimate;
use crate::settings::Strategy;

/// The layout's version.
const VERSION: u8 = 2;

/// Why a memory is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MemoryError {
    /// It ends early, goes on too long, or names what the field does not have.
    #[error("planner memory of {bytes} bytes: expected the memory of a {strategy} planner over the same field")]
    Malformed {
        /// Its length.
        bytes: usize,
        /// The strategy of the planner that was to recall it.
        strategy: &'static str,
    },
    /// It is of another slot.
    #[error("planner memory of slot {found}: expected slot {expected}")]
    OtherSlot {
        /// Its slot.
        found: u64,
        /// The slot asked for.
        expected: u64,
    },
}

/// Starts the memory of `strategy`, with what it believes of the queues, after it has planned `slot`.
pub(crate) fn begin(bytes: &mut Vec<u8>, strategy: Strategy, slot: u64, estimate: Option<&Estimate>) {
    bytes.clear();
    bytes.extend([VERSION, code(strategy), belief_code(estimate)]);
    bytes.extend(slot.to_le_bytes());
    if let Some(estimate) = estimate {
        estimate.remember(bytes);
    }
}

/// The number in memories of what is believed; never change or reuse one.
fn belief_code(estimate: Option<&Estimate>) -> u8 {
    match estimate.map(Estimate::learns) {
        None => 0,
        Some(false) => 1,
        Some(true) => 2,
    }
}

/// The number of a strategy in memories; never change or reuse one.
fn code(strategy: Strategy) -> u8 {
    match strategy {
        Strategy::Rfs => 0,
        Strategy::Gfs => 1,
        Strategy::Uts => 2,
        Strategy::UtsWide => 3,
        Strategy::Exact => 4,
        Strategy::Tour => 5,
        Strategy::RoundRobin => 6,
        Strategy::MaxAgeFirst => 7,
        Strategy::Horizon => 8,
        Strategy::Offline => 9,
    }
}

/// Reads a memory from its front.
pub(crate) struct Reader<'a> {
    whole: &'a [u8],
    rest: &'a [u8],
    strategy: Strategy,
    slot: u64,
    beliefs: u8,
}

impl<'a> Reader<'a> {
    /// Reads past the beginning of the memory of `strategy` after `slot`, up to what is believed.
    pub fn new(bytes: &'a [u8], strategy: Strategy, slot: u64) -> Result<Self, MemoryError> {
        let mut reader = Self { whole: bytes, rest: bytes, strategy, slot, beliefs: 0 };
        let [version, strategy_code, beliefs] = reader.take()?;
        if [version, strategy_code] != [VERSION, code(strategy)] {
            return Err(reader.malformed());
        }
        reader.beliefs = beliefs;
        let found = u64::from_le_bytes(reader.take()?);
        if found == slot { Ok(reader) } else { Err(MemoryError::OtherSlot { found, expected: slot }) }
    }

    /// What it says that a planner believes; `estimate` is what that one believed before.
    pub fn estimate(&mut self, estimate: Option<&Estimate>) -> Result<Option<Estimate>, MemoryError> {
        if self.beliefs != belief_code(estimate) {
            return Err(self.malformed());
        }
        estimate.map(|estimate| estimate.recalled(self.slot, self)).transpose()
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], MemoryError> {
        let (taken, rest) = self.rest.split_first_chunk::<N>().ok_or_else(|| self.malformed())?;
        self.rest = rest;
        Ok(*taken)
    }

    /// A number of at most `most`.
    pub fn number(&mut self, most: u32) -> Result<u32, MemoryError> {
        let number = u32::from_le_bytes(self.take()?);
        if number <= most { Ok(number) } else { Err(self.malformed()) }
    }

    /// A number of at most `most`, which may be large.
    pub fn long(&mut self, most: u64) -> Result<u64, MemoryError> {
        let number = u64::from_le_bytes(self.take()?);
        if number <= most { Ok(number) } else { Err(self.malformed()) }
    }

    /// A number from 0 to `most`, with a fraction.
    pub fn real(&mut self, most: f64) -> Result<f64, MemoryError> {
        let number = f64::from_le_bytes(self.take()?);
        if (0.0..=most).contains(&number) { Ok(number) } else { Err(self.malformed()) }
    }

    /// A coordinate [m].
    pub fn coordinate(&mut self) -> Result<f64, MemoryError> {
        let coordinate = f64::from_le_bytes(self.take()?);
        if coordinate.is_finite() { Ok(coordinate) } else { Err(self.malformed()) }
    }

    /// A number from 0 to 1.
    pub fn share(&mut self) -> Result<f64, MemoryError> {
        self.real(1.0)
    }

    /// Nothing is left.
    pub fn end(&self) -> Result<(), MemoryError> {
        if self.rest.is_empty() { Ok(()) } else { Err(self.malformed()) }
    }

    /// All numbers that are left, each at most `most`.
    pub fn numbers(&mut self, most: u32) -> Result<Vec<u32>, MemoryError> {
        let mut numbers = Vec::with_capacity(self.rest.len() / 4);
        while !self.rest.is_empty() {
            numbers.push(self.number(most)?);
        }
        Ok(numbers)
    }

    /// What to say of a memory that is not one.
    pub fn malformed(&self) -> MemoryError {
        MemoryError::Malformed { bytes: self.whole.len(), strategy: self.strategy.name() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_memory_of_another_slot_strategy_or_version_is_refused() {
        let mut bytes = Vec::new();
        begin(&mut bytes, Strategy::Tour, 7, None);
        assert!(Reader::new(&bytes, Strategy::Tour, 7).is_ok());
        let error = Reader::new(&bytes, Strategy::Tour, 8).err().unwrap();
        assert_eq!(error.to_string(), "planner memory of slot 7: expected slot 8");
        let error = Reader::new(&bytes, Strategy::Horizon, 7).err().unwrap();
        let expected = "planner memory of 11 bytes: expected the memory of a horizon planner over the same field";
        assert_eq!(error.to_string(), expected);
        bytes[0] = 1;
        assert!(Reader::new(&bytes, Strategy::Tour, 7).is_err());
        assert!(Reader::new(&[], Strategy::Tour, 7).is_err());
    }

    #[test]
    fn numbers_out_of_their_range_and_half_numbers_are_refused() {
        let mut bytes = Vec::new();
        begin(&mut bytes, Strategy::Tour, 7, None);
        bytes.extend(5u32.to_le_bytes());
        assert_eq!(Reader::new(&bytes, Strategy::Tour, 7).unwrap().number(5), Ok(5));
        assert!(Reader::new(&bytes, Strategy::Tour, 7).unwrap().number(4).is_err());
        bytes.push(0);
        assert!(Reader::new(&bytes, Strategy::Tour, 7).unwrap().numbers(9).is_err());
    }
}
