//! What became of the changes of a plan that a search proposed.

use serde::{Deserialize, Serialize};

/// What became of the proposals of an operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct OperatorCounts {
    /// How often it was drawn.
    pub proposed: u64,
    /// How often it found no change.
    pub void: u64,
    /// How many of its changes were accepted.
    pub accepted: u64,
    /// How many of these lowered the cost.
    pub improved: u64,
}

impl OperatorCounts {
    /// Adds those of another search.
    ///
    /// ```
    /// use skysink_planner::operator_counts::OperatorCounts;
    /// let mut counts = OperatorCounts { proposed: 7, void: 1, accepted: 3, improved: 2 };
    /// counts.add(&OperatorCounts { proposed: 3, ..OperatorCounts::default() });
    /// assert_eq!((counts.proposed, counts.improved), (10, 2));
    /// ```
    pub fn add(&mut self, other: &Self) {
        self.proposed += other.proposed;
        self.void += other.void;
        self.accepted += other.accepted;
        self.improved += other.improved;
    }
}
