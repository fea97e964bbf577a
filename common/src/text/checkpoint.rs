//! Checkpoints: the state that a process saves after a slot, from which its successor resumes.
//!
//! Storing the bytes is left to the caller.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// A state that outlives its process.
///
/// A type without state needs neither method: it saves no bytes.
pub trait Checkpoint {
    /// Appends the state to `bytes`.
    fn save(&self, _bytes: &mut Vec<u8>) {}

    /// Resumes from exactly the bytes that [`Checkpoint::save`] of an equally constructed value appended.
    ///
    /// # Errors
    /// If the bytes are not a possible state of this value, which is then unchanged.
    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        decode::<()>(bytes)
    }
}

/// A refused checkpoint, with what was expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("checkpoint: expected {0}")]
pub struct CheckpointError(&'static str);

impl CheckpointError {
    /// Refuses a state that is not as `expected`.
    ///
    /// # Errors
    /// If `is_expected` is false.
    pub fn ensure(is_expected: bool, expected: &'static str) -> Result<(), Self> {
        if is_expected { Ok(()) } else { Err(Self(expected)) }
    }
}

/// Appends `value` to `bytes` in the compact format of checkpoints.
///
/// # Panics
/// If `value` serializes a sequence of unknown length, which no derived implementation does.
pub fn encode(value: &impl Serialize, bytes: &mut Vec<u8>) {
    postcard::to_io(value, bytes).expect("writing to a vector cannot fail, and all lengths are known");
}

/// Decodes a value from all of `bytes`.
///
/// # Errors
/// If the bytes are malformed, or some are left over.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CheckpointError> {
    let (value, left) = decode_first(bytes)?;
    CheckpointError::ensure(left.is_empty(), "no bytes after the state")?;
    Ok(value)
}

/// Decodes a value from the beginning of `bytes`, and returns it with the remaining bytes.
///
/// # Errors
/// If the bytes are malformed.
pub fn decode_first<T: DeserializeOwned>(bytes: &[u8]) -> Result<(T, &[u8]), CheckpointError> {
    postcard::take_from_bytes(bytes).map_err(|_| CheckpointError("what this version of the program saved"))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Counter(Vec<u64>);

    impl Checkpoint for Counter {
        fn save(&self, bytes: &mut Vec<u8>) {
            encode(&self.0, bytes);
        }

        fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
            let counts: Vec<u64> = decode(bytes)?;
            CheckpointError::ensure(counts.len() == self.0.len(), "as many counts")?;
            self.0 = counts;
            Ok(())
        }
    }

    struct Stateless;

    impl Checkpoint for Stateless {}

    fn saved(state: &dyn Checkpoint) -> Vec<u8> {
        let mut bytes = Vec::new();
        state.save(&mut bytes);
        bytes
    }

    #[test]
    fn a_restored_state_is_the_saved_one() {
        let mut counter = Counter(vec![0; 3]);
        counter.restore(&saved(&Counter(vec![1, 300, u64::MAX]))).unwrap();
        assert_eq!(counter.0, [1, 300, u64::MAX]);
    }

    #[test]
    fn a_truncated_or_overlong_state_is_refused_and_changes_nothing() {
        let bytes = saved(&Counter(vec![1, 300]));
        let mut counter = Counter(vec![5, 6]);
        for length in 0..bytes.len() {
            assert!(counter.restore(&bytes[..length]).is_err(), "cut after {length}");
        }
        let error = counter.restore(&[&bytes[..], &[0, 0]].concat()).unwrap_err();
        assert_eq!(error.to_string(), "checkpoint: expected no bytes after the state");
        assert_eq!(counter.0, [5, 6]);
    }

    #[test]
    fn a_state_of_another_shape_is_refused() {
        let error = Counter(vec![0]).restore(&saved(&Counter(vec![1, 2]))).unwrap_err();
        assert_eq!(error.to_string(), "checkpoint: expected as many counts");
    }

    #[test]
    fn a_length_beyond_the_bytes_is_refused_without_allocating_it() {
        assert!(Counter(vec![0]).restore(&[0xff, 0xff, 0xff, 0xff, 0xff, 0x7f]).is_err());
    }

    #[test]
    fn a_stateless_type_saves_no_bytes_and_refuses_any() {
        assert!(saved(&Stateless).is_empty() && Stateless.restore(&[]).is_ok());
        assert!(Stateless.restore(&[0]).is_err());
    }

    /// The format is part of a run folder: numbers below 128 take a byte, f64 eight.
    #[test]
    fn the_checkpoint_encoding_is_stable() {
        let mut bytes = vec![9];
        encode(&(5u32, 300u64, Some(1.0f64), "tour"), &mut bytes);
        assert_eq!(bytes, [9, 5, 0xac, 0x02, 1, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f, 4, b't', b'o', b'u', b'r']);
    }
}
