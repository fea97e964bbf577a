//! The metrics of a mission: the figures that are columns of a sweep's results.

use skysink_common::figure::{FigureKind, Support};
use strum::{EnumCount, VariantArray};

use crate::figures::SlotCounts;
use crate::sums::MissionSums;

pub use crate::figures::Metric;

/// The values of all metrics, in the order of [`Metric`]; NaN for those that a mission does not have.
pub type MetricValues = [f64; Metric::COUNT];

impl Metric {
    /// All metrics.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::VARIANTS.iter().copied()
    }

    /// The values of all metrics of a mission.
    ///
    /// # Panics
    /// Never: each metric is a column.
    #[must_use]
    pub fn values(sums: &MissionSums<'_>, counts: &SlotCounts) -> MetricValues {
        Self::ALL.map(|metric| metric.figure().of_column.expect("a column")(sums, counts))
    }

    /// The name of its column.
    pub fn name(self) -> &'static str {
        self.figure().name
    }

    /// Its unit; empty for a fraction or an index.
    pub fn unit(self) -> &'static str {
        self.figure().unit
    }

    /// A description with its unit.
    pub fn label(self) -> String {
        self.figure().label_with_unit()
    }

    /// Whether it is a whole number.
    pub fn is_count(self) -> bool {
        self.figure().kind == FigureKind::Count
    }

    /// Whether it is a wall-clock time, which is not reproducible.
    pub fn is_timing(self) -> bool {
        self.figure().kind == FigureKind::WallClock
    }

    /// The range of its values that its confidence interval respects.
    pub fn support(self) -> Support {
        self.figure().support
    }
}
