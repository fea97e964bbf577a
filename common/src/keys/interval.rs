//! Values that may differ between sensor nodes.

use serde::{Deserialize, Serialize};

/// One number for all sensor nodes, or a range from which each draws its own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number or [lowest, highest]")]
pub enum Interval {
    /// One number for all.
    One(f64),
    /// The lowest and the highest; drawn uniformly, levels uniformly in dB.
    Range([f64; 2]),
}

/// One whole number for all sensor nodes, or a range from which each draws its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a whole number or [lowest, highest]")]
pub enum WholeInterval {
    /// One number for all.
    One(u32),
    /// The lowest and the highest; each whole number between them, the ends included, is as likely.
    Range([u32; 2]),
}

impl WholeInterval {
    /// The lowest and the highest value.
    #[must_use]
    pub fn ends(self) -> [u32; 2] {
        match self {
            Self::One(value) => [value; 2],
            Self::Range(ends) => ends,
        }
    }
}

impl Interval {
    /// The lowest and the highest value.
    #[must_use]
    pub fn ends(self) -> [f64; 2] {
        match self {
            Self::One(value) => [value; 2],
            Self::Range(ends) => ends,
        }
    }

    /// The mean of the interval.
    #[must_use]
    pub fn mean(self) -> f64 {
        let [lowest, highest] = self.ends();
        lowest + (highest - lowest) / 2.0
    }
}
