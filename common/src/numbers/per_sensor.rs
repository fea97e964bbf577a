//! A property of the sensor nodes (SNs) of a field, stored once where all are alike.

/// A property of the SNs of a field.
#[derive(Debug, Clone, PartialEq)]
pub enum PerSensor<T> {
    /// The same for all SNs.
    Equal(T),
    /// By id.
    Each(Vec<T>),
}

impl<T: Copy + PartialEq> PerSensor<T> {
    /// The property of SNs with these `values`, by id.
    #[must_use]
    pub fn new(values: Vec<T>) -> Self {
        match values[..] {
            [first, ..] if values.iter().all(|&value| value == first) => Self::Equal(first),
            _ => Self::Each(values),
        }
    }

    /// Replaces the value of SN `sensor`, one of `count`.
    pub(crate) fn set(&mut self, sensor: usize, count: usize, value: T) {
        if let Self::Equal(all) = *self {
            *self = Self::Each(vec![all; count]);
        }
        if let Self::Each(values) = self {
            values[sensor] = value;
        }
    }

    /// The value of SN `sensor`.
    ///
    /// # Panics
    /// If the values differ, and the SN is unknown.
    #[inline]
    pub fn of(&self, sensor: usize) -> T {
        match self {
            Self::Equal(value) => *value,
            Self::Each(values) => values[sensor],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_are_recognised() {
        assert_eq!(PerSensor::new(vec![2.5; 3]), PerSensor::Equal(2.5));
        assert_eq!(PerSensor::new(vec![2.5, 2.5, 2.0]), PerSensor::Each(vec![2.5, 2.5, 2.0]));
    }
}
