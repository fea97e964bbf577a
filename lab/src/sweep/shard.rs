//! Shards: parts of a sweep that are simulated apart.

use std::fmt::{self, Display, Formatter};

use serde::{Deserialize, Serialize};

/// Shard k of n of a sweep, k from 1 to n.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "(usize, usize)", into = "(usize, usize)")]
pub struct Shard {
    k: usize,
    n: usize,
}

impl Shard {
    /// The whole sweep.
    pub const WHOLE: Self = Self { k: 1, n: 1 };

    /// Shard `k` of `n`; `None` unless k is 1 to n.
    #[must_use]
    pub fn new(k: usize, n: usize) -> Option<Self> {
        (1..=n).contains(&k).then_some(Self { k, n })
    }
}

impl TryFrom<(usize, usize)> for Shard {
    type Error = &'static str;

    fn try_from((k, n): (usize, usize)) -> Result<Self, Self::Error> {
        Self::new(k, n).ok_or("shard: expected [k, n] with k from 1 to n")
    }
}

impl From<Shard> for (usize, usize) {
    fn from(Shard { k, n }: Shard) -> Self {
        (k, n)
    }
}

impl Display for Shard {
    fn fmt(&self, formatter: &mut Formatter) -> fmt::Result {
        write!(formatter, "{} of {}", self.k, self.n)
    }
}
