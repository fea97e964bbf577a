//! A visit of a plan, with the gap that it ends, and the visits of a sensor.

use std::ops::Range;

use crate::plan::decoder::Visit;

/// A visit of the plan, and the gap that it ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Served<L> {
    pub(super) visit: Visit,
    /// The buffer when the gap begins, and after the visit.
    pub(super) before: L,
    pub(super) after: L,
    /// What the gap costs.
    pub(super) cost: f64,
    /// Visits of the sensor before it.
    pub(super) nth: u32,
    /// What the gap costs more for each slot that the visit is later, within [`NEAR`](super::NEAR); `None` if that is
    /// not linear.
    pub(super) slope: Option<f64>,
    /// That slope less the one of the next gap of the sensor; 0 for one that is not linear. Summed over all visits from
    /// one on it is the slope of each sensor's first gap less that of its last.
    pub(super) slope_difference: f64,
    /// Whether it is not, here or at the end.
    pub(super) is_bent: bool,
}

/// A sensor: its visits, and how far a change has come.
#[derive(Debug, Clone)]
pub(super) struct Timeline<L> {
    pub(super) begun: L,
    /// Indices of its visits in the plan.
    pub(super) visits: Vec<u32>,
    /// The last change that touches it, its buffer in the changed plan, and its visits in the plan before the next one.
    pub(super) change: u64,
    pub(super) reached: L,
    pub(super) nth: usize,
    /// What it costs after its last visit, and more for each slot that the window is longer, if that is linear.
    pub(super) end: f64,
    pub(super) end_slope: Option<f64>,
}

impl<L: Copy + PartialEq> Served<L> {
    /// The visit after `nth` others of its sensor, which leave the buffer `level`; what it costs is not known yet.
    #[inline]
    pub(super) fn new(visit: Visit, level: L, nth: usize) -> Self {
        Self {
            visit,
            before: level,
            after: level,
            cost: 0.0,
            nth: nth as u32,
            slope: None,
            slope_difference: 0.0,
            is_bent: false,
        }
    }

    /// Puts a new visit, or one of the plan `shift` slots later, after the buffer `before`. Returns whether it costs as
    /// before, so many slots later; if not, the buffer after it is still `before`.
    #[inline]
    pub(super) fn renew(&mut self, before: L, shift: Option<i32>, later: impl Fn(L, f64) -> L) -> bool {
        let slots = shift.unwrap_or(0);
        self.visit.slot += slots;
        let is_same =
            shift.is_some() && (slots == 0 || self.slope.is_some()) && before == later(self.before, f64::from(slots));
        self.after = if is_same { later(self.after, f64::from(slots)) } else { before };
        self.before = before;
        is_same
    }

    /// Puts the visit, the one at `index`, before a gap of its sensor with the slope `next`, which may be its last, and
    /// extends `changed` by it if its slope differs.
    #[inline]
    pub(super) fn precede(&mut self, next: Option<f64>, is_last: bool, index: usize, changed: &mut Range<usize>) {
        let slope_difference = self.slope.unwrap_or(0.0) - next.unwrap_or(0.0);
        let is_bent = self.slope.is_none() || is_last && next.is_none();
        if slope_difference != self.slope_difference || is_bent != self.is_bent {
            self.slope_difference = slope_difference;
            self.is_bent = is_bent;
            *changed = changed.start.min(index)..changed.end.max(index + 1);
        }
    }
}

impl<L: Copy> Timeline<L> {
    /// The buffer before visit `visit` of the plan, and the number of visits of the sensor before it.
    #[inline]
    pub(super) fn at(&self, plan: &[Served<L>], visit: usize) -> (L, usize) {
        let nth = self.visits.partition_point(|own| (*own as usize) < visit);
        (self.last(nth).map_or(self.begun, |last| plan[last].after), nth)
    }

    /// Index of the last of its first `nth` visits.
    #[inline]
    pub(super) fn last(&self, nth: usize) -> Option<usize> {
        nth.checked_sub(1).map(|last| self.visits[last] as usize)
    }
}
